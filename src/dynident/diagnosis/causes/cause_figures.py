"""Figures of the causes that a search has found, with intervals that count errors of the model.

A clock, a lean of the base, an elastic joint and a wrong zero act on the torque of the bodies, which the fit without
them has wrong by as much. Once they are found, their columns are made again with the bodies beside them and the values
that they have, as a step of Gauss and Newton.

The interval of each cause is that of rows that hang together, or wider where the residual shows errors of the model
(:mod:`dynident.diagnosis.causes.model_error`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.causes.cause_columns import CauseRows
from dynident.diagnosis.causes.cause_search import Blame, Cause, CauseSearch
from dynident.diagnosis.causes.model_error import FitErrors, ModelError
from dynident.diagnosis.causes.weighted_fit import Solved

#: Causes whose torque follows the position of their joint.
PULLS = ("spring", "counterbalance")

#: Steps in which columns are made again for figures: what is late is known from the step before.
STEPS = 3

#: Fall of the sum of log variances from which one of several causes is tried beside others.
WORTH = 0.3

#: Makes the columns of causes with the base parameters of a fit, shape (b,), and the values of each, shape (k,).
Again: TypeAlias = Callable[[Sequence[Cause], Array, Sequence[Array]], list[Cause]]


def figured(
    found: CauseSearch, blames: Sequence[Blame], error: ModelError, again: Again
) -> tuple[tuple[Blame, ...], FitErrors]:
    """Return the same causes with their figures beside each other, and the errors of the model that their fit has.

    Args:
        found: The search.
        blames: What it has found, with rivals.
        error: Errors of the model at its rows.
        again: Makes their columns again.
    """
    rows = found.rows
    causes, solved = about_their_bodies(rows, [blame.cause for blame in blames], again, STEPS)
    errors = _errors(rows, causes, solved, error)
    numbers = [_number(found, blame.cause) for blame in blames]
    told = []
    for k, blame in enumerate(blames):
        rivals, others = [], numbers[:k] + numbers[k + 1 :]
        for rival in blame.rivals:
            number, beside = _number(found, rival.cause), [*causes[:k], rival.cause, *causes[k + 1 :]]
            if number in others:
                continue  # it was taken in later, and is told itself
            beside, fit = about_their_bodies(rows, beside, again, STEPS)
            columns = errors.with_columns(_columns(rows, beside, fit, error), np.sqrt(fit.variances))
            ((_, times),) = found.worths([(*others, number)])
            told_of = _figured(rival, fit, _places(rows, beside, k), columns.widening, times)
            rivals.append(replace(told_of, cause=beside[k]))
        ((_, times),) = found.worths([(*others, numbers[k])])
        one = _figured(blame, solved, _places(rows, causes, k), errors.widening, times)
        told.append(replace(one, cause=causes[k], rivals=tuple(rivals)))
    return tuple(replace(one, size=min(one.size, _together(rows, one, told))) for one in told), errors


def _together(rows: CauseRows, blame: Blame, every: Sequence[Blame]) -> float:
    """Return the torque of all pulls at the joint of one as a share of the measured: a spring and a sine may cancel."""
    if blame.cause.name not in PULLS:
        return blame.size
    same = [one for one in every if one.cause.name in PULLS and one.cause.joint == blame.cause.joint]
    torque = np.sum([np.tensordot(one.values, one.cause.columns, 1) for one in same], axis=0)
    sums = [np.sum(np.where(rows.masks, each, 0.0) ** 2, axis=0) for each in (torque, rows.measured)]
    return float(np.sqrt(np.max(sums[0] / np.maximum(sums[1], 1e-300))))


def with_likeliest(search: CauseSearch, causes: Sequence[Cause]) -> CauseSearch:
    """Return a search with the one of some causes that alone explains the log best, where it does better than others.

    Else it would take in a little of what other causes do. Curves of friction stand beside any cause.
    """
    rows, own = search.rows, CauseSearch(search.rows, causes, search.rows.shared)
    plain = np.log(own.fit([]).variances)
    falls = [plain - np.log(own.fit([k]).variances) for k in range(len(causes))]
    best = max(range(len(causes)), key=lambda k: float(rows.worth @ falls[k]), default=None)
    if best is None or falls[best].sum() < WORTH:
        return search
    others = (k for k, cause in enumerate(search.causes) if cause.name != "friction curve")
    if any(rows.worth @ (plain - np.log(search.fit([k]).variances) - falls[best]) > 0.0 for k in others):
        return search
    return CauseSearch(rows, (*search.causes, causes[best]), rows.shared)


def figure_beside(rows: CauseRows, causes: Sequence[Cause], more: Cause, error: ModelError) -> tuple[float, float]:
    """Return the coefficient of one cause more and its standard deviation, by errors of the model and noise."""
    every = [*causes, more]
    solved = _fit(rows, every)
    widening = _errors(rows, every, solved, error).widening(-1, np.zeros(len(rows.blocks)))
    return float(solved.beta[-1]), float(np.sqrt(solved.covariance[-1, -1] * widening))


def _figured(
    blame: Blame, solved: Solved, places: slice, widening: Callable[[int, Array], float], times: float
) -> Blame:
    """Return a cause with its figures at ``places`` of a fit whose rows hang together by ``times``."""
    factors = np.full(len(solved.variances), times)
    roots = np.sqrt([widening(place, factors) for place in range(places.start, places.stop)])
    covariance = solved.covariance[places, places] * np.outer(roots, roots)
    return replace(blame, values=solved.beta[places], covariance=covariance)


def _fit(rows: CauseRows, causes: Sequence[Cause]) -> Solved:
    """Return the fit of all columns with some causes."""
    return CauseSearch(rows, causes).fit(range(len(causes)))


def about_their_bodies(
    rows: CauseRows, causes: list[Cause], again: Again, steps: int = 1
) -> tuple[list[Cause], Solved]:
    """Return causes with their columns made again with the bodies beside them, and the fit with these."""
    solved = _fit(rows, causes)
    for _ in range(steps):
        beta = solved.beta[: rows.size]
        made = again(causes, beta, [solved.beta[_places(rows, causes, k)] for k in range(len(causes))])
        if all(new is old for new, old in zip(made, causes, strict=True)):
            break
        causes, solved = made, _fit(rows, made)
    return causes, solved


def _number(search: CauseSearch, cause: Cause) -> int:
    return next(k for k, one in enumerate(search.causes) if one is cause)


def _places(rows: CauseRows, causes: Sequence[Cause], which: int) -> slice:
    """Return where the coefficients of one of the causes stand in a fit."""
    begin = rows.size + sum(len(cause.columns) for cause in causes[:which])
    return slice(begin, begin + len(causes[which].columns))


def _columns(rows: CauseRows, causes: Sequence[Cause], solved: Solved, error: ModelError) -> list[Array]:
    """Return the columns of some rows of each joint, over the deviation of its residual, shape (N, k) each."""
    found, every = [], slice(None, None, error.every)
    for i, (block, own) in enumerate(zip(rows.blocks, rows.columns, strict=True)):
        here = np.zeros((len(block[every]), len(solved.beta)))
        here[:, own] = block[every]
        for place, column in enumerate((part[every, i] for cause in causes for part in cause.columns), rows.size):
            here[:, place] = column
        here[~rows.masks[every, i]] = 0.0
        found.append(here / np.sqrt(solved.variances[i]))
    return found


def _errors(rows: CauseRows, causes: Sequence[Cause], solved: Solved, error: ModelError) -> FitErrors:
    """Return the errors of the model that a fit with some causes has."""
    columns = _columns(rows, causes, solved, error)
    targets = np.where(rows.masks, rows.target, 0.0)[:: error.every] / np.sqrt(solved.variances)
    residuals = [target - own @ solved.beta for target, own in zip(targets.T, columns, strict=True)]
    return error.of_rows(columns, residuals, np.sqrt(solved.variances))
