"""What errors of the model make of a coefficient of a quick fit: how much its interval has to be wider.

What a model lacks, such as a bend of a link, an axis that is a little off, or friction that nobody described, is no
noise: it comes back whenever the arm comes back, the columns of the fit take most of it in, and what they leave looks
small. At each joint it is taken as two normal random functions of the same variance, one of the positions, velocities
and accelerations of all joints, one of its own, each over its standard deviation, with squared exponential covariances
(Kennedy and O'Hagan 2001). The residual of each joint is these and white noise; both variances follow from two
quadratic forms of it, with what the fit takes in counted (Rao 1971).

Errors of the frames of the robot model show in no residual: bodies take in most of what they do. Theirs are those of
parts that are made within general tolerances (:mod:`dynident.diagnosis.causes.frame_errors`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.causes.cause_search import MANY
from dynident.diagnosis.causes.quick_fit import OVERSAMPLING, QuickFit
from dynident.diagnosis.causes.weighted_fit import RIDGE
from dynident.identification.problem.regressor_stream import motion_of
from dynident.identification.residuals.quantiles import student_quantile

#: Length of the covariance in standard deviations of a state.
LENGTH = 2.0

#: Rows from one that is looked at to the next, so that noise leaves them independent, and how many are at most.
INDEPENDENT, MOST = int(OVERSAMPLING), 400


@dataclass(frozen=True)
class ModelError:
    """Covariance of an error of the model, of unit variance, between some of the rows of a fit.

    Attributes:
        every: Rows of the fit from one of these to the next.
        covariances: Those at each joint, shape (N, N) each.
        frames: Torques by an error of each axis of one standard deviation, shape (f, N, n); None where axes are right.
    """

    every: int
    covariances: Sequence[Array]
    frames: Array | None = None

    @classmethod
    def of_fit(cls, fit: QuickFit) -> ModelError:
        """Return that of the rows of a log."""
        motion = motion_of(fit.rows.prepared.kept)
        states = np.stack([np.asarray(part) for part in (motion.q, motion.dq, motion.ddq)], axis=2)
        every = max(INDEPENDENT, int(np.ceil(len(states) / MOST)))
        states = states[::every] - states.mean(axis=0)
        spread = states.std(axis=0)
        states /= LENGTH * np.where(spread > 0.0, spread, 1.0)
        joints = states.shape[1]
        apart = [np.sum((own[:, None] - own) ** 2, axis=2) for own in states.transpose(1, 0, 2)]
        of_all = np.exp(-0.5 * np.sum(apart, axis=0) / joints)
        return cls(every, [0.5 * (of_all + np.exp(-0.5 * own)) for own in apart])

    def of_rows(
        self, columns: Sequence[Array], residuals: Sequence[Array], deviations: Array | None = None
    ) -> FitErrors:
        """Return the errors that such rows of a fit have.

        Args:
            columns: Columns of the fit at each joint over the deviation of its residual, rows that do not count zero,
                shape (N, k) each.
            residuals: Over the same deviation, rows that do not count zero, shape (N,) each.
            deviations: These, shape (n,); 1 without them.
        """
        root, variances = _root_of_inverse(columns), []
        for own, residual, covariance in zip(columns, residuals, self.covariances, strict=True):
            counts = np.any(own != 0.0, axis=1).astype(float)
            variances.append(_variances(own @ root, residual, counts, covariance * np.outer(counts, counts)))
        deviations = np.ones(len(columns)) if deviations is None else deviations
        return FitErrors(self, columns, root, tuple(variances), deviations)


@dataclass(frozen=True)
class FitErrors:
    """What errors of the model are in the rows of a fit.

    Attributes:
        model: Their covariance.
        columns: Columns of the fit at each joint, as of :meth:`ModelError.of_rows`, shape (N, k) each.
        root: R with R R' the covariance of the coefficients for independent rows, shape (k, k).
        variances: Variances of error and noise at each joint, and the degrees of freedom behind that of the error.
        deviations: Standard deviations of the residual that the columns are over, shape (n,).
    """

    model: ModelError
    columns: Sequence[Array]
    root: Array
    variances: tuple[tuple[float, float, float], ...]
    deviations: Array

    def with_columns(self, columns: Sequence[Array], deviations: Array) -> FitErrors:
        """Return the same errors in the rows of a fit with other columns, (N, k) each, over other deviations, (n,)."""
        return replace(self, columns=columns, root=_root_of_inverse(columns), deviations=deviations)

    def widening(self, place: int, factors: Array) -> float:
        """Return the variance of a coefficient over that of independent rows.

        It is that of rows that hang together at least. Where few errors tell theirs, it is as much larger as Student's
        intervals are wider (Satterthwaite 1946).

        Args:
            place: The coefficient.
            factors: How much the rows of each joint hang together, shape (n,).
        """
        influences = [own @ (self.root @ self.root[place]) for own in self.columns]
        squares = np.array([influence @ influence for influence in influences]) / self.model.every
        if not squares.any():
            return 1.0  # the coefficient of a column of zeros
        return max(self.variance(influences), float(factors @ squares)) / float(squares.sum())

    def variance(self, influences: Sequence[Array]) -> float:
        """Return the variance of a coefficient by errors of the model and noise, times that of Student's intervals.

        Args:
            influences: What it rises by at each joint with a residual of one of its standard deviations that lasts from
                one of these rows to the next, shape (N,) each.
        """
        total = doubt = 0.0
        for influence, (error, noise, freedom), covariance in zip(
            influences, self.variances, self.model.covariances, strict=True
        ):
            smooth = error * float(influence @ covariance @ influence)
            total += smooth + noise * float(influence @ influence) / self.model.every * INDEPENDENT
            doubt += smooth**2 / freedom
        if self.model.frames is not None:
            total += float(np.sum(np.tensordot(self.model.frames, np.stack(influences, 1) / self.deviations) ** 2))
        freedom = min(total**2 / max(doubt, 1e-300), MANY)
        student = float(student_quantile(0.975, freedom) / student_quantile(0.975, MANY))
        return total * student**2


def _root_of_inverse(columns: Sequence[Array]) -> Array:
    """Return R (k, k) with R R' the covariance of the coefficients of columns (N, k) at each joint."""
    size = columns[0].shape[1]
    gram = sum((own.T @ own for own in columns), np.zeros((size, size)))
    scale = np.sqrt(np.diag(gram))
    scale[scale == 0.0] = 1.0
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale) + RIDGE * np.eye(size))
    return vectors / np.sqrt(np.maximum(values, RIDGE)) / scale[:, None]


def _variances(taken: Array, residual: Array, counts: Array, covariance: Array) -> tuple[float, float, float]:
    """Return the variances of error and noise at a joint, and the degrees of freedom behind that of the error.

    Of either the fit leaves M times it, M = D - T T' with D the rows that count and T = ``taken``, shape (N, k):
    traces of products with M are those of small matrices.
    """
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
