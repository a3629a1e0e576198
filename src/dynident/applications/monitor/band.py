"""The torque band of a monitor: how large the observer's residual is at a state, without any contact.

The variance of a joint's residual is a sum of known shapes with weights >= 0 that clean runs determine: constant noise;
the variance of the model's torque by the covariance of its parameters; noise of each velocity, which enters by the
momentum M dq; a share of the model's own torque (gains); of the speed; and what friction does near standstill. The
weights are those of largest likelihood for normal residuals of that variance, by Fisher scoring: least squares of the
squared residual over its variance, non-negative (McCullagh and Nelder 1989, section 10.5).

The residual is a first-order lag with a = exp(-K dt), so its variance follows that of the moment with a^2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.optimize
import scipy.signal

from dynident.applications.monitor.equations import Terms
from dynident.arrays import Array, frozen

#: Speeds near standstill, as shares of the root mean square speed of the clean runs.
NEAR = (0.02, 0.2)

#: Rounds of the scoring; weights change by less than a thousandth after them.
ROUNDS = 12

#: Squared residuals count up to this many times their variance: what is rarer is the business of the tail.
OUTLYING = 9.0

#: Most samples of the clean runs that the weights are found from.
ROWS = 20_000

#: Least share of a joint's mean square residual that is constant noise: no state is without any.
LEAST = 1e-3


@dataclass(frozen=True)
class BandWeights:
    """Weights of the variances that make up each joint's band.

    Attributes:
        weights: Shape (n, f), in the order of :func:`shapes`.
        speeds: Root mean square speed of each joint in the clean runs, shape (n,), in rad/s or m/s.
    """

    weights: Array
    speeds: Array

    def __post_init__(self) -> None:
        joints = len(self.speeds)
        object.__setattr__(self, "weights", frozen(self.weights, (joints, joints + 5 + len(NEAR)), "weights"))
        object.__setattr__(self, "speeds", frozen(self.speeds, (joints,), "speeds"))

    def variances(self, terms: Terms, deviations: Array, dq: Array) -> Array:
        """Return the variance of each joint's residual if it stayed at a state, shape (N, n), in (N m)^2 or N^2."""
        return np.einsum("sjf,jf->sj", shapes(terms, deviations, dq, np.asarray(self.speeds)), self.weights)


def shapes(terms: Terms, deviations: Array, dq: Array, speeds: Array) -> Array:
    """Return the shapes of the variance of each joint, (N, n, f).

    Args:
        terms: Of the equations.
        deviations: Standard deviation of the torque by the parameters' covariance, shape (N, n).
        dq: Velocities, shape (N, n).
        speeds: Their size in the clean runs, shape (n,).
    """
    count, joints = dq.shape
    found = np.empty((count, joints, joints + 5 + len(NEAR)))
    found[..., 0] = 1.0
    found[..., 1] = deviations**2
    found[..., 2] = terms.drift**2
    found[..., 3] = dq**2
    found[..., 4] = terms.momentum**2
    for k, share in enumerate(NEAR, start=5):
        found[..., k] = 1.0 / (1.0 + (dq / (share * speeds)) ** 2)
    found[..., 5 + len(NEAR) :] = terms.mass**2
    return found


def lagged(values: Array, keep: float) -> Array:
    """Return the values of a moment (N, ...) as a residual's variance follows them, from the first on."""
    fresh = 1.0 - keep**2
    start = values[:1] * keep**2
    return np.asarray(scipy.signal.lfilter([fresh], [1.0, -(keep**2)], values, axis=0, zi=start)[0])


def fitted_band(
    residuals: Sequence[Array], moments: Sequence[Array], keeps: Sequence[float], speeds: Array
) -> BandWeights:
    """Return the band of clean runs.

    Args:
        residuals: The observer's, by run, shape (N, n) each.
        moments: Shapes of the variance by run, shape (N, n, f) each.
        keeps: exp(-K dt) of each run.
        speeds: Size of each joint's speed, shape (n,).
    """
    stride = max(1, sum(map(len, residuals)) // ROWS)
    rows = np.concatenate([lagged(one, keep)[::stride] for one, keep in zip(moments, keeps, strict=True)])
    squares = np.concatenate([one[::stride] for one in residuals]) ** 2
    return BandWeights(np.array([_weights(squares[:, j], rows[:, j]) for j in range(squares.shape[1])]), speeds)


def _weights(squares: Array, rows: Array) -> Array:
    """Return the weights of one joint, shape (f,)."""
    mean = max(float(squares.mean()), 1e-24)
    sizes = rows.mean(axis=0)
    used = sizes > 0
    scaled = rows[:, used] / sizes[used] * mean
    variance = np.full(len(squares), mean)
    found = np.zeros(int(used.sum()))
    for _ in range(ROUNDS):
        capped = np.minimum(squares, OUTLYING * variance) / variance
        triangle = np.asarray(np.linalg.qr(np.column_stack([scaled / variance[:, None], capped]), mode="r"))
        found = scipy.optimize.nnls(triangle[:, :-1], triangle[:, -1])[0]
        found[0] = max(found[0], LEAST)
        variance = scaled @ found
    weights = np.zeros(rows.shape[1])
    weights[used] = found * mean / sizes[used]
    return weights
