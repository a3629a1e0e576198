"""What an estimate owes to its cut-off: the same fit at half and at double of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import ROWS_PER_PERIOD, Prepared, preprocess, resample
from dynident.errors import DynidentError
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.problem.choices import CutoffSensitivity, CutoffTrial
from dynident.identification.problem.problem import Problem, unreduced
from dynident.identification.selection.cutoff.block_triangles import BlockTriangles, block_triangles
from dynident.identification.selection.cutoff.candidates import SAMPLES_PER_HZ, thinned_out
from dynident.model.lapack import solve_upper

#: The other cut-offs, in units of the one used.
FACTORS = (0.5, 2.0)

#: Blocks of time of the cross-validation, and the highest cut-off in terms of the sampling rate.
FOLDS, HIGHEST = 5, 0.4

#: Change in deviations at the cut-off that knows less from which it counts: by chance one in twenty does.
BEYOND = 2.0


def with_cutoff_sensitivity(estimate: Estimate, problem: Problem, logs: Sequence[Log]) -> Estimate:
    """Return an estimate with what weighted least squares finds at half and at double the cut-off, where there is one.

    All is judged at the cut-off of the estimate: the held-out error is that of blocks of its rows, each predicted by a
    fit of the other blocks at the other cut-off. Changes are counted in the deviations of the estimate; those that
    chance does not make are errors of the model (Hausman 1978) and enter the covariance.

    Args:
        estimate: The estimate, with its own load where friction depends on it.
        problem: What it solves, with the load of the estimate.
        logs: The raw logs of the problem, joints in the order of the robot.
    """
    stated = problem.logs[0].how.filter.shared_cutoff()
    if stated is None:
        return estimate
    try:
        own = block_triangles(problem, 0.0, FOLDS)
        rows, covariance = [_figures(estimate, own, own, stated, stated)[0]], estimate.covariance
    except DynidentError:
        return estimate
    for factor in FACTORS:
        hertz = factor * stated
        if hertz > HIGHEST * min(log.log.rate for log in problem.logs):
            continue
        try:
            row, moved = _figures(estimate, own, _blocks(problem, logs, hertz), stated, hertz)
        except DynidentError:
            continue
        rows.append(row)
        if factor < 1.0 or estimate.choices.position_noise is None:  # whose bias grows faster, and is corrected
            covariance = covariance + np.outer(moved, moved)
    table = tuple(sorted(rows, key=lambda row: row.cutoff_hz))
    found = CutoffSensitivity(stated, len(own.blocks), table) if len(table) > 1 else None
    return replace(estimate, covariance=covariance, choices=replace(estimate.choices, cutoff_sensitivity=found))


def _blocks(problem: Problem, logs: Sequence[Log], hertz: float) -> BlockTriangles:
    prepared: list[Prepared] = []
    for log, used in zip(logs, problem.logs, strict=True):
        filter = used.how.filter.with_cutoff(hertz)
        how = replace(used.how, filter=filter, delay_s=used.delay_s, rate_hz=None, rows_per_period=ROWS_PER_PERIOD)
        prepared.append(preprocess(thinned_out(resample(log, how.longest_gap_s), 2 * SAMPLES_PER_HZ * hertz), how))
    return block_triangles(unreduced(problem.model, problem.base, prepared, problem.load), 0.0, FOLDS)


def _figures(
    estimate: Estimate, own: BlockTriangles, other: BlockTriangles, own_hertz: float, hertz: float
) -> tuple[CutoffTrial, Array]:
    """Return the figures of the fit of other rows, judged by the rows of the estimate's own cut-off, and what moved."""
    change: Array = (other.fit[0] - own.fit[0]) / np.maximum(estimate.std, 1e-300)
    surprise = np.abs(change) / np.sqrt(np.maximum(_spread(other, hertz) / _spread(own, own_hertz), 1.0))
    error = torque = 0.0
    for fold, block in enumerate(own.blocks):
        beta = other.without([fold]) if len(other.blocks) > 1 else other.fit[0]
        error += sum(triangle.residual_square(beta) for triangle in block)
        torque += sum(triangle.torque_square for triangle in block)
    trial = CutoffTrial(
        cutoff_hz=hertz,
        cross_validation_error=float(np.sqrt(error / torque)) if torque > 0 else 0.0,
        largest_change=float(np.abs(change).max()),
        parameter=estimate.base.names[int(np.argmax(np.abs(change)))],
        beyond_chance=float(surprise.max()),
        farthest=estimate.base.names[int(np.argmax(surprise))],
        changes=tuple(change.tolist()),
    )
    return trial, np.where(surprise > BEYOND, change * estimate.std, 0.0)


def _spread(blocks: BlockTriangles, hertz: float) -> Array:
    """Return the variance of each parameter (b,) up to a factor, for 2 c independent rows in 1 s and white noise."""
    inverse = solve_upper(blocks.reduced.r, np.eye(len(blocks.reduced.r)))
    return np.sum(np.asarray(inverse) ** 2, axis=1) * blocks.reduced.rows / hertz
