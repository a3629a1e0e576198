"""Cross-validation on triangles: each part of the logs is left out once and predicted by a fit of the rest.

One pass reduces every part by itself; the triangle of the rest is a merge of small triangles, so that k fits cost
little more than one (Stone 1974; contiguous parts, since neighbouring rows are alike: Burman, Chow and Nolan 1994).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynident.arrays import Array, finite
from dynident.errors import BadOption, DynidentError
from dynident.identification.estimators import ESTIMATORS, Estimator
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import Reduced, Triangle, least_squares


@dataclass(frozen=True)
class Fold:
    """One part that was left out.

    Attributes:
        name: Of the log, or the rows in words.
        rows: Rows that count in it.
        rmse: Root mean square error of each joint, shape (n,); NaN where the rest determines no estimate.
        relative_error: |residual| / |torque| over all joints, not centred.
        beta: Estimate without the part, shape (b,).
        missing: Why there is none; empty where there is one.
    """

    name: str
    rows: int
    rmse: Array
    relative_error: float
    beta: Array
    missing: str = ""


@dataclass(frozen=True)
class CrossValidation:
    """All parts.

    Attributes:
        over: ``blocks`` or ``logs``.
        estimator: What fitted the rest.
        folds: The parts.
        relative_error: Over the rows of all parts together; NaN where a part has none.
        in_sample: The same of the fit of all rows.
    """

    over: str
    estimator: str
    folds: tuple[Fold, ...]
    relative_error: float
    in_sample: float

    def figures(self) -> dict[str, Any]:
        """Return the figures as plain data."""
        return {
            "over": self.over,
            "estimator": self.estimator,
            "relative_error": finite(self.relative_error),
            "in_sample": finite(self.in_sample),
            "folds": [
                {"name": fold.name, "rows": fold.rows, "relative_error": finite(fold.relative_error)}
                for fold in self.folds
            ],
        }


def cross_validate(
    problem: Problem,
    estimator: Estimator,
    beta: Array,
    folds: int = 5,
    passes: RowPasses | None = None,
    refit: Callable[[Reduced], Array] | None = None,
) -> CrossValidation:
    """Return the errors of parts of the logs, each predicted by a fit of the rest.

    Args:
        problem: The problem.
        estimator: Fits the rest where it does so (``fits_folds``), else ``wls`` does.
        beta: The estimate from all rows, shape (b,).
        folds: Number of parts of equal length in time; 0 for one part a log.
        passes: The rows, where they are there already.
        refit: Of the estimator and its run on all rows: what that settled is not sought again without each part.

    Raises:
        BadOption: Fewer than two parts, or more than samples.
    """
    if folds == 0 and len(problem.logs) < 2:
        raise BadOption("folds", folds, "there is one log; give 2 or more parts")
    if folds and not 2 <= folds <= problem.samples:
        raise BadOption("folds", folds, f"give 2 to {problem.samples} parts, or 0 for one a log")
    passes = passes or RowPasses(problem)
    parts = _by_log(problem, passes) if folds == 0 else _blocks(problem, passes, folds)
    used = estimator if estimator.fits_folds else WLS()
    found = [
        _fold(problem, used, label, own, [other for _, other in parts if other is not own], refit)
        for label, own in parts
    ]
    errors = np.array(
        [_square(own, fold.beta) if not fold.missing else np.nan for fold, (_, own) in zip(found, parts, strict=True)]
    )
    torque = sum(triangle.torque_square for triangle in problem.triangles)
    return CrossValidation(
        over="logs" if folds == 0 else "blocks",
        estimator=ESTIMATORS.name_of(used),
        folds=tuple(found),
        relative_error=float(np.sqrt(errors.sum() / torque)),
        in_sample=float(np.sqrt(np.sum(problem.residual_squares(beta)) / torque)),
    )


def _fold(
    problem: Problem,
    estimator: Estimator,
    label: str,
    own: tuple[Triangle, ...],
    others: Sequence[tuple[Triangle, ...]],
    refit: Callable[[Reduced], Array] | None,
) -> Fold:
    rows = sum(triangle.rows for triangle in own)
    rest = tuple(first.merged(more) for first, *more in zip(*others, strict=True))
    nothing = np.full(len(own), np.nan)
    left = replace(problem, triangles=rest)
    singular = least_squares(reduced := left.reduced()).singular_values
    if reduced.rows < problem.base.count or singular[-1] <= 1e-9 * singular[0]:
        return Fold(label, rows, nothing, np.nan, np.full(problem.base.count, np.nan), "the rest does not determine it")
    try:
        if refit is None:
            beta = estimator.solve(left).beta
        else:
            beta = problem.base.from_standard(refit(left.reduced(WLS().solve(left).weights)))
    except DynidentError as error:
        return Fold(label, rows, nothing, np.nan, np.full(problem.base.count, np.nan), str(error))
    rmse = np.array([np.sqrt(t.residual_square(beta) / max(t.rows, 1)) for t in own])
    torque = sum(triangle.torque_square for triangle in own)
    relative = float(np.sqrt(_square(own, beta) / torque)) if torque > 0 else np.nan
    return Fold(label, rows, rmse, relative, beta)


def _by_log(problem: Problem, passes: RowPasses) -> list[tuple[str, tuple[Triangle, ...]]]:
    names = [log.log.name for log in problem.logs]
    return list(zip(names, passes.intervals(edges_of_logs(problem)), strict=True))


def _blocks(problem: Problem, passes: RowPasses, folds: int) -> list[tuple[str, tuple[Triangle, ...]]]:
    edges = edges_of_parts(problem, folds)
    names = [f"rows {a + 1} to {b}" for a, b in itertools.pairwise(edges)]
    return list(zip(names, passes.intervals(edges), strict=True))


def edges_of_logs(problem: Problem) -> list[int]:
    """Return where each log begins in the samples of all, and the last one ends."""
    return list(itertools.accumulate((len(log.keep) for log in problem.logs), initial=0))


def edges_of_parts(problem: Problem, count: int) -> list[int]:
    """Return the edges of ``count`` parts of the samples of all logs, of equal length."""
    return [int(edge) for edge in np.linspace(0, problem.samples, count + 1).round()]


def _square(triangles: Sequence[Triangle], beta: Array) -> float:
    return sum(triangle.residual_square(beta) for triangle in triangles)
