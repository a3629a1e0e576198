"""identify: preprocessed logs and an estimator to an Estimate."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, is_dataclass, replace
from importlib.metadata import version
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.errors import LogMismatch
from dynident.estimation.consistency.scale import BodyPrior
from dynident.estimation.consistency.verdicts import judge
from dynident.estimation.cutoff.choice import with_cutoff
from dynident.estimation.cutoff.sensitivity import cutoff_sensitivity
from dynident.estimation.estimate import Estimate
from dynident.estimation.estimators import ESTIMATORS, Estimator
from dynident.estimation.estimators.base import Solution
from dynident.estimation.estimators.wls import WLS
from dynident.estimation.friction.held_out_fields import choose_fields, has_choices, without_optional
from dynident.estimation.friction.load import PASSES, agrees, problem_of, with_load, without_load
from dynident.estimation.friction.variable_projection import has_varying, vary_fields
from dynident.estimation.observer import Observer
from dynident.estimation.problem import Problem, counting_rows
from dynident.estimation.uncertainty.coloured import spectral_uncertainty
from dynident.estimation.uncertainty.covariance import correlation_factors
from dynident.estimation.uncertainty.envelope import departure_of, envelope_of
from dynident.estimation.uncertainty.propagation import prediction_deviations
from dynident.estimation.uncertainty.trust import with_diagnostics
from dynident.estimation.validation import Validation, compare_torques
from dynident.experiment.case_file.case import DEFAULT_FRICTION, default_preprocessing
from dynident.experiment.formats import ColumnMap
from dynident.experiment.log import Log
from dynident.experiment.preprocessing import Prepared, Preprocessing, preprocess
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.body_constraints import Constraints
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.reduction import least_squares
from dynident.model.threads import on_one_blas_thread


@on_one_blas_thread
def identify(
    model: DynamicModel,
    logs: Sequence[Log],
    estimator: str | Estimator = "consistent",
    preprocessing: Preprocessing | None = None,
    columns: ColumnMap | None = None,
    provenance: Mapping[str, Any] | None = None,
    progress: Callable[[str], None] = lambda step: None,
    choose: bool = False,
    constraints: Constraints | None = None,
    prior: BodyPrior | None = None,
    diagnose: bool = False,
    folds: int = 5,
    bootstrap: int = 0,
    sensitivity: bool = False,
) -> Estimate:
    """Identify the base parameters of a model from logs.

    Args:
        model: Robot, drives and friction; fields that its friction parts vary are found first.
        logs: Raw logs with positions and torques; each is preprocessed on its own.
        estimator: Name or part.
        preprocessing: How logs become rows; default: ``default_preprocessing``.
        columns: How the logs were read, kept so that other logs of the robot can be read alike.
        provenance: Facts to keep with the estimate: case, command.
        progress: Told each step in words.
        choose: Choose the friction of each joint from the logs, in place of the model's.
        constraints: What is known about bodies beforehand; estimators of possible robots keep it.
        prior: Standard parameters known beforehand, in place of the description's.
        diagnose: Test the residual and the estimate; ``diagnostics`` of the estimate has the figures.
        folds: Parts of the logs for the cross-validation of the diagnostics; 0: none.
        bootstrap: Draws of the bootstrap of the diagnostics; 0: none.
        sensitivity: Fit at half and at double the cut-off as well; ``cutoff_sensitivity`` of the extras has the table.

    Raises:
        BadOption: One fold, or too few draws.
        ContradictoryConstraints: No robot meets the constraints.
        LogMismatch: A log does not fit the robot, or is too short.
        PoorExcitation: The logs do not determine all base parameters.
        SolverFailed: The estimator found no checked solution.
    """
    part = ESTIMATORS.make(estimator)
    problem = pose(model, logs, preprocessing, progress, choose, constraints, prior)
    estimate = estimate_of(problem, part, columns, provenance, progress)
    if sensitivity:
        progress("other cut-offs")
        ordered = [log.ordered(model.robot.joint_names) for log in logs]
        found = cutoff_sensitivity(estimate, problem, ordered)
        estimate = replace(
            estimate, extras={**estimate.extras, "cutoff_sensitivity": found} if found else estimate.extras
        )
    if not (diagnose or bootstrap):
        return estimate
    progress("diagnostics")
    return with_diagnostics(estimate, problem, part, folds, bootstrap)


def pose(
    model: DynamicModel,
    logs: Sequence[Log],
    preprocessing: Preprocessing | None = None,
    progress: Callable[[str], None] = lambda step: None,
    choose: bool = False,
    constraints: Constraints | None = None,
    prior: BodyPrior | None = None,
) -> Problem:
    """Return the problem that every estimator can be asked to solve; arguments and errors as of :func:`identify`."""
    if not logs:
        raise LogMismatch("identify", "no log", "give at least one log")
    how = preprocessing or default_preprocessing()
    ordered = [log.ordered(model.robot.joint_names) for log in logs]
    first = without_optional(model)
    if choose:
        first = replace(model, friction=tuple(FRICTION.make(name) for name in DEFAULT_FRICTION))
    how, cutoff = with_cutoff(first, ordered, how, progress)
    if choose:  # the delay is found with a full list: it passes for what a shorter one lacks
        from dynident.estimation.friction.alike import USUAL  # few need it

        model = replace(model, friction=USUAL)
    usual, late = without_optional(model), how.delay_s is None
    prepared, facts = _prepared(usual, ordered, how, progress)
    if has_choices(model):
        model, prepared, found = _with_choices(model, ordered, how, prepared, progress)
        facts = {**facts, **found}
    if choose:
        model, choice = _chosen(model, prepared, late, progress)
        facts = {**facts, "friction_choice": choice}
    if has_varying(model):
        model, found = vary_fields(model, prepared, progress)
        facts = {**facts, "non_linear": [asdict(each) for each in found]}
    facts = {**facts, **cutoff}
    progress("base parameters")
    base = base_parameters(model)
    progress("reduction")
    problem = problem_of(model, base, prepared)
    known = constraints or Constraints()
    known.check(model.robot, model.parameters)
    return replace(problem, facts=facts, constraints=known, prior=prior and prior.for_model(model))


def _with_choices(
    model: DynamicModel,
    logs: Sequence[Log],
    how: Preprocessing,
    prepared: Sequence[Prepared],
    progress: Callable[[str], None],
) -> tuple[DynamicModel, Sequence[Prepared], dict[str, Any]]:
    """Return the model with the fields that held-out rows ask for, the logs with their delay, and the facts of both.

    A delay that is to be found is free at first, so that neither it nor friction passes for the other. A free delay
    also hides what the sign of dry friction does, so the fields are chosen again with the delay that was found.
    """
    facts: dict[str, Any] = {}
    late = how.delay_s is None
    chosen, held = choose_fields(model, prepared, progress, late)
    if late:
        if any(each.value != each.stated for each in held):
            prepared, facts = _prepared(chosen, logs, how, progress)
        first, (chosen, held) = chosen, choose_fields(model, prepared, progress)
        if chosen != first:
            prepared, facts = _prepared(chosen, logs, how, progress)
    return chosen, prepared, {**facts, "held_out_fields": [asdict(each) for each in held]}


def _not_kept(problem: Problem, estimator: Estimator) -> dict[str, Any]:
    """Return the name of an estimator that leaves stated constraints aside, for a warning; nothing where none are."""
    if problem.constraints.is_empty or estimator.keeps_constraints:
        return {}
    return {"constraints_not_kept": ESTIMATORS.name_of(estimator)}


def _gain_facts(problem: Problem, weights: Array) -> dict[str, Any]:
    """Return what stated deviations of drive gains do to the estimate; nothing where none are."""
    if not any(joint.drive.gain_deviation for joint in problem.model.robot.active):
        return {}
    from dynident.estimation.drive_gains.propagation import gain_facts  # few need it

    return gain_facts(problem, weights)


def _chosen(
    model: DynamicModel, logs: Sequence[Prepared], late: bool, progress: Callable[[str], None]
) -> tuple[DynamicModel, dict[str, Any]]:
    """Return the model with the friction that the logs ask for, in place of the usual one if better, and how."""
    from dynident.estimation.friction.alike import same_for_all  # few need it
    from dynident.estimation.friction.friction_choice import choose_friction

    choice = choose_friction(model, logs, progress, late)
    own = replace(model, friction=choice.friction)
    found, compared = same_for_all(own, logs, progress, model.friction, choice.pays)
    return found, {**choice.figures(), "alike": [each.figures() for each in compared]}


def _prepared(
    model: DynamicModel, logs: Sequence[Log], how: Preprocessing, progress: Callable[[str], None]
) -> tuple[Sequence[Prepared], dict[str, Any]]:
    """Return the preprocessed logs, and the delay of each where that is asked for."""
    progress("preprocessing")
    if how.delay_s is not None:
        return [preprocess(log, how) for log in logs], {}
    from dynident.estimation.friction.delay import common_delay, find_delays  # few need it

    progress("delay of the torque")
    simple = without_load(model)
    delays, prepared = find_delays(simple, base_parameters(simple), logs, how)
    table = [{"log": log.name, **asdict(delay)} for log, delay in zip(logs, delays, strict=True)]
    return prepared, {"delays": table, "delay_s": common_delay(delays)}


def preparation_of(problem: Problem) -> Preprocessing:
    """Return how logs that the fit has not seen are prepared: as those of the problem, with the delay found there."""
    how = problem.logs[0].how
    return replace(how, delay_s=problem.facts["delay_s"]) if "delay_s" in problem.facts else how


def _solved(problem: Problem, estimator: Estimator, progress: Callable[[str], None]) -> tuple[Problem, Solution]:
    """Return the problem with the load of the drives that its own solution has, and that solution."""
    solution = estimator.solve(problem)
    for _ in range(PASSES):
        if agrees(problem, solution.beta):
            break
        progress("load of the drives")
        problem = with_load(problem, solution.beta)
        solution = estimator.solve(problem)
    return problem, solution


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
    if estimator.wanders:
        problem, _ = _solved(problem, WLS(), progress)
        solution = estimator.solve(problem)
    else:
        problem, solution = _solved(problem, estimator, progress)
    seconds = time.perf_counter() - started
    deviations = problem.joint_deviations(solution.beta)
    train = validate_prepared(model, base, problem.logs, solution.beta)
    factors = correlation_factors(np.split(train.residual, train.starts[1:]), problem.masks)
    covariance, degrees = solution.covariance, solution.degrees
    facts = {**problem.facts, **_gain_facts(problem, solution.weights), **_not_kept(problem, estimator)}
    if covariance is None:
        found = spectral_uncertainty(problem, solution.weights, solution.beta)
        covariance, degrees = found.covariance, found.degrees
    return Estimate(
        model=model,
        base=base,
        beta=solution.beta,
        covariance=covariance,
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
        preprocessing=preparation_of(problem),
        columns=columns or ColumnMap(joints=model.robot.joint_names),
        extras={**solution.extras, **facts, "seconds": seconds},
        provenance={**versions(), "logs": [asdict(log.kept.source) for log in problem.logs], **(provenance or {})},
        degrees=degrees,
        envelope=envelope_of([log.kept for log in problem.logs], problem.triangles, covariance),
    )


@on_one_blas_thread
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
    found = validate_prepared(estimate.model, estimate.base, prepared, estimate.beta)
    observer = Observer(estimate.model, estimate.base, estimate.beta)
    deviations = [prediction_deviations(observer, log, estimate.covariance) for log in prepared]
    found = replace(found, deviations=np.concatenate(deviations), noise=estimate.joint_deviations)
    if estimate.envelope is None:
        return found
    parts = [observer.triangles(log, np.ones((len(log.keep), len(log.log.joints)), bool)) for log in prepared]
    triangles = [first.merged(rest) for first, *rest in zip(*parts, strict=True)]
    logs_seen = [log.kept for log in prepared]
    return replace(found, departure=departure_of(estimate.envelope, logs_seen, triangles, estimate.covariance))


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


def versions() -> dict[str, Any]:
    """Return the versions that produced a result."""
    packages = ("dynident", "numpy", "scipy", "numba", "clarabel")
    return {
        "versions": {name: version(name) for name in packages},
        "python": platform.python_version(),
        "platform": platform.platform(),
    }
