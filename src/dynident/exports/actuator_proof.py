"""An exported MuJoCo model of actuators beside dynident's roll-out under the same commands: of a joint, of a log.

What has to be said of an export of actuators stands here too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from dynident.actuators.arm_motion import arm_loads, arm_rolled_out
from dynident.actuators.estimate import ActuatorEstimate, JointActuator
from dynident.actuators.parameters import PLACE, unit_for
from dynident.actuators.rollout import mean_error, record_of, rolled_out
from dynident.actuators.servo_log import ServoLog
from dynident.actuators.servo_motions import MOST_TURN, MotionFrame
from dynident.actuators.verdict import lacks_scale
from dynident.arrays import Array
from dynident.exports.actuator_bodies import robot_of
from dynident.exports.actuator_files import (
    PLAIN,
    TARGETS,
    command_words,
    mujoco_model,
    mujoco_spec,
    simulator_joint,
    stated_gain,
    urdf_dynamics,
    written_limit,
)
from dynident.model.robot import Robot

#: Largest mean absolute difference in rad that counts as the same motion.
TOLERANCE: Final = 3e-3

#: Motions that are compared, their length in s, commands a second.
_KINDS, _SECONDS, _RATE = ("chirp", "steps"), 6.0, 200.0

#: Logs are followed until they are this long together, in s.
_LOG_SECONDS = 30.0

#: Sizes that the motions are tried at, until MuJoCo keeps the limits of the joint.
_SIZES = (1.0, 0.5, 0.25)

#: Amplitude of a joint that slides, in m, and speed where no limit is stated, in rad/s or m/s.
_SLIDE, _SPEED = 0.05, 5.0


def simulated_differences(
    estimate: ActuatorEstimate, target: str, stated: Mapping[str, str], logs: Callable[[], Sequence[ServoLog]]
) -> tuple[Mapping[str, float], Mapping[str, Mapping[str, float]]] | None:
    """Return ``mujoco_differences`` and ``log_differences`` where a target is simulated here; None for the others.

    Args:
        estimate: The actuators.
        target: Name of the target.
        stated: Its options.
        logs: Returns the logs to follow.

    Raises:
        DynidentError: As of the export.
    """
    if TARGETS.get(target) is not mujoco_model:
        return None
    kp = stated_gain(estimate, stated)
    return mujoco_differences(estimate, kp), log_differences(estimate, logs(), kp)


def mujoco_differences(estimate: ActuatorEstimate, kp: float) -> Mapping[str, float]:
    """Return the mean absolute difference of the positions of MuJoCo and of the roll-out, by joint, in rad.

    One joint moves within its limits, the others hold; contacts and ends of joints are switched off, as roll-outs have
    none. The angle offset and the slew limit are not part of the model, so the roll-out is without them too.

    Empty where the model has joints that were not identified: they have no drive in it, and swing.

    Raises:
        DynidentError: As of the export.
    """
    robot = robot_of(estimate)
    names, compiled = robot.joint_names, _compiled(estimate, robot, kp)
    if compiled is None:
        return {}
    engine, model, places, drives = compiled
    middles = [_middle(joint.limits.lower, joint.limits.upper) for joint in robot.active]
    found = {}
    for k, (name, joint) in enumerate(zip(names, robot.active, strict=True)):
        low, high, speed = joint.limits.lower, joint.limits.upper, joint.limits.velocity
        most = dict(MOST_TURN) if joint.kind == "revolute" else dict.fromkeys(MOST_TURN, _SLIDE)
        reach = 0.9 * min(middles[k] - low, high - middles[k])
        frame = MotionFrame(middles[k], reach, min(speed, _SPEED) or _SPEED, _RATE, _SECONDS, most, True)

        def followed(size: float, frame: MotionFrame = frame, k: int = k) -> tuple[Array, Array]:
            motions = [frame.scaled(kind, size) for kind in _KINDS]
            command = np.concatenate([motions[0].command, motions[1].command[1:]])
            commands = np.tile(middles, (len(command), 1))
            commands[:, k] = command
            return commands, driven(engine, model, commands, places, drives, np.arange(len(command)) / _RATE)

        commands, q = followed(_SIZES[0])
        for size in _SIZES[1:]:
            if low <= q[:, k].min() and q[:, k].max() <= high:
                break
            commands, q = followed(size)
        time = np.arange(len(commands)) / _RATE
        found[name] = _difference(estimate, robot, k, ServoLog(
            "MuJoCo", names, time, q, commands, np.zeros_like(q), np.zeros_like(q), np.ones(q.shape, dtype=bool),
            np.ones(len(q)), np.zeros(q.shape, dtype=bool), kp,
        ))  # fmt: skip
    return found


def _compiled(estimate: ActuatorEstimate, robot: Robot, kp: float) -> tuple[Any, Any, Array, Array] | None:
    """Return the module of MuJoCo, the model without contacts and ends, the places of positions (n,) and drives (n,).

    None where the model has joints that were not identified.
    """
    engine, spec = mujoco_spec(estimate, kp)
    model: Any = spec.compile()
    model.opt.disableflags |= engine.mjtDisableBit.mjDSBL_CONTACT | engine.mjtDisableBit.mjDSBL_LIMIT
    names = robot.joint_names
    if model.nv > len(names) or names != tuple(joint.name for joint in estimate.joints):
        return None
    places = np.array([model.joint(name).qposadr[0] for name in names])
    return engine, model, places, np.array([model.actuator(name).id for name in names])


def log_differences(
    estimate: ActuatorEstimate, logs: Sequence[ServoLog], kp: float
) -> Mapping[str, Mapping[str, float]]:
    """Return the mean absolute difference of the positions of MuJoCo and of the roll-out, by log and joint, in rad.

    The whole arm follows the commands of each log, from its first position at rest. The roll-out has the drives without
    the limits that the robot model states: a limit below what the logs took shows here. Logs at another gain, with a
    payload or with a drive off are left out, and the slew limit, which no MJCF has.

    Args:
        estimate: The actuators.
        logs: Logs of the case.
        kp: Position gain of the export.

    Raises:
        DynidentError: As of the export.
    """
    robot, found, seconds = robot_of(estimate), dict[str, Mapping[str, float]](), 0.0
    compiled = _compiled(estimate, robot, kp)
    if compiled is None:
        return {}
    for log in logs:
        if log.payload is not None or not log.enabled.all() or not (log.kp == kp or np.isnan(log.kp)):
            continue
        own = _log_difference(estimate, robot, replace(log, kp=kp), compiled)
        found[log.name] = dict(zip(robot.joint_names, own.tolist(), strict=True))
        seconds += float(log.time[-1] - log.time[0])
        if seconds >= _LOG_SECONDS:
            break
    return found


def _log_difference(
    estimate: ActuatorEstimate, robot: Robot, log: ServoLog, compiled: tuple[Any, Any, Array, Array]
) -> Array:
    """Return the mean absolute difference of both over a log, shape (n,), in rad or m."""
    rows = [simulator_joint(joint, log.kp) for joint in estimate.joints]
    parameters = [joint.simple.copy() for joint in estimate.joints]
    for own in parameters:
        own[PLACE["slew_limit"]] = np.inf
    stiffness, rate, torque, zeros = (
        np.array(values)
        for values in zip(
            *((one.stiffness, one.damping_gain, own[PLACE["full_torque"]], one.angle_offset)
              for one, own in zip(rows, parameters, strict=True)),
            strict=True,
        )
    )  # fmt: skip
    commands = log.q_ref + (rate * log.dq_ref + torque * log.added) / stiffness + zeros
    theirs = driven(*compiled[:2], commands, *compiled[2:], log.time - log.time[0], log.q[0] + zeros) - zeros
    start = np.stack([log.q[0], np.zeros(robot.dof)])
    ours = arm_rolled_out(robot, log, [joint.law for joint in estimate.joints], parameters, start)
    return np.abs(theirs - ours).mean(axis=0)


def _middle(lower: float, upper: float) -> float:
    return 0.5 * (lower + upper) if np.isfinite(lower) and np.isfinite(upper) else 0.0


def driven(
    engine: Any, model: Any, commands: Array, places: Array, drives: Array, time: Array, start: Array | None = None
) -> Array:
    """Return the positions of MuJoCo under commands, shape (N, n), from rest.

    Args:
        engine: The module of MuJoCo.
        model: The model.
        commands: Shape (N, n), each until the next.
        places: Of the positions, shape (n,).
        drives: Of the commands, shape (n,).
        time: Of the commands, shape (N,), in s, from 0.
        start: Positions that it starts at, shape (n,); None for the first command.
    """
    data = engine.MjData(model)
    data.qpos[places] = commands[0] if start is None else start
    data.ctrl[drives] = commands[0]
    for drive, value in zip(drives.tolist(), commands[0], strict=True):
        count = int(model.actuator_history[drive, 0])
        if count:
            engine.mj_initCtrlHistory(model, data, drive, None, np.full((count, 1), value))
    steps = np.diff(np.round(time / model.opt.timestep).astype(int)).tolist()
    q = np.empty(commands.shape)
    for row, (command, count) in enumerate(zip(commands, [*steps, 0], strict=True)):
        q[row] = data.qpos[places]
        data.ctrl[drives] = command
        if count:
            engine.mj_step(model, data, nstep=count)
    return q


def _difference(estimate: ActuatorEstimate, robot: Robot, k: int, log: ServoLog) -> float:
    laws, parameters = [joint.law for joint in estimate.joints], [joint.simple.copy() for joint in estimate.joints]
    if not np.isfinite(simulator_joint(estimate.joints[k], 1.0).largest_torque):
        most = written_limit(estimate.joints[k], robot.active[k].limits.effort)  # which its model has
        laws[k] = replace(laws[k], limit=most / parameters[k][PLACE["full_torque"]])
    for own in parameters:
        own[PLACE["angle_offset"]], own[PLACE["slew_limit"]] = 0.0, np.inf
    record = record_of(log, k, arm_loads(robot, log, laws, parameters)[k], laws[k])
    return mean_error(record, rolled_out(record, parameters[k]).q)


#: Targets that hold the bodies too.
_WITH_BODIES: Final = (mujoco_model, urdf_dynamics)


def _held_out(joint: JointActuator) -> str:
    """Return the errors on held-out logs of the friction that is exported and of the one that was found, if known."""
    errors = [1e3 * joint.folds.get(name, float("nan")) for name in (PLAIN, joint.friction)]
    unit = unit_for("mrad", joint.slides)
    return f" (held out {errors[0]:.3g} {unit} for {errors[1]:.3g})" if np.all(np.isfinite(errors)) else ""


def _limit_remarks(estimate: ActuatorEstimate, has_model: bool) -> list[str]:
    """Return which force limit is written where none was identified, or another one than that of the robot model."""
    limits, unknown = dict[str, list[str]](), [joint.name for joint in estimate.joints if not joint.has_limit]
    if not has_model:
        return [f"the largest torque of {', '.join(unknown)} is not known: none is written"] if unknown else []
    efforts = {joint.name: joint.limits.effort for joint in robot_of(estimate).active}
    for joint in estimate.joints:
        effort, unit = efforts.get(joint.name, np.inf), unit_for("N m", joint.slides)
        most, is_low = written_limit(joint, effort), written_limit(joint, effort) > 1.001 * effort
        numbers = f"{joint.name} {most:.3g} {unit}, robot model {effort:.3g}"
        if joint.has_limit and is_low:
            words = "identified torque limits above the effort limits of the robot model, written in their place"
        elif joint.has_limit:
            continue
        elif is_low:
            words = "the drives gave more in the logs than the effort limits of the robot model: the largest torque of "
            words += "the logs is written, the limit itself is not known"
        else:
            words, numbers = "the effort limit of the robot model holds, the largest torque is not known", joint.name
        limits.setdefault(words, []).append(numbers)
    return [f"{words} ({'; '.join(own)})" for words, own in limits.items()]


def export_remarks(
    estimate: ActuatorEstimate, target: str, options: Mapping[str, Any] = MappingProxyType({})
) -> list[str]:
    """Return what has to be said of an export: torques that are not known, bodies that a target has not.

    Args:
        estimate: The actuators.
        target: Name of the target.
        options: Those of the target.
    """
    has_model, found = TARGETS.get(target) in _WITH_BODIES, list[str]()
    commands: dict[str, list[str]] = {}
    for joint in estimate.joints if TARGETS.get(target) is mujoco_model else ():
        commands.setdefault(command_words(joint, stated_gain(estimate, options)), []).append(joint.name)
    found += [f"commanded velocity and torque of {', '.join(own)}: {words}" for words, own in commands.items() if words]
    richer = [joint for joint in estimate.joints if joint.friction != PLAIN]
    if richer:
        told = [f"{joint.name} {joint.friction}{_held_out(joint)}" for joint in richer]
        found.append(f"exported is the fit with Coulomb and viscous friction alone, in the place of {'; '.join(told)}")
    found += _limit_remarks(estimate, has_model)
    ratios = [joint.name for joint in estimate.joints if lacks_scale({one.name: one.label for one in joint.known})]
    if ratios:
        found.append(
            f"torques, friction and armature of {', '.join(ratios)} are known as ratios: nothing gives their scale"
        )
    bent = [joint.name for joint in estimate.joints if joint.law.dead_zone or joint.law.punch]
    if bent:
        found.append(
            f"dead zone and punch of {', '.join(bent)} are no part of it: its drives are linear to their limit"
        )
    if estimate.bodies is not None and not has_model:
        names = " or ".join(name for name, write in TARGETS.items() if write in _WITH_BODIES)
        found.append(f"its torques belong to the bodies that were found: export those with --to {names}")
    return found
