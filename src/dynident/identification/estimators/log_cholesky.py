"""Least squares over log-Cholesky forms, which are possible by construction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from dynident.errors import BadOption
from dynident.identification.consistency.consistent_fit import consistent_fit, data_shares, pose_program, scale_of
from dynident.identification.consistency.log_cholesky_fit import descend
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.prior import PULL
from dynident.identification.problem.problem import Problem
from dynident.model.threads import one_blas_thread
from dynident.plugins import bounded


@dataclass(frozen=True, kw_only=True)
class LogCholeskyRun(MethodRun):
    """``singular_links``: on the boundary of the possible, here or at the proven optimum of ``consistent``."""

    singular_links: Sequence[str]


@dataclass(frozen=True)
class LogCholesky(Estimator):
    """Weighted least squares over the log-Cholesky forms of the links (Rucker and Wensing 2022), by Gauss-Newton.

    It minimises what `consistent` minimises. Where the optimum lies on the boundary of the possible, as it mostly does
    when least squares is impossible, no log-Cholesky form reaches it: the search stops within 1 % of the proven optimum
    of `consistent`, says so, and states how far it ended from it. What the problem states about bodies is not kept.

    Attributes:
        pull: How tightly the prior holds: its standard deviation is 1 / sqrt(pull) natural sizes of a parameter.
        iterations: Steps at most.
    """

    pull: float = PULL
    iterations: int = bounded(100, most=10_000)

    from_triangles: ClassVar = True

    def __post_init__(self) -> None:
        if not 0 < self.pull < 1e6:
            raise BadOption("pull", self.pull, "give a number above 0, such as 0.01")
        self.check_steps(self.iterations)

    @property
    def prior_pull(self) -> float:
        return self.pull

    def solve(self, problem: Problem) -> Solution:
        """Search, and measure against the optimum.

        Raises:
            SolverFailed: The optimum to compare with could not be proven.
        """
        weights = WLS().solve(problem).weights
        reduced, scale = problem.reduced(weights), scale_of(problem)
        program = pose_program(problem.model, problem.base, reduced, scale, self.pull)
        proven = consistent_fit(problem.model, problem.base, reduced, scale, self.pull)
        best = program.objective(proven.theta / scale.parameters)
        held = {str(condition["condition"]) for condition in proven.active}
        with one_blas_thread():
            found = descend(program, self.iterations, best)
            shares = data_shares(program, found.phi)
        theta = found.phi * scale.parameters
        words = zip(program.conditions.links, program.conditions.cone_words, strict=True)
        singular = [name for name, text in words if text in held or name in found.singular]
        run = LogCholeskyRun(
            prior=scale.source,
            verdict=found.verdict,
            iterations=found.iterations,
            singular_links=singular,
            gap=(found.objective - best) / (best + 0.5),
            data_share=shares.tolist(),
        )
        return Solution(problem.base.from_standard(theta), weights, theta=theta, run=run)
