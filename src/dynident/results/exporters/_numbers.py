"""Numbers as text: a fixed number of decimals in the unit of the target, read back in SI units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.errors import SolverFailed


@dataclass(frozen=True)
class Decimals:
    """How the values of n joints are printed.

    Attributes:
        scale: Printed unit for each SI unit, shape (n,): 180 / pi for degrees, 1000 for mm.
        places: Digits after the point.
    """

    scale: Array
    places: int

    @property
    def round_off(self) -> Array:
        """Largest error in SI units that the digits make, shape (n,)."""
        return 0.5 * 10.0**-self.places / self.scale

    def texts(self, values: Array) -> list[list[str]]:
        """Return the values (M, n) as text, row by row; zero has no sign.

        Raises:
            SolverFailed: A value is not finite.
        """
        if not np.all(np.isfinite(values)):
            raise SolverFailed("the export", "a sample is not a finite number", "design the motion again")
        rounded = np.round(values * self.scale, self.places) + 0.0
        return [[f"{value:.{self.places}f}" for value in row] for row in rounded.tolist()]

    def read(self, texts: Sequence[Sequence[str]]) -> Array:
        """Return printed values in SI units, shape (M, n)."""
        return np.array([[float(text) for text in row] for row in texts]) / self.scale


def degrees_and_mm(revolute: Sequence[bool]) -> Array:
    """Return the scale of controllers that print degrees and millimetres, shape (n,)."""
    return np.where(np.array(revolute), 180 / np.pi, 1000.0)
