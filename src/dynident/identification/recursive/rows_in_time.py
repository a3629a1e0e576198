"""The rows of a log in order of time, all joints of a sample together."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.data.preprocessing import Prepared
from dynident.identification.problem.regressor_stream import RegressorStream


def rows_in_time(
    regressor: RegressorStream, prepared: Prepared, mask: BoolArray, size: int
) -> Iterator[tuple[slice, Array, Array]]:
    """Yield successive kept rows with their matrices W (m, n, b) and torques (m, n), at most ``size`` at a time.

    Args:
        regressor: What makes the rows.
        prepared: The log.
        mask: Which kept rows count for each joint, shape (N, n); the others are 0.
        size: Most samples at a time.
    """
    count = len(regressor.columns)
    for part, blocks in regressor.segments(prepared):
        for start in range(0, part.stop - part.start, size):
            samples = min(size, part.stop - part.start - start)
            matrix = np.zeros((samples, count, regressor.base.count))
            torque = np.empty((samples, count))
            for i, (columns, block) in enumerate(zip(regressor.columns, blocks, strict=True)):
                matrix[:, i, columns] = block[:-1, start : start + samples].T
                torque[:, i] = block[-1, start : start + samples]
            inside = slice(part.start + start, part.start + start + samples)
            matrix[~mask[inside]], torque[~mask[inside]] = 0.0, 0.0
            yield inside, matrix, torque
