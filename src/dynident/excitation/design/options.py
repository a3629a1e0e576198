"""Options of a design, as values: the shape of the motion, what is known before, the space to keep, the search."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy.typing as npt

from dynident.excitation.design.distances import Distances
from dynident.excitation.design.limits import ToolLimit
from dynident.excitation.design.observation import TorqueUncertainty
from dynident.excitation.design.prior import Prior
from dynident.workers.processes import Pool


@dataclass(frozen=True)
class TrajectoryOptions:
    """The family of motions that is searched.

    Attributes:
        kind: ``rest_fourier``, ``bspline``, or ``fourier`` (14) with a run-in from rest.
        period: Period in s.
        harmonics: Number of sine and cosine pairs per joint, or what is comparable.
        samples: Samples of one period that the search looks at.
    """

    kind: str = "rest_fourier"
    period: float = 10.0
    harmonics: int = 5
    samples: int = 200


@dataclass(frozen=True)
class DesignKnowledge:
    """What is known before the run.

    Attributes:
        noise: Standard deviation of each joint's torque in N m or N, one number or (n,); None for 1 % of the effort
            limits.
        theta: Parameters for the torque limits, shape (p,); None for those of the robot model.
        uncertainty: Chance margin of the torque limits; None for none.
        earlier: What earlier runs know, for criteria that weigh by the noise: they are of both together.
        rows: Effective sample size of each joint that the run gives, to weigh it against ``earlier``; None for 200 a
            second.
    """

    noise: npt.ArrayLike | None = None
    theta: npt.ArrayLike | None = None
    uncertainty: TorqueUncertainty | None = None
    earlier: Prior | None = None
    rows: float | None = None


@dataclass(frozen=True)
class SpaceLimits:
    """What the motion keeps in space.

    Attributes:
        clearance: Pairs of shapes to be kept apart; None leaves them out.
        tool: Largest speed of the tool point; None leaves it out.
    """

    clearance: Distances | None = None
    tool: ToolLimit | None = None


@dataclass(frozen=True)
class SearchOptions:
    """How the motion is searched.

    Attributes:
        starts: Number of random starts.
        seed: Of the starts; start k of a seed is the same whatever their number.
        time_limit: Time in s after which the best motion so far is taken.
        jobs: Processes, None for one a core; above 1 the main module must be importable.
        pool: Where starts are run in place of ``jobs`` processes, such as a cluster.
        checkpoint: File that keeps finished starts; those in it are not searched again.
    """

    starts: int = 4
    seed: int = 0
    time_limit: float = 60.0
    jobs: int | None = 1
    pool: Pool | None = None
    checkpoint: str | Path | None = None
