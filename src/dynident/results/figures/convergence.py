"""Figure of convergence: the objective of one or more searches, iteration by iteration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dynident.results.figures.chart import WIDTH, Level
from dynident.results.figures.signals import line_chart
from dynident.results.text import format_number, label


def convergence_chart(
    traces: Mapping[str, Sequence[float]],
    optimum: float | None = None,
    objective: str = "objective",
    width: float = WIDTH,
) -> str:
    """Return the best objective so far over iterations, the optimum as a line. Figure 6 of the article.

    The vertical axis is logarithmic where the values are above zero and reach over a power of ten.

    Args:
        traces: Objective after each iteration, by name of the estimator.
        optimum: The least objective possible, where it is known.
        objective: What it is, with its unit.
        width: Of the figure.
    """
    lines = [(name, np.arange(1.0, len(trace) + 1), np.asarray(trace, dtype=float)) for name, trace in traces.items()]
    known = [] if optimum is None or not np.isfinite(optimum) else [Level(optimum, f"optimum {format_number(optimum)}")]
    values = np.concatenate([*(y for _, _, y in lines), np.array([level.value for level in known])])
    finite = values[np.isfinite(values)]
    ends = "; ".join(f"{label(name)} ends at {format_number(float(y[-1]))}" for name, _, y in lines if len(y))
    return line_chart(
        "Convergence",
        lines,
        "iteration",
        objective,
        f"Objective over iterations: {ends}."
        + (f" The optimum is {format_number(optimum)}." if known and optimum else ""),
        log=(False, bool(len(finite) and finite.min() > 0 and finite.max() >= 10 * finite.min())),
        levels=known,
        width=width,
    )
