"""Checks of what callers hand to the kernels, and the form in which the kernels take it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, IntArray
from dynident.errors import BadOption
from dynident.model.robot import Chain

Choice: TypeAlias = Literal["auto", "generic", "generated"]

#: Environment variable that chooses the kernels: ``auto`` (generated where the robot is not too large), ``generic``
#: or ``generated``.
VARIABLE = "DYNIDENT_KERNEL"


def kernel_choice() -> Choice:
    """Return what the environment variable DYNIDENT_KERNEL says, ``auto`` where it is not set.

    Raises:
        BadOption: The variable has another value.
    """
    match os.environ.get(VARIABLE, "auto"):
        case "auto" | "":
            return "auto"
        case "generic":
            return "generic"
        case "generated":
            return "generated"
        case other:
            raise BadOption(VARIABLE, other, "choose one of: auto, generic, generated")


def samples(chain: Chain, arrays: Mapping[str, npt.ArrayLike]) -> list[Array]:
    """Return the arrays (N, n), by name, as read-only C-contiguous float64 views.

    Raises:
        ValueError: An array has another shape, or the arrays differ in N.
    """
    found: list[Array] = []
    for name, values in arrays.items():
        array = np.ascontiguousarray(values, dtype=np.float64).view()
        rows = len(found[0]) if found else "N"
        if array.ndim != 2 or array.shape[1] != chain.joints or (found and len(array) != rows):
            raise ValueError(f"{name} has shape {np.shape(values)}, expected ({rows}, {chain.joints})")
        array.setflags(write=False)
        found.append(array)
    return found


def parameters(chain: Chain, theta: npt.ArrayLike) -> Array:
    """Return theta (10 l,) as a read-only C-contiguous float64 view.

    Raises:
        ValueError: It has another shape.
    """
    array = np.ascontiguousarray(theta, dtype=np.float64).view()
    if np.shape(theta) != (10 * chain.links,):
        raise ValueError(f"theta has shape {np.shape(theta)}, expected ({10 * chain.links},)")
    array.setflags(write=False)
    return array


def column_indices(columns: npt.ArrayLike, limit: int) -> IntArray:
    """Return chosen columns as a read-only int array.

    Raises:
        ValueError: Not a list of different whole numbers from 0 to ``limit`` - 1.
    """
    given = np.asarray(columns)
    array = given.astype(np.int64) if given.size else np.zeros(0, dtype=np.int64)
    if given.ndim != 1 or not np.array_equal(array, given):
        raise ValueError(f"columns must be a list of whole numbers, got shape {given.shape} of {given.dtype}")
    if array.size and (array.min() < 0 or array.max() >= limit):
        raise ValueError(f"columns reach from {array.min()} to {array.max()}, expected 0 to {limit - 1}")
    if len(np.unique(array)) != len(array):
        raise ValueError("a column stands twice in columns")
    array.setflags(write=False)
    return array
