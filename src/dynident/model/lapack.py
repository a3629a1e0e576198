"""LAPACK called without the interpreter's lock: of the library that NumPy has loaded, or else of SciPy.

NumPy's wheels carry the whole of LAPACK, of which NumPy offers little. SciPy offers more, but loads for longer than
most commands work, and keeps the lock in most routines, so that threads wait for each other.
"""

from __future__ import annotations

import ctypes
import importlib.machinery
import importlib.util
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from dynident.arrays import Array, address
from dynident.model.threads import libraries

#: LAPACK's whole numbers, as the signature of a routine of SciPy names them.
_INTEGERS = {b"int *": ctypes.c_int, b"int64_t *": ctypes.c_int64, b"npy_int64 *": ctypes.c_int64}

#: The modules by which SciPy hands its BLAS and LAPACK to compiled code.
_OF_SCIPY = ("scipy.linalg.cython_blas", "scipy.linalg.cython_lapack")

#: How NumPy's wheels call a routine, and the whole numbers that it takes by that name.
WHEELS = (("scipy_{}_64_", ctypes.c_int64), ("scipy_{}_", ctypes.c_int))


def tpqrt(factor: Array, rows: Array, block: int) -> None:
    """Overwrite an upper triangle with that of itself over new rows; the rows are lost (LAPACK's ``dtpqrt``).

    Args:
        factor: Shape (k, k), float64 in Fortran order; what stands below its diagonal is left alone.
        rows: Shape (m, k), float64 in Fortran order.
        block: Columns factored at a time, at most k.

    Raises:
        ValueError: Another shape, type or order.
    """
    count, size = rows.shape
    if factor.shape != (size, size) or not 1 <= block <= size:
        raise ValueError(f"a factor R of shape {factor.shape} and blocks of {block} do not fit rows of {rows.shape}")
    for array in (factor, rows):
        if not (array.flags.f_contiguous and array.flags.writeable and array.dtype == np.float64):
            raise ValueError("factor and rows must be writeable float64 arrays in Fortran order")
    if count:
        work = np.empty((2, block * size))
        _run("dtpqrt", count, size, 0, block, factor, size, rows, count, work[0], block, work[1])


def upper_triangle(rows: Array) -> Array:
    """Return R of rows (N, k) by Householder's QR, shape (min(N, k), k), in Fortran order (LAPACK's ``dgeqrf``)."""
    own = np.array(rows, dtype=np.float64, order="F")
    count, size = own.shape
    if not own.size:
        return np.zeros((min(count, size), size), order="F")
    work = np.empty(32 * size)
    _run("dgeqrf", count, size, own, count, np.empty(min(count, size)), work, work.size)
    return own[:size] * _upper(min(count, size), size)


def cholesky(matrix: Array) -> Array | None:
    """Return the upper U of a matrix U'U (k, k), in Fortran order; None where it is not positive (``dpotrf``)."""
    own = np.array(matrix, dtype=np.float64, order="F")
    if own.size and _run("dpotrf", b"U", len(own), own, len(own)):
        return None
    return own * _upper(*own.shape)


@cache
def _upper(rows: int, columns: int) -> Array:
    """Return ones where a matrix has its upper triangle: a product with them takes less time than ``np.triu``."""
    return np.asfortranarray(np.triu(np.ones((rows, columns))))


def solve_positive(matrix: Array, right: Array) -> Array | None:
    """Return X of A X = B by Cholesky's factor of A (k, k); None where A is not positive (LAPACK's ``dposv``)."""
    own, found = np.array(matrix, dtype=np.float64, order="F"), np.array(right, dtype=np.float64, order="F")
    if found.size and _run("dposv", b"L", len(own), found.size // len(own), own, len(own), found, len(own)):
        return None
    return found


def inverse_positive(matrix: Array) -> Array:
    """Return the inverse of A (k, k), by Cholesky's factor where A is positive (LAPACK's ``dpotri``)."""
    own = cholesky(matrix)
    if own is None or (own.size and _run("dpotri", b"U", len(own), own, len(own))):
        return np.linalg.inv(matrix)
    whole = own + own.T  # below its diagonal the factor is 0
    np.einsum("ii->i", whole)[...] *= 0.5
    return whole


def solve_upper(factor: Array, right: Array, transposed: bool = False) -> Array:
    """Return X of R X = B, or of R' X = B, for the upper triangle R of a matrix (k, k) (LAPACK's ``dtrtrs``).

    Raises:
        LinAlgError: R has a zero on its diagonal.
        ValueError: R is no square, or B has not as many rows.
    """
    if factor.shape != (len(right), len(right)):
        raise ValueError(f"R of shape {factor.shape} does not fit a right side of {right.shape}")
    own, found = np.asarray(factor, dtype=np.float64, order="F"), np.array(right, dtype=np.float64, order="F")
    way = b"T" if transposed else b"N"
    if found.size and _run("dtrtrs", b"U", way, b"N", len(own), found.size // len(own), own, len(own), found, len(own)):
        raise np.linalg.LinAlgError("R has a zero on its diagonal")
    return found


def times_upper(factor: Array, right: Array) -> None:
    """Overwrite B (k, m) in Fortran order with U B, for the upper triangle U of a matrix (k, k) (``dtrmm``)."""
    own, scale = np.asarray(factor, dtype=np.float64, order="F"), np.ones(1)
    size, many = right.shape
    _run("dtrmm", b"L", b"U", b"N", b"N", size, many, scale, own, size, right, size, has_state=False)


def _run(name: str, *given: int | bytes | Array, has_state: bool = True) -> int:
    """Call a routine; its last argument, where it has one, is its state, which is returned: 0 if all went well.

    Raises:
        ValueError: It does not take these arguments, a number that is none among them.
    """
    found = routine(name, len(given) + has_state)
    whole = [each for each in given if isinstance(each, int)]
    numbers = (found.integer * (len(whole) + 1))(*whole)
    place, step = ctypes.addressof(numbers), ctypes.sizeof(found.integer)
    places: list[Any] = []
    for each in given:
        if isinstance(each, int):
            places.append(place)
            place += step
        elif isinstance(each, bytes):
            places.append(each)
        else:
            places.append(address(each.T) if each.flags.writeable else each.ctypes.data)
    found.call(*places, *[place] * has_state)
    state = int(numbers[len(whole)])
    if state < 0:
        raise ValueError(f"LAPACK's {name} does not take argument {-state}")
    return state


@dataclass(frozen=True)
class _Routine:
    """A routine whose arguments are all addresses, and its type of whole numbers."""

    call: Callable[..., None]
    integer: Any


@cache
def routine(name: str, arguments: int) -> _Routine:
    """Return a routine of the library that NumPy has loaded, or of SciPy's where NumPy has none of the known names."""
    made = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * arguments)
    for library in (each.dynlib for each in libraries().lib_controllers if each.user_api == "blas"):
        for pattern, integer in WHEELS:
            symbol = getattr(library, pattern.format(name), None)
            if symbol is not None:
                return _Routine(made(ctypes.cast(symbol, ctypes.c_void_p).value or 0), integer)
    pointer, integer = of_scipy(name)
    return _Routine(made(pointer), integer)


def of_scipy(name: str) -> tuple[int, Any]:
    """Return the address of a routine in the LAPACK of SciPy, and the type of its whole numbers.

    Raises:
        RuntimeError: It takes another one than is known here.
    """
    modules: list[Any] = [import_module(module) for module in _OF_SCIPY]  # loads slowly
    capsule = next(module.__pyx_capi__[name] for module in modules if name in module.__pyx_capi__)
    named = ctypes.PYFUNCTYPE(ctypes.c_char_p, ctypes.py_object)(("PyCapsule_GetName", ctypes.pythonapi))
    signature = named(capsule)
    whole = [each.strip() for each in signature.partition(b"(")[2].split(b",") if b"int" in each]
    if not whole or whole[0] not in _INTEGERS:
        raise RuntimeError(f"LAPACK's {name} of this SciPy takes {signature.decode()}; install the version pinned")
    pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
        ("PyCapsule_GetPointer", ctypes.pythonapi)
    )
    return pointer(capsule, signature), _INTEGERS[whole[0]]


@contextmanager
def lapack_of_scipy() -> Iterator[None]:
    """Have SciPy's LAPACK at hand for compiled code of others, without the rest of ``scipy.linalg``.

    The usual import of the two modules takes five times as long. Where they cannot be loaded alone, it is left to that.
    """
    loaded = {name: module for name in _OF_SCIPY if name not in sys.modules and (module := _alone(name)) is not None}
    sys.modules.update(loaded)
    try:
        yield
    finally:
        for name in loaded:
            sys.modules.pop(name, None)  # a later import finds them in their package


def _alone(name: str) -> ModuleType | None:
    """Return a compiled module without the package that it is in; None where that fails."""
    top, *folders, last = name.split(".")
    package = importlib.util.find_spec(top)
    for place in (package and package.submodule_search_locations) or ():
        for ending in importlib.machinery.EXTENSION_SUFFIXES:
            spec = importlib.util.spec_from_file_location(name, Path(place, *folders, last + ending))
            if spec is None or spec.loader is None or not Path(spec.origin or "").exists():
                continue
            try:
                module = importlib.util.module_from_spec(spec)
                spec.loader.exec_module(module)
            except ImportError:  # such as a library that the package itself makes known to the system
                return None
            return module
    return None
