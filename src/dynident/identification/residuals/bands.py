"""Rows of a problem by frequency: stretches of time, transformed, with the power that the filter passes beside them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.preprocessing import Prepared
from dynident.identification.residuals.row_passes import RowPasses
from dynident.identification.residuals.stretches import Stretch, stretches

#: Frequencies to either side of an average, over the root of the number of those that the filter passes.
WIDTH = 0.5


@dataclass(frozen=True)
class Band:
    """Unweighted rows of a stretch of time, by frequency.

    Attributes:
        samples: Where its rows stand in the samples of all logs, shape (M,).
        counting: Which of them count, shape (M, n).
        rows: Their transform, zero where they do not count, shape (F, n, m).
        shape: Power that the filter passes, between 0 and 1, shape (F,).
        step: One row in how many is here.
    """

    samples: IntArray
    counting: BoolArray
    rows: Array
    shape: Array
    step: int

    @property
    def twice(self) -> Array:
        """How many frequencies of the two-sided transform each one stands for, shape (F,)."""
        count = np.full(len(self.shape), 2.0)
        count[0] = 1.0
        if len(self.samples) % 2 == 0:
            count[-1] = 1.0
        return count

    @property
    def width(self) -> int:
        """Number of neighbouring frequencies to average over, odd."""
        wide = float(np.sum(self.shape) ** 2 / np.sum(self.shape**2))
        return min(2 * round(WIDTH * wide**0.5) + 1, 2 * ((len(self.shape) - 1) // 2) + 1)

    def transformed(self, values: Array) -> Array:
        """Return the transform of values over the samples of all logs (N, n), shape (F, n)."""
        own = np.where(self.counting, values[self.samples], 0.0)
        return np.fft.rfft(own, axis=0) * np.sqrt(self.step / len(own))

    def averaged(self, values: Array) -> Array:
        """Return the mean over neighbouring frequencies, along the first axis; the spectrum goes on symmetrically."""
        half = self.width // 2
        run = np.pad(values, [(half, half)] + [(0, 0)] * (values.ndim - 1), mode="reflect")
        total, done, size = np.zeros_like(values), 0, 1
        while True:  # sums of 1, 2, 4, ... neighbours, of which those of the width are put together
            if self.width & size:
                total = total + run[done : done + len(values)]
                done += size
            if 2 * size > self.width:
                return total / self.width
            run = run[:-size] + run[size:]
            size *= 2


def bands(passes: RowPasses) -> Iterator[Band]:
    """Yield the rows of a problem by frequency, stretch by stretch."""
    return bands_of(stretches(passes), passes.columns, passes.problem.base.count)


def bands_beside(passes: RowPasses, factors: Array) -> Iterator[Band]:
    """Yield the rows of each sample times a factor (N,), and beside them the rows as they are: m = 2 b columns."""
    count = passes.problem.base.count
    parts = (
        replace(part, blocks=tuple(np.concatenate([block * factors[part.samples], block]) for block in part.blocks))
        for part in stretches(passes)
    )
    return bands_of(parts, [np.r_[own, count + own] for own in passes.columns], 2 * count)


def bands_of(parts: Iterable[Stretch], columns: Sequence[IntArray], size: int) -> Iterator[Band]:
    """Yield stretches of rows by frequency.

    Args:
        parts: The stretches.
        columns: Positions of each joint's rows among all columns.
        size: Number of all columns, m.
    """
    for stretch in parts:
        count = len(stretch.samples)
        shape = filter_power(stretch.log, count, stretch.step * stretch.log.every)
        rows = np.zeros((len(shape), len(columns), size), dtype=complex)
        for i, (own, block) in enumerate(zip(columns, stretch.blocks, strict=True)):
            rows[:, i, own] = np.fft.rfft(block, axis=1).T * np.sqrt(stretch.step / count)
        yield Band(stretch.samples, stretch.counting, rows, shape, stretch.step)


def filter_power(log: Prepared, count: int, every: int) -> Array:
    """Return the share of the power of white torque noise that the filter of a log passes, shape (count // 2 + 1,).

    Args:
        log: The log.
        count: Number of rows of a transform.
        every: One sample in how many is such a row; what is beyond their frequencies comes back among them.
    """
    reach = log.how.filter.reach(log.log.rate)
    if not reach:
        return np.ones(count // 2 + 1)
    times = -(-(2 * reach + 1) // (count * every))
    impulse = np.zeros((1, count * every * times))
    impulse[0, impulse.shape[1] // 2] = 1.0
    power = np.abs(np.fft.fft(log.smooth(impulse)[0]))[::times] ** 2
    return power.reshape(every, count).mean(axis=0)[: count // 2 + 1]
