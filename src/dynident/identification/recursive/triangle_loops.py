"""Compiled loops that add rows to a triangle and take rows out of it, in place.

With the triangle R (k, k) and a row x, adding makes R'R + x x' of R'R by Givens rotations; taking out makes R'R - x x'
by hyperbolic ones in their mixed form, which uses each new entry of R for the row (Chambers 1971; Bojanczyk, Brent, van
Dooren and de Hoog 1987). That form has small errors as long as no diagonal loses most of itself.
"""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.model.kernels.jit import compiled


@compiled
def add_rows(triangle: Array, rows: Array) -> None:
    """Add rows (m, k) to an upper triangle (k, k); both are overwritten."""
    size = len(triangle)
    for i in range(len(rows)):
        for k in range(size):
            entry = rows[i, k]
            if entry == 0.0:
                continue
            diagonal = triangle[k, k]
            length = np.sqrt(diagonal * diagonal + entry * entry)
            cosine, sine = diagonal / length, entry / length
            triangle[k, k] = length
            for j in range(k + 1, size):
                above, below = triangle[k, j], rows[i, j]
                triangle[k, j] = cosine * above + sine * below
                rows[i, j] = cosine * below - sine * above


@compiled
def take_rows(triangle: Array, rows: Array, least: float) -> float:
    """Take rows (m, k) out of an upper triangle (k, k); both are overwritten.

    Args:
        triangle: Of rows among which those taken out are; the last column is the right-hand side.
        rows: The rows.
        least: Share of the square of a diagonal that has to be left.

    Returns:
        The smallest share of the square of a diagonal, the last one left out, that was left; below ``least`` the work
        has been broken off there and the triangle is of no use. The last diagonal, the residual, is 0 where rounding
        would make it negative.
    """
    size, worst = len(triangle), 1.0
    for i in range(len(rows)):
        for k in range(size):
            entry = rows[i, k]
            if entry == 0.0:
                continue
            diagonal = triangle[k, k]
            if k == size - 1:
                rest = (diagonal - entry) * (diagonal + entry)
                triangle[k, k] = np.sqrt(rest) if rest > 0.0 else 0.0
                continue
            tangent = entry / diagonal if diagonal != 0.0 else 1.0
            left = (1.0 - tangent) * (1.0 + tangent)
            if not left >= least:
                return left
            worst = min(worst, left)
            cosine = np.sqrt(left)
            secant = 1.0 / cosine
            triangle[k, k] = cosine * diagonal
            for j in range(k + 1, size):
                above, below = triangle[k, j], rows[i, j]
                above = secant * (above - tangent * below)
                triangle[k, j] = above
                rows[i, j] = cosine * below - tangent * above
    return worst
