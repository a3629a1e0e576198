"""Rows of the observation matrix, filtered at the samples that are kept alone; columns are made in the cache."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.data.preprocessing._thinning import Thinning

#: Writes rows over a slice of the samples of a log into arrays.
Make: TypeAlias = Callable[[slice, Sequence[Array]], object]

#: Samples filtered at a time, and samples whose columns are made at a time: these stay in the cache.
SEGMENT, FOLDED = 1 << 16, 2000


def stretches(samples: int, reach: int, is_thinned: bool) -> Iterator[slice]:
    """Yield slices of all samples; of many, not thinned, the first and the last are where a filter sees the ends."""
    is_whole = is_thinned or samples <= SEGMENT
    inner = range(0, samples, SEGMENT)[1:] if is_whole else range(reach, samples - reach, SEGMENT)
    edges = [0, *inner, samples] if is_whole or not inner else [0, *inner, samples - reach, samples]
    yield from map(slice, edges[:-1], edges[1:])


def stretch_of(rows: IntArray) -> slice | IntArray:
    """Return ascending rows as a slice where none is left out between them: a view then, not a copy."""
    first, last = int(rows[0]), int(rows[-1])
    return slice(first, last + 1) if last - first + 1 == len(rows) else rows


def thinned_rows(make: Make, sizes: Sequence[int], samples: int, keep: IntArray, thin: Thinning) -> list[Array]:
    """Return the filtered columns W_i' of each joint at kept samples, shape (K_i, m) each.

    Args:
        make: Writes [W_i, tau_i]' over a slice of the samples, not filtered, into arrays (K_i + 1, N).
        sizes: K_i of each joint.
        samples: Of the whole log, N.
        keep: Kept samples of a stretch of it, a multiple of ``thin.every`` apart, shape (m,).
        thin: The filter.
    """
    log = _TurnedEnds(make, sizes, samples, min(thin.pad, samples - 1))
    every, half, past = thin.every, thin.half, -(-thin.reach // thin.every)
    begin, end = int(keep[0]) - past * every, int(keep[-1]) + past * every
    at_start, at_end = begin < half, end > samples - 1 - half
    last = samples - 1 + log.pad
    if at_start:  # from where the window sees but the constant, and the end has forgotten what was before
        begin = int(keep[0]) - -(-(int(keep[0]) + max(log.pad + half, thin.reach - last - half)) // every) * every
    if at_end:
        end = int(keep[-1]) - (int(keep[-1]) - last - half) // every * every
    count = 1 + (end - begin) // every
    ends = np.cumsum(sizes)[:-1]  # columns of all joints stand side by side, as a filter takes many at a time
    folded, left = np.empty((sum(sizes), count + past * at_end)), np.zeros((sum(sizes), thin.powers.shape[1]))
    folded_of, left_of = np.split(folded, ends), np.split(left, ends)
    done = last - thin.reach
    step = max(1, max(FOLDED, 8 * (2 * half + 1)) // every)
    for first in range(0, count, step):
        many = min(step, count - first)
        low, high = begin + first * every - half, begin + (first + many - 1) * every + half + 1
        blocks = log.blocks(low, high)
        for block, out in zip(blocks, folded_of, strict=True):
            thin.fold(block[:-1], out, first, many)
        if at_end and min(high, last) > max(low, done):
            done = max(low, done)
            weights = thin.powers[last - done : 0 : -1][: min(high, last) - done]
            for block, own in zip(blocks, left_of, strict=True):
                own[...] += block[:-1, done - low : min(high, last) - low] @ weights
            done = min(high, last)
    places: IntArray | slice = (keep - begin) // every
    if places[-1] - places[0] == len(places) - 1:  # no gap: a view in place of a copy
        places = slice(places[0], places[-1] + 1)
    if at_end:
        folded[:, count:] = folded[:, count - 1 : count]
    found = thin.settle(folded)[:, places]
    if at_end:
        late = slice(np.searchsorted(keep, last - thin.reach), None)
        left -= folded[:, -1:] * thin.powers[1:].sum(axis=0)
        found[:, late] -= thin.last_outputs(left, last - keep[late])
    return np.split(found, ends)


class _TurnedEnds:
    """The columns of a log, over its samples and over what a filter sees beyond both ends of it."""

    def __init__(self, make: Make, sizes: Sequence[int], samples: int, pad: int) -> None:
        self.make, self.sizes, self.samples, self.pad = make, sizes, samples, pad
        self._blocks: list[Array] = []
        self._ends: dict[int, list[Array]] = {}

    def blocks(self, low: int, high: int) -> list[Array]:
        """Return [W_i, tau_i]' over samples ``low`` to ``high``, shape (K_i + 1, high - low); overwritten by the next.

        Before the first sample and after the last one they are turned about it for ``pad`` samples, then constant.
        """
        first, stop = max(low, 0), min(high, self.samples)
        if low >= 0 and high <= self.samples:
            return self._made(low, high)
        found: list[Array] = [np.empty((size + 1, high - low)) for size in self.sizes]
        if first < stop:
            for block, own in zip(found, self._made(first, stop), strict=True):
                block[:, first - low : stop - low] = own
        if low < 0:
            before = np.maximum(np.arange(low, min(high, 0)), -self.pad)
            for block, head in zip(found, self._end(0), strict=True):
                block[:, : len(before)] = 2.0 * head[:, :1] - head[:, -before]
        if high > self.samples:
            after = np.minimum(np.arange(max(low, self.samples), high) - self.samples + 1, self.pad)
            for block, tail in zip(found, self._end(self.samples - 1 - self.pad), strict=True):
                block[:, block.shape[1] - len(after) :] = 2.0 * tail[:, -1:] - tail[:, self.pad - after]
        return found

    def _end(self, begin: int) -> list[Array]:
        """Return the samples of an end that are turned about it, which may have been made with others."""
        if begin not in self._ends:
            self._made(begin, begin + self.pad + 1)
        return self._ends[begin]

    def _made(self, first: int, stop: int) -> list[Array]:
        if not self._blocks or self._blocks[0].shape[1] != stop - first:  # fresh memory costs more than what is written
            self._blocks = [np.empty((size + 1, stop - first)) for size in self.sizes]
        self.make(slice(first, stop), self._blocks)
        for begin in (0, self.samples - 1 - self.pad):
            if first <= begin and begin + self.pad < stop:
                inside = slice(begin - first, begin - first + self.pad + 1)
                self._ends[begin] = [block[:, inside].copy() for block in self._blocks]
        return self._blocks
