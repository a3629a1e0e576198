"""Diagnostics of an estimate: whiteness, constant variance, influence, errors-in-variables bias, cross-validation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dynident.arrays import Array
from dynident.errors import DynidentError
from dynident.identification.problem.estimator import Estimator
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.bands import bands
from dynident.identification.residuals.covariance import correlation_factors
from dynident.identification.residuals.quantiles import chi_square_tail
from dynident.identification.residuals.row_passes import RowPasses
from dynident.identification.selection.cross_validation import (
    CrossValidation,
    cross_validate,
    edges_of_logs,
    edges_of_parts,
)
from dynident.model.lapack import solve_upper
from dynident.model.reduction import Reduced, least_squares

if TYPE_CHECKING:
    from dynident.identification.uncertainty.exogeneity import Exogeneity

#: Level of significance of the verdicts.
LEVEL = 0.01

#: Share of its power that the filter passes where the residual is tested for whiteness.
PASSED = 0.5

#: Lags of the test for whiteness at most, and frequencies a lag at least.
LAGS, PER_LAG = 20, 5

#: Parts of the logs whose influence is measured.
PARTS = 10

#: Cook's distance above which one part decides the estimate (Cook 1977).
DECIDES = 1.0


@dataclass(frozen=True)
class Diagnostics:
    """Tests of an estimate; p-values are the chance of as much where nothing is wrong.

    Attributes:
        effective_rows: Effective sample size of the residuals, by their autocorrelation.
        rows: Rows that count.
        whiteness: p-value of each joint that the noise before the filter is white, shape (n,).
        constant_variance: p-value of each joint that its noise depends on neither speed nor torque, shape (n,).
        leverage: Share of the parameters that each part of the logs decides; they sum to 1, shape (k,).
        cook: Cook's distance of each part: how far the estimate goes without it, in its own ellipsoid, shape (k,).
        condition_raw: Condition number of the weighted rows as they are.
        condition_scaled: The same with unit columns.
        exogeneity: The test of Durbin, Wu and Hausman; None where there are no instruments.
        reference: What the instruments are made of, or why there are none.
        cross_validation: Over parts of the logs, and over logs where there are several.
        joints: Names.
    """

    effective_rows: float
    rows: int
    whiteness: Array
    constant_variance: Array
    leverage: Array
    cook: Array
    condition_raw: float
    condition_scaled: float
    exogeneity: Exogeneity | None
    reference: str
    cross_validation: tuple[CrossValidation, ...]
    joints: tuple[str, ...]

    def figures(self) -> dict[str, Any]:
        """Return all numbers and the verdicts as plain data."""
        test = self.exogeneity
        return {
            "effective_sample_size": self.effective_rows,
            "rows": self.rows,
            "condition_raw": self.condition_raw if np.isfinite(self.condition_raw) else None,
            "condition_scaled": self.condition_scaled if np.isfinite(self.condition_scaled) else None,
            "joints": [
                {"name": name, "whiteness_p": float(white), "constant_variance_p": float(same)}
                for name, white, same in zip(self.joints, self.whiteness, self.constant_variance, strict=True)
            ],
            "parts": [
                {"leverage": float(lever), "cook": float(cook) if np.isfinite(cook) else None}
                for lever, cook in zip(self.leverage, self.cook, strict=True)
            ],
            "errors_in_variables": {
                "instruments": self.reference,
                "statistic": None if test is None else test.statistic,
                "degrees_of_freedom": None if test is None else test.degrees,
                "p": None if test is None else test.p_value,
            },
            "cross_validation": [found.figures() for found in self.cross_validation],
            "verdicts": list(self.verdicts()),
        }

    def verdicts(self) -> tuple[str, ...]:
        """Return the results of the tests, one sentence each."""
        share = self.effective_rows / max(self.rows, 1)
        said = [f"effective sample size {self.effective_rows:.0f} of {self.rows} torque values ({100 * share:.2g} %)"]
        said.append(
            _of_joints(
                self.whiteness, self.joints, "residuals are white (before the filter)", "residuals are autocorrelated"
            )
        )
        constant = "residual variance is constant over speed and torque"
        varies = "residual variance depends on speed or torque"
        said.append(_of_joints(self.constant_variance, self.joints, constant, varies))
        test = self.exogeneity
        tested = "" if test is None else f"p = {test.p_value:.2g}, instruments {self.reference}"
        if test is None:
            said.append(f"errors-in-variables bias: not tested ({self.reference})")
        elif test.is_biased(LEVEL):
            advice = "try --estimator iv"
            said.append(f"errors-in-variables bias: significant ({tested}); {advice}")
        else:
            said.append(f"errors-in-variables bias: not significant ({tested})")
        for found in self.cross_validation:
            error = f"{100 * found.relative_error:.3g} %" if np.isfinite(found.relative_error) else "not determined"
            here = f"{100 * found.in_sample:.3g} %"
            said.append(f"cross-validation over {len(found.folds)} {found.over}: error {error}, training error {here}")
        top = int(np.argmax(self.cook))
        if self.cook[top] > DECIDES:
            said.append(f"block {top + 1} of {len(self.cook)} is influential (Cook's distance {self.cook[top]:.2g})")
        return tuple(said)


def _of_joints(p_values: Array, joints: Sequence[str], fine: str, found: str) -> str:
    bad = [name for name, p in zip(joints, p_values, strict=True) if p < LEVEL]
    if not bad:
        return fine
    return f"{found}: {'all joints' if len(bad) == len(joints) else ', '.join(bad)}"


def diagnose(
    problem: Problem, estimator: Estimator, beta: Array, folds: int = 5, refit: Callable[[Reduced], Array] | None = None
) -> Diagnostics:
    """Return the diagnostics of an estimate.

    Args:
        problem: The problem.
        estimator: What found it, for cross-validation.
        beta: The estimate, shape (b,).
        folds: Parts for cross-validation over time; 0: none.
        refit: See :func:`cross_validate`.
    """
    passes = RowPasses(problem)
    logs = edges_of_logs(problem) if folds and len(problem.logs) > 1 else []
    passes.intervals(sorted({*edges_of_parts(problem, PARTS), *edges_of_parts(problem, max(folds, 1)), *logs}))
    residual, deviations = passes.residuals(beta), problem.joint_deviations(beta)
    factors = correlation_factors(passes.by_log(residual), problem.masks)
    reduced = problem.reduced(1.0 / deviations)
    values = np.linalg.svd(reduced.r, compute_uv=False)
    leverage, cook = _influence(problem, passes, beta, 1.0 / deviations, factors)
    test, reference = _exogeneity(problem, 1.0 / deviations)
    checked = [cross_validate(problem, estimator, beta, folds, passes, refit)] if folds else []
    if folds and len(problem.logs) > 1:
        checked.append(cross_validate(problem, estimator, beta, 0, passes, refit))
    return Diagnostics(
        effective_rows=float(np.sum(problem.counts / factors)),
        rows=int(problem.counts.sum()),
        whiteness=whiteness_of(passes, residual, 1.0 / deviations),
        constant_variance=constancy_of(problem, passes, residual),
        leverage=leverage,
        cook=cook,
        condition_raw=float(values[0] / values[-1]) if values[-1] > 0 else np.inf,
        condition_scaled=least_squares(reduced).condition_number,
        exogeneity=test,
        reference=reference,
        cross_validation=tuple(checked),
        joints=tuple(problem.model.robot.joint_names),
    )


def whiteness_of(passes: RowPasses, residual: Array, weights: Array) -> Array:
    """Return the p-value of Box and Pierce (1970) of each joint, from the frequencies that the filter passes.

    The periodogram over the filter's power and over what the fit leaves of it is flat for white noise. K independent
    ordinates make autocorrelations of variance 1 / (2 K).
    """
    upper = passes.problem.reduced(weights).r
    root = solve_upper(upper, np.eye(len(upper)))
    joints = residual.shape[1]
    total, degrees = np.zeros(joints), 0
    for band in bands(passes):
        inside = np.flatnonzero(band.shape[1:] > PASSED * band.shape.max()) + 1
        lags = min(LAGS, len(inside) // PER_LAG)
        if lags < 1:
            continue
        flat = band.rows.reshape(-1, len(upper)) @ root
        lever = weights**2 * np.sum(np.abs(flat) ** 2, axis=1).reshape(len(band.shape), -1)
        left = band.shape[:, None] * np.clip(1.0 - lever, 0.1, 1.0)
        power = (np.abs(band.transformed(residual)) ** 2 / left)[inside]
        waves = np.cos(np.pi * np.outer(np.arange(1, lags + 1), np.arange(len(inside)) + 0.5) / len(inside))
        total += 2 * len(inside) * np.sum((waves @ power / np.maximum(power.sum(axis=0), 1e-300)) ** 2, axis=0)
        degrees += lags
    return chi_square_tail(total, degrees) if degrees else np.ones(joints)


def constancy_of(problem: Problem, passes: RowPasses, residual: Array) -> Array:
    """Return the p-value of Koenker (1981) of each joint: squared residual over |dq|, dq^2 and |tau|.

    Rows count as many as the squared residuals are worth.
    """
    motion = np.concatenate([np.asarray(log.kept.dq) for log in problem.logs])
    torque = np.concatenate([np.asarray(log.kept.torque) for log in problem.logs])
    lengths = np.cumsum([len(log.keep) for log in problem.logs])[:-1]
    squares = np.where(passes.counting, residual**2, 0.0)
    means = squares.sum(axis=0) / np.maximum(passes.counting.sum(axis=0), 1)
    centred = np.where(passes.counting, squares - means, 0.0)
    factors = correlation_factors(np.split(centred, lengths), problem.masks)
    found = np.ones(residual.shape[1])
    for i in range(residual.shape[1]):
        keep = passes.counting[:, i]
        speed, load = np.abs(motion[keep, i]), np.abs(torque[keep, i])
        design = np.stack([np.ones(len(speed)), speed, speed**2, load], axis=1)
        design = design / np.maximum(np.linalg.norm(design, axis=0), 1e-300)
        target = centred[keep, i]
        whole = float(target @ target)
        if len(target) <= design.shape[1] or whole <= 0:
            continue
        coefficients, _, rank, _ = np.linalg.lstsq(design, target)
        explained = 1.0 - float(np.sum((target - design @ coefficients) ** 2)) / whole
        found[i] = chi_square_tail(len(target) / factors[i] * max(explained, 0.0), max(int(rank) - 1, 1))
    return found


def _influence(problem: Problem, passes: RowPasses, beta: Array, weights: Array, factors: Array) -> tuple[Array, Array]:
    """Return leverage and Cook's distance (Cook 1977) of parts of the logs, from triangles without each of them."""
    whole = least_squares(problem.reduced(weights))
    parts = passes.intervals(edges_of_parts(problem, PARTS))
    reduced = problem.reduced(weights)
    mean = float(np.average(factors, weights=np.maximum(problem.counts, 1)))
    leverage, cook = np.zeros(PARTS), np.full(PARTS, np.nan)
    for k, own in enumerate(parts):
        alone = replace(problem, triangles=own).reduced(weights)
        leverage[k] = float(np.sum(alone.r.T @ alone.r * whole.unscaled_covariance)) / problem.base.count
        others = [part for j, part in enumerate(parts) if j != k]
        rest = tuple(first.merged(more) for first, *more in zip(*others, strict=True))
        found = least_squares(replace(problem, triangles=rest).reduced(weights))
        if found.singular_values[-1] > 1e-9 * found.singular_values[0]:
            change = reduced.r @ (found.beta - whole.beta)
            cook[k] = float(change @ change) / problem.base.count / mean
    return leverage, np.where(np.isnan(cook), np.inf, cook)


def _exogeneity(problem: Problem, weights: Array) -> tuple[Exogeneity | None, str]:
    """Return the test with the commanded motion for instruments where all logs have it, and what it was made of."""
    if any(log.log.q_ref is None for log in problem.logs):
        return None, "the logs have no commanded positions q_ref"
    from dynident.identification.problem.commanded_motion import commanded_motion  # few logs need it
    from dynident.identification.residuals.instruments import instruments
    from dynident.identification.uncertainty.exogeneity import durbin_wu_hausman

    try:
        paths = [commanded_motion(log.log) for log in problem.logs]
        logs = [
            replace(log, log=replace(log.log.with_step("states commanded"), q=path[0], dq=path[1], ddq=path[2]))
            for log, path in zip(problem.logs, paths, strict=True)
        ]
        return durbin_wu_hausman(instruments(problem, logs), weights), "from the commanded motion"
    except DynidentError as error:
        return None, str(error)
