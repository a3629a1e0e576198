"""From logs of commands and positions to the actuators of a robot: linear start, output error, friction, verdict.

Of joints whose logs give torques no scale, ratios to the torque at full duty are known, and values by a stated one.
Torque at full duty, friction, back-EMF, and armature with the inertia of the bodies may all be twice as large where no
weight is carried: the motion is the same. Half widths of ratios are those with the torque at full duty held.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dynident.actuators.arm_bodies import free_bodies, stated_bodies
from dynident.actuators.arm_coupling import Arm
from dynident.actuators.arm_fit import FEW_TURNS, FIRST_TURNS, MOST_TURNS, finished, settled, turned
from dynident.actuators.direction_search import turned_over
from dynident.actuators.estimate import ActuatorEstimate, Combination, JointActuator
from dynident.actuators.friction_choice import FOLDS, moves
from dynident.actuators.joint_fit import JointData, JointFit, at_ratio, first_fit, follows, richer_fit, sought_again
from dynident.actuators.joint_load import carrying, joint_loads, load_times, measured_motion, motion_at, rigid_inertia
from dynident.actuators.linear_start import OFF_S, saturated_share, start_rows
from dynident.actuators.output_error import ROUGH, THOROUGH
from dynident.actuators.parameters import PLACE, with_zero
from dynident.actuators.poor_fit import EXTRAPOLATION, poor_fit, unseen_weight
from dynident.actuators.rollout import FIRST, STEP, JointRecord, mean_errors, record_of, started
from dynident.actuators.servo_log import (
    AUTO,
    ServoLog,
    ServoSetup,
    check_gains,
    is_outside,
    is_read_back,
    kp_values,
    laws_of,
)
from dynident.actuators.torque_state import check_saturation
from dynident.actuators.verdict import AS_RATIO, EXPERIMENTS, WEAK, Known, Spread, known_parameters, lacks_scale
from dynident.arrays import Array
from dynident.model.robot import Robot

#: Logs of this length in s all is found from first: delay, gain, friction, zeros of the encoders.
FIRST_S = 60.0

#: Logs with this share of the most motion of a joint are drawn from.
_NEAR_MOST = 0.5


def identify_actuators(
    robot: Robot,
    setup: ServoSetup,
    train: Sequence[ServoLog],
    test: Sequence[ServoLog] = (),
    progress: Callable[[str], None] = lambda step: None,
) -> ActuatorEstimate:
    """Identify the actuator of every joint from logs of commands and positions.

    Each joint is rolled out by itself under its logged commands, with the other joints on their measured motion. In
    an arm the roll-outs of all joints then say how it moved between the samples and where the encoders' zeros are, and
    the output error goes on under these loads.

    Args:
        robot: With the joints of the logs; its inertias are the scale of all torques.
        setup: Drive laws and friction.
        train: Logs to learn from.
        test: Logs to test on.
        progress: Called with each step in words.

    Raises:
        NotConsistent: The robot model has no inertias, or not of all links where they are free.
        LogMismatch: All samples of a joint rest or are saturated, or logs state no gain.
        SolverFailed: No start gives a finite roll-out.
    """
    rigid_inertia(robot)
    if setup.bodies:
        stated_bodies(robot, setup)
    progress("loads of the joints")
    laws = laws_of(setup, [*train, *test])
    check_saturation(robot, laws, train)
    logs = check_gains([*train, *test], laws[0].kp)
    measured = [measured_motion(log) for log in logs]
    ends = [load_times(log, robot.dof) for log in logs]
    motions = [motion_at(motion, between) for motion, between in zip(measured, ends, strict=True)]
    robots = [carrying(robot, log) for log in logs]
    loads = [joint_loads(one, motion) for one, motion in zip(robots, motions, strict=True)]
    datas, kp = [], kp_values(logs[: len(train)])
    for joint, (name, law) in enumerate(zip(robot.joint_names, laws, strict=True)):
        records = [record_of(log, joint, load[joint], law) for log, load in zip(logs, loads, strict=True)]
        rows = [
            start_rows(log, joint, load[joint], motion, law)
            for log, load, motion in list(zip(logs, loads, measured, strict=True))[: len(train)]
        ]
        data = JointData(name, law, tuple(records[: len(train)]), tuple(records[len(train) :]), tuple(rows))
        has_both = data.has_off or law.controls_torque  # else viscous friction stands for back-EMF too
        datas.append(data if has_both else data.while_on())
    arm = Arm(robots, measured, ends, motions, datas, [], [])
    arm, bodies = _fitted(arm, first_logs(datas, setup.friction), setup.friction, progress), None
    if setup.bodies:
        arm, bodies = free_bodies(arm, robot, setup, logs, progress)
    arm, spreads = finished(arm, progress)
    progress("directions of the joints")
    pairs = list(zip(arm.datas, arm.fits, strict=True))
    odd = [one for one in turned_over(robot, train) if not (one.is_zero and follows(*pairs[one.joint]))]
    told = {one.joint: one.remark(robot.joint_names) for one in odd}
    parts = enumerate(zip(arm.datas, arm.fits, spreads, strict=True))
    joints = [_answer(*each, kp, told.get(joint, "") if told else None) for joint, each in parts]
    joints = [one.of_slide() if own.kind == "prismatic" else one for one, own in zip(joints, robot.active, strict=True)]
    return ActuatorEstimate(robot.name, tuple(joints), bodies=bodies)


def first_logs(datas: Sequence[JointData], friction: str = "m1") -> list[int]:
    """Return the training logs that all is found from first, at least FIRST_S; all of them for a single joint.

    Where friction is to be chosen each joint moves in as many of them as there are folds of the cross-validation.

    Drawn one by one, from those with most motion of the joint, without or with a payload or its drive off, of which the
    logs before have the least share. They have some of each of these motions, as back-EMF stands on the drive that is
    off, and the scale of the torques on the payload.
    """
    rows = datas[0].rows
    seconds = np.array([one.log.time[-1] - one.log.time[0] for one in rows])
    payloads = list(dict.fromkeys(one.log.payload for one in rows))
    carries = np.array([[one.log.payload == payload for payload in payloads] for one in rows])
    kinds = [np.hstack([on[:, None] * carries, off[:, None]]) for on, off in (one.motion_seconds().T for one in datas)]
    motion = np.hstack(kinds)
    whole = np.maximum(motion.sum(axis=0), 1e-9)
    chosen, left = list[int](), np.random.default_rng(0).permutation(len(seconds))
    while len(left):
        found = motion[chosen].sum(axis=0)
        if len(datas) > 1 and seconds[chosen].sum() >= FIRST_S and np.all((found > OFF_S) | (whole <= OFF_S)):
            break
        scarce = motion[left, int(np.argmin(found / whole))]
        place = int(np.argmax(scarce >= _NEAR_MOST * scarce.max()))
        chosen.append(int(left[place]))
        left = np.delete(left, place)
    for where in (moves(data.train) for data in datas if friction == AUTO):
        scarce = [k for k in left.tolist() if where[k] and k not in chosen]
        chosen += scarce[: max(FOLDS - int(where[chosen].sum()), 0)]
    return sorted(chosen)


def _fitted(arm: Arm, first: Sequence[int], friction: str, progress: Callable[[str], None]) -> Arm:
    """Return an arm with the fits of its joints, found from some of the logs, at last under the loads of all logs."""
    effort = ROUGH if len(arm.datas) > 1 else THOROUGH
    part = arm.part(first)
    fits = [first_fit(data, friction, effort, progress) for data in part.datas]
    ratios = [fit.ratio for fit in fits]
    arm, part = (
        replace(one, datas=[at_ratio(*each) for each in zip(one.datas, ratios, strict=True)]) for one in (arm, part)
    )
    used = [with_zero(fit.parameters, 0.0) for fit in fits]  # the measured motion has no zeros
    is_all = len(first) == len(arm.datas[0].train)
    most = (MOST_TURNS if is_all else FEW_TURNS) if friction == "m1" else FIRST_TURNS
    part = settled(replace(part, fits=fits, used=used), progress, most=most)
    pairs = list(zip(part.datas, part.fits, strict=True))
    if friction in ("m1", AUTO) and len(pairs) > 1:
        fits = [sought_again(*each, effort) for each in pairs]
        is_same = all(one is other for one, other in zip(fits, part.fits, strict=True))
        part = part if is_same else settled(replace(part, fits=fits), progress, most=most)
    if friction != "m1":
        pairs = list(zip(part.datas, part.fits, strict=True))
        fits = [richer_fit(*each, friction, effort, progress, from_fit=len(pairs) > 1) for each in pairs]
        part = settled(replace(part, fits=fits), progress)
    if len(part.fits) == 1:
        return replace(arm, fits=part.fits, used=used)
    progress("motion of the whole arm in all logs")
    motions, zeros = list(arm.motions), [own[PLACE["angle_offset"]] for own in part.used]
    for k, motion in zip(first, part.motions, strict=True):
        motions[k] = replace(motion, q=motion.q - zeros)
    used = [with_zero(own, 0.0) for own in part.used]
    arm = replace(arm, motions=motions, fits=part.fits, used=used, few=first, turns=part.turns)
    arm = turned(arm, part.fits)
    return arm if is_all else settled(arm, progress, 0, FEW_TURNS)


def _answer(
    data: JointData, fit: JointFit, spread: Spread, kp: tuple[float, ...], turned: str | None = None
) -> JointActuator:
    """Return the answer for one joint, with what is known of each parameter.

    Args:
        data: The joint.
        fit: What is found of it.
        spread: How far.
        kp: Position gains of the training logs.
        turned: What is said of its direction, empty for nothing, where that of any joint is wrong: what follows from
            that is not said; None where none is.
    """
    known = known_parameters(fit.problem(data), fit.parameters, spread)
    parameters, simple, linear = fit.parameters.copy(), fit.simple.copy(), fit.linear.copy()
    law, ratio = data.law, fit.ratio
    if law.gain_is_free:  # reported as duty per rad of error and unit of kp
        law, ratio = replace(law, error_gain=1.0), ratio * law.error_gain
        for values in (parameters, simple, linear):
            values[PLACE["gain_ratio"]] *= ratio
        known = tuple(one.scaled(ratio) if one.name == "gain_ratio" else one for one in known)
    remarks = _remarks(data, kp, poor_fit(data, fit.parameters) if turned is None else turned)
    inertia = float(np.mean([np.mean(one.loads[:, 0]) for one in data.train]))
    known = as_ratios(known, spread, inertia)
    is_scaleless = lacks_scale({one.name: one.label for one in known})
    if law.full_torque is not None and is_scaleless and not law.gain_is_free:
        known = at_torque(known, law.full_torque, inertia)
        parameters, simple, linear = (
            rescaled(one, law.full_torque[0], inertia) for one in (parameters, simple, linear)
        )
    elif law.full_torque is not None:
        remarks += contradiction(known, law.full_torque, law.gain_is_free)
    elif is_scaleless and turned is None:
        remarks += unseen_weight(data)
    moved = [row for row, record in zip(data.rows, data.train, strict=True) if not record.is_held]
    saturated = saturated_share(moved or data.rows, fit.parameters)[0]
    largest = saturated_share(data.rows, fit.simple)[1] * float(simple[PLACE["full_torque"]])
    known, combinations = _known_together(data, known, parameters, spread, kp)
    test = [started(one, fit.parameters, FIRST) for one in data.test]
    return JointActuator(
        name=data.name,
        law=law,
        kp=kp,
        friction=fit.friction,
        parameters=parameters,
        known=known,
        combinations=combinations,
        linear=linear,
        simple=simple,
        train=_errors(data.train, fit.parameters),
        test=_errors(test, fit.parameters),
        linear_test=_errors(test or data.train, fit.linear),
        folds=fit.folds,
        saturated=saturated,
        remarks=remarks,
        largest_torque=largest,
    )


def _errors(records: Sequence[JointRecord], parameters: Array) -> dict[str, float]:
    """Return the mean errors in rad of the logs in which the joint is not held; of all where it is held in each."""
    own = [one for one in records if not one.is_held] or records
    return dict(zip((one.name for one in own), map(float, mean_errors(own, parameters, STEP)), strict=True))


def _known_together(
    data: JointData, known: tuple[Known, ...], parameters: Array, spread: Spread, kp: tuple[float, ...]
) -> tuple[tuple[Known, ...], tuple[Combination, ...]]:
    """Return the parameters with those that structure keeps apart marked, and the combinations that are known."""
    found, law, halves = list[Combination](), data.law, {one.name: one.half_width for one in known}
    if law.gain_is_free and "gain_ratio" not in halves:
        torque = parameters[PLACE["full_torque"]]
        known = tuple(
            replace(one, label="not separable", half_width=np.inf, together="gain_ratio")
            if one.name == "full_torque"
            else one
            for one in known
        )
        unit = "N m/rad" if not kp or kp == (1.0,) else "N m/rad per unit of kp"
        words = f"gain times torque at full duty; to separate them, {EXPERIMENTS['gain_ratio']}"
        half = law.error_gain * halves["full_torque"]
        found.append(Combination("stiffness", float(torque * law.error_gain), unit, words, half))
    pair = {"viscous": "back_emf", "back_emf": "viscous"}
    parts = [k for k, one in enumerate(known) if one.name in pair]
    if law.controls_torque or data.has_off or [known[k].label for k in parts] == ["identified"] * 2:
        return known, tuple(found)
    total = float(sum(parameters[PLACE[name]] for name in pair))
    words = f"viscous friction and back-EMF together; to separate them, {EXPERIMENTS['viscous']}"
    half = sum(halves[known[k].name] for k in parts)
    if len(parts) == 2 and np.isfinite(halves["full_torque"]) and law.full_torque is None:
        half = spread.half_width_of_sum(parts)
    found.append(Combination("damping", total, "N m s/rad", words, half))
    marked = list(known)
    for k in parts:
        one, other = known[k], pair[known[k].name]
        if not np.isfinite(halves.get(other, np.inf)):
            label = "not separable" if one.label == "identified" else one.label
            marked[k] = replace(one, together=other, label=label)
    return tuple(marked), tuple(found)


def _remarks(data: JointData, kp: tuple[float, ...], first: str) -> tuple[str, ...]:
    remarks = list(filter(None, [first]))
    if all(is_read_back(one.log, one.joint) for one in data.rows):
        text = "commands are its positions and noise, which moves no joint: where they are read back, log what is sent"
        remarks.append(text)
    outside = sorted({one.kp for one in data.test if is_outside(one.kp, kp)})
    if outside:
        those = ", ".join(f"{value:g}" for value in outside)
        remarks.append(
            f"{EXTRAPOLATION}: test logs at kp {those}, training logs at kp {min(kp):g} to {max(kp):g}; "
            "their test error is no check of the model within its range"
        )
    return tuple(remarks)


#: Parameters in units of the torque at full duty; armature is one with the inertia of the bodies.
_SCALED = ("full_torque", "back_emf", "viscous", "coulomb", "coulomb_stribeck")


def as_ratios(known: Sequence[Known], spread: Spread, inertia: float) -> tuple[Known, ...]:
    """Return what is known of a joint, with the ratios that are known where the scale is not.

    Args:
        known: Free parameters of the joint.
        spread: How its errors spread them; the covariance has the directions that the logs see.
        inertia: Of the bodies about the joint, which is one with the armature, in kg m^2.
    """
    if spread.ratio is not None or not lacks_scale({one.name: one.label for one in known}):
        return tuple(known)
    names = [one.name for one in known]
    scaled = np.array([_of_scale(one.name, one.value, inertia) for one in known])
    torque, found = names.index("full_torque"), []
    for k, one in enumerate(known):
        if one.label != "not separable" or scaled[k] == 0.0 or k == torque:
            found.append(one)
            continue
        beside = np.eye(len(names))[k] - scaled[k] / scaled[torque] * np.eye(len(names))[torque]
        half = float(spread.factors[k] * np.sqrt(max(float(beside @ spread.covariance @ beside), 0.0)))
        is_known = half < WEAK * abs(scaled[k])
        found.append(replace(one, label=AS_RATIO, together="full_torque", ratio=half) if is_known else one)
    return tuple(found)


def at_torque(known: Sequence[Known], stated: tuple[float, float], inertia: float) -> tuple[Known, ...]:
    """Return what is known of a joint without scale where its torque at full duty is stated.

    Args:
        known: As of :func:`as_ratios`.
        stated: Torque at full duty and its half width, in N m.
        inertia: Of the bodies about the joint, in kg m^2.
    """
    torque = next(one.value for one in known if one.name == "full_torque")
    share, found = stated[1] / stated[0], []
    for one in known:
        size = _of_scale(one.name, one.value, inertia)
        value = one.value + size * (stated[0] / torque - 1.0)
        if one.name != "full_torque" and one.label != AS_RATIO:
            found.append(replace(one, value=value))
            continue
        half = float(np.hypot(share * size * stated[0] / torque, (one.ratio or 0.0) * stated[0] / torque))
        label = "identified" if half < WEAK * abs(value) else "weak"
        found.append(Known(one.name, value, half, label))
    return tuple(found)


def contradiction(known: Sequence[Known], stated: tuple[float, float], is_free: bool) -> tuple[str, ...]:
    """Return in words what a stated torque says where it is not the scale.

    Args:
        known: Free parameters of the joint.
        stated: Torque at full duty and its half width, in N m.
        is_free: Whether the gain of the drive is not known.
    """
    found = next(one for one in known if one.name == "full_torque")
    if is_free:
        return ("full_torque has no effect while the gain of the drive is not known: state error_gain and kp",)
    if not abs(found.value - stated[0]) > np.hypot(found.half_width, stated[1]):
        return ()
    return (
        f"full torque {found.value:.3g} +- {found.half_width:.2g} N m by the logs, stated {stated[0]:.3g} +- "
        f"{stated[1]:.2g}: check the bodies of the robot model, kp and the drive law; the logs are the scale here",
    )


def rescaled(parameters: Array, torque: float, inertia: float) -> Array:
    """Return the parameters of a joint without scale, shape (COUNT,), at another torque at full duty in N m."""
    found = parameters.copy()
    for name in (*_SCALED, "armature"):
        value = float(parameters[PLACE[name]])
        found[PLACE[name]] += _of_scale(name, value, inertia) * (torque / float(parameters[PLACE["full_torque"]]) - 1.0)
    found[PLACE["armature"]] = max(float(found[PLACE["armature"]]), 0.0)
    return found


def _of_scale(name: str, value: float, inertia: float) -> float:
    """Return what of a parameter grows with the scale of all torques."""
    return value + inertia if name == "armature" else value * (name in _SCALED)
