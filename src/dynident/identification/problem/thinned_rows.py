"""Rows of the observation matrix, filtered at the samples that are kept alone; columns are made in the cache."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.data.preprocessing._thinning import Thinning

#: Samples filtered at a time, and samples whose columns are made at a time: these stay in the cache.
SEGMENT, FOLDED = 1 << 16, 2000


def stretches(samples: int, reach: int) -> Iterator[slice]:
    """Yield slices of all samples; the first and the last are those from which a filter sees the end of the log."""
    inner = range(reach, samples - reach, SEGMENT)
    edges = [0, *inner, samples - reach, samples] if inner else [0, samples]
    yield from map(slice, edges[:-1], edges[1:])


def stretch_of(rows: IntArray) -> slice | IntArray:
    """Return ascending rows as a slice where none is left out between them: a view then, not a copy."""
    first, last = int(rows[0]), int(rows[-1])
    return slice(first, last + 1) if last - first + 1 == len(rows) else rows


def thinned_rows(
    make: Callable[[slice, Sequence[Array]], object], sizes: Sequence[int], outer: slice, keep: IntArray, thin: Thinning
) -> list[Array]:
    """Return the filtered columns W_i' of each joint at kept samples, shape (K_i, m) each.

    Args:
        make: Writes [W_i, tau_i]' over a slice of the samples, not filtered, into arrays (K_i + 1, N).
        sizes: K_i of each joint.
        outer: Samples that are known, the reach of the filter beyond the kept ones.
        keep: Kept samples, a multiple of ``thin.every`` apart, shape (m,).
        thin: The filter.
    """
    every, half = thin.every, thin.half
    begin = int(keep[0] - (keep[0] - half - outer.start) // every * every)
    count = 1 + (outer.stop - 1 - half - begin) // every
    folded = [np.empty((size, count)) for size in sizes]
    step = max(1, max(FOLDED, 8 * (2 * half + 1)) // every)
    blocks: list[Array] = []
    for first in range(0, count, step):
        many = min(step, count - first)
        low, length = begin + first * every - half, (many - 1) * every + 2 * half + 1
        if not blocks or blocks[0].shape[1] != length:  # fresh memory costs more than what is written into it
            blocks = [np.empty((size + 1, length)) for size in sizes]
        make(slice(low, low + length), blocks)
        for block, out in zip(blocks, folded, strict=True):
            thin.fold(block[:-1], out, first, many)
    places: IntArray | slice = (keep - begin) // every
    if places[-1] - places[0] == len(places) - 1:  # no gap: a view in place of a copy
        places = slice(places[0], places[-1] + 1)
    return [thin.settle(rows)[:, places] for rows in folded]
