"""Array aliases, the one way to freeze an array, and the one way to write values that JSON may not hold.

The letters of shapes are the same everywhere: N samples, n joints, r = N n rows, p standard, b base parameters,
k coefficients, l links.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias, TypeGuard

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.floating[Any]]
IntArray: TypeAlias = npt.NDArray[np.signedinteger[Any]]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
ComplexArray: TypeAlias = npt.NDArray[np.complexfloating[Any, Any]]


def frozen(values: npt.ArrayLike, shape: tuple[int | None, ...] | None = None, name: str = "array") -> Array:
    """Return a read-only float64 copy of ``values``, checked against ``shape`` (None: any length).

    An array that nobody can write to is returned as it is.

    Raises:
        ValueError: The shape differs.
    """
    array = values if _is_frozen(values) else np.array(values, dtype=np.float64)
    if shape is not None and (
        array.ndim != len(shape) or any(want not in (None, got) for want, got in zip(shape, array.shape, strict=True))
    ):
        raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    array.setflags(write=False)
    return array


def _is_frozen(values: npt.ArrayLike) -> TypeGuard[Array]:
    """Return whether nobody can write to an array: it is read-only and no view of another one."""
    if not isinstance(values, np.ndarray) or type(values) is not np.ndarray or values.dtype != np.float64:
        return False
    return values.base is None and not values.flags.writeable


def address(array: Any) -> int:
    """Return the address of a writable C-contiguous array, three times as fast as ``array.ctypes.data``."""
    return ctypes.addressof(ctypes.c_char.from_buffer(array)) if array.size else 0


def finite(value: float) -> float | None:
    """Return the number, or None where it is not finite and JSON has no word for it."""
    return float(value) if np.isfinite(value) else None


def vector_text(values: Iterable[float], digits: int = 6) -> str:
    """Return numbers as a list in text, such as a gravity; without the sign of zero."""
    return ", ".join(f"{value + 0.0:.{digits}g}" for value in values)


def plain(value: Any) -> Any:
    """Return a value as JSON can hold it: arrays as lists, numbers that are not finite as null."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return finite(value)
    return value
