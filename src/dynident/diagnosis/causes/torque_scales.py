"""The scale of one joint's torque as an unknown of the fit, with its interval: what the other joints and friction say.

The bodies are shared by all joints. Where the torque of one joint has another scale, a fit with that scale free is far
better; its profile likelihood (Seber and Wild 2003, section 5.4) gives the interval. A scale that the joint's own
parameters take in, such as that of a first vertical axis, leaves the likelihood flat: the interval is then wide, and no
figure is told.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.causes.quick_fit import RIDGE, QuickFit
from dynident.identification.residuals.covariance import correlation_factors

#: Logarithms of the factors between which a scale is looked for, and their distance.
WIDEST, STEP = 5.0, 0.5

#: First step of the search from a linear estimate, and the rounds in which its own size is weighed.
NEAR, ROUNDS = 0.02, 4

#: Rise of the deviance at the ends of a 95 % interval of one unknown, and the precision of the logarithms.
RISE, PRECISION = 3.84, 1e-3


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


def joint_scales(fit: QuickFit) -> tuple[JointScale, ...]:
    """Return the scale of each joint's torque where only that one has another."""
    return tuple(_scale(fit, k, name) for k, name in enumerate(fit.model.robot.joint_names))


def _scale(fit: QuickFit, joint: int, name: str) -> JointScale:
    def logs(x: float) -> Array:
        """Return the log variances of the joints in their own scales at the factor e^x, shape (n,)."""
        found = np.log(fit.solve(fit.triangles, _mixing(fit, joint, x)).variances)
        found[joint] -= 2 * x
        return found

    grid = np.arange(-WIDEST, WIDEST + STEP, STEP).tolist()
    coarse = min(grid, key=lambda x: float(logs(x).sum()))
    starts = [(coarse, STEP / 2), *((x, NEAR) for x in _linear(fit, joint))]
    best, at_best = min((_refined(logs, *start) for start in starts), key=lambda found: float(found[1].sum()))
    worth = fit.counts / _together(fit, joint, best)
    low, high = (_end(lambda x: float(worth @ (logs(x) - at_best)), best, side) for side in (-1.0, 1.0))
    gain = float(fit.plain.score - at_best.sum())
    return JointScale(name, float(np.exp(best)), float(np.exp(low)), float(np.exp(high)), gain)


def _refined(logs: Callable[[float], Array], best: float, step: float) -> tuple[float, Array]:
    """Return where the likelihood is largest near a start, and the log variances there (Hooke and Jeeves 1961)."""
    found = logs(best)
    while step > PRECISION:
        sides = [(side, logs(side)) for side in (best - step, best + step)]
        side, values = min(sides, key=lambda each: float(each[1].sum()))
        if values.sum() < found.sum() and abs(side) <= 2 * WIDEST:
            best, found = side, values
        else:
            step /= 2
    return best, found


def _linear(fit: QuickFit, joint: int) -> list[float]:
    """Return the logarithm of the factor as one more linear unknown: W beta less the factor's torque is what is known.

    Joints weigh by the size of their torques. Noise of the torque makes the factor too small by about its share of the
    variance: a start, as the valley is often narrow.
    """
    size = fit.base.count
    factor = 1.0
    for _ in range(ROUNDS):
        gram, side = RIDGE * np.eye(size + 1), np.zeros(size + 1)
        for i, (own, triangle) in enumerate(fit.triangles):
            logged, known = triangle[:, len(own) + i], triangle[:, -1]
            weight = 1.0 / max(float(np.linalg.norm(logged)) * (factor if i == joint else 1.0), 1e-300)
            added = logged if i == joint else np.zeros(len(logged))
            columns, every = np.column_stack([triangle[:, : len(own)], -added]) * weight, np.append(own, size)
            gram[np.ix_(every, every)] += columns.T @ columns
            side[every] += columns.T @ (weight * (logged - added - known))
        scale = np.sqrt(np.diag(gram))
        found = float(np.linalg.solve(gram / np.outer(scale, scale), side / scale)[-1] / scale[-1])
        if not found > 0:
            return []
        factor = found
    return [float(np.log(factor))]


def _mixing(fit: QuickFit, joint: int, x: float) -> Array:
    mixing = np.eye(fit.model.robot.dof)
    mixing[joint, joint] = np.exp(x)
    return mixing


def _together(fit: QuickFit, joint: int, x: float) -> Array:
    """Return by how much the rows of each joint hang together once the scale is right, shape (n,)."""
    mixing = _mixing(fit, joint, x)
    beta = fit.solve(fit.triangles, mixing).beta
    residual = fit.residual_of(fit.rows, beta) + fit.rows.torque @ (mixing - np.eye(len(mixing))).T
    return correlation_factors([residual], [fit.rows.masks])


def _end(rise: Callable[[float], float], best: float, side: float) -> float:
    """Return where the deviance has risen enough on one side; infinite where it does not."""
    step = PRECISION
    while rise(best + side * step) < RISE:
        step *= 2
        if step > WIDEST:
            return side * np.inf
    low, high = step / 2, step
    for _ in range(6):
        middle = (low + high) / 2
        low, high = (middle, high) if rise(best + side * middle) < RISE else (low, middle)
    return best + side * high
