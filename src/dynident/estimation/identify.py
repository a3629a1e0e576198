"""identify: preprocessed logs and an estimator to an Estimate."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, is_dataclass
from importlib.metadata import version
from typing import Any

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.errors import LogMismatch
from dynident.estimation.consistency import judge
from dynident.estimation.estimate import Estimate
from dynident.estimation.estimators import ESTIMATORS, Estimator
from dynident.estimation.problem import Observer, Problem, counting_rows, make_problem
from dynident.estimation.validation import Validation, compare_torques
from dynident.experiment.case import default_preprocessing
from dynident.experiment.formats import ColumnMap
from dynident.experiment.log import Log
from dynident.experiment.preprocessing import Prepared, Preprocessing, preprocess
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.reduction import least_squares

#: Least share of independent rows that is taken to be left over for the residual.
FEWEST_FREE = 0.1


def identify(
    model: DynamicModel,
    logs: Sequence[Log],
    estimator: str | Estimator = "consistent",
    preprocessing: Preprocessing | None = None,
    columns: ColumnMap | None = None,
    provenance: Mapping[str, Any] | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> Estimate:
    """Identify the base parameters of a model from logs.

    Args:
        model: Robot, drives and friction.
        logs: Raw logs with positions and torques; each is preprocessed on its own.
        estimator: Name or part.
        preprocessing: How logs become rows; default: ``default_preprocessing``.
        columns: How the logs were read, kept so that other logs of the robot can be read alike.
        provenance: Facts to keep with the estimate: case, command.
        progress: Told each step in words.

    Raises:
        LogMismatch: A log does not fit the robot, or is too short.
        PoorExcitation: The logs do not determine all base parameters.
        SolverFailed: The estimator found no checked solution.
    """
    part = ESTIMATORS.make(estimator)
    problem = pose(model, logs, preprocessing, progress)
    return estimate_of(problem, part, columns, provenance, progress)


def pose(
    model: DynamicModel,
    logs: Sequence[Log],
    preprocessing: Preprocessing | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> Problem:
    """Return the problem that every estimator can be asked to solve; arguments and errors as of :func:`identify`."""
    if not logs:
        raise LogMismatch("identify", "no log", "give at least one log")
    how = preprocessing or default_preprocessing()
    progress("base parameters")
    base = base_parameters(model)
    progress("preprocessing and reduction")
    prepared = [preprocess(log.ordered(model.robot.joint_names), how) for log in logs]
    return make_problem(model, base, prepared)


def estimate_of(
    problem: Problem,
    estimator: Estimator,
    columns: ColumnMap | None = None,
    provenance: Mapping[str, Any] | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> Estimate:
    """Return the estimate of one estimator, with covariance, verdicts and provenance.

    Raises:
        SolverFailed: The estimator found no checked solution.
    """
    model, base = problem.model, problem.base
    progress(f"estimator {ESTIMATORS.name_of(estimator)}")
    started = time.perf_counter()
    solution = estimator.solve(problem)
    seconds = time.perf_counter() - started
    deviations = problem.joint_deviations(solution.beta)
    train = validate_prepared(model, base, problem.logs, solution.beta)
    factors = correlation_factors(np.split(train.residual, train.starts[1:]), problem.masks)
    return Estimate(
        model=model,
        base=base,
        beta=solution.beta,
        covariance=_covariance(problem, solution.weights, deviations, factors)
        if solution.covariance is None
        else solution.covariance,
        theta=solution.theta,
        joint_deviations=deviations,
        correlation_factors=factors,
        condition_number=least_squares(problem.reduced(1.0 / deviations)).condition_number,
        samples=problem.samples,
        inertial_base_parameters=base_parameters(model, inertial_only=True).count,
        estimator=ESTIMATORS.name_of(estimator),
        options=asdict(estimator) if is_dataclass(estimator) else {},
        consistency=judge(model, base, solution.beta, solution.theta),
        train=train,
        preprocessing=problem.logs[0].how,
        columns=columns or ColumnMap(joints=model.robot.joint_names),
        extras={**solution.extras, "seconds": seconds},
        provenance={**versions(), "logs": [asdict(log.kept.source) for log in problem.logs], **(provenance or {})},
    )


def validate(estimate: Estimate, logs: Sequence[Log], preprocessing: Preprocessing | None = None) -> Validation:
    """Compare an estimate with logs that it has not seen; they are prepared as those of the fit.

    Args:
        estimate: The estimate.
        logs: Raw logs with positions and torques.
        preprocessing: Another preparation than that of the fit.

    Raises:
        LogMismatch: A log does not fit the robot, or is too short.
    """
    how = preprocessing or estimate.preprocessing
    prepared = [preprocess(log.ordered(estimate.model.robot.joint_names), how) for log in logs]
    return validate_prepared(estimate.model, estimate.base, prepared, estimate.beta)


def validate_prepared(model: DynamicModel, base: BaseParameters, logs: Sequence[Prepared], beta: Array) -> Validation:
    """Compare base parameters with preprocessed logs."""
    for log in logs:
        if log.log.torque is None:
            raise LogMismatch(log.log.name, "no torques to compare with", "map torque columns in the case file")
    observer = Observer(model, base)
    return compare_torques(
        [log.kept for log in logs],
        [log.smooth(observer.predict(log.log, beta).T).T[log.keep] for log in logs],
        [counting_rows(model, log) for log in logs],
        model.robot.units,
        logs[0].how.standstill,
        logs[0].statement(),
    )


def correlation_factors(
    residuals: Sequence[Array], masks: Sequence[BoolArray] | None = None, longest: float = 0.25
) -> Array:
    """Return how much the rows of each joint hang together: the integrated autocorrelation of its residual, >= 1.

    The sum 1 + 2 sum rho_k is cut at the first negative pair (Geyer 1992); filtered or modelled badly, residuals are
    far from independent, and covariances that ignore it are too small.

    Args:
        residuals: Residuals of each log over the rows used, shape (N, n) each.
        masks: Which of them count in the fit, shape (N, n) each; None: all. Those that do not are taken as zero.
        longest: Share of a log that the sum may reach over.

    Returns:
        Shape (n,).
    """
    counting = [np.ones(r.shape, bool) for r in residuals] if masks is None else masks
    total, rows = np.zeros(residuals[0].shape[1]), np.zeros(residuals[0].shape[1])
    for residual, mask in zip(residuals, counting, strict=True):
        count = mask.sum(axis=0)
        pairs = zip(residual.T, mask.T, strict=True)
        total += count * np.array([_integrated(column, keep, longest) for column, keep in pairs])
        rows += count
    return np.where(rows > 0, total / np.maximum(rows, 1), 1.0)


def _integrated(residual: Array, keep: BoolArray, longest: float) -> float:
    if np.count_nonzero(keep) < 2:
        return 1.0
    centred = np.where(keep, residual - residual[keep].mean(), 0.0)
    size = 2 ** int(np.ceil(np.log2(2 * len(centred))))
    spectrum = np.abs(np.fft.rfft(centred, size)) ** 2
    covariance = np.fft.irfft(spectrum, size)[: max(2, int(longest * len(centred)))]
    if covariance[0] <= 0:
        return 1.0
    rho = covariance / covariance[0]
    pairs = rho[: len(rho) // 2 * 2].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs <= 0)
    return max(1.0, float(2 * pairs[: negative[0] if len(negative) else len(pairs)].sum() - 1))


def _covariance(problem: Problem, weights: Array, deviations: Array, factors: Array) -> Array:
    """Return the sandwich A^-1 B A^-1: A has the weights of the fit, B also what the residuals of a joint are worth.

    Residuals that hang together are worth fewer rows, and the parameters take their share of those.
    """
    inverse = least_squares(problem.reduced(weights)).unscaled_covariance
    spread = problem.reduced(weights**2 * deviations * np.sqrt(factors)).r @ inverse
    rows, independent = problem.counts.sum(), np.sum(problem.counts / factors)
    taken = (1 - problem.base.count / rows) / max(1 - problem.base.count / independent, FEWEST_FREE)
    return spread.T @ spread * max(taken, 1.0)


def versions() -> dict[str, Any]:
    """Return the versions that produced a result."""
    packages = ("dynident", "numpy", "scipy", "numba", "clarabel")
    return {
        "versions": {name: version(name) for name in packages},
        "python": platform.python_version(),
        "platform": platform.platform(),
    }
