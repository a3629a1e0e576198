"""Actuators on logs: free roll-outs beside what was measured, and beside the actuator that the robot model states."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynident.actuators.arm_motion import arm_loads, arm_rolled_out
from dynident.actuators.estimate import ActuatorEstimate, JointActuator
from dynident.actuators.joint_load import JointLoad
from dynident.actuators.parameters import PLACE
from dynident.actuators.rollout import FIRST, HELD, JointRecord, mean_error, record_of, rolled_out, started
from dynident.actuators.servo_log import ServoLog, check_gains, is_outside
from dynident.arrays import Array
from dynident.errors import LogMismatch
from dynident.model.joint import Joint
from dynident.model.robot import Robot


@dataclass(frozen=True)
class FollowedJoint:
    """The roll-out of one joint over one log; the commands are its only input.

    Attributes:
        joint: Name of the joint.
        log: Name of the log.
        kp: Position gain of the log.
        is_outside: Whether the gain is outside those of the training logs.
        is_trained: Whether the log is one of the training logs.
        time: Shape (N,), in s.
        command: Shape (N,), in rad.
        measured: Shape (N,), in rad.
        predicted: Shape (N,), in rad.
        error: Mean absolute error, in rad; the other joints on their measured motion.
        whole: The same with the whole arm let go, all joints together by their commands; infinite where they diverge.
        linear: The same of the linear start.
        nominal: The same with armature, damping and friction of the robot model; nan where it states none.
        load: Root mean square of the torque of the bodies, in N m.
        stated: Parameters of the drive as identified with those of the robot model, shape (COUNT,); None for none.
        by_model: Positions of the roll-out with them, shape (N,), in rad; None for none.
        slides: Whether the joint slides: m and N stand for rad and N m.
    """

    joint: str
    log: str
    kp: float
    is_outside: bool
    is_trained: bool
    time: Array
    command: Array
    measured: Array
    predicted: Array
    error: float
    whole: float
    linear: float
    nominal: float
    load: float
    stated: Array | None = None
    by_model: Array | None = None
    slides: bool = False


def followed(
    estimate: ActuatorEstimate, robot: Robot, logs: Sequence[ServoLog], trained: Collection[str] = ()
) -> tuple[FollowedJoint, ...]:
    """Return the roll-outs of an estimate over logs, joint by joint and log by log.

    A joint that a log holds at one command throughout is left out of it, where others move: it tests nothing.

    Args:
        estimate: The actuators.
        robot: The robot of the logs.
        logs: Logs of commands and positions.
        trained: Names of those that the estimate was trained on.

    Raises:
        LogMismatch: Another robot than that of the estimate.
        BadOption: Some logs state gains and others do not.
        NotConsistent: The robot model has no inertias.
    """
    names = tuple(joint.name for joint in estimate.joints)
    if names != robot.joint_names:
        evidence = f"the robot model has the joints {', '.join(robot.joint_names)}, the estimate {', '.join(names)}"
        raise LogMismatch(f"robot '{robot.name}'", evidence, "name the case file of this estimate")
    found: list[FollowedJoint] = []
    logs = check_gains(logs, estimate.joints[0].law.kp)
    laws, values = [joint.law for joint in estimate.joints], [joint.parameters for joint in estimate.joints]
    robot = estimate.on(robot)
    loads = [arm_loads(robot, log, laws, values) for log in logs]
    runs = [_whole_arm(estimate, robot, *each) for each in zip(logs, loads, strict=True)]
    for k, (actuator, joint) in enumerate(zip(estimate.joints, robot.active, strict=True)):
        nominal = _stated(actuator, joint)
        for log, load, (own, whole) in zip(logs, loads, runs, strict=True):
            held = (np.ptp(log.q_ref, axis=0) < HELD) & log.enabled.all(axis=0)
            if held[k] and not held.all():
                continue
            record = own[k]
            predicted = rolled_out(record, actuator.parameters).q
            by_model = None if nominal is None else rolled_out(record, nominal).q
            found.append(
                FollowedJoint(
                    actuator.name,
                    log.name,
                    log.kp,
                    is_outside(log.kp, actuator.kp),
                    log.name in trained,
                    log.time - log.time[0],
                    log.q_ref[:, k],
                    record.q,
                    predicted,
                    mean_error(record, predicted),
                    mean_error(record, whole[:, k]),
                    mean_error(record, rolled_out(record, actuator.linear).q),
                    float("nan") if by_model is None else mean_error(record, by_model),
                    float(np.sqrt(np.mean(load[k].torque(log.time, record.q) ** 2))),
                    nominal,
                    by_model,
                    actuator.slides,
                )
            )
    return tuple(found)


def _whole_arm(
    estimate: ActuatorEstimate, robot: Robot, log: ServoLog, loads: Sequence[JointLoad]
) -> tuple[list[JointRecord], Array]:
    """Return each joint in a log from its first reads, and the positions of the whole arm from there, shape (N, n)."""
    laws, values = [joint.law for joint in estimate.joints], [joint.parameters for joint in estimate.joints]
    parts = enumerate(zip(loads, laws, values, strict=True))
    records = [started(record_of(log, k, load, law), own, FIRST) for k, (load, law, own) in parts]
    return records, arm_rolled_out(robot, log, laws, values, np.column_stack([one.start for one in records]))


def _stated(actuator: JointActuator, joint: Joint) -> Array | None:
    """Return the drive as identified with armature, damping and friction of the robot model; None where it has none.

    A stated damping stands for viscous friction and back-EMF together, as simulators take it.
    """
    stated: Mapping[str, float | None] = {
        "armature": joint.drive.reflected_inertia or None,
        "viscous": joint.damping,
        "coulomb": joint.friction,
    }
    if not any(stated.values()):
        return None
    values = actuator.simple.copy()
    for name, value in stated.items():
        values[PLACE[name]] = value or 0.0
    values[PLACE["back_emf"]] = 0.0
    values[PLACE["armature"]] = max(values[PLACE["armature"]], 1e-7)
    return values


def friction_of(actuator: JointActuator, speed: Array, load: float) -> Array:
    """Return the friction of a joint that moves evenly against a load, shape (N,), in N m.

    Args:
        actuator: The actuator.
        speed: In rad/s, 0 or above, shape (N,).
        load: Torque of the bodies, which the motor carries, in N m.
    """
    value = actuator.value
    fade = np.exp(-((speed / value("stribeck_velocity")) ** value("stribeck_exponent")))
    steady = value("coulomb") + (value("load_motor") + value("load_external")) * load
    still = value("load_motor_stribeck") + value("load_external_stribeck")
    return steady + fade * (value("coulomb_stribeck") + still * load) + value("viscous") * speed
