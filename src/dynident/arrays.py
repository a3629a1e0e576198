"""Array aliases and the one way to freeze an array.

The letters of shapes are the same everywhere: N samples, n joints, r = N n rows, p standard, b base parameters,
k coefficients, l links.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.floating[Any]]
IntArray: TypeAlias = npt.NDArray[np.signedinteger[Any]]
BoolArray: TypeAlias = npt.NDArray[np.bool_]


def frozen(values: npt.ArrayLike, shape: tuple[int | None, ...] | None = None, name: str = "array") -> Array:
    """Return a read-only float64 copy of ``values``, checked against ``shape`` (None: any length).

    Raises:
        ValueError: The shape differs.
    """
    array = np.array(values, dtype=np.float64)
    if shape is not None and (
        array.ndim != len(shape) or any(want not in (None, got) for want, got in zip(shape, array.shape, strict=True))
    ):
        raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    array.setflags(write=False)
    return array
