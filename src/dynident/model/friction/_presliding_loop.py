"""The element of presliding friction along a motion, in compiled code: loaded by models that have the part alone."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.model.kernels.jit import compiled


@compiled
def stops(q: Array, length: float, start: float) -> Array:
    """Return the deflection of the element along positions (N, n), from ``start`` on."""
    found = np.empty_like(q)
    found[0] = start
    for k in range(1, len(q)):
        for j in range(q.shape[1]):
            found[k, j] = min(max(found[k - 1, j] + q[k, j] - q[k - 1, j], -length), length)
    return found
