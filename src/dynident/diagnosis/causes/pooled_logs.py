"""Several logs of one robot as one: the quick fit of those that one set of parameters explains.

A cause that logs share (gravity, a sign, an order, a scale) is told once, by the evidence of all of them. A log that
one set of parameters does not explain as it does the others has another load, mounting or setting, and is left to
itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.data.log import Log
from dynident.diagnosis.causes.held_out import ReadRows
from dynident.diagnosis.causes.quick_fit import OVERSAMPLING, QuickFit
from dynident.diagnosis.causes.weighted_fit import TargetProducts

#: Residual variance of a joint under the parameters of all logs, over that under those of its own log, freedoms taken
#: off, from which a log is unlike the others: the error doubles.
UNLIKE = 4.0

#: Logs of which the one is looked for without which the others are the most alike, the furthest ones.
TRIED = 10

#: Periods of the cut-off between two logs, and at either end of a log that the filter mixes with what is between.
PAUSE, MIXED = 4.0, 2.0


def pooled_fit(fits: Sequence[QuickFit]) -> QuickFit:
    """Return the quick fit of several logs of one case as one log; rows near the pause between two are left out."""
    how = fits[0].how
    period = 1.0 / float(how.filter.bandwidth() or 1.0)
    log, starts = joined([fit.log for fit in fits], PAUSE * period, max(how.trim_s, MIXED * period) - period)
    return replace(fits[0], log=log, starts=starts)


def joined(logs: Sequence[Log], pause_s: float, margin_s: float) -> tuple[Log, Array]:
    """Return logs one after another on one grid, and when each of them begins.

    Args:
        logs: Logs of the same joints on uniform grids, with torques.
        pause_s: Time between two logs, in which signals go over smoothly from the end of one to the start of the next.
        margin_s: What of the ends of a log belongs to the gap between them.

    Returns:
        The log, with the pauses among its gaps, and the times in s, shape (L,).
    """
    rate = min(log.rate for log in logs)
    count = int(np.ceil(pause_s * rate))
    share = np.arange(1, count + 1)[:, None] / (count + 1.0)
    blend, begin = share**2 * (3.0 - 2.0 * share), 0.0
    starts: list[float] = []
    gaps, moved = [np.zeros((0, 2))], dict[str, list[Array]](q=[], torque=[])
    for log in logs:
        if starts:
            gaps.append(np.array([[begin - (count + 1) / rate - margin_s, begin + margin_s]]))
        gaps += [] if log.gaps is None else [log.gaps + begin - log.time[0]]
        starts.append(begin)
        grid = np.arange(int(log.duration * rate * (1.0 + 1e-12)) + 1) / rate + log.time[0]
        for name, parts in moved.items():
            values = np.column_stack([np.interp(grid, log.time, column) for column in np.asarray(getattr(log, name)).T])
            parts.extend([parts[-1][-1] + blend * (values[0] - parts[-1][-1])] if parts else [])
            parts.append(values)
        begin += (len(grid) + count) / rate
    q, torque = (np.concatenate(parts) for parts in moved.values())
    whole = replace(logs[0], time=np.arange(len(q)) / rate, q=q, torque=torque, gaps=np.concatenate(gaps))
    return whole, np.array(starts)


@dataclass(frozen=True)
class AlikeLogs:
    """Which logs one set of parameters explains.

    Attributes:
        fit: Of these; None where there are no two of them.
        together: Their numbers.
        ratios: The residual variance of each log and joint under the parameters of these, over that under the log's
            own, shape (L, n): 1 where a log has too few rows of a joint to tell. Empty where nothing was compared.
    """

    fit: QuickFit | None = None
    together: tuple[int, ...] = ()
    ratios: Array = field(default_factory=lambda: np.zeros((0, 0)))


def pooled_logs(fits: Sequence[QuickFit | None]) -> AlikeLogs:
    """Return what logs of a case are alike; one is taken out after the other until those that are left are.

    Args:
        fits: Of each log; None has no part.
    """
    there = [k for k, fit in enumerate(fits) if fit is not None]
    known = [fit for fit in fits if fit is not None]
    if len(known) < 2:
        return AlikeLogs()
    pooled = pooled_fit(known)
    if not pooled.has_rows_enough:
        return AlikeLogs()
    kept, told = _alike(pooled, _products(pooled))
    ratios = np.ones((len(fits), told.shape[1]))
    ratios[there] = told
    if kept.sum() < 2:
        return AlikeLogs(ratios=ratios)
    chosen = [k for k, keep in enumerate(kept) if keep]
    fit = pooled if kept.all() else pooled_fit([known[k] for k in chosen])
    return AlikeLogs(fit, tuple(there[k] for k in chosen), ratios)


def alike_parts(fits: Sequence[QuickFit]) -> tuple[BoolArray, Array]:
    """Return which of P parts of many logs are alike, shape (P,), and ratios as of :class:`AlikeLogs`, shape (P, n).

    Args:
        fits: Of each part, of one log or several.
    """
    return _alike(fits[0], [TargetProducts.summed(_products(fit)) for fit in fits])


def _alike(fit: QuickFit, logs: Sequence[TargetProducts]) -> tuple[BoolArray, Array]:
    """Return which of L logs of a model are alike, shape (L,), and the ratios of their variances, shape (L, n)."""
    free = np.array([len(own) for own in fit.rows.columns])
    worth = np.array([log.counts for log in logs]) / OVERSAMPLING
    own = np.array([log.fitted().variances for log in logs]) * worth / np.maximum(worth - free, 1.0)

    def ratios_with(kept: BoolArray) -> Array:
        beta = TargetProducts.summed([log for log, keep in zip(logs, kept, strict=True) if keep]).fitted().beta
        shared = np.array([log.variances(beta) for log in logs])
        return np.where(worth > 2.0 * free, shared / np.maximum(own, 1e-300), 1.0)

    kept = np.full(len(logs), True)
    ratios = ratios_with(kept)
    while kept.sum() > 2 and ratios[kept].max() > UNLIKE:
        furthest = np.argsort(np.where(kept, -ratios.max(axis=1), 0.0))[: min(TRIED, int(kept.sum()))]
        trials = [np.where(np.arange(len(logs)) == one, False, kept) for one in furthest]
        kept = min(trials, key=lambda trial: float(ratios_with(trial)[trial].max()))
        ratios = ratios_with(kept)
    return (kept if ratios[kept].max() <= UNLIKE else np.zeros(len(logs), bool)), ratios


def _products(fit: QuickFit) -> list[TargetProducts]:
    """Return the products of each log of a fit."""
    rows = fit.rows
    which = np.searchsorted(fit.starts, np.asarray(rows.prepared.kept.time), side="right") - 1
    read = ReadRows(rows, np.eye(fit.model.robot.dof))
    return [read.products(rows.masks & (which == k)[:, None]) for k in range(len(fit.starts))]
