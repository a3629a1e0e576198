"""The scale of one joint's torque as an unknown of the fit, with its interval: what the other joints and friction say.

The bodies are shared by all joints. Where the torque of one joint has another scale, a fit with that scale free is far
better; its profile likelihood (Seber and Wild 2003, section 5.4) gives the interval. A scale that the joint's own
parameters take in, such as that of a first vertical axis, leaves the likelihood flat: the interval is then wide, and no
figure is told.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.causes.column_readings import GOOD
from dynident.diagnosis.causes.held_out import HeldOutErrors, ReadRows, predicts_unseen
from dynident.diagnosis.causes.line_search import Found, Search, lowest_near, run, side_by_side
from dynident.diagnosis.causes.model_error import ModelError
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.weighted_fit import RIDGE
from dynident.identification.residuals.covariance import correlation_factors

#: Logarithms of the factors between which a scale is looked for, their distance, and how near a linear estimate is.
WIDEST, STEP, NEAR = 5.0, 1.0, 0.1

#: Rounds in which a joint's own size is weighed in the linear estimate.
ROUNDS = 4

#: Rise of the deviance at the ends of a 95 % interval of one unknown, precision of the logarithms and of these ends.
RISE, PRECISION, ENDS = 3.84, 1e-3, 0.02

#: Half-width of an interval in logarithms up to which a figure stands, and from which the log does not tell the scale.
SHARP, BLUNT = 0.1, 0.25

#: Gain of the score from which one torque has another scale: where its figure stands, and where it does not. Errors of
#: the model bring gains of 0.9 without any.
SHARP_GAIN, GAIN = 0.5, 1.5

#: Gain of the score from which the scale of a joint is an error, where it predicts samples that it was not found on.
SURE_GAIN = 3.0

#: Least factor that is told, and the share of the largest gain from which another joint explains it as well.
FACTOR, RIVAL = 1.2, 0.8


@dataclass(frozen=True)
class JointScale:
    """The factor that a joint's torque has to be multiplied by.

    Attributes:
        joint: Name of the joint.
        factor: The likeliest one.
        low: Lower end of its 95 % interval; 0 where there is none.
        high: Upper end; infinite where there is none.
        gain: By how much the fit is better with it, in log variance.
    """

    joint: str
    factor: float
    low: float
    high: float
    gain: float

    @property
    def spread(self) -> float:
        """Half the interval in logarithms: about the relative half-width."""
        return float(np.log(self.high / self.low)) / 2 if self.low > 0 and np.isfinite(self.high) else np.inf

    @property
    def is_other(self) -> bool:
        """Whether the torque has another scale than the others' fit asks for."""
        far = max(self.factor, 1 / self.factor) >= FACTOR and not self.low <= 1 <= self.high
        return far and self.gain >= (SHARP_GAIN if self.spread <= SHARP else GAIN)

    @property
    def is_open(self) -> bool:
        """Whether the log does not tell the scale."""
        return self.spread > BLUNT


def joint_scales(fit: QuickFit, joints: Sequence[str] | None = None) -> tuple[JointScale, ...]:
    """Return the scale of the torque of each joint, or of some by name, where only that one has another."""

    def logs(asked: Sequence[tuple[int, float]]) -> list[Array]:
        """Return the log variances (n,) of the joints in their own scales, one joint's at the factor e^x."""
        found = np.log(fit.variances(fit.shared, np.array([_mixing(fit, *each) for each in asked])))
        for own, (joint, x) in zip(found, asked, strict=True):
            own[joint] -= 2 * x
        return list(found)

    error = ModelError.of_fit(fit)
    wanted = [k for k, name in enumerate(fit.model.robot.joint_names) if joints is None or name in joints]
    return tuple(run(side_by_side([_scale(fit, joint, error) for joint in wanted]), logs))


def other_scales(scales: Sequence[JointScale]) -> tuple[JointScale, ...]:
    """Return the joint whose torque has another scale and those that explain the log about as well, the best first."""
    ranked = sorted(scales, key=lambda scale: -scale.gain)
    if not ranked or not ranked[0].is_other:
        return ()
    return tuple(scale for scale in ranked if scale.is_other and scale.gain >= RIVAL * ranked[0].gain)


def reading_of(fit: QuickFit, scale: JointScale) -> ReadRows:
    """Return the rows of a log with the torque of a joint multiplied by its factor."""
    return ReadRows(fit.rows, mixing_of(fit, scale))


def mixing_of(fit: QuickFit, scale: JointScale) -> Array:
    """Return what the torques are multiplied by, shape (n, n), where a joint has its own factor."""
    return _mixing(fit, fit.model.robot.joint_names.index(scale.joint), float(np.log(scale.factor)))


def is_sure(fit: QuickFit, scale: JointScale) -> bool:
    """Return whether the scale of a joint is far off, explains it, and predicts samples that it was not found on.

    One without an end, or beside which the joint is not explained, fits where the torque has nothing to do with the
    bodies: another cause then, or none at all.
    """
    if scale.gain <= SURE_GAIN or not np.isfinite(scale.spread):
        return False
    joint = fit.model.robot.joint_names.index(scale.joint)
    torque = fit.rows.torque[fit.rows.masks[:, joint], joint]
    left = HeldOutErrors(fit).errors(reading_of(fit, scale))[:, joint].sum()
    if left > GOOD**2 * np.var(torque) * len(torque):
        return False

    def found_on(learned: QuickFit) -> ReadRows:
        return reading_of(learned, joint_scales(learned, [scale.joint])[0])

    return predicts_unseen(fit, found_on)


def _scale(fit: QuickFit, joint: int, error: ModelError) -> Search[tuple[int, float], Array, JointScale]:
    """Return the scale of a joint by log variances (n,) of the joints at logarithms of its factor."""
    name = fit.model.robot.joint_names[joint]
    if not fit.moves[joint]:
        return JointScale(name, 1.0, 0.0, np.inf, 0.0)
    grid = [(x, STEP / 2) for x in np.arange(-WIDEST, WIDEST + STEP, STEP).tolist()]
    grid += [(x, NEAR) for x in _linear(fit, joint)]
    values = yield [(joint, x) for x, _ in (*grid, (0.0, 0.0))]
    start, near = grid[int(np.argmin([float(each.sum()) for each in values[:-1]]))]
    best = yield from _measured(lowest_near(start, near, PRECISION / 2), joint, lambda each: float(each.sum()))
    (at_best,) = yield [(joint, best)]
    worth = _worth(fit, joint, best, error)
    ends = side_by_side([_end(best, side) for side in (-1.0, 1.0)])
    low, high = yield from _measured(ends, joint, lambda each: float(worth @ (each - at_best)))
    gain = float(values[-1].sum()) - float(at_best.sum())
    return JointScale(name, float(np.exp(best)), float(np.exp(low)), float(np.exp(high)), gain)


def _measured(
    search: Search[float, float, Found], joint: int, measure: Callable[[Array], float]
) -> Search[tuple[int, float], Array, Found]:
    """Return what a search finds by a measure of the log variances at logarithms of a joint's factor."""
    try:
        wanted = next(search)
        while True:
            found = yield [(joint, x) for x in wanted]
            wanted = search.send([measure(each) for each in found])
    except StopIteration as end:
        return end.value


def _linear(fit: QuickFit, joint: int) -> list[float]:
    """Return the logarithm of the factor as one more linear unknown: W beta less the factor's torque is what is known.

    Joints weigh by the size of their torques. Noise of the torque makes the factor too small by about its share of the
    variance: a start, as the valley is often narrow.
    """
    products, size, factor = fit.triangles.products, fit.base.count, 1.0
    every, taken = np.arange(len(products.grams)), np.eye(len(products.grams))[joint]
    squares, at_joint = products.squares[every, every, every], products.squares[joint, joint]
    sides = products.sides[every, :, every] * (1.0 - taken)[:, None] - products.sides[:, :, -1]
    for _ in range(ROUNDS):
        weights = 1.0 / np.maximum(squares * np.where(taken > 0, factor**2, 1.0), 1e-300)
        gram, side = RIDGE * np.eye(size + 1), np.append(weights @ sides, weights[joint] * at_joint[-1])
        gram[:size, :size] += np.tensordot(weights, products.grams, 1)
        gram[:size, size] = gram[size, :size] = -weights[joint] * products.sides[joint, :, joint]
        gram[size, size] += weights[joint] * at_joint[joint]
        scale = np.sqrt(np.diag(gram))
        found = float(np.linalg.lstsq(gram / np.outer(scale, scale), side / scale)[0][-1] / scale[-1])
        if not found > 0:
            return []
        factor = found
    return [float(np.log(factor))]


def _mixing(fit: QuickFit, joint: int, x: float) -> Array:
    mixing = np.eye(fit.model.robot.dof)
    mixing[joint, joint] = np.exp(x)
    return mixing


def _worth(fit: QuickFit, joint: int, x: float, error: ModelError) -> Array:
    """Return what rows of each joint are worth once the scale is right, shape (n,): errors of the model count."""
    mixing, rows = _mixing(fit, joint, x), fit.rows
    solved = fit.solve(fit.triangles.products, mixing)
    residual = fit.residual_of(rows, solved.beta) + rows.torque @ (mixing - np.eye(len(mixing))).T
    factors = correlation_factors([residual], [rows.masks])
    every, columns, residuals = slice(None, None, error.every), [], []
    for i, (block, own) in enumerate(zip(rows.blocks, rows.columns, strict=True)):
        deviation, counts = float(np.sqrt(solved.variances[i])), rows.masks[every, i]
        here = np.zeros((len(counts), len(solved.beta) + 1))
        here[:, own] = block[every]
        here[:, -1] = -(block[every] @ solved.beta[own]) * (i == joint)
        columns.append(np.where(counts[:, None], here / deviation, 0.0))
        residuals.append(np.where(counts, residual[every, i] / deviation, 0.0))
    return fit.counts / error.of_rows(columns, residuals).widening(-1, factors)


def _end(best: float, side: float) -> Search[float, float, float]:
    """Return where the deviance has risen enough on one side; infinite where it does not."""
    low, high, below, (above,) = 0.0, PRECISION, 0.0, (yield [best + side * PRECISION])
    while above < RISE:
        low, high, below = high, 4 * high, above
        if high > WIDEST:
            return side * np.inf
        (above,) = yield [best + side * high]
    while high - low > ENDS * high:  # the deviance is about a parabola: its root is about straight
        roots = np.sqrt(np.maximum([below, RISE, above], 0.0))
        share = float(np.clip((roots[1] - roots[0]) / max(roots[2] - roots[0], 1e-300), ENDS, 1.0 - ENDS))
        middle = low + share * (high - low)
        (found,) = yield [best + side * middle]
        if abs(np.sqrt(max(found, 0.0)) - roots[1]) < ENDS * roots[1] / 2:
            return best + side * middle
        low, high, below, above = (middle, high, found, above) if found < RISE else (low, middle, below, found)
    return best + side * high
