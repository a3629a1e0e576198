"""Bootstrap: the spread of estimates over noise drawn anew.

Two of them. The block bootstrap draws blocks of the residual itself (Kuensch 1989; circular: Politis and Romano 1992)
of a length that the residual chooses (Politis and White 2004, corrected by Patton, Politis and White 2009), all joints
of a block together. The bootstrap of an estimate draws base parameters from its covariance and fits possible robots to
them again: what conditions narrow, and how the prior pulls, is in the spread.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.covariance import FEWEST_FREE, residual_factors
from dynident.identification.residuals.row_passes import RowPasses
from dynident.identification.residuals.stretches import Stretch, stretches
from dynident.model.reduction import Reduced, least_squares


@dataclass(frozen=True)
class BootstrapDraws:
    """Estimates over noise drawn anew.

    Attributes:
        beta: Base parameters, shape (D, b).
        theta: Standard parameters behind them, shape (D, p); None where the method finds base parameters only.
        block: Rows of a block, in samples of the logs; 0 where noise was drawn from the covariance.
    """

    beta: Array
    theta: Array | None = None
    block: float = 0.0

    @property
    def covariance(self) -> Array:
        """Of the base parameters, shape (b, b)."""
        return np.atleast_2d(np.cov(self.beta, rowvar=False))

    def interval(self, level: float = 0.95) -> tuple[Array, Array]:
        """Return the quantiles that hold a share of the draws, shapes (b,)."""
        low, high = np.quantile(self.beta, [0.5 - 0.5 * level, 0.5 + 0.5 * level], axis=0)
        return low, high


def block_bootstrap(problem: Problem, weights: Array, beta: Array, draws: int = 200) -> BootstrapDraws:
    """Return least-squares estimates over residuals drawn in circular blocks, each log by itself.

    Residuals are made as large as the noise: the fit takes b degrees of freedom of the rows, those that hang together
    counted once.

    Args:
        problem: The problem.
        weights: Weight of each joint's rows in the fit, shape (n,).
        beta: The estimate, shape (b,).
        draws: How many.
    """
    passes = RowPasses(problem)
    inverse = least_squares(problem.reduced(weights)).unscaled_covariance
    residual = passes.residuals(beta)
    independent = float(np.sum(problem.counts / residual_factors(passes, beta)))
    residual = residual / np.sqrt(max(1.0 - problem.base.count / independent, FEWEST_FREE))
    found = errors_drawn(stretches(passes), passes.columns, residual, weights, inverse, draws)
    return replace(found, beta=beta + found.beta)


def errors_drawn(
    parts: Iterable[Stretch],
    columns: Sequence[IntArray],
    residual: Array,
    weights: Array,
    inverse: Array,
    draws: int = 200,
    seed: int = 0,
) -> BootstrapDraws:
    """Return the errors of the same, from rows in stretches of time, their columns, residuals (N, n) and (X'X)^-1."""
    generator = np.random.default_rng(seed)
    found, blocks = np.zeros((draws, len(inverse))), list[float]()
    for stretch in parts:
        own = np.where(stretch.counting, residual[stretch.samples], 0.0)
        count = len(own)
        length = int(np.clip(round(automatic_block(own)), 1, count))
        blocks.append(length * stretch.step)
        starts = generator.integers(0, count, size=(draws, -(-count // length)))
        order = (starts[:, :, None] + np.arange(length)).reshape(draws, -1)[:, :count] % count
        for i, (mine, block) in enumerate(zip(columns, stretch.blocks, strict=True)):
            found[:, mine] += (weights[i] ** 2 * stretch.step) * own[order, i] @ block.T
    return BootstrapDraws(found @ inverse, block=float(np.mean(blocks)))


def automatic_block(series: Array) -> float:
    """Return the length of circular blocks that is best for means of a series (N, n), mean over its columns.

    Politis and White 2004: (2 G^2 / D)^(1/3) N^(1/3) with flat-top sums up to twice the lag beyond which
    autocorrelations are insignificant; D = 4/3 g(0)^2 for circular blocks.
    """
    count = len(series)
    found = []
    for column in series.T:
        centred = column - column.mean()
        if not np.any(centred):
            continue
        size = 2 ** int(np.ceil(np.log2(2 * count)))
        lags = np.fft.irfft(np.abs(np.fft.rfft(centred, size)) ** 2, size)[: count // 2 + 1] / count
        band = 2.0 * np.sqrt(np.log10(count) / count) * lags[0]
        calm = max(5, int(np.sqrt(np.log10(count))))
        large = np.abs(lags[1:]) > band
        quiet = np.convolve(large, np.ones(calm), "full")[calm - 1 :] == 0
        last = int(np.argmax(quiet)) if quiet.any() else len(large)
        reach = min(2 * max(last, 1), len(lags) - 1)
        k = np.arange(1, reach + 1)
        flat = np.minimum(1.0, 2.0 * (1.0 - k / reach)) if reach > 1 else np.ones(1)
        power = lags[0] + 2 * np.sum(flat * lags[k])
        slope = 2 * np.sum(flat * k * lags[k])
        found.append((1.5 * slope**2 / max(power, 1e-12 * lags[0]) ** 2 * count) ** (1 / 3))
    return float(np.clip(np.mean(found), 1.0, np.ceil(min(3 * np.sqrt(count), count / 3)))) if found else 1.0


def refitted(
    reduced: Reduced,
    beta: Array,
    covariance: Array,
    fit: Callable[[Reduced], Array],
    to_beta: Callable[[Array], Array],
    draws: int = 200,
) -> BootstrapDraws:
    """Return estimates of standard parameters over base parameters drawn from a normal distribution.

    Args:
        reduced: Weighted triangle of the fit.
        beta: Least-squares estimate about which is drawn, shape (b,).
        covariance: Its covariance, shape (b, b).
        fit: From a triangle to standard parameters, shape (p,).
        to_beta: From standard to base parameters.
        draws: How many.
    """
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    noise = np.random.default_rng(0).normal(size=(draws, len(beta))) @ root.T
    theta = np.array([fit(replace(reduced, z=reduced.r @ (beta + one))) for one in noise])
    return BootstrapDraws(np.array([to_beta(one) for one in theta]), theta)
