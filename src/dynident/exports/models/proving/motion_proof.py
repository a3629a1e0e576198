"""An exported model follows the motion of a log in simulation, under computed torque and PD.

Two plants: the simulator of this package with all friction of the model, by the Runge-Kutta rule, and where it is
installed MuJoCo with the MJCF of the model, by its own integrator at 1 and 2 ms. The controllers are those of the
virtual cell, their torques without limits; in MuJoCo they act once a step. Computed torque has a bandwidth of 8 Hz. The
gains of PD are those of the virtual cell, with 1 / (M^-1)_ii, the inertia of a joint while the others are free, in
place of M_ii. Beside it stands the condition number of the mass matrix along the motion.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.errors import BadOption, DynidentError, NotConsistent, SolverFailed
from dynident.exports.models.mjcf import Mjcf
from dynident.exports.models.proving.engines import mujoco_version, without_log
from dynident.exports.models.proving.followed_motion import MOST_STEPS, FollowedMotion, MotionProof
from dynident.exports.models.proving.logged_motion import LoggedMotion, logged_motion
from dynident.exports.models.subject.drives import Drives, drives_of
from dynident.exports.models.subject.identified import Identified, identified
from dynident.exports.models.subject.states import states_of
from dynident.identification.estimate.estimate import Estimate
from dynident.model.friction import Motion
from dynident.model.kernels import batched
from dynident.model.kernels.generic import WORK, pack
from dynident.simulation.cell import Cell
from dynident.simulation.cell_plant import armature, cell_plant
from dynident.simulation.cell_simulation import LOOKS, NEAR, STILL, simulate_cell
from dynident.simulation.controllers import Controller, Loop
from dynident.simulation.controllers.base import USUAL_HZ, following
from dynident.simulation.controllers.computed_torque import ComputedTorque
from dynident.simulation.controllers.pd import Pd

#: Steps of MuJoCo in s.
STEPS = (0.001, 0.002)

#: Ticks of the controllers of the own simulator, a second.
RATE = 1000.0

#: A joint whose motion spans less, in rad or m, is judged by this span.
LEAST_SPAN = 0.1

#: Position error in rad or m beyond which nothing more is simulated.
LOST = 1e3

#: Speed over which the sign of Coulomb friction fed forward turns, in rad/s or m/s.
WIDTH = 0.02


def prove_motion(subject: Identified | Estimate, log: Log) -> MotionProof:
    """Simulate a model that follows the motion of a log, up to 10 s.

    Args:
        subject: The model, or an estimate, which is made ready as for an export.
        log: A log with positions of the robot's joints.

    Raises:
        LogMismatch: A log of another robot, or one without a motion that can be followed.
        NotConsistent: No physically consistent robot has the base parameters of the estimate.
    """
    subject = identified(subject) if isinstance(subject, Estimate) else subject
    motion = logged_motion(log.ordered(subject.model.robot.joint_names), subject.estimate.preprocessing.longest_gap_s)
    followed = _Followed(subject, motion, drives_of(subject))
    runs = (*_own_runs(followed), *_mujoco_runs(followed))
    looked = motion.evaluate(np.linspace(0.0, motion.duration, LOOKS))[0]
    nominal = subject.model.robot.nominal
    conditions = [
        None if bodies is None else _condition(subject, bodies, looked)
        for bodies in (subject.theta[: subject.model.inertial_count], nominal)
    ]
    assert conditions[0] is not None
    touching = _touching(followed)
    return MotionProof(motion.log, motion.start, motion.duration, runs, conditions[0], conditions[1], touching)


def _condition(subject: Identified, bodies: Array, q: Array) -> tuple[float, float]:
    """Return median and largest condition number of the mass matrix with rotors at positions (N, n)."""
    masses = batched.mass_matrix(subject.model.robot.chain, bodies, q) + armature(subject.model, subject.theta)
    found = np.linalg.cond(masses)
    return float(np.median(found)), float(np.max(found))


@dataclass(frozen=True)
class _Followed:
    """A model, the motion that it follows, and what the controllers are told of its drives.

    Attributes:
        subject: The model.
        motion: The motion.
        drives: As the MJCF holds them.
    """

    subject: Identified
    motion: LoggedMotion
    drives: Drives

    @property
    def bodies(self) -> Array:
        """Inertial parameters, shape (10 l,)."""
        return self.subject.theta[: self.subject.model.inertial_count]

    @property
    def rotors(self) -> Array:
        """Rotor inertia at the joints, shape (n, n), in kg m^2 or kg."""
        return armature(self.subject.model, self.subject.theta)

    def rigid(self, states: Array) -> Array:
        """Return the torque of the bodies at states (3, N, n), shape (N, n), in N m or N."""
        return batched.inverse_dynamics(self.subject.model.robot.chain, self.bodies, *states)

    def controllers(self, step: float) -> Iterator[tuple[str, Controller]]:
        """Yield the controllers by name, with their gains at a step in s."""
        yield "computed_torque", ComputedTorque(USUAL_HZ, rate=1.0 / step, feedforward="model")
        states = np.asarray(self.motion.evaluate(np.linspace(0.0, self.motion.duration, LOOKS)))
        masses = batched.mass_matrix(self.subject.model.robot.chain, self.bodies, states[0]) + self.rotors
        inertia = 1.0 / np.max(np.diagonal(np.linalg.inv(masses), axis1=1, axis2=2), axis=0)
        needed = self.rigid(states) + self.drives.torque(Motion(*states), armature=True, coupled=True)
        lacking = needed - self.rigid(np.stack([states[0], *np.zeros((2, *states[0].shape))]))
        size, span = np.sqrt(np.mean(lacking**2, axis=0)), np.std(states[0], axis=0)
        wanted = np.sqrt(np.divide(size, NEAR * span * inertia, out=np.zeros_like(size), where=span > STILL))
        coupling = self.drives.coupling
        friction = np.diagonal(coupling.T @ np.diag(self.drives.damping) @ coupling)
        stiffness, damping = following(Loop(inertia, masses, step, friction, wanted), 1.0)
        yield "pd", Pd(stiffness=tuple(stiffness), damping=tuple(damping), rate=1.0 / step, feedforward="gravity")

    def settings(self, control: Controller) -> Array:
        """Return the numbers of a controller's law; its gains are stated, so that nothing of the joints is needed."""
        ones = np.ones(self.subject.model.robot.dof)
        return np.array(control.settings(Loop(ones, np.diag(ones)[None], 1.0, ones, ones)), dtype=np.float64)

    def goals(self, states: Array, feed: str) -> Array:
        """Return what a law is told at states (3, N, n), shape (N, 5, n): q, dq, ddq, torque fed, torque of drives."""
        beside, springs = np.zeros_like(states[0]), self.drives.spring_torque(Motion(*states))
        fed = self.rigid(np.stack([states[0], beside, beside])) + springs
        if feed == "model":
            coupling = self.drives.coupling
            speed = states[1] @ coupling.T
            beside = (speed * self.drives.damping + np.tanh(speed / WIDTH) * self.drives.dry) @ coupling + springs
            fed = self.rigid(states) + states[2] @ self.rotors.T + beside
        return np.ascontiguousarray(np.stack([*states, fed, beside], axis=1))


def _own_runs(followed: _Followed) -> Iterator[FollowedMotion]:
    subject, motion = followed.subject, followed.motion
    for name, control in followed.controllers(1.0 / RATE):
        run = FollowedMotion("dynident", name, 1.0 / RATE)
        cell = Cell(control, saturation=False, lead_in=0.0)
        try:
            body = cell_plant(subject.model, subject.theta, cell)
            q, dq, _ = motion.evaluate(np.linspace(0.0, motion.duration, LOOKS))
            run = replace(run, duration=min(motion.duration, MOST_STEPS / body.fastest(body.masses(q), q, dq)))
            found = simulate_cell(subject.model, subject.theta, motion, cell, duration=run.duration)
        except (SolverFailed, NotConsistent) as error:
            yield replace(run, failure=error.evidence)
        except BadOption as error:  # friction that no integration takes
            yield replace(run, why_not=str(error))
        else:
            reference = np.asarray(found.log.q_ref)
            yield _judged(run, np.abs(found.truth.q - reference), reference, subject)


def _mujoco_runs(followed: _Followed) -> Iterator[FollowedMotion]:
    version = mujoco_version()
    for step in STEPS:
        for name, control in followed.controllers(step):
            run = FollowedMotion(version or "MuJoCo", name, step)
            if not version:
                yield replace(run, why_not="not installed")
                continue
            try:
                with without_log():
                    model, without = _mujoco_model(followed.subject, step)
                    run = replace(run, simulator=version + without)
                    errors, reference = _stepped(followed, control, step, model)
            except DynidentError:
                raise
            except Exception as error:  # an engine of others may raise anything
                reason = " ".join(str(error).split())[:200]
                yield replace(run, failure=f"MuJoCo does not run it ({reason})")
            else:
                run = replace(run, duration=followed.motion.duration)
                yield _judged(run, errors, reference, followed.subject)


def _judged(run: FollowedMotion, error: Array, reference: Array, subject: Identified) -> FollowedMotion:
    """Return a run with its errors (N, n), as far as they were simulated, judged by the spans of the motion."""
    span = np.maximum(np.ptp(reference, axis=0), LEAST_SPAN)
    lost = ~(error <= span)
    failure = ""
    if np.any(lost):
        row, joint = np.argwhere(lost)[0]
        name = subject.model.robot.joint_names[joint]
        failure = f"{name} is further from the motion than its span at {row * run.step:.3g} s"
        error = error[: row + 1]
    worst = np.max(np.nan_to_num(error, nan=np.inf), axis=0)
    return replace(run, error=tuple(worst.tolist()), share=float(np.max(worst / span)), failure=failure)


def _stepped(followed: _Followed, control: Controller, step: float, model: Any) -> tuple[Array, Array]:
    """Return position errors and positions of the motion by MuJoCo, each (N, n); NaN after a motion that is lost.

    The controller is told of bodies, rotors, viscous and Coulomb friction: what the MJCF holds.
    """
    import mujoco

    api: Any = mujoco
    robot = followed.subject.model.robot
    time = np.arange(int(followed.motion.duration / step) + 1) * step
    states = np.asarray(followed.motion.evaluate(time))
    goals, settings, law = followed.goals(states, control.feedforward), followed.settings(control), control.law()
    known = (*(np.array(one) for one in pack(robot.chain)), np.array(followed.bodies), followed.rotors)
    believed = (np.full(robot.dof, np.inf), step, known)
    work, tau = np.zeros((len(robot.links) + 1, WORK)), np.zeros(robot.dof)
    memory, seen = np.zeros((control.memory, robot.dof)), np.empty((2, robot.dof))
    places = [int(model.joint(joint.name).dofadr[0]) for joint in robot.active]
    state, errors = api.MjData(model), np.full((len(time), robot.dof), np.nan)
    _begin(followed.subject, model, state, states[:, 0])
    for k in range(len(time)):
        seen[0], seen[1] = state.qpos[places], state.qvel[places]
        errors[k] = np.abs(seen[0] - states[0, k])
        if not np.all(errors[k] < LOST) or not np.all(np.isfinite(seen[1])):
            break
        law(settings, goals[k], seen, believed, memory, work, tau)
        memory[0] += 1.0
        state.qfrc_applied[places] = tau
        api.mj_step(model, state)
    return errors, states[0]


def _mujoco_model(subject: Identified, step: float) -> tuple[Any, str]:
    """Return the MJCF of a model as MuJoCo loads it, and in words what it is without.

    A user's own MJCF whose meshes are missing is not loaded as it stands either: a new one of the same model, which
    names no mesh, takes its place.
    """
    import mujoco

    api: Any = mujoco
    try:
        model, without = _loaded(api, subject), ""
    except Exception:  # an engine of others may raise anything
        source = subject.source
        if source is None or source.kind != "mjcf" or _loads(api, source.path):
            raise
        model, without = _loaded(api, replace(subject, source=None)), " without meshes"
    model.opt.timestep = step
    model.opt.disableflags |= int(api.mjtDisableBit.mjDSBL_AUTORESET)  # a lost motion stays lost
    return model, without


def _touching(followed: _Followed) -> tuple[tuple[str, str], ...]:
    """Return the pairs of bodies of the MJCF that touch along the motion; none where MuJoCo does not run it."""
    if not mujoco_version():
        return ()
    import mujoco

    api: Any = mujoco
    try:
        with without_log():
            model, _ = _mujoco_model(followed.subject, STEPS[0])
    except DynidentError:
        raise
    except Exception:  # an engine of others may raise anything; its runs say so
        return ()
    found, state = dict[tuple[str, str], None](), api.MjData(model)
    states = np.asarray(followed.motion.evaluate(np.linspace(0.0, followed.motion.duration, LOOKS)))
    for k in range(LOOKS):
        _begin(followed.subject, model, state, states[:, k])
        api.mj_forward(model, state)
        bodies = [model.geom_bodyid[one.geom] for one in state.contact[: state.ncon] if one.dist < 0.0]
        found |= dict.fromkeys((model.body(one).name, model.body(two).name) for one, two in bodies)
    return tuple(found)


def _loaded(api: Any, subject: Identified) -> Any:
    with tempfile.TemporaryDirectory(prefix="dynident-") as folder:
        path = Path(folder) / "model.xml"
        path.write_bytes(Mjcf(motors=False).content(subject, path).files[path])
        return api.MjModel.from_xml_path(str(path))


def _loads(api: Any, path: Path) -> bool:
    """Return whether MuJoCo loads a user's own file."""
    try:
        api.MjModel.from_xml_path(str(path))
    except Exception:
        return False
    return True


def _begin(subject: Identified, model: Any, state: Any, first: Array) -> None:
    """Put all joints of a MuJoCo model, followers too, on a state (3, n) of the motion."""
    follows = states_of(subject.model).follows
    for k in range(model.njnt):
        column, multiplier, offset = follows[model.joint(k).name]
        state.qpos[k], state.qvel[k] = multiplier * first[0, column] + offset, multiplier * first[1, column]
