"""What the torques leave where bodies are known: a load, a scale of all torques, and causes that free bodies hide."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.causes.cause_columns import CauseRows
from dynident.diagnosis.causes.cause_search import Blame, Cause
from dynident.diagnosis.causes.flange_load import TEN, TOLD, load_columns
from dynident.diagnosis.causes.known_bodies import FIRST, Anchored, KnownBodies, NominalBodies
from dynident.diagnosis.causes.quick_fit import OVERSAMPLING
from dynident.diagnosis.causes.trends import Trends
from dynident.identification.residuals.covariance import correlation_factors

#: Causes that have no meaning against bodies: friction may be another one.
LEFT_OUT = ("friction curve",)


class AgainstBodies:
    """What the torques leave where the bodies are the known ones, as far as they are known.

    Attributes:
        fit: The quick fit, whose bodies are free.
    """

    def __init__(self, trends: Trends, known: KnownBodies) -> None:
        self.fit, self._trends, self._known = trends.fit, trends, known

    @cached_property
    def blames(self) -> tuple[Blame, ...]:
        """What differs from the known bodies, the cause that explains most first.

        A cause that is left in the residual makes its rows hang together. So they are counted again beside the causes
        that are sure all the same, and these are looked for with the new count (feasible generalized least squares).
        """
        search, fit = self._search, self.fit
        found = search.blames()
        if not found:
            return ()
        factors = correlation_factors([search.residual([blame.cause for blame in found])], [fit.rows.masks])
        return search.with_factors(np.minimum(factors, fit.counts / fit.independent_rows)).blames()

    @cached_property
    def _search(self) -> Anchored:
        """The products of all columns."""
        fit, rows = self.fit, self.fit.rows
        target = rows.torque - rows.known
        found = CauseRows(rows.blocks, rows.columns, fit.base.count, target, rows.torque, rows.masks, OVERSAMPLING)
        causes = [cause for cause in self._trends.causes if cause.name not in LEFT_OUT]
        load = Cause("load at the flange", "", load_columns(fit), hidden=TEN - TOLD)
        causes += [load, Cause("torque scale", "", self.bodies[None])]
        return Anchored(found, causes, self._known, fit.counts / fit.independent_rows)

    @cached_property
    def masses(self) -> Array:
        """Mass of each link by the robot model, in kg; infinite where it states none."""
        theta, count = self.fit.model.nominal(), self.fit.model.inertial_count
        return (
            np.full(count // TEN, np.inf) if theta is None or not theta[:count].any() else theta[TEN - 1 : count : TEN]
        )

    @property
    def last_link(self) -> float:
        """Standard deviation of the mass of the last link in kg, whose errors no log tells from a load."""
        return FIRST * float(self.masses[-1]) if isinstance(self._known, NominalBodies) else 0.0

    @cached_property
    def bodies(self) -> Array:
        """Torque of the known bodies, shape (N, n)."""
        fit, rows = self.fit, self.fit.rows
        beta = np.zeros(fit.base.count)
        beta[self._known.places] = self._known.values
        return np.stack([block @ beta[own] for block, own in zip(rows.blocks, rows.columns, strict=True)], axis=1)
