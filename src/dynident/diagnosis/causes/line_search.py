"""The lowest value of a function of one variable near a start."""

from __future__ import annotations

from collections.abc import Callable


def lowest_near(score: Callable[[float], float], start: float, step: float, precision: float) -> float:
    """Return where a score is lowest near a start: steps to the better side, then vertices of parabolas.

    Args:
        score: The function.
        start: Where to begin.
        step: The first step, above 0; a peak narrower than it may be missed.
        precision: The step below which the search ends.
    """
    best, found = start, score(start)
    while step > precision:
        low, high = score(best - step), score(best + step)
        if min(low, high) < found:
            best, found = (best - step, low) if low < high else (best + step, high)
            continue
        vertex = best + 0.5 * step * (low - high) / max(low - 2.0 * found + high, 1e-300)
        value = score(vertex)
        best, found = (vertex, value) if value < found else (best, found)
        step /= 8
    return best
