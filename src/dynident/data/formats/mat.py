"""Logs as MATLAB files, version 4 to 7.3, and HDF5: vectors and matrices by name, also inside structs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.data.formats._arrays import ArrayTable, checked_file, columns_of
from dynident.data.formats._mat_values import read_values
from dynident.data.formats.base import LogFormat
from dynident.errors import LogFormatError, MissingDependency

_MAX_BYTES, _MOST_BYTES = 1 << 30, 1 << 44
_STEP = "save plain arrays in MATLAB: save('log.mat', 't', 'q', 'tau'); tables and timeseries objects cannot be read"
_HDF5 = b"\x89HDF\r\n\x1a\n"
_DEEPEST = 8


@dataclass(frozen=True)
class Mat(LogFormat):
    """MATLAB or HDF5 file; a matrix q is the columns q1, ..., qn, a field of a struct or what a group holds is data.q.

    HDF5, which is MATLAB's version 7.3, needs the extra ``mat``.
    """

    suffixes: ClassVar = (".mat", ".h5", ".hdf5")

    def open(self, path: str | Path) -> ArrayTable:
        """Return the table; see :meth:`LogFormat.open`."""
        digest = checked_file(path, _MOST_BYTES if _is_hdf5(path) else _MAX_BYTES)
        return _new(path, digest) if _is_hdf5(path) else _old(path, digest)


def _is_hdf5(path: str | Path) -> bool:
    try:
        with open(path, "rb") as stream:
            return stream.read(8) == _HDF5 or stream.read(512)[504:] == _HDF5
    except OSError:
        return False  # said in words by what reads it next


def _old(path: str | Path, digest: str) -> ArrayTable:
    try:
        data = read_values(path)
    except (ValueError, OSError) as error:
        evidence = f"it does not read as a MATLAB file, or is damaged: {error}"
        raise LogFormatError(path, None, evidence, _STEP) from error
    arrays = dict(_walk_values(data, "", 0))
    found = columns_of(path, {name: array.shape for name, array in arrays.items()}, number_vectors=False)
    return replace(ArrayTable.of(path, digest, "MATLAB file", found), load=arrays.__getitem__)


def _walk_values(data: dict[str, Any], above: str, depth: int) -> Iterator[tuple[str, Array]]:
    for name, value in data.items():
        if isinstance(value, dict) and depth < _DEEPEST:
            yield from _walk_values(value, f"{above}{name}.", depth + 1)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
            yield f"{above}{name}", value


def _new(path: str | Path, digest: str) -> ArrayTable:
    with _opened(path) as file:
        shapes = {name: _shape(item) for name, item in _walk_groups(_package(), file, "", 0)}
    found = columns_of(path, shapes, number_vectors=False)
    return replace(ArrayTable.of(path, digest, "MATLAB 7.3 file", found), parts=partial(_parts, path, found[1]))


def _package() -> Any:
    try:
        import h5py
    except ImportError as error:
        raise MissingDependency("reading HDF5 and MATLAB files of version 7.3", "h5py", "mat") from error
    return h5py


@contextmanager
def _opened(path: str | Path) -> Iterator[Any]:
    h5py = _package()
    try:
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:  # TypeError is of types unknown to h5py
        evidence = f"it does not read as an HDF5 or MATLAB 7.3 file, or is damaged: {error}"
        raise LogFormatError(path, None, evidence, _STEP) from error


def _shape(item: Any) -> tuple[int, ...]:
    """Return the shape of a data set as MATLAB has it: it stores columns first."""
    shape = tuple(item.shape)[::-1]
    return (max(shape),) if len(shape) == 2 and 1 in shape else shape


def _parts(path: str | Path, count: int, name: str, rows: int) -> Iterator[Array]:
    """Yield blocks of rows (rows, k) of a data set; memory holds one block."""
    with _opened(path) as file:
        item = dict(_walk_groups(_package(), file, "", 0))[name]
        across = item.shape[-1] == count  # what MATLAB calls its first dimension
        for first in range(0, count, rows):
            size = min(rows, count - first)
            if across:
                yield np.asarray(item[..., first : first + size]).reshape(-1, size).T
            else:
                yield np.asarray(item[first : first + size]).reshape(size, -1)


def _walk_groups(h5py: Any, group: Any, above: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Yield name and data set of every array of numbers."""
    for name in group:
        if isinstance(name, bytes):
            raise ValueError(f"the name {name[:60]!r} is not UTF-8")
        # References of MATLAB's own, and links that lead out of the file, are passed over.
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        item = group[name]
        if isinstance(item, h5py.Group) and depth < _DEEPEST:
            yield from _walk_groups(h5py, item, f"{above}{name}.", depth + 1)
        elif isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub":
            yield f"{above}{name}", item
