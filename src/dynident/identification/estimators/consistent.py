"""Physically consistent weighted least squares, the default."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, TypeAlias

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.identification.consistency.conic import solve_ranges
from dynident.identification.consistency.consistent_fit import (
    MARGIN,
    METRICS,
    ConsistentFit,
    Metric,
    consistent_fit,
    run_of,
    scale_of,
    scaled_data,
    solve_program,
)
from dynident.identification.consistency.plausible_fit import plausible_fit
from dynident.identification.estimate.plausibility import Plausibility
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.prior import PULL, Scale
from dynident.identification.problem.problem import Problem
from dynident.model.body_constraints import BODIES
from dynident.model.reduction import Reduced

Bodies: TypeAlias = Literal["free", "plausible", "auto"]


@dataclass(frozen=True)
class Consistent(Estimator):
    """Physically consistent weighted least squares: P_i > 0 for every link, friction and rotor inertia >= 0.

    Weights come from weighted least squares first. What the data leave open settles at the prior: the one that the
    problem states, else the robot model's inertias where they are possible, else balls of the right size. What the
    problem states about bodies (masses, centres, hulls) holds as well. The answer is proven to be the optimum.

    Attributes:
        pull: How tightly the prior holds: its standard deviation is 1 / sqrt(pull) natural sizes of a parameter.
        margin: Smallest eigenvalue of each link's scaled pseudo-inertia: how far inside the possible it stays.
        metric: How far a body is from the prior: `natural` sizes, constant `pull_back` metric, or `entropic` (log-det).
        bodies: `free`: consistent; `plausible`: also within bounds from the robot model, near it where the data allow;
            `auto`: plausible where `metric` is `natural`.
        ranges: Find the range of each standard parameter within the bounds of plausible bodies and the noise.
    """

    pull: float = PULL
    margin: float = MARGIN
    metric: Metric = "natural"
    bodies: Bodies = "auto"
    ranges: bool = False

    keeps_constraints: ClassVar = True
    from_triangles: ClassVar = True
    fits_folds: ClassVar = True
    contest_options: ClassVar = {"bodies": "free"}

    def __post_init__(self) -> None:
        if not 0 < self.pull < 1e6:
            raise BadOption("pull", self.pull, "give a number above 0, such as 0.01")
        if not 0 < self.margin < 0.1:
            raise BadOption("margin", self.margin, "give a share between 0 and 0.1, such as 1e-8")
        if self.metric not in METRICS:
            raise BadOption("metric", self.metric, f"choose one of: {', '.join(METRICS)}")
        if self.bodies not in BODIES:
            raise BadOption("bodies", self.bodies, f"choose one of: {', '.join(BODIES)}")
        if self.bodies == "plausible" and self.metric != "natural":
            raise BadOption("metric", self.metric, "plausible bodies have the entropic metric; leave it out")

    @property
    def prior_pull(self) -> float:
        return self.pull

    def _bounded(self, problem: Problem) -> bool:
        return self.bodies == "plausible" or (self.bodies == "auto" and self.metric == "natural")

    def refit(self, problem: Problem, run: MethodRun | None = None) -> Callable[[Reduced], Array]:
        scale = scale_of(problem)
        if not self._bounded(problem):
            return lambda reduced: self._free(problem, reduced, scale).theta
        weights, settled = WLS().solve(problem).weights, None if run is None else Plausibility.of(run)
        rows = max(problem.reduced(weights).rows, 1)
        program = plausible_fit(problem, weights, self.pull, self.margin, settled).program

        def fit(reduced: Reduced) -> Array:
            """Fit within the same bounds and with the same pull, which counts as many rows as the data."""
            data, target = scaled_data(problem.base, reduced, scale)
            share = rows / max(reduced.rows, 1)
            return solve_program(program.on(data, target, share)).candidate.phi * scale.parameters

        return fit

    def solve(self, problem: Problem) -> Solution:
        """Fit and prove.

        Raises:
            ContradictoryConstraints: The stated conditions clash.
            SolverFailed: No solver's answer passed the check.
        """
        weights = WLS().solve(problem).weights
        reduced, scale = problem.reduced(weights), scale_of(problem)
        fit = free = self._free(problem, reduced, scale)
        metric, facts = self.metric, None
        if self.ranges and not self._bounded(problem):
            raise BadOption("ranges", True, "they need bounds of plausible bodies: --bodies plausible")
        if self._bounded(problem):
            found = plausible_fit(problem, weights, self.pull, self.margin)
            free_beta = tuple(problem.base.from_standard(free.theta).tolist())
            fit, metric, facts = found.fit, "entropic", replace(found.facts, free_beta=free_beta)
            if self.ranges:
                spans = (scale.parameters[:, None] * solve_ranges(*found.limited)).tolist()
                facts = replace(facts, ranges=tuple(map(tuple, spans)))
        beta = problem.base.from_standard(fit.theta)
        run = replace(run_of(fit, scale, reduced, beta, metric), plausibility=facts)
        return Solution(beta, weights, theta=fit.theta, run=run)

    def _free(self, problem: Problem, reduced: Reduced, scale: Scale) -> ConsistentFit:
        options = (self.pull, self.margin, self.metric)
        return consistent_fit(problem.model, problem.base, reduced, scale, *options, problem.constraints)
