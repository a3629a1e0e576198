"""Figure of convergence: the objective of one or more searches, iteration by iteration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dynident.arrays import Array
from dynident.results.figures.chart import WIDTH, Level
from dynident.results.figures.signals import line_chart
from dynident.results.text import format_number, label

_WIDE = 10.0  # ratio from which on an axis is logarithmic


def convergence_chart(
    traces: Mapping[str, Sequence[float]], optimum: float | None = None, objective: str = "objective"
) -> str:
    """Return the best objective so far over iterations, the optimum as a line. Figure 6 of the article.

    An axis is logarithmic where it reaches over a power of ten: the upward one from the least to the largest
    objective (above zero), the other one from the shortest to the longest search.

    Args:
        traces: Objective after each iteration, by name of the estimator; one value at least.
        optimum: The least objective possible, where it is known.
        objective: What it is, with its unit.
    """
    lines = [(name, np.arange(1.0, len(trace) + 1), np.asarray(trace, dtype=float)) for name, trace in traces.items()]
    levels, said = [], "; ".join(f"{label(name)} ends at {format_number(float(y[-1]))}" for name, _, y in lines)
    if optimum is not None and np.isfinite(optimum):
        levels = [Level(optimum, f"optimum {format_number(optimum)}")]
        said += f"; the optimum is {format_number(optimum)}"
    values = np.concatenate([*(y for _, _, y in lines), [level.value for level in levels]])
    return line_chart(
        "Convergence",
        lines,
        "iteration",
        objective,
        f"Objective over iterations: {said}.",
        log=(_is_wide(np.array([float(len(y)) for _, _, y in lines])), _is_wide(values[np.isfinite(values)])),
        levels=levels,
        size=(WIDTH, 210.0),
    )


def _is_wide(values: Array) -> bool:
    return bool(len(values) and values.min() > 0 and values.max() >= _WIDE * values.min())
