"""What the rigid body asks of each joint along a log: inertia and bias torque over its own angle."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import butter, sosfiltfilt

from dynident.actuators.rollout_loop import COLUMNS
from dynident.actuators.servo_log import ServoLog
from dynident.arrays import Array
from dynident.errors import NotConsistent
from dynident.model.inertia import Inertia
from dynident.model.kernels import batched
from dynident.model.robot import Robot
from dynident.simulation.effects import Payload

#: Cut-off in Hz of the zero-phase filter of the measured motion, at most; a fifth of the rate where that is less.
CUTOFF_HZ = 10.0

#: Samples of an even grid per sample of the log.
_FINER = 1.0


@dataclass(frozen=True)
class MeasuredMotion:
    """The measured motion of a log, filtered, on an even grid.

    Attributes:
        time: Shape (K,), in s.
        q: Shape (K, n).
        dq: Shape (K, n).
        ddq: Shape (K, n).
        sos: The filter, as second-order sections, to be run over other signals of the grid as well.
    """

    time: Array
    q: Array
    dq: Array
    ddq: Array
    sos: Array

    def filtered(self, values: Array) -> Array:
        """Return signals on the grid, shape (K, ...), filtered as the motion is."""
        return np.asarray(sosfiltfilt(self.sos, values, axis=0))


def measured_motion(log: ServoLog, cutoff_hz: float = CUTOFF_HZ) -> MeasuredMotion:
    """Return the filtered motion of a log and its derivatives."""
    step = float(np.median(np.diff(log.time))) / _FINER
    count = max(round((log.time[-1] - log.time[0]) / step) + 1, 32)
    time = np.linspace(log.time[0], log.time[-1], count)
    rate = (count - 1) / (time[-1] - time[0])
    sos = np.asarray(butter(4, min(cutoff_hz, 0.2 * rate), fs=rate, output="sos"))
    even = np.column_stack([np.interp(time, log.time, column) for column in log.q.T])
    q = np.asarray(sosfiltfilt(sos, even, axis=0))
    dq = np.gradient(q, time, axis=0)
    return MeasuredMotion(time, q, dq, np.gradient(dq, time, axis=0), sos)


@dataclass(frozen=True)
class JointLoad:
    """Load of one joint with the others on their measured motion, at the samples of a log.

    Attributes:
        inertia: Of the robot model about the joint, shape (N,).
        bias: Torque c0 + c1 cos q + c2 sin q over the joint's own angle, shape (N, 3).
    """

    inertia: Array
    bias: Array

    def torque(self, q: Array) -> Array:
        """Return the bias torque at positions of the joint, shape (N,), in N m or N."""
        return self.bias[:, 0] + self.bias[:, 1] * np.cos(q) + self.bias[:, 2] * np.sin(q)


def rigid_inertia(robot: Robot) -> Array:
    """Return the inertial parameters of a robot model that the load is made of, shape (10 l,).

    Raises:
        NotConsistent: The model has no inertias.
    """
    nominal = robot.nominal
    if nominal is None or not np.any(np.abs(np.asarray(nominal)) > 0):
        step = (
            "the known bodies are the scale of all torques: add inertial elements to the links, or a known payload; "
            "without them gains, friction and armature are known as ratios only"
        )
        raise NotConsistent(f"robot '{robot.name}'", "its model has no inertias", step)
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


def joint_loads(robot: Robot, log: ServoLog, motion: MeasuredMotion) -> list[JointLoad]:
    """Return the load of every joint; the order of the log's joints is that of the robot.

    A payload of the log is a part of it. Rotor inertia that the robot model states is none: the armature is found as a
    whole.
    The bias of a joint that turns is taken at three of its own angles a third of a turn apart, the other joints on
    their measured motion: gravity is exact at every angle, and for a single joint so is all of it.
    """
    if log.payload is not None:
        robot = with_payload(robot, log.payload)
    theta = rigid_inertia(robot)
    q, dq, ddq = (
        np.column_stack([np.interp(log.time, motion.time, column) for column in values.T])
        for values in (motion.q, motion.dq, motion.ddq)
    )
    chain = robot.chain
    masses = batched.mass_matrix(chain, theta, q)
    loads = []
    for joint, active in enumerate(robot.active):
        still = ddq.copy()
        still[:, joint] = 0.0
        if active.kind != "revolute":
            bias = np.zeros((log.samples, 3))
            bias[:, 0] = batched.inverse_dynamics(chain, theta, q, dq, still)[:, joint]
        else:
            values, angles = [], []
            for turn in (0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0):
                turned = q.copy()
                turned[:, joint] += turn
                values.append(batched.inverse_dynamics(chain, theta, turned, dq, still)[:, joint])
                angles.append(turned[:, joint])
            torque, angle = np.array(values), np.array(angles)
            parts = (torque.mean(axis=0), (torque * np.cos(angle)).mean(axis=0), (torque * np.sin(angle)).mean(axis=0))
            bias = np.column_stack([parts[0], 2.0 * parts[1], 2.0 * parts[2]])
        loads.append(JointLoad(masses[:, joint, joint], bias))
    return loads


def loop_samples(log: ServoLog, joint: int, load: JointLoad) -> Array:
    """Return what the compiled roll-out takes of a log and a joint, shape (N, COLUMNS)."""
    table = np.empty((log.samples, COLUMNS))
    table[:, 0] = log.time
    table[:, 1] = log.q_ref[:, joint]
    table[:, 2] = log.dq_ref[:, joint]
    table[:, 3] = log.added[:, joint]
    table[:, 4] = log.enabled[:, joint]
    table[:, 5] = log.supply
    table[:, 6] = load.inertia
    table[:, 7:] = load.bias
    return table
