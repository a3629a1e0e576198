"""What static friction can hold: at rest a drive's torque is anything in an interval, and a model states that.

A drive that rests has no friction of its own motion: dry friction takes whatever the load asks for, up to its level at
breakaway in either direction. So the torque of a joint at rest is known to lie between two values, the torque of the
bodies and of offsets less and plus what its resting drives can hold. Signs are sharp there, however wide they are in
the model; parts with a state are at their bounds. No log says in which state friction that builds up over a distance
begins: until the drive has moved on, its torque lies between those of both bounds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from dynident.applications.compensation import parameters_of
from dynident.arrays import Array, BoolArray
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, at_rest, preprocess
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.plausibility import Plausibility
from dynident.identification.estimate.validation import Validation, fits_of, ratio
from dynident.identification.problem.problem import rest_speeds
from dynident.identification.problem.regressor_stream import remembered_motion
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction, Motion
from dynident.model.friction.presliding import SETTLED

#: States of friction from the lower and from the upper end on.
StatePaths: TypeAlias = tuple[Array, Array]

#: Speed at which dry friction holds, and the width of its sign there, in rad/s or m/s.
CREEP, SHARP = 1e-6, 1e-9


@dataclass(frozen=True)
class HeldTorque:
    """Torque where static friction holds.

    Attributes:
        torque: Torque of the model, friction with a memory at its states as anywhere, shape (N, n), in N m or N.
        middle: Where drives rest the middle of what the torque can be, elsewhere the torque, shape (N, n).
        half: Half the width of the interval about it, shape (N, n); 0 where no drive of the joint rests, or what a
            filter leaves of it there.
        rests: Where a drive of the joint rests, or has not moved on since the start of the log, shape (N, n).
    """

    torque: Array
    middle: Array
    half: Array
    rests: BoolArray

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Least and largest torque of the model, shape (N, n) each: at rest of the interval, else the torque both."""
        sides = (self.middle - self.half, self.middle + self.half)
        low, high = (np.where(self.rests, side, self.torque) for side in sides)
        return low, high


def held_torque(
    model: DynamicModel, theta: Array, motion: Motion, rests: BoolArray, ends: StatePaths | None = None
) -> HeldTorque:
    """Return the torques between which static friction holds each joint.

    Args:
        model: Robot, drives and friction.
        theta: Standard parameters, shape (p,).
        motion: The motion, with the states of friction where it has some.
        rests: Where each drive rests, shape (N, n).
        ends: States of friction from both ends on, as of :func:`end_states`; None where the states are known.
    """
    coupling, table = np.asarray(model.robot.coupling), model.coefficient_table(theta)
    motion = model.loaded(motion, theta)
    own = np.einsum("sjk,jk->sj", model.friction_values(motion), table)
    middle, half = held_friction(with_sharp_signs(model), table, motion)
    between, reach, apart = (own, 0.0, False) if ends is None else friction_between(model, table, motion, ends)
    middle, half = np.where(rests, middle, between), np.where(rests, half, reach)
    torque = model.torque(motion, theta)
    shift, halves = (middle - own) @ coupling, half @ np.abs(coupling)
    return HeldTorque(torque, torque + shift, halves, ((rests | apart) @ (coupling != 0)) > 0)


def with_sharp_signs(model: DynamicModel) -> DynamicModel:
    """Return the model whose dry friction is at its level at any speed."""
    return replace(model, friction=tuple(_sharp(part) for part in model.friction))


def held_friction(sharp: DynamicModel, table: Array, motion: Motion) -> tuple[Array, Array]:
    """Return middle and half width of what the friction of each drive can be where it rests, shape (N, n) each.

    Args:
        sharp: The model with sharp signs.
        table: Coefficients of its friction by drive, shape (n, k).
        motion: The motion, with the load and the states of friction where it asks for them.
    """
    ways = (_creeping(sharp, motion, sign) for sign in (1.0, -1.0))
    forth, back = (np.einsum("sjk,jk->sj", sharp.friction_values(way), table) for way in ways)
    return 0.5 * (forth + back), 0.5 * np.abs(forth - back)


def end_states(model: DynamicModel, start: Array | None = None) -> StatePaths | None:
    """Return the states (n, s) that friction may begin with, of parts that build up over a distance at both bounds.

    Args:
        model: Robot, drives and friction; where no part builds up over a distance there is nothing to return.
        start: The other states, shape (..., n, s); None for their start.
    """
    each = [(part, state) for part in model.friction for state in part.states]
    if not any(part.lags for part, _ in each):
        return None
    low = np.tile([own.start for _, own in each], (model.robot.dof, 1)) if start is None else np.array(start)
    high = low.copy()
    for k, (part, own) in enumerate(each):
        if part.lags:
            low[..., k], high[..., k] = own.low, own.high
    return low, high


def state_paths(model: DynamicModel, motion: Motion, step: float, ends: StatePaths | None) -> StatePaths | None:
    """Return the states of friction along a motion, shape (N, n, s) each, that begins with those of both ends (n, s).

    Args:
        model: Robot, drives and friction.
        motion: Samples that follow each other.
        step: Time from one to the next, in s.
        ends: As of :func:`end_states`; None for nothing to follow.
    """
    if ends is None:
        return None
    low, high = (np.asarray(model.with_states(motion, step, end).state) for end in ends)
    return low, high


def friction_between(
    model: DynamicModel, table: Array, motion: Motion, ends: StatePaths
) -> tuple[Array, Array, BoolArray]:
    """Return middle and half width of the friction of each drive between states of both ends, shape (N, n) each.

    Beside them stands where these have not come together yet.

    Args:
        model: Robot, drives and friction.
        table: Coefficients of its friction by drive, shape (n, k).
        motion: The motion, with the load where friction asks for it.
        ends: States along it from both ends on, shape (N, n, s) each.
    """
    low, high = (np.einsum("sjk,jk->sj", model.friction_values(replace(motion, state=state)), table) for state in ends)
    spans = [own.high - own.low if part.lags else np.inf for part in model.friction for own in part.states]
    apart = np.any(np.abs(ends[1] - ends[0]) > SETTLED * np.array(spans), axis=-1)
    return 0.5 * (low + high), 0.5 * np.abs(high - low), apart


def _creeping(model: DynamicModel, motion: Motion, sign: float) -> Motion:
    """Return the motion with all drives creeping one way."""
    creep = np.linalg.solve(np.asarray(model.robot.coupling), np.full(model.robot.dof, sign * CREEP))
    count = sum(len(part.states) for part in model.friction)
    state = np.zeros((*motion.q.shape, count)) if motion.state is None and count else motion.state
    if ends := end_states(model, state):
        state = ends[int(sign > 0)]
    return replace(motion, dq=np.broadcast_to(creep, motion.q.shape), state=state)


def _sharp(part: Friction) -> Friction:
    return replace(part, width=SHARP) if "width" in part.options else part  # type: ignore[call-arg]


def held_along(model: DynamicModel, thetas: Sequence[Array], prepared: Prepared) -> list[HeldTorque]:
    """Return the torques of several parameters along the kept rows of a log, filtered as the measured ones are.

    At rest the torque is taken as steady, so that its interval is filtered as it is. Elsewhere it may be anything that
    the filter makes of torques in their intervals.

    Args:
        model: Robot, drives and friction.
        thetas: Standard parameters, shape (p,) each.
        prepared: The log.
    """
    log = prepared.log
    motion = remembered_motion(model, log)
    speeds = motion.at_motors(np.asarray(model.robot.coupling)).dq
    rests = at_rest(speeds, rest_speeds(model.robot, prepared.how.standstill), log.rate)
    steady = (rests @ (np.asarray(model.robot.coupling) != 0)) > 0
    start = None if motion.state is None else motion.state[0]
    ends = None if isinstance(log.before, Log) else end_states(model, start)
    paths, found = state_paths(model, motion, 1.0 / log.rate, ends), []
    weights = _weights(prepared)
    for each in (held_torque(model, theta, motion, rests, paths) for theta in thetas):
        smooth = prepared.smooth(np.concatenate([each.torque, each.middle, each.half], axis=1).T).T[prepared.keep]
        torque, middle, half = np.split(smooth, 3, axis=1)
        half = np.maximum(half, np.where(steady, 0.0, _most(weights, each.half))[prepared.keep])
        found.append(HeldTorque(torque, middle, half, each.rests[prepared.keep]))
    return found


def _weights(prepared: Prepared) -> Array:
    """Return the sizes of the weights of the filter of a log about a sample, shape (2 reach + 1,)."""
    reach = prepared.how.filter.reach(prepared.log.rate)
    pulse = np.zeros((1, 2 * reach + 1))
    pulse[0, reach] = 1.0
    return np.abs(prepared.smooth(pulse)[0]) if reach else pulse[0]


def _most(weights: Array, half: Array) -> Array:
    """Return how large a filter leaves signals at most that nowhere exceed half widths (N, n).

    Its weights have both signs (it overshoots): it is the half widths times the size of each weight.
    """
    reach, most = len(weights) // 2, half.copy()
    if reach and (some := half.any(axis=0)).any():
        longer = np.pad(half[:, some], ((reach, reach), (0, 0)), mode="edge")
        size = min(k * 2 ** int(np.ceil(np.log2((len(longer) + 2 * reach) / k))) for k in (4, 5, 6))
        spectrum = np.fft.rfft(longer, size, axis=0) * np.fft.rfft(weights, size)[:, None]
        most[:, some] = np.maximum(np.fft.irfft(spectrum, size, axis=0)[2 * reach : 2 * reach + len(half)], 0.0)
    return most


def with_rest(estimate: Estimate, found: Validation, logs: Sequence[Prepared]) -> Validation:
    """Return a validation whose errors over all rows count samples at rest against what static friction can hold.

    So do those of the nominal inertias and of the fit without bounds of bodies. Samples in motion are counted as they
    were. Beside the errors stands how many samples at rest lie in the interval, wider by the 95 % band of the measured
    torque where that is known.

    Args:
        estimate: The estimate.
        found: Its validation on the logs.
        logs: The logs as they were prepared for it.
    """
    if not found.rests:
        return found
    model, nominal, bodies = estimate.model, found.nominal, Plausibility.of(estimate.run)
    thetas = {"own": parameters_of(estimate)}
    if nominal is not None and model.robot.nominal is not None:
        thetas["nominal"] = np.append(model.robot.nominal, list(nominal.friction.values()))
    if found.free_bodies_error is not None and bodies is not None:
        thetas["free"] = estimate.base.to_standard(np.array(bodies.free_beta))
    parts = zip(*(held_along(model, list(thetas.values()), log) for log in logs), strict=True)
    every = {name: _joined(own) for name, own in zip(thetas, parts, strict=True)}
    counted = _counted(found, replace(every["own"], torque=found.predicted))
    if nominal is not None and "nominal" in every:
        fitted = _counted(found, every["nominal"])
        errors = tuple(fit.relative_error for fit in fitted.joints)
        nominal = replace(nominal, friction_fitted=fitted.total_relative_error, joints_friction_fitted=errors)
    free = _counted(found, every["free"]).total_relative_error if "free" in every else found.free_bodies_error
    table = tuple(_at_rest(counted, every["own"]))
    return replace(counted, at_rest=table, nominal=nominal, free_bodies_error=free)


def with_rest_in_training(estimate: Estimate, logs: Sequence[Log]) -> Estimate:
    """Return an estimate whose training errors count samples at rest so.

    Args:
        estimate: The estimate.
        logs: The raw logs of its fit; each is prepared with the delay that the fit took out of it.
    """
    if not estimate.train.rests:
        return estimate
    how, names = estimate.preprocessing, estimate.model.robot.joint_names
    delays = [each.applied for each in estimate.choices.delays or ()] or [how.delay_s] * len(logs)
    pairs = zip(logs, delays, strict=True)
    prepared = [preprocess(log.ordered(names), replace(how, delay_s=delay)) for log, delay in pairs]
    return replace(estimate, train=with_rest(estimate, estimate.train, prepared))


def counted_at_rest(model: DynamicModel, theta: Array, found: Validation, logs: Sequence[Prepared]) -> Validation:
    """Return a validation of parameters (p,) on prepared logs whose errors count samples at rest so."""
    held = _joined([held_along(model, [theta], log)[0] for log in logs])
    return _counted(found, replace(held, torque=found.predicted)) if found.rests else found


def _at_rest(counted: Validation, held: HeldTorque) -> Iterator[dict[str, Any]]:
    """Yield of each joint that rests as plain data how its samples at rest lie to the interval."""
    widths, distances = counted.half_widths(), np.abs(counted.residual)
    for i, fit in enumerate(counted.joints):
        own = held.rests[:, i]
        if own.any():
            distance, bound = distances[own, i], 0.0 if widths is None else widths[1][own, i]
            half, beyond = (float(np.sqrt(np.mean(each**2))) for each in (held.half[own, i], distance))
            facts = {"name": fit.name, "unit": fit.unit, "samples": int(own.sum()), "half_width": half}
            yield facts | {"inside": float(np.mean(distance <= bound)), "rms_beyond": beyond}


def _counted(found: Validation, held: HeldTorque) -> Validation:
    """Return a validation of other torques of the model with the errors over all rows of the nearest ones."""
    names, units = zip(*((fit.name, fit.unit) for fit in found.joints), strict=True)
    own = replace(found, predicted=held.torque, held=held.bounds)
    joints = fits_of(names, units, own.measured, own.unfiltered, own.nearest, np.ones(own.nearest.shape, dtype=bool))
    total = ratio(np.linalg.norm(own.residual), np.linalg.norm(own.measured))
    return replace(own, joints=joints, total_relative_error=total)


def _joined(parts: Sequence[HeldTorque]) -> HeldTorque:
    """Return the torques along several logs, one after the other."""
    names = ("torque", "middle", "half", "rests")
    return HeldTorque(*(np.concatenate([getattr(one, name) for one in parts]) for name in names))
