"""How sure an estimate is where residuals are coloured, differ between logs and depend on each other between joints.

A covariance consistent under heteroscedasticity and autocorrelation (HAC), by frequency in place of a kernel over lags.

The error of every estimator here is, to first order, sum_i G_i X_i' v_i: X_i the rows of joint i, v_i their residuals
or what the estimator makes of them (bounded, signs, whitened between joints), G_i its influence; for least squares
with weights w it is w_i^2 A^-1. Its covariance is sum_f L(f)* S(f) L(f) over the frequencies (Hannan 1970, chapter
VII), L the rows times their influence, S the cross-power of the v_i, averaged over neighbouring frequencies (Daniell
1946). Two things make averages of a residual's power too small or too large where logs are short, and both are known
beforehand: the fit takes more from the residual at frequencies where the regressor is strong (its leverage h(f), as in
HC2 of MacKinnon and White 1985), and the power falls with that of the torque's filter |H(f)|^2 within the average. So
S(f) = |H|^2 avg(|v|^2) / avg(|H|^2 (1 - h)).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.bands import Band, bands
from dynident.identification.residuals.covariance import FEWEST_FREE
from dynident.identification.residuals.quantiles import student_quantile
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import least_squares, triangle_of
from dynident.model.threads import one_blas_thread

#: How often the power found takes the place of the filter's as the shape within an average.
SHARPENED = 2


@dataclass(frozen=True)
class Uncertainty:
    """Covariance of an estimate and how well it is known itself.

    Attributes:
        covariance: Of the base parameters, shape (b, b).
        degrees: Degrees of freedom of each variance (Satterthwaite 1946), for quantiles of Student's t, shape (b,).
    """

    covariance: Array
    degrees: Array

    @property
    def deviations(self) -> Array:
        """Standard deviation of each base parameter, shape (b,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def half_widths(self, level: float = 0.95) -> Array:
        """Return half the width of the interval that holds each parameter at a level of confidence, shape (b,)."""
        return self.deviations * student_quantile(0.5 + 0.5 * level, self.degrees)

    def with_prior(self, spread: Array) -> Uncertainty:
        """Return the same with an error beside it that is known to have the covariance ``spread``, shape (b, b)."""
        both = self.covariance + spread
        own = np.maximum(np.diag(self.covariance), np.finfo(float).tiny)
        return Uncertainty(both, self.degrees * np.maximum(np.diag(both) / own, 1.0) ** 2)


@dataclass(frozen=True)
class Influence:
    """An estimator to first order: its error is sum_i gains_i X_i' v_i over the rows X_i of each joint.

    Attributes:
        gains: Shape (n, b, m), m columns of the rows; where m > b the regressor is the last b of them.
        plain: Covariance of the error were all rows independent, shape (b, b).
        slopes: How much less of v_i is left for an error d of the parameters: sum_j slopes_ij x_j' d, shape (n, n).
    """

    gains: Array
    plain: Array
    slopes: Array

    @classmethod
    def of_rows(
        cls, problem: Problem, values: Array, inverse: Array, gains: Array, slopes: Array | None = None
    ) -> Influence:
        """Return that of an error inverse sum_i gains_i X_i' v_i, one number a joint.

        Args:
            problem: The problem.
            values: v, over the samples of all logs, shape (N, n).
            inverse: Shape (b, b).
            gains: Of each joint, shape (n,).
            slopes: What x_i' d takes from v_i, shape (n,); None: 1, as for residuals.
        """
        size = np.sqrt(np.sum(values**2, axis=0) / np.maximum(problem.counts, 1))
        root = problem.reduced(gains * size).r @ inverse.T
        taken = np.ones(len(gains)) if slopes is None else slopes
        return cls(gains[:, None, None] * inverse, root.T @ root, np.diag(taken))


def uncertainty_of(
    found: Iterable[Band], values: Array, influence: Influence, asked: Array | None = None
) -> Uncertainty:
    """Return the covariance of an estimate from its rows by frequency.

    Args:
        found: The rows, from ``bands``.
        values: v of the estimate over the samples of all logs, zero where a row has no say, shape (N, n).
        influence: The estimator.
        asked: Gains of what is asked for, in the place of the estimate itself, shape (n, k, m).
    """
    wanted = influence.gains if asked is None else asked
    size = wanted.shape[1]
    covariance, total, doubt = np.zeros((size, size)), np.zeros(size), np.zeros(size)
    for band in found:
        with one_blas_thread():
            parts, share, freedom = _errors(band, values, influence, wanted)
            covariance += parts.T @ parts
        total += share.sum(axis=(0, 1))
        doubt += np.sum(share**2 / freedom[:, :, None], axis=(0, 1))
    degrees = total**2 / np.where(doubt > 0, doubt, np.inf)
    return Uncertainty(covariance, np.where(doubt > 0, np.maximum(degrees, 1.0), np.inf))


def error_root(found: Iterable[Band], values: Array, influence: Influence, asked: Array) -> Array:
    """Return a triangle S with S'S the covariance of what is asked for, shape (s, k); see :func:`uncertainty_of`."""
    root = np.zeros((0, asked.shape[1]))
    for band in found:
        with one_blas_thread():
            root = triangle_of(np.concatenate([root, _errors(band, values, influence, asked)[0]]))
    return root


def _errors(band: Band, values: Array, influence: Influence, asked: Array) -> tuple[Array, Array, Array]:
    """Return rows whose squares sum to the covariance, (2 F n, k), and power and freedom of each average."""
    spread = _product(band.rows, asked)
    left = left_over(band, values, influence, spread if asked is influence.gains else None)
    power = cross_power(band, values, left)
    spectrum, vectors = np.linalg.eigh(power)
    roots = vectors * np.sqrt(np.maximum(spectrum, 0.0) * band.twice[:, None])[:, None, :]
    parts = (np.conj(np.swapaxes(roots, 1, 2)) @ spread).reshape(-1, asked.shape[1])
    # Frequencies within one average rise and fall together, so each average counts once.
    groups = np.arange(0, len(band.shape), band.width)
    own = band.twice[:, None] * np.real(np.einsum("fii->fi", power))
    share = np.add.reduceat(_square(spread) * own[:, :, None], groups, axis=0)
    freedom = np.add.reduceat(band.twice[:, None] * _free(band, left, band.shape[:, None]), groups, axis=0)
    return np.concatenate([parts.real, parts.imag]), share, freedom


def _square(values: Array) -> Array:
    return values.real**2 + values.imag**2


def _product(rows: Array, gains: Array) -> Array:
    """Return the rows (F, n, m) of each joint times its gains (n, k, m), shape (F, n, k)."""
    found = np.empty((len(rows), *gains.shape[:2]), dtype=complex)
    for i, own in enumerate(gains):
        # Contiguous real products take a tenth of the time of complex or strided ones.
        found[:, i].real = np.ascontiguousarray(rows[:, i].real) @ own.T
        found[:, i].imag = np.ascontiguousarray(rows[:, i].imag) @ own.T
    return found


def left_over(band: Band, values: Array, influence: Influence, spread: Array | None = None) -> Array:
    """Return the share of the power of each v_i that the fit leaves at each frequency, shape (F, n).

    E|v_i - y_i d|^2 / E|v_i|^2 = 1 - 2 Re(y_i* L_i) + y_i C y_i* / s_i^2 with y_i the slopes times the regressor and C
    the plain covariance; for least squares with the right weights it is 1 - h.

    Args:
        band: The stretch.
        values: v, over the samples of all logs, shape (N, n).
        influence: The estimator.
        spread: L, the rows times their influence, where it is there already, shape (F, n, b).
    """
    size = influence.gains.shape[1]
    regressor, slopes = band.rows[:, :, -size:], influence.slopes
    if np.count_nonzero(slopes - np.diag(np.diag(slopes))):
        taken = np.einsum("ij,fjb->fib", slopes, regressor)
    else:
        taken = regressor * np.diag(slopes)[:, None]
    spread = _product(band.rows, influence.gains) if spread is None else spread
    again = _product(taken, np.broadcast_to(influence.plain, (len(slopes), size, size)))
    mean = np.sum(values**2, axis=0) / max(len(values), 1)
    own = np.sum(taken.real * spread.real + taken.imag * spread.imag, axis=2)
    both = np.sum(taken.real * again.real + taken.imag * again.imag, axis=2)
    return 1.0 - 2.0 * own + both / np.where(mean > 0, mean, np.inf)


def cross_power(band: Band, values: Array, left: Array) -> Array:
    """Return the cross-power of the joints' residuals at each frequency, shape (F, n, n), Hermitian, >= 0.

    Args:
        band: The stretch.
        values: Shape (N, n).
        left: Share of the power of each joint that the fit leaves at each frequency, shape (F, n).
    """
    transform = band.transformed(values)
    power = transform[:, :, None] * np.conj(transform)[:, None, :]
    power = band.averaged(power.real) + 1j * band.averaged(power.imag)
    own = np.maximum(np.real(np.einsum("fii->fi", power)), 0.0)  # running sums leave a little less than nothing
    live = np.maximum(band.counting.mean(axis=0), 1.0 / len(band.samples))
    most = own * band.width / (FEWEST_FREE * live)  # all power of an average at one frequency
    shape = np.repeat(band.shape[:, None], own.shape[1], axis=1)
    for _ in range(SHARPENED):
        over = band.averaged(shape) * _free(band, left, shape) * live
        shape = np.minimum(shape * own / np.maximum(over, 1e-300), most)
    ratio = np.sqrt(shape / np.maximum(own, 1e-300))
    return power * ratio[:, :, None] * ratio[:, None, :]


def _free(band: Band, left: Array, shape: Array) -> Array:
    """Return the share of the residual's power that the fit leaves, about each frequency, shape (F, n)."""
    mean = band.averaged(shape * np.maximum(left, 0.0))
    return np.maximum(mean / np.maximum(band.averaged(shape), 1e-300), FEWEST_FREE)


def spectral_uncertainty(problem: Problem, weights: Array, beta: Array, passes: RowPasses | None = None) -> Uncertainty:
    """Return the covariance of least squares with one weight a joint, residuals coloured as they are.

    Args:
        problem: The problem.
        weights: Weight of each joint's rows in the fit, shape (n,).
        beta: The estimate, shape (b,).
        passes: The rows, where they are there already.
    """
    passes = passes or RowPasses(problem)
    residual = passes.residuals(beta)
    inverse = least_squares(problem.reduced(weights)).unscaled_covariance
    return uncertainty_of(bands(passes), residual, Influence.of_rows(problem, residual, inverse, weights**2))
