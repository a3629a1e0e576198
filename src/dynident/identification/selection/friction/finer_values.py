"""Non-linear friction fields to a finer step: Gauss and Newton's, of all of them together, in a fit of all rows.

The coefficients are eliminated (Golub and Pereyra 1973; Kaufman 1975): a step is the coefficient of one more column,
the difference of a part's columns on both sides of its value, and all columns are in one Gram matrix. Where two fields
can stand for each other a step goes along their valley, which the fields in turn would cross in many small ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.identification.selection.friction.column_pool import ColumnPool, PooledLogs
from dynident.identification.selection.friction.nested_fits import RIDGE, entries, nested_fits
from dynident.identification.selection.friction.parts_by_drive import by_drive, with_values
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction

#: Distance in logarithms of the values of which differences are taken, and a step that is none.
APART, SETTLED = 0.1, 5e-3

#: A step of so many of its deviations is none either; the least share that is taken of one that raised the loss; how
#: often each field of a step that the ends of ranges bound is looked at.
UNSURE, SHORTEST, SWEEPS = 0.1, 0.1, 100


def finer_values(
    model: DynamicModel,
    fields: Sequence[tuple[Sequence[int], str]],
    spans: Sequence[tuple[float, float]],
    most: Sequence[float],
    pooled: PooledLogs,
    turns: int,
) -> tuple[Array, Array]:
    """Return the values of fields near those of the model that fit all rows best, and deviations of their logarithms.

    Args:
        model: The model.
        fields: Places of the parts that share the value, and the name, of each of m fields.
        spans: Least and largest values.
        most: Largest factor of a step; one that does not lower the loss is cut to the least of a parabola through both.
        pooled: The logs.
        turns: Steps at most.
    """
    (low, high), limits = np.log(spans).T, np.log(most)
    at = best = np.log(given := [float(getattr(model.friction[own[0]], name)) for own, name in fields])
    exact = dict(zip(at.tolist(), given, strict=True))  # values whose columns are there, to the last bit
    least, slope, deviations, weights = np.inf, 0.0, np.full(len(at), np.inf), None
    for left in reversed(range(turns)):
        now, sides, free = model, list[Friction](), fields if left else ()  # no step follows the last loss
        for value, (own, name) in zip(at.tolist(), fields, strict=True):
            now = with_values(now, own, {name: exact.setdefault(value, float(np.exp(value)))})
        for value, (own, name) in zip(at.tolist(), free, strict=False):
            for by in (value - APART / 2, value + APART / 2):
                sides += [replace(now.friction[p], **{name: float(np.exp(by))}) for p in own]
        pool = pooled.pool([*now.friction, *sides])
        sets = by_drive(model, now.friction, range(len(now.friction)))
        weights = pool.weights(sets) if weights is None else weights
        wholes, keep = pool.by_delay(pool.weighted(weights, pool.totals)[0]), pool.chosen(sets)
        lists = np.repeat(pool.lists([sets])[None], len(wholes), axis=0)
        losses, mixed = nested_fits(entries(wholes), entries(wholes), lists)
        view = int(np.argmin(losses))
        loss, beta = float(losses[view, 0]), mixed[view, 0]
        step, covariance = _step(wholes[view], pool, keep, beta, free)
        if not left:
            best = at if loss < least else best
        elif loss < least:
            least, best = loss, at
            deviations = np.sqrt(np.diag(covariance) * loss / max(float(pool.rows.sum()), 1.0))
            curves, ends = np.linalg.inv(covariance), (np.maximum(low - at, -limits), np.minimum(high - at, limits))
            way = np.clip(step, *ends)
            for k in SWEEPS * [*range(len(at))]:  # each goes where it fits best beside those that an end stops
                way[k] = min(max(way[k] + curves[k] @ (step - way) / curves[k, k], ends[0][k]), ends[1][k])
            at = np.clip(at + way, low, high)
            slope = -2.0 * float((at - best) @ curves @ step)
        else:
            share = float(np.clip(slope / (2.0 * (slope - loss + least)), SHORTEST, 0.5))
            at, slope = best + (at - best) * share, slope * share
        if np.all(np.abs(at - best) < np.maximum(SETTLED, UNSURE * deviations)):
            break
    return np.array([exact[value] for value in best.tolist()]), deviations


def _step(
    whole: Array, pool: ColumnPool, keep: IntArray, beta: Array, fields: Sequence[tuple[Sequence[int], str]]
) -> tuple[Array, Array]:
    """Return the step of the fields (m,) from values with the fit ``beta`` (c + 1,) of ``keep``, its covariance (m, m).

    ``whole`` are the products (c + 1, c + 1).
    """
    turn = np.zeros((len(whole), len(keep) + len(fields) + 1))
    turn[keep, np.arange(len(keep))] = turn[-1, -1] = 1.0
    beside = iter(pool.columns[-2 * sum(len(own) for own, _ in fields) :])
    for slope, (own, _) in zip(turn.T[len(keep) : -1], fields, strict=True):
        for sign, p in ((sign, p) for sign in (-1.0, 1.0) for p in own):
            for there, other in zip(pool.columns[p], next(beside), strict=True):
                slope[other] += sign * beta[there] / APART
    products = turn.T @ whole @ turn
    lost = np.diag(products) <= 0.0  # by rounding
    products[lost], products[:, lost] = 0.0, 0.0
    size = np.sqrt(np.where(lost, 1.0, np.diag(products)))[:-1]
    inverse = np.linalg.inv(products[:-1, :-1] / np.outer(size, size) + RIDGE * np.eye(len(size)))
    found, last = inverse @ (products[:-1, -1] / size) / size, slice(len(keep), None)
    return found[last], (inverse / np.outer(size, size))[last, last]
