"""From logs of commands and positions to the actuators of a robot: linear start, output error, friction, verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.estimate import ActuatorEstimate, Combination, JointActuator
from dynident.actuators.friction_choice import choose_friction
from dynident.actuators.joint_load import joint_loads, measured_motion, rigid_inertia
from dynident.actuators.linear_start import (
    LinearStart,
    StartRows,
    free_parameters,
    linear_start,
    refinable,
    start_at,
    start_rows,
)
from dynident.actuators.output_error import ServoProblem, output_error, starts_from
from dynident.actuators.parameters import FRICTION_MODELS, PLACE
from dynident.actuators.rollout import STEP, JointRecord, mean_errors, record_of, rolled_out
from dynident.actuators.servo_log import AUTO, ServoLog, ServoSetup, check_gains, is_outside, kp_values
from dynident.actuators.verdict import EXPERIMENTS, Known, known_parameters
from dynident.arrays import Array
from dynident.errors import LogMismatch
from dynident.model.robot import Robot

#: Gains that are tried where the gain is free, as multiples of that of the law.
GAIN_RATIOS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)

#: A gain counts as separable where saturation lowers the error of the roll-outs by this share, and at least this share
#: of the samples saturates.
SEPARATES, SATURATED = 0.05, 0.01

#: Shortest time in s with the drive off and the joint in motion that tells back-EMF from viscous friction.
OFF_S = 0.2


@dataclass(frozen=True)
class JointData:
    """One joint in all logs.

    Attributes:
        name: The joint.
        law: Its drive law.
        train: What the roll-outs take of the training logs.
        test: The same of the test logs.
        rows: What the linear start takes of the training logs.
    """

    name: str
    law: DriveLaw
    train: tuple[JointRecord, ...]
    test: tuple[JointRecord, ...]
    rows: tuple[StartRows, ...]

    @property
    def has_off(self) -> bool:
        """Whether the drive is off during motion for long enough to tell back-EMF from viscous friction."""
        seconds = 0.0
        for one in self.rows:
            moving = (one.on < 0.5) & (np.abs(one.motion.dq[:, one.joint]) > 0.2)
            seconds += float(moving.sum()) * (one.motion.time[1] - one.motion.time[0])
        return seconds > OFF_S


def identify_actuators(
    robot: Robot,
    setup: ServoSetup,
    train: Sequence[ServoLog],
    test: Sequence[ServoLog] = (),
    progress: Callable[[str], None] = lambda step: None,
) -> ActuatorEstimate:
    """Identify the actuator of every joint from logs of commands and positions.

    Each joint is rolled out by itself under its logged commands, with the other joints on their measured motion.

    Args:
        robot: With the joints of the logs; its inertias are the scale of all torques.
        setup: Drive laws and friction.
        train: Logs to learn from.
        test: Logs to test on.
        progress: Called with each step in words.

    Raises:
        NotConsistent: The robot model has no inertias.
        LogMismatch: All samples of a joint rest or are saturated, or logs state no gain.
        SolverFailed: No start gives a finite roll-out.
    """
    rigid_inertia(robot)
    progress("loads of the joints")
    logs = check_gains([*train, *test], setup.laws[0].kp)
    motions = [measured_motion(log) for log in logs]
    loads = [joint_loads(robot, log, motion) for log, motion in zip(logs, motions, strict=True)]
    joints = []
    for joint, (name, law) in enumerate(zip(robot.joint_names, setup.laws, strict=True)):
        records = [record_of(log, joint, load[joint], law) for log, load in zip(logs, loads, strict=True)]
        rows = [
            start_rows(log, joint, load[joint], motion, law)
            for log, load, motion in list(zip(logs, loads, motions, strict=True))[: len(train)]
        ]
        data = JointData(name, law, tuple(records[: len(train)]), tuple(records[len(train) :]), tuple(rows))
        joints.append(_joint(data, setup.friction, kp_values(logs[: len(train)]), progress))
    return ActuatorEstimate(robot.name, tuple(joints))


def _joint(data: JointData, friction: str, kp: tuple[float, ...], progress: Callable[[str], None]) -> JointActuator:
    progress(f"{data.name}: linear start")
    richest = FRICTION_MODELS["m3" if friction == AUTO else friction]
    law, ratio = data.law, _gain(data)
    if ratio != 1.0:
        data = _at_ratio(data, ratio)
    scanned = linear_start(data.rows, data.train, law, richest)
    has_gain = law.gain_is_free and ratio != 1.0
    folds: dict[str, float] = {}
    if friction == AUTO:
        progress(f"{data.name}: friction by cross-validation of roll-outs")
        friction, folds = choose_friction(data.train, data.rows, law, scanned, data.has_off)
    model = FRICTION_MODELS[friction]
    linear = start_at(data.rows, law, model, scanned)
    progress(f"{data.name}: output error, friction {friction}")
    free = free_parameters(law, model, linear, has_gain, data.has_off)
    problem = ServoProblem(data.train, free, model)
    fit = output_error(problem, starts_from(refinable(linear, law, data.has_off), model))
    known = known_parameters(problem.finely, fit.parameters)
    simple = fit.parameters.copy() if friction == "m1" else _simple(data, law, scanned, has_gain)
    linear_test = _errors(data.test or data.train, linear)
    parameters = fit.parameters.copy()
    if ratio != 1.0:  # the ratio of the scan is part of the gain that is reported
        for values in (parameters, simple, linear):
            values[PLACE["gain_ratio"]] *= ratio
        known = tuple(one.scaled(ratio) if one.name == "gain_ratio" else one for one in known)
    saturated = float(np.mean(np.concatenate([rolled_out(one, fit.parameters).saturated for one in data.train])))
    known, combinations = _known_together(data, law, known, parameters, has_gain, kp)
    return JointActuator(
        name=data.name,
        law=law,
        kp=kp,
        friction=friction,
        parameters=parameters,
        known=known,
        combinations=combinations,
        linear=linear,
        simple=simple,
        train=_errors(data.train, fit.parameters),
        test=_errors(data.test, fit.parameters),
        linear_test=linear_test,
        folds=folds,
        saturated=saturated,
        remarks=_remarks(data, kp),
    )


def _simple(data: JointData, law: DriveLaw, scanned: LinearStart, has_gain: bool) -> Array:
    """Return the parameters of the fit with Coulomb and viscous friction, shape (COUNT,)."""
    model = FRICTION_MODELS["m1"]
    start = refinable(start_at(data.rows, law, model, scanned), law, data.has_off)
    free = free_parameters(law, model, start, has_gain, data.has_off)
    return output_error(ServoProblem(data.train, free, model), [start]).parameters


def _gain(data: JointData) -> float:
    """Return the multiple of the law's gain at which saturation explains the logs; 1 where none does."""
    law = data.law
    if not law.gain_is_free or not np.isfinite(law.limit):
        return 1.0
    errors: dict[float, float] = {}
    for ratio in GAIN_RATIOS:
        own = _at_ratio(data, ratio)
        try:
            found = linear_start(own.rows, own.train, replace(law, slew_limit=np.inf), FRICTION_MODELS["m1"])
        except LogMismatch:  # everything saturates
            break
        share = float(np.mean(np.concatenate([rolled_out(one, found.parameters).saturated for one in own.train])))
        if ratio == 1.0 or share > SATURATED:
            errors[ratio] = found.error
    best = min(errors, key=lambda ratio: errors[ratio])
    plain = errors[min(errors)]
    return best if best != min(errors) and errors[best] < (1.0 - SEPARATES) * plain else 1.0


def _at_ratio(data: JointData, ratio: float) -> JointData:
    """Return the data of a joint with a multiple of the gain of its law."""

    def scaled(numbers: Array) -> Array:
        return np.array([numbers[0] * ratio, *numbers[1:]])

    records = [[replace(one, law=scaled(one.law)) for one in part] for part in (data.train, data.test)]
    rows = tuple(replace(one, law=scaled(one.law), fixed={}) for one in data.rows)
    return replace(data, train=tuple(records[0]), test=tuple(records[1]), rows=rows)


def _errors(records: Sequence[JointRecord], parameters: Array) -> dict[str, float]:
    return dict(zip((one.name for one in records), map(float, mean_errors(records, parameters, STEP)), strict=True))


def _known_together(
    data: JointData, law: DriveLaw, known: tuple[Known, ...], parameters: Array, has_gain: bool, kp: tuple[float, ...]
) -> tuple[tuple[Known, ...], tuple[Combination, ...]]:
    """Return the parameters with those that structure keeps apart marked, and the combinations that are known."""
    found = []
    if law.gain_is_free and not has_gain:
        torque = parameters[PLACE["full_torque"]]
        known = tuple(
            replace(one, label="not separable", half_width=np.inf, together="gain_ratio")
            if one.name == "full_torque"
            else one
            for one in known
        )
        unit = "N m/rad" if not kp or kp == (1.0,) else "N m/rad per unit of kp"
        words = f"gain times torque at full duty; to tell them apart {EXPERIMENTS['gain_ratio']}"
        found.append(Combination("stiffness", float(torque * law.error_gain), unit, words))
    if not law.controls_torque and not data.has_off:
        total = float(parameters[PLACE["viscous"]])
        words = f"viscous friction and back-EMF together; to tell them apart {EXPERIMENTS['viscous']}"
        found.append(Combination("damping", total, "N m s/rad", words))
        known = tuple(
            replace(one, together="back_emf", label="not separable" if one.label == "identified" else one.label)
            if one.name == "viscous"
            else one
            for one in known
        )
    return known, tuple(found)


def _remarks(data: JointData, kp: tuple[float, ...]) -> tuple[str, ...]:
    remarks = []
    outside = sorted({one.kp for one in data.test if is_outside(one.kp, kp)})
    if outside:
        those = ", ".join(f"{value:g}" for value in outside)
        remarks.append(
            f"extrapolation: test logs at kp {those}, training logs at kp {min(kp):g} to {max(kp):g}; "
            "their test error is no check of the model within its range"
        )
    return tuple(remarks)
