"""What a benchmark came to: one row for each method in each condition, over all its draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dynident.arrays import finite
from dynident.studies.benchmark.runner import reasons
from dynident.studies.benchmark.virtual_tasks import VirtualTask

#: Figures of which the median and the 90th percentile are told.
SPREAD = ("parameter_distance", "weighted_distance", "torque_distance", "seconds")

#: Figures of which the mean is told.
MEANS = ("iterations", "simulations", "evaluations")


@dataclass(frozen=True)
class MethodRow:
    """One method in one condition.

    Attributes:
        robot: Name.
        noise: Name of the level.
        rate: Samples a second, in Hz.
        method: Label.
        draws: Logs that it was given so far.
        failures: Those on which it came to nothing.
        why: The most frequent reason; empty for none.
        medians: Median over the draws that succeeded of each figure in :data:`SPREAD`; NaN where there is none.
        tails: Their 90th percentiles.
        means: Mean of each figure in :data:`MEANS`; NaN where the method does not tell.
        consistent: Share of physically consistent estimates.
        coverage: Share of 95 % intervals of base parameters that hold the truth, over all draws.
    """

    robot: str
    noise: str
    rate: float
    method: str
    draws: int
    failures: int
    why: str
    medians: Mapping[str, float]
    tails: Mapping[str, float]
    means: Mapping[str, float]
    consistent: float
    coverage: float

    def figures(self) -> dict[str, Any]:
        """Return the row as plain data; a figure that does not exist is None."""
        data = asdict(self)
        for name in ("medians", "tails", "means"):
            data[name] = {key: finite(value) for key, value in data[name].items()}
        return {**data, "consistent": finite(self.consistent), "coverage": finite(self.coverage)}


def summary_of(results: Sequence[tuple[VirtualTask, Mapping[str, Any]]]) -> tuple[MethodRow, ...]:
    """Return a row for each condition and method that has results, conditions in the order of the tasks.

    Within a condition the best median distance of torques stands first, methods that always fail last. The order in
    which results came does not matter.
    """
    groups: dict[tuple[str, str, float, str], list[Mapping[str, Any]]] = {}
    for task, result in sorted(results, key=lambda each: each[0].draw):
        groups.setdefault((*task.condition, task.entrant.label), []).append(result)
    rows = [_row(key, found) for key, found in groups.items()]
    order = {key: place for place, key in enumerate(dict.fromkeys(task.condition for task, _ in results))}

    def rank(row: MethodRow) -> tuple[int, float, str]:
        figure = row.medians["torque_distance"]
        return order[row.robot, row.noise, row.rate], figure if np.isfinite(figure) else np.inf, row.method

    return tuple(sorted(rows, key=rank))


def _row(key: tuple[str, str, float, str], results: Sequence[Mapping[str, Any]]) -> MethodRow:
    good = [result for result in results if not result.get("failure")]
    why = next(iter(reasons(results)), "")
    parameters = sum(result["parameters"] for result in good)
    return MethodRow(
        *key,
        draws=len(results),
        failures=len(results) - len(good),
        why=why,
        medians={name: _quantile(good, name, 0.5) for name in SPREAD},
        tails={name: _quantile(good, name, 0.9) for name in SPREAD},
        means={name: _mean(good, name) for name in MEANS},
        consistent=float(np.mean([result["consistent"] for result in good])) if good else float("nan"),
        coverage=sum(result["covered"] for result in good) / parameters if parameters else float("nan"),
    )


def _values(results: Sequence[Mapping[str, Any]], name: str) -> list[float]:
    return [float(result[name]) for result in results if result.get(name) is not None]


def _quantile(results: Sequence[Mapping[str, Any]], name: str, level: float) -> float:
    values = _values(results, name)
    return float(np.quantile(values, level)) if values else float("nan")


def _mean(results: Sequence[Mapping[str, Any]], name: str) -> float:
    values = _values(results, name)
    return float(np.mean(values)) if values else float("nan")
