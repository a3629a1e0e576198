"""The fit of one joint: gain, linear start, friction, output error, and again under loads that are known better."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.friction_choice import choose_friction
from dynident.actuators.joint_load import JointLoad
from dynident.actuators.linear_start import (
    OFF_S,
    LinearStart,
    StartRows,
    free_parameters,
    linear_start,
    refinable,
    saturated_share,
    start_at,
)
from dynident.actuators.output_error import RefineEffort, ServoProblem, log_errors, output_error, refined, starts_from
from dynident.actuators.parameters import FRICTION_MODELS, PLACE
from dynident.actuators.rollout import (
    ROUGH_STEP,
    SEARCH,
    SEARCH_STEP,
    JointRecord,
    encoder_step,
    mean_errors,
    rolled_out,
    started,
)
from dynident.actuators.servo_log import AUTO
from dynident.arrays import Array
from dynident.errors import LogMismatch

#: Gains that are tried where the gain is free, as multiples of that of the law.
GAIN_RATIOS = (2.0, 4.0, 8.0, 16.0, 32.0)

#: Gains that are tried about the best of these.
_NEAR_RATIOS = (0.5**0.25, 2.0**0.25, 2.0**0.5, 2.0**0.75)

#: A gain counts as separable where saturation lowers the error of the roll-outs by this share, and at least this share
#: of the samples saturates.
SEPARATES, SATURATED = 0.05, 0.01

#: Errors of this many times the noise of the encoder may be those of a search that ended far from the answer.
_BESIDE = 2.0

#: A slew limit of the goal that is faster than the fastest motion by this factor is none.
NO_LIMIT = 10.0

#: Least speed in rad/s of a joint whose drive is off that tells back-EMF from viscous friction.
OFF_SPEED = 0.2


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
    def records(self) -> tuple[JointRecord, ...]:
        """The records of the training and the test logs."""
        return self.train + self.test

    def under(self, loads: Sequence[JointLoad]) -> JointData:
        """Return the joint under other loads, one for each log."""
        records = [record.under(load) for record, load in zip(self.records, loads, strict=True)]
        count = len(self.train)
        return replace(self, train=tuple(records[:count]), test=tuple(records[count:]))

    def part(self, logs: Sequence[int]) -> JointData:
        """Return the joint in some of the training logs, to be searched by longer steps where it is one of an arm."""
        step = SEARCH_STEP if self.is_alone else ROUGH_STEP
        train = tuple(replace(self.train[k], search=step) for k in logs)
        return replace(self, train=train, test=(), rows=tuple(self.rows[k] for k in logs))

    def started(self, parameters: Array) -> JointData:
        """Return the joint with the training logs started where roll-outs follow them best."""
        return replace(self, train=tuple(started(one, parameters, longest=SEARCH) for one in self.train))

    def while_on(self) -> JointData:
        """Return the joint with training samples counted only where the drive is on; all of a log where it never is."""
        on = [one.used & (one.samples[:, 4] > 0.5) for one in self.train]
        counted = [replace(one, used=u) if u.any() else one for one, u in zip(self.train, on, strict=True)]
        return replace(self, train=tuple(counted))

    @property
    def is_alone(self) -> bool:
        """Whether the robot has no other joint."""
        return len(self.rows[0].log.joints) == 1

    @property
    def fastest(self) -> float:
        """The fastest measured motion, in rad/s, filtered."""
        return max(float(np.max(np.abs(one.motion.dq[:, one.joint]))) for one in self.rows)

    @property
    def has_off(self) -> bool:
        """Whether the drive is off during motion for long enough to tell back-EMF from viscous friction."""
        return bool(self.motion_seconds()[:, 1].sum() > OFF_S)

    def motion_seconds(self) -> Array:
        """Return for how long in s the joint moves in each training log, drive on and drive off, shape (logs, 2)."""
        found = []
        for one in self.rows:
            speed, is_off = np.abs(one.motion.dq[:, one.joint]), one.on < 0.5
            coasts = is_off & (speed > one.log.sized(one.joint, OFF_SPEED))
            counts = [np.sum(~is_off & (speed > one.rest)), np.sum(coasts)]
            found.append((one.motion.time[1] - one.motion.time[0]) * np.array(counts))
        return np.array(found)


@dataclass(frozen=True)
class JointFit:
    """What is found of one joint.

    Attributes:
        ratio: Multiple of the law's gain at which saturation explains the logs; 1 where none does.
        friction: Name of the friction model.
        folds: Cross-validation error of each friction model, in rad.
        free: Names of the free parameters.
        scanned: Where the scan of delay and slew limit ended.
        linear: Parameters of the linear start, shape (COUNT,).
        parameters: Of the output error, shape (COUNT,).
        simple: The same with Coulomb and viscous friction, shape (COUNT,).
        simple_free: Names of its free parameters.
    """

    ratio: float
    friction: str
    folds: Mapping[str, float]
    free: tuple[str, ...]
    scanned: LinearStart
    linear: Array
    parameters: Array
    simple: Array
    simple_free: tuple[str, ...]

    def problem(self, data: JointData) -> ServoProblem:
        """Return the roll-outs of the training logs with the free parameters."""
        return ServoProblem(data.train, self.free, FRICTION_MODELS[self.friction])


def first_fit(data: JointData, friction: str, effort: RefineEffort, progress: Callable[[str], None]) -> JointFit:
    """Return what is found of a joint from nothing: gain, delay and slew limit, and the output error with m1.

    Args:
        data: The joint.
        friction: Name of the friction model that the scan has, or ``auto``; ``richer_fit`` goes on from there.
        effort: How long to look.
        progress: Called with each step in words.
    """
    progress(f"{data.name}: linear start")
    ratio = _gain(data)
    fit, error = _fit_at(data, ratio, friction, effort)
    if ratio == 1.0:
        return fit
    # a linear start that is far off may look saturated, and so may stiction
    (plain, without), (_, sticking) = (_fit_at(data, 1.0, friction, effort, own) for own in ("m1", "m2"))
    return fit if error < (1.0 - SEPARATES) * min(without, sticking) else plain


def _fit_at(
    data: JointData, ratio: float, friction: str, effort: RefineEffort, refined_by: str = "m1"
) -> tuple[JointFit, float]:
    """Return the fit at a multiple of the gain of the law, and the mean error of its roll-outs in rad."""
    data = at_ratio(data, ratio)
    scanned = linear_start(data.rows, data.train, data.law, FRICTION_MODELS["m3" if friction == AUTO else friction])
    fit = _refined(data, refined_by, scanned, ratio, effort)
    return fit, float(mean_errors(data.train, fit.parameters).mean())


def richer_fit(
    data: JointData,
    fit: JointFit,
    friction: str,
    effort: RefineEffort,
    progress: Callable[[str], None],
    from_fit: bool = False,
) -> JointFit:
    """Return the fit with a friction model that is stated, or that cross-validation chooses, from that with m1.

    Args:
        data: The joint.
        fit: With m1.
        friction: Name of the friction model, or ``auto``.
        effort: How long to look.
        progress: Called with each step in words.
        from_fit: Whether the search starts at the fit, whose loads are known better than those of the linear start.
    """
    folds: dict[str, float] = {}
    if friction == AUTO:
        progress(f"{data.name}: friction by cross-validation of roll-outs")
        off = data.motion_seconds()[:, 1]
        friction, folds = choose_friction(data.train, data.rows, data.law, fit.scanned, off, fit.parameters)
    if friction == "m1":
        return replace(fit, folds=folds)
    progress(f"{data.name}: output error, friction {friction}")
    richer = _refined(data, friction, fit.scanned, fit.ratio, effort, fit if from_fit else None)
    return replace(richer, folds=folds, simple=fit.simple, simple_free=fit.free)


def sought_again(data: JointData, fit: JointFit, effort: RefineEffort) -> JointFit:
    """Return the fit of a joint of an arm from several starts about it, under loads that are known better now.

    Only where it leaves more than the encoder's noise: under the first loads the search may have ended far from it.

    Args:
        data: The joint.
        fit: With m1.
        effort: How long to look.
    """
    noise, before = encoder_step(data.train) / np.sqrt(12.0), log_errors(fit.problem(data), fit.parameters)
    if np.median(before) <= _BESIDE * noise:
        return fit
    found = _refined(data, "m1", fit.scanned, fit.ratio, effort, fit)
    after = log_errors(found.problem(data), found.parameters)
    return found if np.log(after).mean() < np.log(before).mean() else fit


def follows(data: JointData, fit: JointFit) -> bool:
    """Return whether roll-outs of most logs in which a joint is not held leave no more than its encoder's noise."""
    noise, errors = encoder_step(data.train) / np.sqrt(12.0), log_errors(fit.problem(data), fit.parameters)
    own = [not one.is_held for one in data.train]
    return bool(np.median(errors[own] if any(own) else errors) <= _BESIDE * noise)


def _refined(
    data: JointData,
    friction: str,
    scanned: LinearStart,
    ratio: float,
    effort: RefineEffort,
    simpler: JointFit | None = None,
) -> JointFit:
    """Return the linear start and the output error with one friction model, from a simpler fit where there is one."""
    law, model = data.law, FRICTION_MODELS[friction]
    linear = start_at(data.rows, law, model, scanned)
    free = free_parameters(law, model, linear, law.gain_is_free and ratio != 1.0, data.has_off)
    start = linear.copy()
    if simpler is not None:
        places = [PLACE[name] for name in (*simpler.free, "back_emf")]
        start[places] = simpler.parameters[places]
    starts = starts_from(refinable(start, law, model, data.has_off), model)
    found = output_error(ServoProblem(data.train, free, model), starts, effort=effort).parameters
    found, free = _without_none(data, found, free)
    return JointFit(ratio, friction, {}, free, scanned, linear, found, found.copy(), free)


def _without_none(data: JointData, parameters: Array, free: tuple[str, ...]) -> tuple[Array, tuple[str, ...]]:
    """Return parameters (COUNT,) and the free ones without a slew limit that is none."""
    if "slew_limit" not in free or parameters[PLACE["slew_limit"]] <= NO_LIMIT * data.fastest:
        return parameters, free
    parameters[PLACE["slew_limit"]] = np.inf
    return parameters, tuple(name for name in free if name != "slew_limit")


def fit_again(data: JointData, fit: JointFit, most: int, finely: bool = False) -> JointFit:
    """Return the output error from where it ended before, under a load that is known better now.

    Args:
        data: The joint under that load.
        fit: Where it ended.
        most: Evaluations at most.
        finely: Whether with the step of the answer.
    """

    def again(start: Array, free: tuple[str, ...], friction: str) -> tuple[Array, tuple[str, ...]]:
        problem = ServoProblem(data.train, free, FRICTION_MODELS[friction])
        if finely:  # the last step: what is free stays free
            return refined(problem.finely, start, most), free
        return _without_none(data, refined(problem, start, most), free)

    parameters, free = again(fit.parameters, fit.free, fit.friction)
    simple, simple_free = parameters.copy(), free
    if fit.friction != "m1":
        simple, simple_free = again(fit.simple, fit.simple_free, "m1")
    return replace(fit, parameters=parameters, free=free, simple=simple, simple_free=simple_free)


def _gain(data: JointData) -> float:
    """Return the multiple of the law's gain at which saturation explains the logs; 1 where none does.

    Of GAIN_RATIOS the largest that is as good as any, and some about it: a limit that is a little too low lets a weight
    fall, and one that is too high explains nothing.
    """
    law = data.law
    if not law.gain_is_free or not np.isfinite(law.limit):
        return 1.0
    errors, shares = dict[float, float](), dict[float, float]()

    def largest_duty_at(ratio: float) -> float:
        own = at_ratio(data, ratio)
        found = linear_start(own.rows, own.train, replace(law, slew_limit=np.inf), FRICTION_MODELS["m1"])
        rolled = [rolled_out(one, found.parameters).saturated for one in own.train]
        errors[ratio], shares[ratio] = found.error, float(np.mean(np.concatenate(rolled)))
        return saturated_share(own.rows, found.parameters)[1]

    largest = largest_duty_at(1.0)
    plain = errors[1.0]
    with suppress(LogMismatch):  # everything saturates
        for ratio in GAIN_RATIOS:
            if ratio * largest < law.limit:  # nothing saturates
                errors[ratio], shares[ratio] = plain, 0.0
            else:
                largest_duty_at(ratio)
    most = min(errors.values()) / (1.0 - SEPARATES)
    first = max(ratio for ratio, error in errors.items() if error <= most)
    with suppress(LogMismatch):
        for factor in _NEAR_RATIOS:
            if first * factor * largest >= law.limit:
                largest_duty_at(first * factor)
    seen = {ratio: error for ratio, error in errors.items() if shares[ratio] > SATURATED}
    best = min(seen, key=lambda ratio: seen[ratio], default=1.0)
    return best if errors[best] < (1.0 - SEPARATES) * plain else 1.0


def at_ratio(data: JointData, ratio: float) -> JointData:
    """Return the data of a joint with a multiple of the gain of its law."""
    if ratio == 1.0:
        return data

    def scaled(numbers: Array) -> Array:
        return np.array([numbers[0] * ratio, *numbers[1:]])

    records = [[replace(one, law=scaled(one.law)) for one in part] for part in (data.train, data.test)]
    rows = tuple(replace(one, law=scaled(one.law), fixed={}) for one in data.rows)
    return replace(data, train=tuple(records[0]), test=tuple(records[1]), rows=rows)
