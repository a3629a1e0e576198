"""LAPACK by the addresses that SciPy hands to compiled code: called without the interpreter's lock.

SciPy's own functions keep the lock in most routines, so that threads wait for each other.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import scipy.linalg.cython_lapack

from dynident.arrays import Array, address

#: LAPACK's whole numbers, as the signature of a routine names them.
_INTEGERS = {b"int *": ctypes.c_int, b"int64_t *": ctypes.c_int64, b"npy_int64 *": ctypes.c_int64}


def tpqrt(factor: Array, rows: Array, block: int) -> None:
    """Overwrite an upper triangle with that of itself over new rows; the rows are lost (LAPACK's ``dtpqrt``).

    Args:
        factor: Shape (k, k), float64 in Fortran order; what stands below its diagonal is left alone.
        rows: Shape (m, k), float64 in Fortran order.
        block: Columns factored at a time, at most k.

    Raises:
        ValueError: Another shape, type or order.
    """
    (count, size), integer = rows.shape, _integer("dtpqrt")
    if factor.shape != (size, size) or not 1 <= block <= size:
        raise ValueError(f"a factor R of shape {factor.shape} and blocks of {block} do not fit rows of {rows.shape}")
    for array in (factor, rows):
        if not (array.flags.f_contiguous and array.flags.writeable and array.dtype == np.float64):
            raise ValueError("factor and rows must be writeable float64 arrays in Fortran order")
    if not count:
        return
    numbers = (integer * 8)(count, size, 0, block, size, count, block, 0)
    start, step = ctypes.addressof(numbers), ctypes.sizeof(integer)
    m, n, trapezoid, columns, lda, ldb, ldt, info = range(start, start + 8 * step, step)
    work = np.empty(2 * block * size)
    reflectors, room = address(work), address(work) + work.nbytes // 2
    call = _routine("dtpqrt", 12)
    call(m, n, trapezoid, columns, address(factor.T), lda, address(rows.T), ldb, reflectors, ldt, room, info)
    assert numbers[7] == 0  # arguments are as they should be


@cache
def _routine(name: str, arguments: int) -> Callable[..., None]:
    """Return a routine whose arguments are all addresses."""
    capsule = scipy.linalg.cython_lapack.__pyx_capi__[name]
    pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
        ("PyCapsule_GetPointer", ctypes.pythonapi)
    )
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * arguments)(pointer(capsule, _signature(name)))


@cache
def _integer(name: str) -> Any:
    """Return the type of whole number that a routine takes.

    Raises:
        RuntimeError: Another one than is known here.
    """
    first = _signature(name).partition(b"(")[2].partition(b",")[0]
    if first not in _INTEGERS:
        raise RuntimeError(f"LAPACK's {name} of this SciPy takes {first.decode()!r}; install the version pinned")
    return _INTEGERS[first]


@cache
def _signature(name: str) -> bytes:
    named = ctypes.PYFUNCTYPE(ctypes.c_char_p, ctypes.py_object)(("PyCapsule_GetName", ctypes.pythonapi))
    return named(scipy.linalg.cython_lapack.__pyx_capi__[name])
