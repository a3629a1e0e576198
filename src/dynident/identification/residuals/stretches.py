"""Rows of a problem in stretches of time, thinned to what its filter lets pass, for statistics of residuals in time.

A low-pass filter makes neighbouring rows say the same; sums of products of rows over one in ``step`` of them, times
``step``, are the sums over all. Memory holds one stretch.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.preprocessing import Prepared
from dynident.identification.residuals.row_passes import RowPasses, Segment

#: Rows of a stretch.
LENGTH = 1 << 12

#: Rows a period of the filter's cut-off that are enough to keep all its power.
PER_PERIOD = 8.0


@dataclass(frozen=True)
class Stretch:
    """Unweighted rows of a stretch of time.

    Attributes:
        log: The log that it is of.
        samples: Where its rows stand in the samples of all logs, shape (M,).
        counting: Which of them count, shape (M, n).
        blocks: Columns of each joint, transposed, zero where a row does not count, shape (K_i, M).
        step: One row in how many is here.
    """

    log: Prepared
    samples: IntArray
    counting: BoolArray
    blocks: tuple[Array, ...]
    step: int


def stretches(passes: RowPasses) -> Iterator[Stretch]:
    """Yield the rows of a problem stretch by stretch; no stretch reaches over the end of a log."""
    return stretches_of(passes.problem.logs, passes, passes.counting)


def stretches_of(logs: Sequence[Prepared], made: Iterable[Segment], counts: BoolArray) -> Iterator[Stretch]:
    """Yield rows stretch by stretch; no stretch reaches over the end of a log.

    Args:
        logs: Their logs.
        made: All rows of the logs in order; what stands last in each block is no column.
        counts: Which rows count, over the samples of all logs, shape (N, n).
    """
    segments = iter(made)
    start = 0
    for log in logs:
        step = row_step(log)
        used = np.arange(0, len(log.keep), step)
        edges = [int(part[0]) for part in np.array_split(used, max(1, round(len(used) / LENGTH)))] + [len(log.keep)]
        done, at, pieces = 0, 0, list[list[Array]]()
        while done < len(log.keep):
            segment = next(segments)
            first, last = segment.samples.start - start, segment.samples.stop - start
            while done < last:
                stop = min(last, edges[at + 1])
                rows = slice(done + (-done) % step - first, stop - first, step)
                pieces.append([np.array(block[:-1, rows]) for block in segment.blocks])
                done = stop
                if done == edges[at + 1]:
                    samples = np.arange(edges[at], done, step) + start
                    counting = counts[samples]
                    joined = (np.concatenate(joint, axis=1) for joint in zip(*pieces, strict=True))
                    blocks = tuple(np.where(counting[:, i], block, 0.0) for i, block in enumerate(joined))
                    yield Stretch(log, samples, counting, blocks, step)
                    at, pieces = at + 1, []
        start += len(log.keep)


def row_step(log: Prepared) -> int:
    """Return one row in how many keeps all that the filter of a log lets pass."""
    cutoff = log.how.filter.bandwidth()
    if cutoff is None or not log.how.filter.reach(log.log.rate):
        return 1
    return max(1, int(log.log.rate / log.every / (PER_PERIOD * cutoff)))
