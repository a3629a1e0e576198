"""What the rigid body asks of each joint along a log: inertia and bias torque over its own angle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from dynident.actuators.rollout_loop import COLUMNS
from dynident.actuators.servo_log import ServoLog
from dynident.arrays import Array
from dynident.data.preprocessing._zero_phase import LowPass, butterworth, zero_phase
from dynident.errors import NotConsistent
from dynident.model.inertia import Inertia
from dynident.model.kernels import batched
from dynident.model.robot import Robot
from dynident.simulation.effects import Payload

#: Cut-off in Hz of the zero-phase filter of the measured motion, at most; a fifth of the rate where that is less.
CUTOFF_HZ = 10.0

#: Order of that filter, and the samples by which the ends of a signal are extended.
_ORDER, _PAD = 4, 15

#: Logs with a longer step in s than the first are filtered and differentiated on a grid of the second, their positions
#: on a curve between the samples: central differences over 5 ms are 0.2 % small at 3 Hz, over 33 ms 7 %.
COARSE_STEP, GRID_STEP = 8e-3, 5e-3

#: Longest part of the interval between two samples in s over which the load of an arm counts as constant: in the
#: search, and in the answer.
LOAD_STEP, FINE_LOAD_STEP = 5e-3, 1e-3


@dataclass(frozen=True)
class MeasuredMotion:
    """The measured motion of a log, filtered, on an even grid.

    Attributes:
        time: Shape (K,), in s.
        q: Shape (K, n).
        dq: Shape (K, n).
        ddq: Shape (K, n).
        low_pass: The filter, to be run over other signals of the grid as well.
    """

    time: Array
    q: Array
    dq: Array
    ddq: Array
    low_pass: LowPass

    def filtered(self, values: Array) -> Array:
        """Return signals on the grid, shape (K, ...), filtered as the motion is."""
        columns = values.reshape(len(values), -1).T
        return zero_phase(columns, self.low_pass, _PAD).T.reshape(values.shape)


def measured_motion(log: ServoLog) -> MeasuredMotion:
    """Return the filtered motion of a log and its derivatives."""
    step = float(np.median(np.diff(log.time)))
    count = max(round((log.time[-1] - log.time[0]) / (step if step <= COARSE_STEP else GRID_STEP)) + 1, 32)
    time = np.linspace(log.time[0], log.time[-1], count)
    rate = (count - 1) / (time[-1] - time[0])
    low_pass = butterworth(_ORDER, min(CUTOFF_HZ, 0.2 / step), rate)
    q = zero_phase(between(log.time, log.q, time).T, low_pass, _PAD).T
    dq = np.gradient(q, time, axis=0)
    return MeasuredMotion(time, q, dq, np.gradient(dq, time, axis=0), low_pass)


def between(stamps: Array, values: Array, time: Array) -> Array:
    """Return signals (N, n) between their samples, shape (K, n): on a line, or a curve where samples are far apart."""
    if np.median(np.diff(stamps)) <= COARSE_STEP:
        return np.column_stack([np.interp(time, stamps, column) for column in values.T])
    return np.asarray(Akima1DInterpolator(stamps, values, axis=0, method="akima")(time))


def load_times(log: ServoLog, joints: int) -> Array:
    """Return the ends of the parts of the load, shape ((N - 1) S + 1,): S equal ones in each interval of a log.

    A single joint has no load that changes in between.
    """
    return log.time if joints == 1 else divided(log.time, LOAD_STEP)


def divided(ends: Array, step: float) -> Array:
    """Return the ends of equal parts of the intervals between some times (K + 1,), each no longer than a step."""
    parts = ceil(float(np.median(np.diff(ends))) / step - 1e-6)
    inner = ends[:-1, None] + np.diff(ends)[:, None] * (np.arange(parts) / parts)
    return np.append(inner, ends[-1])


@dataclass(frozen=True)
class ArmMotion:
    """Motion of all joints in the parts of the load.

    Attributes:
        time: Middle of each part, shape (K,), in s.
        q: Angles of the robot model, shape (K, n).
        dq: Shape (K, n).
        ddq: Shape (K, n).
    """

    time: Array
    q: Array
    dq: Array
    ddq: Array


def motion_at(motion: MeasuredMotion | ArmMotion, ends: Array) -> ArmMotion:
    """Return a motion in the parts of the load between some times (K + 1,)."""
    time = 0.5 * (ends[1:] + ends[:-1])
    q, dq, ddq = (
        np.column_stack([np.interp(time, motion.time, column) for column in values.T])
        for values in (motion.q, motion.dq, motion.ddq)
    )
    return ArmMotion(time, q, dq, ddq)


@dataclass(frozen=True)
class JointLoad:
    """Load of one joint with the others on their motion.

    Attributes:
        time: Shape (K,), in s.
        inertia: Of the robot model about the joint, shape (K,).
        bias: Torque c0 + c1 cos q + c2 sin q over the joint's own angle, shape (K, 3).
    """

    time: Array
    inertia: Array
    bias: Array

    @property
    def rows(self) -> Array:
        """Inertia and bias torque as the compiled roll-out takes them, shape (K, LOADS)."""
        return np.column_stack([self.inertia, self.bias])

    def torque(self, time: Array, q: Array) -> Array:
        """Return the bias torque at positions of the joint at some times, each (N,), in N m or N."""
        c0, c1, c2 = (np.interp(time, self.time, column) for column in self.bias.T)
        return np.asarray(c0 + c1 * np.cos(q) + c2 * np.sin(q))


def rigid_inertia(robot: Robot) -> Array:
    """Return the inertial parameters of a robot model that the load is made of, shape (10 l,).

    Raises:
        NotConsistent: The model has no inertias, or not of all links, or no masses.
    """
    nominal, bodies = robot.nominal, [link.inertia for link in robot.links if link.inertia is not None]
    if nominal is None or not any(body.mass > 0 for body in bodies):
        lacks = "its model has no masses" if np.any(np.abs(np.asarray(nominal, dtype=float)) > 0) else ""
        if bodies and nominal is None:
            names = ", ".join(link.name for link in robot.links if link.inertia is None)
            lacks = f"its model has no inertia of {names}"
        step = (
            "the known bodies are the scale of all torques: add inertial elements to the links (mass, centre and "
            "inertia, of CAD or scales; rough ones do where identify --bodies free finds them too); without, all that "
            "a log tells are ratios"
        )
        raise NotConsistent(f"robot '{robot.name}'", lacks or "its model has no inertias", step)
    return np.asarray(nominal)


def with_payload(robot: Robot, payload: Payload) -> Robot:
    """Return a robot that carries a payload as a part of one of its links, the last one where none is named.

    Raises:
        NotConsistent: That link has no inertia.
    """
    links = list(robot.links)
    place = [link.name for link in links].index(payload.link) if payload.link else len(links) - 1
    inertia = links[place].inertia
    if inertia is None:
        step = "add an inertial element to it: the payload is added to its mass"
        raise NotConsistent(f"robot '{robot.name}'", f"link {links[place].name} has no inertia", step)
    own = Inertia.from_centre_of_mass(payload.mass, payload.centre, np.diag(payload.inertia))
    links[place] = replace(links[place], inertia=inertia + own)
    return replace(robot, links=tuple(links))


def carrying(robot: Robot, log: ServoLog) -> Robot:
    """Return the robot with what it carried in a log."""
    return robot if log.payload is None else with_payload(robot, log.payload)


def joint_loads(robot: Robot, motion: ArmMotion) -> list[JointLoad]:
    """Return the load of every joint; the order of the joints of the motion is that of the robot."""
    inertias = inertias_of(robot, motion)
    return [JointLoad(motion.time, inertias[:, j], bias_of(robot, motion, j)) for j in range(robot.dof)]


def inertias_of(robot: Robot, motion: ArmMotion) -> Array:
    """Return the inertia about each joint with the others held, shape (K, n)."""
    return np.diagonal(batched.mass_matrix(robot.chain, rigid_inertia(robot), motion.q), axis1=1, axis2=2)


def bias_of(robot: Robot, motion: ArmMotion, joint: int) -> Array:
    """Return the bias torque of a joint over its own angle, shape (K, 3), with the others on their motion.

    Rotor inertia that the robot model states is no part of the load: the armature is found as a whole.
    The bias of a joint that turns is taken at three of its own angles a third of a turn apart: gravity is exact at
    every angle, and for a single joint so is all of it.
    """
    theta, chain = rigid_inertia(robot), robot.chain
    still = motion.ddq.copy()
    still[:, joint] = 0.0
    if robot.active[joint].kind != "revolute":
        bias = np.zeros((len(still), 3))
        bias[:, 0] = batched.inverse_dynamics(chain, theta, motion.q, motion.dq, still)[:, joint]
        return bias
    turns = 2.0 * np.pi / 3.0 * np.arange(3)
    q, dq, ddq = (np.tile(values, (3, 1)) for values in (motion.q, motion.dq, still))
    q[:, joint] += np.repeat(turns, len(still))
    torque = batched.inverse_dynamics(chain, theta, q, dq, ddq)[:, joint].reshape(3, -1) / 1.5
    cosine, sine = np.cos(motion.q[:, joint]), np.sin(motion.q[:, joint])
    along, across = np.cos(turns) @ torque, np.sin(turns) @ torque
    return np.column_stack([0.5 * torque.sum(axis=0), along * cosine - across * sine, along * sine + across * cosine])


def measured_loads(robot: Robot, log: ServoLog, motion: MeasuredMotion | None = None) -> list[JointLoad]:
    """Return the load of every joint along the measured motion of a log, which is found where it is not given."""
    motion = measured_motion(log) if motion is None else motion
    return joint_loads(carrying(robot, log), motion_at(motion, load_times(log, robot.dof)))


def loop_samples(log: ServoLog, joint: int) -> Array:
    """Return what the compiled roll-out takes of a log and a joint, shape (N, COLUMNS)."""
    table = np.empty((log.samples, COLUMNS))
    table[:, 0] = log.time
    table[:, 1] = log.q_ref[:, joint]
    table[:, 2] = log.dq_ref[:, joint]
    table[:, 3] = log.added[:, joint]
    table[:, 4] = log.enabled[:, joint]
    table[:, 5] = log.supply
    return table
