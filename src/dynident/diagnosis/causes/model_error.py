"""What errors of the model make of a coefficient of a quick fit: how much its interval has to be wider.

What a model lacks, such as a bend of a link or friction that nobody described, is no noise: it comes back whenever the
arm comes back, the columns of the fit take most of it in, and what they leave looks small. It is taken as a normal
random function of the positions and velocities of all joints, each over its own standard deviation, with a squared
exponential covariance of unit length (Kennedy and O'Hagan 2001). The residual of each joint is that and white noise;
both variances follow from two quadratic forms of it, with what the fit takes in counted (Rao 1971).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.causes.cause_search import MANY
from dynident.diagnosis.causes.quick_fit import OVERSAMPLING, QuickFit
from dynident.diagnosis.causes.weighted_fit import RIDGE
from dynident.identification.problem.regressor_stream import motion_of
from dynident.identification.residuals.quantiles import student_quantile

#: Rows from one that is looked at to the next, so that noise leaves them independent, and how many are at most.
INDEPENDENT, MOST = int(OVERSAMPLING), 400


@dataclass(frozen=True)
class ModelError:
    """Covariance of an error of the model, of unit variance, between some of the rows of a fit.

    Attributes:
        every: Rows of the fit from one of these to the next.
        covariance: Shape (N, N).
    """

    every: int
    covariance: Array

    @classmethod
    def of_fit(cls, fit: QuickFit) -> ModelError:
        """Return that of the rows of a log."""
        motion = motion_of(fit.rows.prepared.kept)
        states = np.concatenate([np.asarray(motion.q), np.asarray(motion.dq)], axis=1)
        every = max(INDEPENDENT, int(np.ceil(len(states) / MOST)))
        states = states[::every] - states.mean(axis=0)
        spread = states.std(axis=0)
        states /= np.where(spread > 0.0, spread, 1.0) * np.sqrt(0.5 * states.shape[1])
        squares = np.sum(states**2, axis=1)
        apart = squares[:, None] + squares - 2.0 * states @ states.T
        return cls(every, np.exp(-0.5 * np.maximum(apart, 0.0)))

    def widening(self, columns: Sequence[Array], residuals: Sequence[Array], factors: Array) -> float:
        """Return the variance of the last coefficient over that of independent rows.

        It is that of rows that hang together at least. Where few errors tell theirs, it is as much larger as Student's
        intervals are wider (Satterthwaite 1946).

        Args:
            columns: Columns of the fit at each joint over the deviation of its residual, rows that do not count zero,
                shape (N, k) each.
            residuals: Over the same deviation, rows that do not count zero, shape (N,) each.
            factors: How much the rows of each joint hang together, shape (n,).
        """
        size = columns[0].shape[1]
        gram = sum((own.T @ own for own in columns), np.zeros((size, size)))
        scale = np.sqrt(np.diag(gram))
        scale[scale == 0.0] = 1.0
        values, vectors = np.linalg.eigh(gram / np.outer(scale, scale) + RIDGE * np.eye(size))
        root = vectors / np.sqrt(np.maximum(values, RIDGE)) / scale[:, None]  # the inverse is root root'
        with_error = together = independent = doubt = 0.0
        for own, residual, factor in zip(columns, residuals, factors, strict=True):
            influence, counts = own @ root @ root[-1], np.any(own != 0.0, axis=1).astype(float)
            error, noise, freedom = self._variances(own @ root, residual, counts)
            squares = float(influence @ influence) / self.every
            error *= float(influence @ self.covariance @ influence)
            with_error += error + noise * squares * INDEPENDENT
            doubt += error**2 / freedom
            together += factor * squares
            independent += squares
        freedom = min(with_error**2 / max(doubt, 1e-300), MANY)
        student = float(student_quantile(0.975, freedom) / student_quantile(0.975, MANY))
        return max(with_error * student**2, together) / max(independent, 1e-300)

    def _variances(self, taken: Array, residual: Array, counts: Array) -> tuple[float, float, float]:
        """Return the variances of error and noise at a joint, and the degrees of freedom behind that of the error.

        Of either the fit leaves M times it, M = D - T T' with D the rows that count and T = ``taken``, shape (N, k):
        traces of products with M are those of small matrices.
        """
        covariance = self.covariance * np.outer(counts, counts)
        carried, gram = covariance @ taken, taken.T @ taken
        both = taken.T @ carried
        of_error = float(np.trace(covariance) - 2.0 * np.trace(both) + np.sum(gram * both))
        of_noise = float(counts.sum() - 2.0 * np.trace(gram) + np.sum(gram**2))
        twice = float(np.sum(covariance**2) - 2.0 * np.sum(carried**2) + np.sum(both**2))
        squares, smooth = float(residual @ residual), float(residual @ covariance @ residual)
        freedom, whole = max(of_error**2 / max(twice, 1e-300), 1.0), of_noise * twice - of_error**2
        if whole > 0.0:
            error = (smooth * of_noise - squares * of_error) / whole
            noise = (squares * twice - smooth * of_error) / whole
            if error <= 0.0:
                return 0.0, squares / max(of_noise, RIDGE), freedom
            if noise >= 0.0:
                return error, noise, freedom
        return squares / max(of_error, RIDGE), 0.0, freedom
