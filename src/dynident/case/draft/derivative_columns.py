"""Which columns of a table are the derivatives of which others, told by their values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array

#: Correlation of positions and integrated velocities from which one is called the derivative of the other.
DERIVATIVE = 0.98

#: How far the joints' factors between them may differ from their median: they have one clock.
ONE_CLOCK = 0.05

#: Fewest columns that are taken for the joints of a log whose robot model has more; two may be so by chance.
LEAST = 3

#: Share of a signal's columns that have to move.
MOVE = 0.5


@dataclass(frozen=True)
class Derivative:
    """Columns ``of`` whose derivative by the row's time the columns ``by`` are, times a factor."""

    of: tuple[int, ...]
    by: tuple[int, ...]
    factor: float


def runs_of(columns: Sequence[int], count: int) -> list[tuple[int, ...]]:
    """Return sets of ``count`` columns that may be one signal: side by side, or every k-th one."""
    there, last = set(columns), max(columns, default=-1)
    found: dict[tuple[int, ...], None] = {}
    for stride in range(1, 1 + last // max(count - 1, 1)):
        for start in range(last + 1 - stride * (count - 1)):
            run = tuple(range(start, start + stride * count, stride))
            if there.issuperset(run) and (stride == 1 or count > 1):
                found.setdefault(run)
    return list(found)


def derivatives(clock: Array, values: Array, runs: Sequence[tuple[int, ...]]) -> list[Derivative]:
    """Return the runs of which one is the derivative of the other, column by column with one factor.

    Integrals are compared, straight lines taken off: noise and coarse encoders hardly matter then, and a sensor's
    offset not at all.
    """
    steps = np.diff(clock)[:, None]
    areas = np.concatenate(
        [np.zeros((1, values.shape[1])), np.cumsum(0.5 * (values[1:] + values[:-1]) * steps, axis=0)]
    )
    own, areas = less_line(clock, values), less_line(clock, areas)
    sizes = np.linalg.norm(own, axis=0), np.linalg.norm(areas, axis=0)
    product = own.T @ areas
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = product / np.outer(*sizes)
        factor = product / (sizes[0] ** 2)[:, None]
    close = (correlation > DERIVATIVE) & (factor > 0)
    starts: dict[int, dict[int, tuple[int, ...]]] = {}
    for run in runs:
        starts.setdefault(_stride(run), {})[run[0]] = run
    found = []
    for of in runs:
        moving = np.flatnonzero(sizes[0][list(of)] > 1e-3 * sizes[0][list(of)].max()).tolist()
        if len(moving) < MOVE * len(of):
            continue
        followers = np.flatnonzero(close[of[moving[0]]]) - moving[0] * _stride(of)
        for by in (starts[_stride(of)].get(start, of) for start in followers.tolist()):
            pairs = tuple(np.array([(of[k], by[k]) for k in moving]).T)
            middle = float(np.median(factor[pairs]))
            alike = np.abs(factor[pairs] / max(middle, 1e-300) - 1) < ONE_CLOCK
            if not set(of) & set(by) and np.all(close[pairs]) and np.all(alike):
                found.append(Derivative(of, by, middle))
    return found


def less_line(clock: Array, values: Array) -> Array:
    """Return columns less the straight line of each over the time; zero where they are one but for rounding."""
    line = np.column_stack([np.ones(len(clock)), (clock - clock.mean()) / np.ptp(clock)])
    left = values - line @ (np.linalg.pinv(line) @ values)
    return np.where(np.linalg.norm(left, axis=0) > 1e-9 * np.linalg.norm(values, axis=0), left, 0.0)


def _stride(run: tuple[int, ...]) -> int:
    return run[1] - run[0] if len(run) > 1 else 1


def joint_count(clock: Array, values: Array, usable: Sequence[int], most: int) -> int:
    """Return the largest number of columns, fewer than ``most``, that have their derivatives in as many others.

    Args:
        clock: Time of the samples in any unit, shape (N,).
        values: The columns, shape (N, k).
        usable: Columns that may be signals of joints.
        most: Joints of the robot.

    Returns:
        0 where no :data:`LEAST` columns or more have.
    """
    largest = min(most - 1, len(usable) // 2)
    return next((n for n in range(largest, LEAST - 1, -1) if derivatives(clock, values, runs_of(usable, n))), 0)
