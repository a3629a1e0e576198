"""What plausible bodies cost and where data contradict the robot model, as an estimate states it."""

from __future__ import annotations

from dataclasses import dataclass

from dynident.identification.problem.method_run import MethodRun

#: The name under which the range of the total mass is relaxed.
TOTAL_MASS = "total mass"


@dataclass(frozen=True)
class ContradictedMass:
    """A mass range that the data contradict beyond their noise.

    Attributes:
        name: The link, or :data:`TOTAL_MASS`.
        statistic: Fall of the weighted residual square without the range, each joint's over its correlation factor.
        limit: Quantile of chi-square with one degree of freedom that it exceeds.
        gain: Relative fall of the weighted residual of the training samples without the range.
        is_relaxed: Whether the range, and with it the pull of the link, was dropped; one that a person states is kept.
    """

    name: str
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
        cost_limit: What it may at most: the 95 % quantile of chi-square with one degree of freedom a base parameter.
        contradicted: Mass ranges that the data contradict.
        uniform: Links without a possible nominal inertia: the pull is to the uniform body that fills the geometry.
        free_beta: Base parameters of the fit without bounds and pull, b of them.
    """

    weight: float
    cost_rise: float
    cost_limit: float
    contradicted: tuple[ContradictedMass, ...]
    uniform: tuple[str, ...]
    free_beta: tuple[float, ...] = ()

    @classmethod
    def of(cls, run: MethodRun) -> Plausibility | None:
        """Return what the run of an estimate states; None where its bodies have no bounds."""
        stated = run.data().get("plausibility")
        if stated is None:
            return None
        contradicted = tuple(ContradictedMass(**item) for item in stated["contradicted"])
        tuples = {key: tuple(stated[key]) for key in ("uniform", "free_beta")}
        return cls(**{**stated, **tuples, "contradicted": contradicted})
