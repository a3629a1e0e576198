"""Passes over the rows of a problem, for methods that one triangle cannot serve.

Rows are made segment by segment from the logs. Where all of them fit into :data:`KEPT` bytes the first pass keeps
them, joint by joint without the columns that are zero on a joint; beyond that every pass makes them anew, and memory
holds one segment. Residuals and weights, n numbers a sample, are always kept.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, BoolArray
from dynident.identification.problem.problem import Problem
from dynident.identification.problem.regressor_stream import Segments
from dynident.model.reduction import CHUNK, Triangle, absorb, absorber
from dynident.model.threads import one_blas_thread

#: Bytes of rows that are kept between passes.
KEPT = 1 << 28


@dataclass(frozen=True)
class Segment:
    """Some samples of one log.

    Attributes:
        samples: Where they stand in the samples of all logs, m of them.
        blocks: [W_i, tau_i]' of each joint over them, shape (K_i + 1, m).
    """

    samples: slice
    blocks: tuple[Array, ...]


class RowPasses:
    """The rows of a problem, as often as they are asked for.

    Attributes:
        problem: The problem.
        counting: Which rows count, over the samples of all logs, shape (N, n).
        columns: Positions in beta of the columns of each joint's blocks.
    """

    def __init__(self, problem: Problem, kept: int = KEPT) -> None:
        self.problem = problem
        self.counting: BoolArray = np.concatenate(problem.masks)
        self._regressor = problem.regressor
        self.columns = self._regressor.columns
        size = 8 * problem.samples * sum(len(columns) + 1 for columns in self.columns)
        self._stored: list[Segment] | None = [] if size <= kept else None
        if self._stored is not None and problem.kept is not None:
            self._stored = list(self._made(chain.from_iterable(parts) for parts in problem.kept.segments))
        self._pieces: dict[tuple[int, int], tuple[Triangle, ...]] = {}

    def __iter__(self) -> Iterator[Segment]:
        if self._stored:
            yield from self._stored
            return
        made: list[Segment] = []
        for segment in self._made(self._regressor.segments(log) for log in self.problem.logs):
            if self._stored is not None:
                made.append(segment)
            yield segment
        if self._stored is not None:
            self._stored = made

    def _made(self, logs: Iterable[Segments]) -> Iterator[Segment]:
        """Yield the segments of all logs with their place in the samples of all."""
        start = 0
        for log, segments in zip(self.problem.logs, logs, strict=True):
            for part, blocks in segments:
                yield Segment(slice(start + part.start, start + part.stop), blocks)
            start += len(log.keep)

    def one_thread(self) -> AbstractContextManager[Any]:
        """Return a context in which linear algebra uses one thread, as small panels are fastest."""
        return one_blas_thread()

    def logs(self) -> Iterator[Segment]:
        """Yield each log in one segment; memory holds the rows of one log at a time."""
        start, parts = 0, list[Segment]()
        lengths = iter([len(log.keep) for log in self.problem.logs])
        length = next(lengths)
        for segment in self:
            parts.append(segment)
            if segment.samples.stop == start + length:
                blocks = zip(*[part.blocks for part in parts], strict=True)
                joined = [joint[0] if len(parts) == 1 else np.concatenate(joint, axis=1) for joint in blocks]
                yield Segment(slice(start, start + length), tuple(joined))
                start, length, parts = start + length, next(lengths, 0), []

    def by_log(self, values: npt.NDArray[Any]) -> list[npt.NDArray[Any]]:
        """Return values over the samples of all logs, shape (N, ...), log by log."""
        return np.split(values, np.cumsum([len(log.keep) for log in self.problem.logs])[:-1])

    def residuals(self, beta: Array) -> Array:
        """Return measured less predicted torque, zero where a row does not count, shape (N, n)."""
        residual = np.zeros(self.counting.shape)
        with self.one_thread():
            for segment in self:
                for i, (own, block) in enumerate(zip(self.columns, segment.blocks, strict=True)):
                    residual[segment.samples, i] = block[-1] - beta[own] @ block[:-1]
        return np.where(self.counting, residual, 0.0)

    def products(self, values: Array) -> Array:
        """Return W'v over the rows that count, shape (b,).

        Args:
            values: v, shape (N, n).
        """
        total = np.zeros(self.problem.base.count)
        counted = np.where(self.counting, values, 0.0)
        with self.one_thread():
            for segment in self:
                for i, (own, block) in enumerate(zip(self.columns, segment.blocks, strict=True)):
                    total[own] += block[:-1] @ counted[segment.samples, i]
        return total

    def triangles(self, weights: Array) -> tuple[Triangle, ...]:
        """Return the triangle of each joint over the rows that count, each row times its weight.

        Args:
            weights: Shape (N, n); rows of weight zero are not counted in the triangle's ``rows``.
        """
        counted = np.where(self.counting, weights, 0.0)
        factors: list[Array] = [np.zeros((len(own) + 1,) * 2, order="F") for own in self.columns]
        take = absorber(len(counted))
        with self.one_thread():
            for segment in self:
                for i, block in enumerate(segment.blocks):
                    own = counted[segment.samples, i]
                    used = np.flatnonzero(own)
                    for start in range(0, len(used), CHUNK):
                        rows = used[start : start + CHUNK]
                        factors[i] = take(factors[i], np.ascontiguousarray(block[:, rows] * own[rows]).T)
        return tuple(
            Triangle(own, np.triu(factor), int(np.count_nonzero(counted[:, i])))
            for i, (own, factor) in enumerate(zip(self.columns, factors, strict=True))
        )

    def intervals(self, edges: Sequence[int]) -> list[tuple[Triangle, ...]]:
        """Return the triangle of each joint over the samples between each two edges that count.

        What is asked for is kept: intervals that consist of earlier ones are merged, the rows are not read again.

        Args:
            edges: Ascending positions in the samples of all logs.
        """
        wanted = list(itertools.pairwise(edges))
        known = {edge for piece in self._pieces for edge in piece}
        if not (self._pieces and known.issuperset(edges)):
            self._pieces |= dict(zip(wanted, self._reduced(wanted), strict=True))
        found: list[tuple[Triangle, ...]] = []
        for first, stop in wanted:
            inside = [own for piece, own in sorted(self._pieces.items()) if first <= piece[0] and piece[1] <= stop]
            exact = self._pieces.get((first, stop))
            found.append(exact or tuple(one.merged(rest) for one, *rest in zip(*inside, strict=True)))
        return found

    def _reduced(self, wanted: Sequence[tuple[int, int]]) -> list[tuple[Triangle, ...]]:
        sizes = [len(own) + 1 for own in self.columns]
        factors: list[list[Array]] = [[np.zeros((size, size), order="F") for size in sizes] for _ in wanted]
        with self.one_thread():
            for segment in self:
                place = segment.samples
                for own, (first, stop) in zip(factors, wanted, strict=True):
                    for start in range(max(first, place.start), min(stop, place.stop), CHUNK):
                        part = slice(start, min(start + CHUNK, stop, place.stop))
                        counted = self.counting[part]
                        cut = slice(part.start - place.start, part.stop - place.start)
                        for i, block in enumerate(segment.blocks):
                            rows = block[:, cut] if counted[:, i].all() else block[:, cut][:, counted[:, i]]
                            own[i] = absorb(own[i], np.array(rows, order="C").T)
        return [
            tuple(
                Triangle(columns, np.triu(factor), int(rows))
                for columns, factor, rows in zip(self.columns, own, self.counting[a:z].sum(axis=0), strict=True)
            )
            for own, (a, z) in zip(factors, wanted, strict=True)
        ]
