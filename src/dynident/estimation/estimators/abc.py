"""The artificial bee colony of the article, with the certified optimum beside it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.estimation.estimators.base import Estimator, Solution
from dynident.estimation.landscape import absolute_landscape, box_optimum, square_landscape
from dynident.estimation.problem import Problem
from dynident.model.reduction import LeastSquares, Reduced, least_squares

#: Half-width of the box where none is given, in sizes of the least-squares estimate and in its standard deviations.
BOX_SIZES, BOX_DEVIATIONS = 5.0, 5.0


@dataclass(frozen=True)
class ArtificialBeeColony(Estimator):
    """The article's artificial bee colony, (7)-(13), after Karaboga 2005; the certified optimum is reported beside it.

    In (10) the neighbour k is another food source, k != i, as in Karaboga 2005. The article draws k from 1..D, the
    number of parameters: with 21 parameters and 15 sources that cannot run. The objective is (9) with joint norms as
    absolute values, F = 1/N sum_i sum_j delta_j |tau_ji - tau_pji| in N m, or the mean of the squares, computed on the
    reduced triangle. No colony is needed to minimise either: the optimum in the same box is computed and certified as
    well, and ``extras`` says how far the colony ended from it.

    Attributes:
        colony: Number of bees N_s, half employed and half onlookers; even, 4 or more.
        limit: Trials without success above which a source may be given up, one per iteration.
        iterations: Number of iterations T_max.
        seed: Seed of the random numbers.
        norm: l1 is (9), the mean absolute error in N m; l2 is the mean squared error in N^2 m^2.
        delta: Weight of each joint in (9); None is 1 for all.
        lower: Lower bound of each base parameter; None is -5 times size and deviation of the least-squares estimate.
        upper: Upper bound of each base parameter; None is 5 times size and deviation of the least-squares estimate.
        polish: Return the certified optimum in place of the colony's best source.
    """

    colony: int = 30
    limit: int = 15
    iterations: int = 50
    seed: int = 0
    norm: Literal["l1", "l2"] = "l1"
    delta: tuple[float, ...] | None = None
    lower: tuple[float, ...] | None = None
    upper: tuple[float, ...] | None = None
    polish: bool = False

    def __post_init__(self) -> None:
        if self.colony < 4 or self.colony % 2:
            raise BadOption("colony", self.colony, "give an even number, 4 or more")
        if self.limit < 1:
            raise BadOption("limit", self.limit, "give 1 or more")
        if self.iterations < 1:
            raise BadOption("iterations", self.iterations, "give 1 or more")
        if self.seed < 0:
            raise BadOption("seed", self.seed, "give 0 or more")
        if self.norm not in ("l1", "l2"):
            raise BadOption("norm", self.norm, "choose l1 or l2")

    def solve(self, problem: Problem) -> Solution:
        """Search the box, certify the optimum, and return the better known of the two as ``polish`` says.

        ``extras``: trace (best objective after each iteration), objective (of the colony), optimum F*, lower_bound (no
        point of the box is below it), gap (F - F*) / F* (None where F* is a perfect fit), box (lower, upper, source),
        at_bound (parameters of the optimum that the box holds back), evaluations, scouts, settings, polished.

        Raises:
            BadOption: A box or weights that do not fit the problem.
            SolverFailed: The optimum could not be certified.
        """
        from dynident.estimation.colony import search

        plain = problem.reduced()
        delta = self._weights(len(problem.triangles))
        lower, upper, source = self._box(problem, plain, least_squares(plain))
        land = (square_landscape if self.norm == "l2" else absolute_landscape)(problem, delta)
        optimum = box_optimum(land, lower, upper)
        swarm = search(land, lower, upper, self.colony, self.limit, self.iterations, self.seed)
        beta = optimum.x if self.polish else swarm.x
        near = 1e-6 * (upper - lower)
        held = (optimum.x <= lower + near) | (optimum.x >= upper - near)
        extras = {
            "trace": swarm.trace.tolist(),
            "objective": swarm.objective,
            "optimum": optimum.objective,
            "lower_bound": optimum.lower_bound,
            "gap": _gap(swarm.objective, optimum.objective, land.value(np.zeros(len(lower)))),
            "box": {"lower": lower.tolist(), "upper": upper.tolist(), "source": source},
            "at_bound": [name for name, at in zip(problem.base.names, held, strict=True) if at],
            "evaluations": swarm.evaluations,
            "scouts": swarm.scouts,
            "settings": {key: value for key, value in asdict(self).items() if key not in ("lower", "upper")},
            "polished": self.polish,
        }
        # The squares are least squares with these weights; for (9) the joints' own deviations are the nearest stand-in.
        weights = np.sqrt(delta) if self.norm == "l2" and self.polish else 1.0 / problem.joint_deviations(beta)
        return Solution(np.array(beta), weights, extras=extras)

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


def _gap(objective: float, optimum: float, nothing: float) -> float | None:
    """Return (F - F*) / F*; None where F* is rounding, measured against the objective of beta = 0."""
    return objective / optimum - 1.0 if optimum > 1e-9 * nothing else None
