"""An estimate from a digest: the same as from the rows, for estimators that ask for triangles only."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, is_dataclass, replace
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.identification.consistency.verdicts import judge
from dynident.identification.estimate.envelope import Envelope, torque_bands
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Fit, Validation
from dynident.identification.estimators import ESTIMATORS, Estimator
from dynident.identification.fit import not_kept, versions
from dynident.identification.problem.choices import Choices
from dynident.identification.problem.estimator import Solution
from dynident.identification.problem.prior import BodyPrior
from dynident.identification.problem.problem import Problem, check_rank
from dynident.identification.streaming.digest import Digest
from dynident.identification.streaming.stretch_statistics import StretchStatistics
from dynident.model.body_constraints import Constraints
from dynident.model.reduction import Triangle, least_squares


def check_estimator(estimator: Estimator) -> None:
    """Refuse an estimator that reads rows, where only triangles are left.

    Raises:
        BadOption: It needs rows.
    """
    if estimator.from_triangles:
        return
    able = ", ".join(name for name in ESTIMATORS.names() if ESTIMATORS.get(name).from_triangles)
    step = f"it needs the samples, and the file holds their QR factors only; choose one of: {able}"
    raise BadOption("estimator", ESTIMATORS.name_of(estimator), step)


def problem_of(digest: Digest, constraints: Constraints | None = None, prior: BodyPrior | None = None) -> Problem:
    """Return the problem of a digest; it has no rows.

    Raises:
        PoorExcitation: The rows do not determine all base parameters.
    """
    known = constraints or Constraints()
    known.check(digest.model.robot, digest.model.parameters)
    triangles = tuple(joint.triangle for joint in digest.joints)
    problem = Problem(
        digest.model,
        digest.base,
        (),
        (),
        triangles,
        constraints=known,
        prior=prior and prior.for_model(digest.model),
        left=StretchStatistics(digest),
    )
    check_rank(problem.reduced(), digest.base)
    return problem


def identify_digest(
    digest: Digest,
    estimator: str | Estimator = "consistent",
    constraints: Constraints | None = None,
    prior: BodyPrior | None = None,
    provenance: Mapping[str, Any] | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> Estimate:
    """Identify the base parameters of a model from a digest.

    Estimate, covariance and figures of the fit are over all rows; the signals that the estimate keeps are some of them,
    and the furthest state of the envelope is the furthest that was seen on the way.

    Args:
        digest: What is left of the rows.
        estimator: Name or part.
        constraints: What is known about bodies beforehand.
        prior: Standard parameters known beforehand, in place of the robot model's.
        provenance: Facts to keep with the estimate.
        progress: Called with each step in words.

    Raises:
        BadOption: The estimator needs rows.
        PoorExcitation: The rows do not determine all base parameters.
        SolverFailed: The estimator found no checked solution.
    """
    part = ESTIMATORS.make(estimator)
    check_estimator(part)
    problem = problem_of(digest, constraints, prior)
    progress(f"estimator {ESTIMATORS.name_of(part)}")
    started = time.perf_counter()
    solution = part.solve(problem)
    segments, seconds = len(digest.joints[0].counts), time.perf_counter() - started
    run = replace(solution.run, streamed=True, segments=segments, seconds=seconds)
    found = assembled(digest, problem, part, replace(solution, run=run), provenance or {})
    return replace(found, choices=Choices(constraints_not_kept=not_kept(problem, part)))


def assembled(
    digest: Digest, problem: Problem, part: Estimator, solution: Solution, provenance: Mapping[str, Any]
) -> Estimate:
    """Return the estimate of a solution, with covariance, verdicts and figures over all rows of a digest."""
    model, base, left = digest.model, digest.base, StretchStatistics(digest)
    deviations = problem.joint_deviations(solution.beta)
    covariance, degrees = solution.covariance, solution.degrees
    if covariance is None:
        inverse = least_squares(problem.reduced(solution.weights)).unscaled_covariance
        covariance, degrees = left.uncertainty(inverse, solution.weights, solution.beta)
        pull = solution.pull(problem)
        covariance = covariance + np.outer(pull, pull)
    return Estimate(
        model=model,
        base=base,
        beta=solution.beta,
        covariance=covariance,
        theta=solution.theta,
        joint_deviations=deviations,
        correlation_factors=left.factors(solution.beta),
        condition_number=least_squares(problem.reduced(1.0 / deviations)).condition_number,
        samples=problem.samples,
        inertial_base_parameters=base.rank_of(model.inertial_count),
        estimator=ESTIMATORS.name_of(part),
        options=asdict(part) if is_dataclass(part) else {},
        consistency=judge(model, base, solution.beta, solution.theta),
        train=figures_of(digest, solution.beta),
        preprocessing=digest.how,
        columns=digest.columns,
        run=solution.run,
        provenance={**versions(), "logs": [asdict(chunk) for chunk in digest.chunks], **provenance},
        degrees=degrees,
        envelope=_envelope(digest, problem.triangles, covariance),
    )


def figures_of(digest: Digest, beta: Array) -> Validation:
    """Return the figures of a fit over all rows of a digest, with the signals of those that are kept."""
    every = tuple(
        _fit(digest, i, joint.every, joint.products.sum(axis=0), beta) for i, joint in enumerate(digest.joints)
    )
    moving = tuple(_fit(digest, i, joint.triangle, joint.products[0], beta) for i, joint in enumerate(digest.joints))
    squares = np.array([joint.every.residual_square(beta) for joint in digest.joints])
    torques = np.array([joint.products[:, 1, -2].sum() for joint in digest.joints])
    sampled = digest.sampled
    residuals = [
        rows[:, -1] - rows[:, :-1] @ beta[j.columns] for rows, j in zip(sampled.rows, digest.joints, strict=True)
    ]
    statement = {**digest.how.statement(), "rate_hz": round(digest.chunks[0].rate, 6)}
    return Validation(
        joints=every,
        moving=moving,
        total_relative_error=float(np.sqrt(squares.sum() / torques.sum())) if torques.sum() > 0 else float("nan"),
        samples=digest.samples,
        standstill=digest.how.standstill,
        filter=statement,
        logs=tuple(chunk.path for chunk in digest.chunks),
        time=sampled.time,
        starts=sampled.starts,
        q=sampled.q,
        dq=sampled.dq,
        measured=sampled.measured,
        unfiltered=sampled.unfiltered,
        predicted=sampled.measured - np.stack(residuals, axis=1),
    )


def _fit(digest: Digest, joint: int, triangle: Triangle, products: Array, beta: Array) -> Fit:
    """Return the figures of one joint from its triangle and the products of :class:`JointRows`.

    With m the measured torque, e the residual, p = m - e the prediction and d what the filter took from the torque.
    """
    name, unit = digest.model.robot.joint_names[joint], digest.model.robot.units[joint]
    rows = round(float(products[0, -3]))
    if not rows:
        return Fit(name, unit, 0, *[float("nan")] * 6)
    vector = np.append(-beta[triangle.columns], 1.0)
    sum_e, sum_me, sum_de = products[:, :-3] @ vector
    sum_m, sum_mm, sum_dd = products[0, -2], products[1, -2], products[2, -1]
    square = triangle.residual_square(beta)
    variance = max(sum_mm / rows - (sum_m / rows) ** 2, 0.0)
    predicted = max((sum_mm - 2 * sum_me + square) / rows - ((sum_m - sum_e) / rows) ** 2, 0.0)
    shared = (sum_mm - sum_me) / rows - sum_m / rows * (sum_m - sum_e) / rows
    changes = variance > 1e-24 * max(sum_mm / rows, 1e-300)
    return Fit(
        name=name,
        unit=unit,
        samples=rows,
        rmse=float(np.sqrt(square / rows)),
        rmse_unfiltered=float(np.sqrt(max(sum_dd + 2 * sum_de + square, 0.0) / rows)),
        correlation=float(shared / np.sqrt(variance * predicted)) if changes and predicted > 0 else float("nan"),
        r2=float(1.0 - square / rows / variance) if changes else float("nan"),
        relative_error=float(np.sqrt(square / sum_mm)) if sum_mm > 0 else float("nan"),
        deviation=float(np.sqrt(variance)),
    )


def _envelope(digest: Digest, triangles: Sequence[Triangle], covariance: Array) -> Envelope:
    states, dof = digest.states, digest.model.robot.dof
    return Envelope(
        low=states.low.reshape(3, dof),
        high=states.high.reshape(3, dof),
        mean=states.mean,
        whitener=states.whitener,
        furthest=float(np.max(states.distances(states.far))),
        bands=torque_bands(triangles, covariance),
    )
