"""What a log tells of a fault at most: the Cramer-Rao bound of its size, by the known truth.

The torque of the fault is known exactly here, as the log without it is: it is the one column that is fitted beside the
robot's, whose bodies have the earlier estimate for a prior, with the noise of the log without the fault. The checks
know neither which fault it is nor its phase, and look for errors of the model besides: no interval of theirs can be
narrower, and no fault be named that is not as sure as it has to be among all causes. Faults of the clock or of the
positions have no such column.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.faults.figures import WIDE, CleanLog
from benchmarks.faults.trials import Trial, subject_of
from dynident.arrays import Array
from dynident.diagnosis.causes.against_bodies import Anchored
from dynident.diagnosis.causes.cause_columns import CauseRows
from dynident.diagnosis.causes.cause_search import CHANCE, Cause
from dynident.diagnosis.causes.quick_fit import OVERSAMPLING, QuickFit
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.residuals.quantiles import chi_square_tail

#: Deviations of half a 95 % interval.
Z95 = 1.96


def sureness(faulty: Trial, clean: CleanLog, earlier: Estimate, folder: Path) -> float:
    """Return how many standard deviations a fault is from none at most; infinite where its torque is not known."""
    subject = replace(clean.subject, earlier=earlier)
    fit, known = subject.fit, subject.known
    column = None if fit is None else _torque(faulty, clean.trial, fit, folder)
    if fit is None or known is None or column is None:
        return np.inf
    rows, fault = fit.rows, Cause("the fault", "", column[None], is_filtered=True)
    target = rows.torque - rows.known
    found = CauseRows(rows.blocks, rows.columns, fit.base.count, target, rows.torque, rows.masks, OVERSAMPLING)
    solved = Anchored(found, [fault], known, fit.counts / fit.independent_rows).fit([0])
    return float(1.0 / np.sqrt(solved.covariance[-1, -1]))


def log_tells(grade: str, sure: float, clean: CleanLog) -> bool:
    """Return whether a log may tell a fault better than with a grade: name one that was missed, or a narrower interval.

    A false figure is never the log's.
    """
    trends = clean.subject.trends
    if grade == "wide":
        return Z95 / sure <= WIDE
    kinds = {(cause.name, bool(cause.joint)) for cause in trends.causes} if trends else ()
    return bool(grade or trends is None or len(kinds) * chi_square_tail(sure**2, 1) < CHANCE)


def _torque(faulty: Trial, right: Trial, fit: QuickFit, folder: Path) -> Array | None:
    """Return the torque of a fault, filtered as the rows of the fit are, shape (N, n); None where it is none."""
    wrong, stated = (np.asarray(one.case.robot.gravity) for one in (faulty, right))
    if any(not np.array_equal(faulty.columns[name], right.columns[name]) for name in ("t", "q")):
        return None
    if np.array_equal(wrong, stated):
        other = subject_of(faulty, folder).fit
        return (
            None
            if other is None or other.rows.torque.shape != fit.rows.torque.shape
            else (other.rows.torque - fit.rows.torque)
        )
    prepared = fit.rows.prepared
    still, *along = (regressor.predict(prepared.log, fit.plain.beta) for regressor in fit.gravity_observers)
    pull = np.tensordot(wrong - stated, np.stack(along) - still, 1)
    return prepared.smooth(pull.T)[:, prepared.keep].T
