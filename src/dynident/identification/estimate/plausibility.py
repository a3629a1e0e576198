"""What a consistent fit states: its proof, what plausible bodies cost, where data contradict the robot model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dynident.identification.problem.method_run import MethodRun

#: The name under which the range of the total mass is relaxed.
TOTAL_MASS = "total mass"


@dataclass(frozen=True)
class ContradictedBound:
    """A bound that the data contradict beyond their noise.

    Attributes:
        name: The link, or :data:`TOTAL_MASS`.
        bound: `mass`, `size`, or `wider size`: one that was widened to hold the nominal body.
        statistic: Fall of the weighted residual square without the bound, each joint's over its correlation factor.
        limit: Quantile of chi-square that it exceeds, with one degree of freedom, ten for a size.
        gain: Relative fall of the weighted residual of the training samples without the bound.
        is_relaxed: Whether the bound was dropped, with a mass also the pull of the link; a stated one is kept.
    """

    name: str
    bound: str
    statistic: float
    limit: float
    gain: float
    is_relaxed: bool


@dataclass(frozen=True)
class Plausibility:
    """How an estimate of plausible bodies came about.

    Attributes:
        weight: v of the pull to the nominal bodies, in residual variances; see ``plausible_fit``.
        cost_rise: What the pull raises the weighted residual square by, in residual variances.
        cost_limit: What it may at most: the 95 % region of the base parameters, see ``plausible_fit``.
        contradicted: Bounds that the data contradict.
        uniform: Links without a possible nominal inertia: the pull is to the uniform body that fills the geometry.
        fitted: Links whose nominal inertia breaks their bounds: the pull is to the nearest body that meets them.
        widened: Links whose possible nominal inertia reaches beyond their shapes: the size that bounds them holds both.
        massless: Links whose mass neither data nor robot model nor constraints determine.
        free_beta: Base parameters of the fit without bounds and pull, b of them.
        ranges: Least and largest value of each standard parameter within the bounds and the limit of the cost, p pairs;
            infinite where nothing holds it, NaN where none is proven; empty where they were not asked for.
    """

    weight: float
    cost_rise: float
    cost_limit: float
    contradicted: tuple[ContradictedBound, ...]
    uniform: tuple[str, ...]
    fitted: tuple[str, ...] = ()
    widened: tuple[str, ...] = ()
    massless: tuple[str, ...] = ()
    free_beta: tuple[float, ...] = ()
    ranges: tuple[tuple[float, float], ...] = ()

    @classmethod
    def of(cls, run: MethodRun) -> Plausibility | None:
        """Return what the run of an estimate states; None where its bodies have no bounds."""
        stated = run.data().get("plausibility")
        if stated is None:
            return None
        contradicted = tuple(ContradictedBound(**{"bound": "mass", **item}) for item in stated["contradicted"])
        tuples = {key: tuple(stated.get(key, ())) for key in ("uniform", "fitted", "widened", "massless", "free_beta")}
        return cls(**{**stated, **tuples, "contradicted": contradicted})


@dataclass(frozen=True, kw_only=True)
class ConsistentRun(MethodRun):
    """Rise of the residual over the free fit (a fraction), solver, what holds the estimate (natural sizes), metric.

    ``plausibility`` is what plausible bodies cost, for these.
    """

    residual_above_unconstrained: float | None
    solver: str
    failed_solvers: Sequence[str]
    active: Sequence[str]
    active_slack: Sequence[float]
    active_multiplier: Sequence[float]
    metric: str | None = None
    plausibility: Plausibility | None = None
