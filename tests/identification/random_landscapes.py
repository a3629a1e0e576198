"""Random objectives of the searches in a box."""

from __future__ import annotations

import numpy as np

from dynident.identification.search.landscape import Landscape


def random_landscape(power: int, rows: tuple[int, ...], columns: int = 5) -> Landscape:
    generator = np.random.default_rng(0)
    edges = np.concatenate([[0], np.cumsum(rows)]).astype(np.int64)
    matrix = generator.standard_normal((columns, edges[-1]))
    present = generator.random((columns, len(rows))) > 0.3
    present[:, 0] = True
    matrix[~np.repeat(present, rows, axis=1)] = 0.0
    target = generator.uniform(-2, 2, columns) @ matrix + 0.3 * generator.standard_normal(edges[-1])
    return Landscape(matrix, target, edges, present, generator.uniform(0.1, 1, len(rows)) / edges[-1], power, 0.25)
