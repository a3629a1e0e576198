"""What a virtual cell logs of what was true: sensors, clocks and lost rows, applied to the samples of the loop.

The commanded motion is a trajectory with a run-in from rest before time 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.data.log import Log, Source
from dynident.errors import BadOption, UnknownChoice
from dynident.excitation.trajectories.base import Trajectory
from dynident.excitation.trajectories.quintic import Quintic
from dynident.simulation.cell import Cell
from dynident.simulation.cell_plant import CellPlant
from dynident.simulation.effects import each
from dynident.simulation.plant import Clock


def streams(seed: int) -> dict[str, np.random.Generator]:
    """Return the source of random numbers of each effect; none changes what another draws."""
    names = ("position", "velocity", "effort", "jitter", "dropped")
    seeds = np.random.SeedSequence(seed).spawn(len(names))
    return {name: np.random.default_rng(one) for name, one in zip(names, seeds, strict=True)}


@dataclass(frozen=True)
class Samples:
    """What the compiled loop kept, sample by sample of the log.

    Attributes:
        q: Joint positions, shape (N, n).
        dq: Velocities, shape (N, n).
        ddq: Accelerations, shape (N, n).
        torque: Of the drives at the joints, shape (N, n).
        friction: At the joints, shape (N, n).
        spring: Torque of the springs at the joints, shape (N, n).
        drive_q: Positions of the drives carried to the joints, shape (N, n).
        drive_dq: Velocities of them, shape (N, n).
        jump: By how much ``torque`` jumps there, shape (N, n); it has the value after it.
    """

    q: Array
    dq: Array
    ddq: Array
    torque: Array
    friction: Array
    spring: Array
    drive_q: Array
    drive_dq: Array
    jump: Array

    def at(self, row: Array, step: float) -> Samples:
        """Return the samples at broken rows (M,): positions by cubics through their velocities, the rest by lines."""
        first = np.clip(row.astype(np.int64), 0, len(self.q) - 2)
        share = (row - first)[:, None]
        lines = {
            name: values[first] + share * (values[first + 1] - values[first])
            for name, values in vars(self).items()
            if name not in ("q", "drive_q")
        }
        cubics = {
            name: _cubic(getattr(self, name), getattr(self, speed), first, share, step)
            for name, speed in (("q", "dq"), ("drive_q", "drive_dq"))
        }
        return Samples(**cubics, **lines)


@dataclass(frozen=True)
class LoopRun:
    """A finished run of the loop and what it was run with.

    Attributes:
        samples: What the loop kept.
        body: The plant.
        cell: The cell.
        ticks: Its clock.
        motion: The commanded motion.
        noise: Noise of measured q and dq at the rows, shape (N, 2, n).
        source: Provenance of the log.
        seed: Of what is drawn.
    """

    samples: Samples
    body: CellPlant
    cell: Cell
    ticks: Clock
    motion: CommandedCourse
    noise: Array
    source: Source
    seed: int

    def log(self, gains: Mapping[str, float] | None) -> tuple[Log, Log, Array, Array]:
        """Return log, truth, friction and torque behind the gears, as a run of the cell has them.

        Args:
            gains: Drive gains by joint in N m/A; None for torques.

        Raises:
            BadOption: Drive gains that are missing or 0.
            UnknownChoice: A gain of a joint that is not there.
        """
        draw, told, body = streams(self.seed), self.ticks.row_times, self.body
        recorder, step = self.cell.recorder, self.ticks.per_row / self.ticks.rate
        true, found = told, self.samples
        if recorder.jitter_s:
            jitter = draw["jitter"].normal(size=len(told)) * recorder.jitter_s
            true = np.clip(told + np.clip(jitter, -0.49 * step, 0.49 * step), 0.0, told[-1])
            found = self.samples.at(true / step, step)
        late = self.cell.effort.delay_s
        felt = self._torque_at((true - late) / step) if late else _felt(found, body, self.cell)
        temperature = body.start + body.heat[0] * (1.0 - np.exp(-true[:, None] * body.heat[1]))
        names, link = body.robot.joint_names, _behind_gears(found, body)
        signals = (found.q, found.dq, found.ddq, found.torque)
        truth = Log(names, true, *signals, temperature=temperature, source=self.source)
        log = Log(
            names,
            true if recorder.stamps == "true" else told,
            **self._motion(found, told),  # type: ignore[arg-type]
            **_effort(felt, body, self.cell, gains, draw["effort"]),
            temperature=temperature if body.heat[2, 0] > 0 else None,
            source=self.source,
        )
        keep = np.flatnonzero(draw["dropped"].uniform(size=len(told)) >= recorder.dropped)
        keep = np.union1d(keep, [0, len(told) - 1])
        if len(keep) < len(told):
            lost = f"{len(told) - len(keep)} samples dropped"
            log, truth = log.rows(keep, lost), truth.rows(keep, lost)
        return log, truth, found.friction[keep], link[keep]

    def _torque_at(self, row: Array) -> Array:
        """Return what torque sensors feel at broken rows, shape (N, n), by lines; the first one before the first."""
        whole = _felt(self.samples, self.body, self.cell)
        return np.stack([np.interp(row, np.arange(len(whole)), one) for one in whole.T], axis=1)

    def _motion(self, found: Samples, told: Array) -> dict[str, Array | None]:
        """Return measured positions, velocities where they are logged, and the commanded motion."""
        encoder = self.cell.encoder
        q = rounded(found.drive_q + self.noise[:, 0], each("encoder.resolution", encoder.resolution, self.body.joints))
        dq = found.drive_dq + self.noise[:, 1]
        if encoder.velocity == "difference":
            dq = np.diff(q, axis=0, prepend=q[:1]) * (self.ticks.rate / self.ticks.per_row)
        goal = self.motion.evaluate(told)
        return {"q": q, "dq": dq if self.cell.recorder.velocities else None, "q_ref": goal[0], "dq_ref": goal[1]}


def rounded(values: Array, resolution: Array) -> Array:
    """Return values (N, n) at the nearest steps of a resolution (n,); 0 leaves them as they are."""
    step = np.where(resolution > 0, resolution, 1.0)
    return np.where(resolution > 0, step * np.floor(values / step + 0.5), values)


def _cubic(q: Array, dq: Array, first: IntArray, x: Array, step: float) -> Array:
    """Return Hermite's cubics through positions and velocities of the rows ``first`` and the next, at shares x."""
    left, right = q[first], q[first + 1]
    rise, fall = step * dq[first], step * dq[first + 1]
    bend = 3.0 * (right - left) - 2.0 * rise - fall
    return left + x * (rise + x * (bend + x * (2.0 * (left - right) + rise + fall)))


def _behind_gears(samples: Samples, body: CellPlant) -> Array:
    """Return the torque that moves the bodies less the known bias, shape (N, n): what link-side sensors measure."""
    if body.is_elastic:
        return samples.spring
    return samples.torque - samples.friction - samples.ddq @ body.armature.T


def _felt(samples: Samples, body: CellPlant, cell: Cell) -> Array:
    """Return the torque at the joints on the side that the cell measures, shape (N, n)."""
    half = 0.5 * samples.jump if cell.effort.held == "mean" else np.zeros_like(samples.jump)
    if cell.effort.side == "motor":
        return samples.torque - half
    found = _behind_gears(samples, body)
    if body.is_elastic or not half.any():
        return found  # springs do not jump
    rotors = np.linalg.solve(body.masses(samples.q), half[..., None])[..., 0] @ body.armature.T
    return found - half + rotors


def _effort(
    felt: Array, body: CellPlant, cell: Cell, gains: Mapping[str, float] | None, draw: np.random.Generator
) -> dict[str, Array]:
    """Return the logged torques at the joints, or the currents of the motors where drive gains are given."""
    n, coupling, names = body.joints, body.coupling, body.robot.joint_names
    level, step = (each(f"effort.{name}", getattr(cell.effort, name), n) for name in ("noise", "resolution"))
    error = draw.normal(size=felt.shape) * level
    if cell.effort.side == "link":
        return {"torque": rounded(felt + error, step)}
    motors = np.linalg.solve(coupling.T, felt.T).T  # torques at the joints are C' times those of the motors
    if gains is None:
        return {"torque": rounded(motors + error, step) @ coupling}
    for name in gains:
        if name not in names:
            raise UnknownChoice("joint", name, names)
    for name in names:
        if not (name in gains and np.isfinite(gains[name]) and gains[name] != 0):
            raise BadOption(f"gains['{name}']", gains.get(name), "give each joint's drive gain in N m/A, not 0")
    return {"current": rounded(motors / np.array([gains[name] for name in names]) + error, step)}


#: Length in s of the run-in at most; every step of it is in memory.
LONGEST_LEAD_IN = 1000.0


@dataclass(frozen=True)
class CommandedCourse:
    """A trajectory with its run-in before time 0.

    Attributes:
        trajectory: The motion from time 0 on.
        run_in: From rest to the start of the trajectory; None to begin on it.
        length: Length of the log, in s.
    """

    trajectory: Trajectory
    run_in: Quintic | None
    length: float

    def evaluate(self, time: Array) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq at the times (N,), each (N, n)."""
        early = time < 0
        q, dq, ddq = self.trajectory.evaluate(np.where(early, 0.0, time))
        if self.run_in is not None and np.any(early):
            # The first control can be a fraction of a tick before the run-in starts: at rest.
            run_in = self.run_in.evaluate(np.maximum(time[early] + self.run_in.length, 0.0))
            q[early], dq[early], ddq[early] = run_in
        return q, dq, ddq


def course(trajectory: Trajectory, lead_in: float, duration: float | None, joints: int) -> CommandedCourse:
    """Return the commanded motion of a robot with so many joints.

    Args:
        trajectory: The motion.
        lead_in: Length of the run-in, in s; 0 for none.
        duration: Length of the log, in s; None for the trajectory's. Only periodic motions go on beyond theirs.
        joints: Number of joints.

    Raises:
        BadOption: Other joints, or lengths that cannot be.
    """
    if trajectory.joints != joints:
        raise BadOption("trajectory", f"for {trajectory.joints} joints", f"the robot has {joints}")
    if not 0 <= lead_in < np.inf:
        raise BadOption("lead_in", lead_in, "give seconds, 0 or more")
    if lead_in > LONGEST_LEAD_IN:
        raise BadOption("lead_in", lead_in, f"give {LONGEST_LEAD_IN:g} s or less")
    length = trajectory.duration if duration is None else duration
    if not 0 < length < np.inf:
        raise BadOption("duration", duration, "give seconds, above 0")
    if length > trajectory.duration * (1 + 1e-9) and not trajectory.periodic:
        raise BadOption("duration", duration, f"the trajectory ends after {trajectory.duration:g} s and has no period")
    start = np.array(trajectory.evaluate(0.0))[:, 0]
    return CommandedCourse(trajectory, Quintic.from_rest(start, lead_in) if lead_in else None, length)
