"""Several logs of one robot as one: the quick fit of those that one set of parameters explains.

A cause that logs share (gravity, a sign, an order, a scale) is told once, by the evidence of all of them. A log that
one set of parameters does not explain as it does the others has another load, mounting or setting, and is left to
itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.log import Log
from dynident.diagnosis.causes.held_out import ReadRows
from dynident.diagnosis.causes.quick_fit import OVERSAMPLING, QuickFit
from dynident.diagnosis.causes.weighted_fit import TargetProducts
from dynident.diagnosis.finding import UNLIKE_OTHERS, Finding, Severity
from dynident.identification.problem.regressor_stream import motion_of
from dynident.model.robot import Robot

#: Residual variance of a joint under the parameters of all logs, over that under those of its own log, freedoms taken
#: off, from which a log is unlike the others: the error doubles.
UNLIKE = 4.0

#: Share of a joint's torque that bodies of the other logs leave, and times what bodies of its own do, from which a log
#: contradicts them.
MUCH, FAR = 0.05, 10.0

#: Ratio of a joint's root mean square speeds in two logs from which friction of the one need not hold in the other.
OTHER_SPEED = 5.0

#: Times by which parameters of the other logs raise the residual of a log from which that is a warning; and from which
#: it is one whatever else is found: a cause that all logs share raises the residual of their own parameters as well.
UNLIKE_GRAVELY, UNLIKE_BY_FAR = 3.0, 10.0

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
        contradicts: Numbers of the others whose bodies contradict those of these, or of all where no two are alike.
        other_speeds: Numbers of the others whose friction alone differs, at joints of other speeds.
    """

    fit: QuickFit | None = None
    together: tuple[int, ...] = ()
    ratios: Array = field(default_factory=lambda: np.zeros((0, 0)))
    contradicts: tuple[int, ...] = ()
    other_speeds: tuple[int, ...] = ()


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
    others = kept if kept.any() else np.ones(len(kept), bool)
    apart = {k: _with_own_friction(pooled, k, others) for k in np.flatnonzero(~kept).tolist()}
    contradicts = tuple(there[k] for k, own in apart.items() if own.contradicts)
    speeds = tuple(there[k] for k, own in apart.items() if own.explains and _has_other_speeds(pooled, k, told[k]))
    if kept.sum() < 2:
        return AlikeLogs(ratios=ratios, contradicts=contradicts, other_speeds=speeds)
    chosen = [k for k, keep in enumerate(kept) if keep]
    fit = pooled if kept.all() else pooled_fit([known[k] for k in chosen])
    return AlikeLogs(fit, tuple(there[k] for k in chosen), ratios, contradicts, speeds)


def alike_parts(fits: Sequence[QuickFit]) -> tuple[BoolArray, Array]:
    """Return which of P parts of many logs are alike, shape (P,), and ratios as of :class:`AlikeLogs`, shape (P, n).

    Args:
        fits: Of each part, of one log or several.
    """
    return _alike(fits[0], [TargetProducts.summed(_products(fit)) for fit in fits])


def unlike_finding(
    robot: Robot, ratios: Array, others_agree: bool, why: bool, is_error: bool = False, is_speed: bool = False
) -> Finding:
    """Return what is said of a log that parameters of others do not explain.

    Args:
        robot: The robot.
        ratios: Of the residual variances of its joints, shape (n,).
        others_agree: Whether the other logs, or some of them, have the same parameters.
        why: Whether there is another cause that may be why.
        is_error: Whether its bodies contradict theirs, where it is one to learn from.
        is_speed: Whether friction of its own explains it, at joints of other speeds.
    """
    times = np.sqrt(ratios)
    joint = int(np.argmax(times))
    others = "parameters of the other logs" if others_agree else "parameters that logs share"
    evidence = f"with {others} its residual is {times[joint]:.3g} times that with parameters of its own"
    evidence = evidence if others_agree else f"the logs do not agree: {evidence}"
    same = "load, mounting, gains, zeros and units"
    remedy = (
        f"make sure that {same} are those of the other logs, and that the friction model holds at its speeds; else "
    )
    remedy += "give it a case of its own"
    is_apart = bool(times[joint] > UNLIKE_BY_FAR or is_error)
    if is_speed:
        evidence += "; it moves far slower or faster there, and friction of its own explains it"
        remedy = "state friction that holds at these speeds, such as stribeck (friction: auto chooses), or leave it so"
    elif is_apart:
        remedy = f"do not fit it with the others: give it a case of its own, or make {same} those of the others; "
        remedy += "'dynident payload ESTIMATE LOG' weighs a tool, by an estimate without it"
    is_warning = not is_speed and (is_apart or (times[joint] > UNLIKE_GRAVELY and not why))
    severity: Severity = "error" if is_error else "warning" if is_warning else "note"
    name, numbers = robot.joint_names[joint], {"times": float(times[joint])}
    return Finding(severity, UNLIKE_OTHERS, name, evidence, remedy, numbers)


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


@dataclass(frozen=True)
class _OwnFriction:
    """A log under bodies that it shares with others, with friction and offsets of its own, as of another day.

    Attributes:
        explains: Whether that explains it about as well as bodies of its own.
        contradicts: Whether its bodies surely are others: what is left is much of a joint's torque, and far more than
            with bodies of its own.
    """

    explains: bool
    contradicts: bool


def _has_other_speeds(fit: QuickFit, k: int, ratios: Array) -> bool:
    """Return whether joints at which log k of a fit is unlike the others, by ``ratios`` (n,), have far other speeds."""
    speeds, here = motion_of(fit.rows.prepared.kept).dq ** 2, _which(fit) == k
    own, others = (np.mean(speeds[part], axis=0) for part in (here, ~here))
    apart = np.abs(np.log(np.maximum(own, 1e-300) / np.maximum(others, 1e-300))) > 2.0 * np.log(OTHER_SPEED)
    return bool(np.all(apart[ratios > UNLIKE]))


def _with_own_friction(fit: QuickFit, k: int, others: BoolArray) -> _OwnFriction:
    """Return what bodies of the ``others`` (L,) and friction of its own leave of log k of a pooled fit."""
    rows, which, size = fit.rows, _which(fit), fit.base.count
    here = which == k
    masks, used = rows.masks & here[:, None], here | others[which]
    blocks, columns = list[Array](), list[IntArray]()
    for block, own in zip(rows.blocks, rows.columns, strict=True):
        is_friction = fit.base.is_friction[own]
        blocks.append(np.column_stack([block, np.where(here[:, None], block[:, is_friction], 0.0)]))
        columns.append(np.concatenate([own, size + own[is_friction]]))
    read = ReadRows(replace(rows, blocks=tuple(blocks), columns=tuple(columns)), np.eye(fit.model.robot.dof))
    counts = np.maximum(masks.sum(axis=0), 1)
    shared, alone = (
        np.where(masks, read.squared_errors(read.fitted(some).beta), 0.0).sum(axis=0) / counts
        for some in (rows.masks & used[:, None], masks)
    )
    torque = np.where(masks, rows.torque, 0.0)
    size_of = np.sum(torque**2, axis=0) / counts - (torque.sum(axis=0) / counts) ** 2
    tells = counts / OVERSAMPLING > 2.0 * np.array([len(own) for own in columns])
    contradicts = tells & (shared > MUCH**2 * size_of) & (shared > FAR**2 * alone)
    return _OwnFriction(not np.any(tells & (shared > UNLIKE * alone)), bool(contradicts.any()))


def _which(fit: QuickFit) -> IntArray:
    """Return the number of the log of each row of a fit, shape (N,)."""
    return np.searchsorted(fit.starts, np.asarray(fit.rows.prepared.kept.time), side="right") - 1


def _products(fit: QuickFit) -> list[TargetProducts]:
    """Return the products of each log of a fit."""
    rows, which = fit.rows, _which(fit)
    read = ReadRows(rows, np.eye(fit.model.robot.dof))
    return [read.products(rows.masks & (which == k)[:, None]) for k in range(len(fit.starts))]
