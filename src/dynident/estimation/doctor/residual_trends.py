"""What the residual of a quick fit still follows: springs and drift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.estimation.doctor._quick_fit import QuickFit
from dynident.estimation.doctor.base import Check, Finding, Subject, listed

#: z-score from which a trend is there, and share of the joint's residual variance that it must explain.
SURE, EXPLAINED = 8.0, 0.5

#: Share of the joint's torque (root mean square) from which a trend matters.
MATTERS = 0.03


@dataclass(frozen=True)
class ResidualTrends(Check):
    """Unmodelled springs and torques that drift over the log."""

    stage: ClassVar[int] = 2

    def findings(self, subject: Subject) -> Sequence[Finding]:
        fit = subject.fit
        if fit is None:
            return []
        time = np.asarray(fit.rows.prepared.kept.time)
        clock = (time - time.mean()) / max(float(np.ptp(time)), 1e-9)
        q = fit.rows.prepared.kept.q
        drift = _trend(fit, np.repeat(clock[:, None], q.shape[1], axis=1))
        spring = _trend(fit, q - q.mean(axis=0))
        found = []
        if drift:
            worst = max(drift.values(), key=abs)
            evidence = f"the residual runs off by up to {worst:.3g} N m (or N) from start to end of the log"
            remedy = "warm the arm up first, or map temperatures and add friction: temperature"
            found.append(Finding("warning", "drift", listed(list(drift)), evidence, remedy, {"change": worst}))
        if spring:
            worst = max(spring.values(), key=abs)
            evidence = f"the residual follows the position, up to {worst:.3g} N m/rad (or N/m)"
            remedy = "a spring, hose or counterbalance: state it, or take its torque off (drives: bias)"
            found.append(Finding("warning", "spring", listed(list(spring)), evidence, remedy, {"stiffness": worst}))
        return found


def _trend(fit: QuickFit, columns: Array) -> dict[str, float]:
    """Return the coefficient of one own column (N, n) at each joint where it is sure and matters, by joint."""
    found: dict[str, float] = {}
    for i, name in enumerate(fit.model.robot.joint_names):
        mask = fit.rows.masks[:, i]
        if mask.sum() < 4 * fit.base.count / fit.model.robot.dof or np.ptp(columns[mask, i]) == 0:
            continue
        matrix = np.column_stack([fit.rows.blocks[i][mask], columns[mask, i]])
        target = fit.rows.torque[mask, i] - fit.rows.known[mask, i]
        norms = np.linalg.norm(matrix, axis=0)
        live = norms > 0
        if not live[-1]:
            continue
        coefficient, variance, before = _own_fit(matrix[:, live] / norms[live], target)
        value = coefficient / norms[-1]
        size = abs(value) * float(np.std(columns[mask, i]))
        share = 1.0 - variance / before if before > 0 else 0.0
        matters = size > MATTERS * float(np.sqrt(np.mean(target**2)))
        rows = fit.independent_rows[i]
        sure = share * rows / max(1.0 - share, 1e-9) > SURE**2
        if matters and sure and share > EXPLAINED:
            found[name] = float(value)
    return found


def _own_fit(matrix: Array, target: Array) -> tuple[float, float, float]:
    """Return the coefficient of the last column, and the residual variances with it and without."""
    with_it = np.linalg.lstsq(matrix, target, rcond=1e-8)[0]
    without = np.linalg.lstsq(matrix[:, :-1], target, rcond=1e-8)[0]
    after = float(np.mean((matrix @ with_it - target) ** 2))
    before = float(np.mean((matrix[:, :-1] @ without - target) ** 2))
    return float(with_it[-1]), after, before
