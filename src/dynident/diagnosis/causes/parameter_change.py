"""A log of two sets of parameters: a load that is taken up and put down, a gain or a zero that changes.

Parts of the log are told apart by what explains them better, two fits in turn (Lloyd 1982, with residuals in place of
distances): each part goes to the fit that leaves less of it, and each fit learns from its parts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.diagnosis.causes.pooled_logs import log_of_rows, part_products, with_own_friction
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.weighted_fit import TargetProducts

#: Length of a part in s, how many there are at least and at most, and passes by which they are told apart.
PART_S, FEWEST, MOST, PASSES = 1.0, 16, 64, 12


@dataclass(frozen=True)
class ParameterChange:
    """Rows of one log whose bodies contradict those of its other rows, with friction of their own.

    Attributes:
        rows: Those rows of the fit, the fewer of both, shape (N,).
        times: Residual of each joint of a set with bodies of the other, over that with its own, shape (n,).
    """

    rows: BoolArray
    times: Array


def parameter_change(fit: QuickFit) -> ParameterChange | None:
    """Return rows of a log that have other bodies than the rest of it; None where there are none in any log."""
    time, logs = np.asarray(fit.rows.prepared.kept.time), log_of_rows(fit)
    for log in range(len(fit.starts)):
        own = np.flatnonzero(logs == log)
        if not len(own):
            continue
        length = time[own[-1]] - time[own[0]]
        count = int(np.clip(length / PART_S, FEWEST, MOST))
        part = np.full(len(time), -1)
        part[own] = np.minimum((time[own] - time[own[0]]) / max(length, 1e-300) * count, count - 1).astype(int)
        if (is_other := _two_sets(fit, part, count)) is None:
            continue
        inner = is_other.copy(), ~is_other  # a part beside one of the other set may have rows of both
        for k in np.flatnonzero(np.diff(is_other)).tolist():
            for one in inner:
                one[k : k + 2] = False
        first, second = (np.isin(part, np.flatnonzero(one)) for one in inner)
        found = [with_own_friction(fit, *sets) for sets in ((first, second), (second, first))]
        if any(one.contradicts for one in found):
            rows = np.isin(part, np.flatnonzero(is_other))
            rows = rows if 2 * rows.sum() <= len(own) else (logs == log) & ~rows
            return ParameterChange(rows, np.max([one.times for one in found if one.contradicts], axis=0))
    return None


def _two_sets(fit: QuickFit, part: IntArray, count: int) -> BoolArray | None:
    """Return which parts of a log belong to the one of the two sets that explain it best, (count,); None for no two.

    Args:
        fit: The fit.
        part: Number of the part of each row, shape (N,); -1 for none.
        count: How many parts there are.
    """
    parts, best, least = part_products(fit, part, count), None, np.inf
    for start in _starts(fit, part, count):
        is_one = start
        for _ in range(PASSES):
            before, sets = is_one, _summed(parts, is_one)
            if sets is None:
                break
            fits = [one.fitted() for one in sets]
            weights = 1.0 / np.minimum(fits[0].variances, fits[1].variances)
            left = np.array([[weights @ (one.variances(own.beta) * one.counts) for own in fits] for one in parts])
            about = left + np.vstack([left[1:], left[-1:]]) + np.vstack([left[:1], left[:-1]])  # with its neighbours
            is_one = about[:, 0] < about[:, 1]
            if np.array_equal(before, is_one):
                break
        if (sets := _summed(parts, is_one)) is not None:
            score = float(sum(one.counts @ np.log(one.fitted().variances) for one in sets))
            best, least = (is_one, score) if score < least else (best, least)
    return best


def _starts(fit: QuickFit, part: IntArray, count: int) -> Iterator[BoolArray]:
    """Yield which parts the search begins with: of more torque than the fit has, and those before some time."""
    residual, torque = (np.where(fit.rows.masks, one, 0.0) for one in (fit.residual, fit.rows.torque))
    torque = np.where(fit.rows.masks, torque - torque.sum(axis=0) / fit.counts, 0.0)
    power = (residual * torque) @ (1.0 / np.maximum(fit.plain.variances, 1e-300))
    yield np.bincount(part[part >= 0], power[part >= 0], count) > 0
    for share in (0.25, 0.5, 0.75):
        yield np.arange(count) < share * count


def _summed(parts: Sequence[TargetProducts], is_one: BoolArray) -> list[TargetProducts] | None:
    """Return the products of the parts of either set; None where one has none."""
    if is_one.all() or not is_one.any():
        return None
    return [
        TargetProducts.summed([one for one, there in zip(parts, some, strict=True) if there])
        for some in (is_one, ~is_one)
    ]
