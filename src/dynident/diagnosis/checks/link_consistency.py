"""Links that cannot be consistent with the torques, beyond noise and model error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.causes.body_consistency import DRAWS, inconsistency
from dynident.diagnosis.causes.cause_columns import CauseRows
from dynident.diagnosis.causes.cause_search import CauseSearch
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.robot_misfit import presliding
from dynident.diagnosis.causes.trend_findings import is_grave
from dynident.diagnosis.causes.trends import DELAY
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding


def _bent(rows: CauseRows, fit: QuickFit) -> Array:
    """Return the torque of friction that builds up after reversals, as fitted beside the bodies, shape (N, n)."""
    causes = presliding(fit)
    rows = replace(rows, target=fit.rows.torque - fit.rows.known)
    solved = CauseSearch(rows, causes).fit(range(len(causes)))
    columns = np.concatenate([cause.columns for cause in causes])
    taken = np.tensordot(solved.beta[-len(columns) :], columns, 1)
    return taken if fit.explained is None else fit.explained + taken


@dataclass(frozen=True)
class LinkConsistency(Check):
    """Rise of the residual that links of positive mass density cost, against a parametric bootstrap.

    A delay of the torque, friction that the log is sure to have and the case has not, and any cause that explains most
    of the residual are taken off before.
    """

    stage: ClassVar[int] = 2
    tells: ClassVar[tuple[str, ...]] = ("inconsistent links",)

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        found, trends = None if subject.fit is None else inconsistency(subject.fit), subject.trends
        if found is not None and trends is not None:  # these move the bodies as well
            known = [one for one in trends.blames if one.cause.name in ("friction curve", DELAY) or is_grave(one)]
            torques = [np.tensordot(blame.values, blame.cause.columns, 1) for blame in known]
            fit = trends.fit.explained_by(np.sum(torques, axis=0)) if known else trends.fit
            found = found if fit is subject.fit else inconsistency(fit)
            found = found and inconsistency(fit.explained_by(_bent(trends.rows, fit)))
        if found is None:
            return []
        evidence = (
            f"links of positive mass density raise the residual by {100 * found.rise:.2g} %; noise and model error of "
            f"this size raise it by at most {100 * found.chance:.2g} % in {DRAWS} draws; {found.link} is held most"
        )
        remedy = (
            f"check torque scales, gear ratios and signs of the joints up to {found.link}, and lengths and axes of the "
            "robot model"
        )
        numbers = {"rise": found.rise, "chance": found.chance}
        return [Finding("warning", "inconsistent links", "", evidence, remedy, numbers)]
