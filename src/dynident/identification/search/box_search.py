"""What the estimators that search a box share: options, box, objective, and the certified optimum beside the search."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.problem import Problem
from dynident.identification.search.landscape import (
    Landscape,
    Optimum,
    absolute_landscape,
    box_optimum,
    square_landscape,
)
from dynident.identification.search.swarm import Rules, Stage, Swarm, run
from dynident.model.reduction import LeastSquares, Reduced, least_squares
from dynident.plugins import bounded

#: Half-width of the box where none is given, in sizes of the least-squares estimate and in its standard deviations.
BOX_SIZES, BOX_DEVIATIONS = 5.0, 5.0


@dataclass(frozen=True, kw_only=True)
class SearchRun(MethodRun):
    """(F - F*) / F*, None for a perfect fit; the box and what it holds back; the rule that ended it; options."""

    gap: float | None = field()
    box: Mapping[str, Any]
    at_bound: Sequence[str]
    stopped: str
    settings: Mapping[str, Any]
    polished: bool
    scouts: int | None = None


@dataclass(frozen=True, kw_only=True)
class BoxSearch(Estimator):
    """A random search of a box of base parameters; the certified optimum of the box is reported beside it.

    The objective is (9) with joint norms as absolute values, F = 1/N sum_i sum_j delta_j |tau_ji - tau_pji| in N m, or
    the mean of the squares, computed on the reduced triangle.

    Attributes:
        iterations: Number of iterations at most.
        max_evaluations: Evaluations of the objective at most; None for any number.
        stall: Iterations within which the best objective must fall by a millionth of itself; None for any number.
        max_seconds: Time in s after which no iteration is begun; None for any time. A seed does not repeat such a run.
        seed: Seed of the random numbers.
        norm: l1 is (9), the mean absolute error in N m; l2 is the mean squared error in N^2 m^2.
        delta: Weight of each joint in (9); None is 1 for all.
        lower: Lower bound of each base parameter; None is -5 times size and deviation of the least-squares estimate.
        upper: Upper bound of each base parameter; None is 5 times size and deviation of the least-squares estimate.
        polish: Return the certified optimum in place of the search's best point.
    """

    may_not_converge = True

    iterations: int = bounded(1000, most=1_000_000)
    max_evaluations: int | None = bounded(None, most=100_000_000)
    stall: int | None = bounded(None, most=1_000_000)
    max_seconds: float | None = None
    seed: int = 0
    norm: Literal["l1", "l2"] = "l1"
    delta: tuple[float, ...] | None = None
    lower: tuple[float, ...] | None = None
    upper: tuple[float, ...] | None = None
    polish: bool = False

    def __post_init__(self) -> None:
        rules = self.rules  # refuses its own
        if rules.evaluations is not None:
            rules.affordable(*self.costs)
        if self.seed < 0:
            raise BadOption("seed", self.seed, "give 0 or more")
        if self.norm not in ("l1", "l2"):
            raise BadOption("norm", self.norm, "choose l1 or l2")

    @property
    def rules(self) -> Rules:
        """When the search ends."""
        return Rules(self.iterations, self.max_evaluations, self.stall, self.max_seconds)

    @property
    @abstractmethod
    def costs(self) -> tuple[int, int]:
        """Evaluations before the first iteration, and in each iteration at most."""

    @abstractmethod
    def stages(self, land: Landscape, lower: Array, upper: Array) -> Iterator[Stage]:
        """Search the box lower < upper, stage by stage; the rules end it from outside."""

    def search(self, land: Landscape, lower: Array, upper: Array) -> Swarm:
        """Search the box lower < upper for the smallest value of a landscape."""
        return run(land, self.stages(land, lower, upper), self.rules, self.rules.affordable(*self.costs))

    def solve(self, problem: Problem) -> Solution:
        """Search the box, certify the optimum, and return the better known of the two as ``polish`` says.

        Raises:
            BadOption: A box or weights that do not fit the problem.
            SolverFailed: The optimum could not be certified.
        """
        plain = problem.reduced()
        delta = self._weights(len(problem.triangles))
        lower, upper, source = self._box(problem, plain, least_squares(plain))
        land = (square_landscape if self.norm == "l2" else absolute_landscape)(problem, delta)
        swarm = self.search(land, lower, upper)
        optimum = _lower_of(box_optimum(land, lower, upper), swarm)
        beta = optimum.x if self.polish else swarm.x
        near = 1e-6 * (upper - lower)
        held = (optimum.x <= lower + near) | (optimum.x >= upper - near)
        run = SearchRun(
            trace=swarm.trace.tolist(),
            objective=swarm.objective,
            optimum=optimum.objective,
            lower_bound=optimum.lower_bound,
            gap=_gap(swarm.objective, optimum.objective, land.value(np.zeros(len(lower)))),
            box={"lower": lower.tolist(), "upper": upper.tolist(), "source": source},
            at_bound=[name for name, at in zip(problem.base.names, held, strict=True) if at],
            evaluations=swarm.evaluations,
            stopped=swarm.stopped,
            settings={key: value for key, value in asdict(self).items() if key not in ("lower", "upper")},
            polished=self.polish,
            scouts=self.scouts(swarm),
        )
        # The squares are least squares with these weights; for (9) the joints' own deviations are the nearest stand-in.
        weights = np.sqrt(delta) if self.norm == "l2" and self.polish else 1.0 / problem.joint_deviations(beta)
        return Solution(np.array(beta), weights, run=run)

    def scouts(self, swarm: Swarm) -> int | None:
        """Return how many points the method gave up; None for methods that give up none."""
        return None

    def _weights(self, joints: int) -> Array:
        if self.delta is None:
            return np.ones(joints)
        delta = np.asarray(self.delta, dtype=float)
        if delta.shape != (joints,) or not np.all(np.isfinite(delta) & (delta >= 0)) or not delta.any():
            raise BadOption("delta", self.delta, f"give one weight >= 0 for each of the {joints} joints, one above 0")
        return delta

    def _box(self, problem: Problem, plain: Reduced, fit: LeastSquares) -> tuple[Array, Array, str]:
        """Return the box and where it comes from, in words."""
        count = problem.base.count
        variance = plain.residual_square(fit.beta) / max(plain.rows - count, 1)
        half = BOX_SIZES * np.abs(fit.beta) + BOX_DEVIATIONS * np.sqrt(variance * np.diag(fit.unscaled_covariance))
        # A parameter that least squares puts at exactly zero (noise-free data) still needs a box with a width.
        half = np.maximum(half, 1e-9 * np.linalg.norm(fit.beta * plain.column_norms) / plain.column_norms)
        lower = self._bound("lower", self.lower, -half)
        upper = self._bound("upper", self.upper, half)
        for j in np.flatnonzero(~(lower < upper)):
            name = problem.base.parameters[problem.base.independent[j]].name
            raise BadOption("lower", float(lower[j]), f"the bound of {name} must be below its upper one, {upper[j]:g}")
        own = (self.lower is not None) + (self.upper is not None)
        size = f"{BOX_SIZES:g} times the size of the least-squares estimate plus {BOX_DEVIATIONS:g} standard deviations"
        return lower, upper, (f"+-{size}", f"as given on one side, {size} on the other", "as given")[own]

    def _bound(self, option: str, given: tuple[float, ...] | None, default: Array) -> Array:
        if given is None:
            return default
        bound = np.array(given, dtype=float)
        if bound.shape != default.shape or not np.isfinite(bound).all():
            raise BadOption(option, given, f"give one finite number for each of the {len(default)} base parameters")
        return bound


@dataclass(frozen=True, kw_only=True)
class PopulationSearch(BoxSearch):
    """Search by points that are all moved in each iteration; ``least`` is how few its moves take."""

    least: ClassVar[int] = 4

    population: int = bounded(30, most=10_000)

    def __post_init__(self) -> None:
        if self.population < self.least:
            raise BadOption("population", self.population, f"give {self.least} or more")
        super().__post_init__()

    @property
    def costs(self) -> tuple[int, int]:
        return self.population, self.population


def _lower_of(optimum: Optimum, swarm: Swarm) -> Optimum:
    """Return the optimum, or the search's own point where that is lower, within the width of the certificate."""
    if swarm.objective >= optimum.objective:
        return optimum
    return Optimum(swarm.x, swarm.objective, min(optimum.lower_bound, swarm.objective))


def _gap(objective: float, optimum: float, nothing: float) -> float | None:
    """Return (F - F*) / F*; None where F* is rounding, measured against the objective of beta = 0."""
    return objective / optimum - 1.0 if optimum > 1e-9 * nothing else None
