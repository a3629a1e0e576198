"""Logs as MATLAB files, version 4 to 7.3: vectors and matrices by name, also inside structs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.errors import LogFormatError, MissingDependency
from dynident.experiment.formats._arrays import ArrayTable, checked_file, columns_of
from dynident.experiment.formats.base import LogFormat

_MAX_BYTES = 1 << 30
_STEP = "save plain arrays in MATLAB: save('log.mat', 't', 'q', 'tau'); tables and timeseries objects cannot be read"
_HDF5 = b"\x89HDF\r\n\x1a\n"
_DEEPEST = 8


@dataclass(frozen=True)
class Mat(LogFormat):
    """MATLAB file; a matrix q is the columns q1, ..., qn, a field of a struct is data.q.

    Version 7.3 needs the extra ``mat``.
    """

    suffixes: ClassVar = (".mat",)

    def open(self, path: str | Path) -> ArrayTable:
        """Return the table; see :meth:`LogFormat.open`."""
        digest = checked_file(path, _MAX_BYTES)
        arrays, how = _new(path) if _is_hdf5(path) else _old(path)
        places = columns_of(path, {name: array.shape for name, array in arrays.items()}, number_vectors=False)
        return ArrayTable(
            path=str(path), sha256=digest, header=tuple(places), how=how, places=places, load=arrays.__getitem__
        )


def _is_hdf5(path: str | Path) -> bool:
    with open(path, "rb") as stream:
        return stream.read(8) == _HDF5 or stream.read(512)[504:] == _HDF5


def _old(path: str | Path) -> tuple[dict[str, Array], str]:
    from scipy.io import loadmat  # loads slowly

    try:
        data = loadmat(path, simplify_cells=True)
    except Exception as error:  # the parser lets any error out of a damaged file
        evidence = f"no MATLAB file, or a damaged one ({type(error).__name__}: {error})"
        raise LogFormatError(path, None, evidence, _STEP) from error
    return dict(_walk_values(data, "", 0)), "MATLAB file"


def _walk_values(data: dict[str, Any], above: str, depth: int) -> Iterator[tuple[str, Array]]:
    for name, value in data.items():
        if name.startswith("__"):
            continue
        if isinstance(value, dict) and depth < _DEEPEST:
            yield from _walk_values(value, f"{above}{name}.", depth + 1)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
            yield f"{above}{name}", value


def _new(path: str | Path) -> tuple[dict[str, Array], str]:
    try:
        import h5py
    except ImportError as error:
        raise MissingDependency("reading MATLAB files of version 7.3", "h5py", "mat") from error
    try:
        with h5py.File(path, "r") as file:
            return dict(_walk_groups(h5py, file, "", 0)), "MATLAB 7.3 file"
    except (OSError, RuntimeError, ValueError, KeyError) as error:
        evidence = f"no MATLAB 7.3 file, or a damaged one ({error})"
        raise LogFormatError(path, None, evidence, _STEP) from error


def _walk_groups(h5py: Any, group: Any, above: str, depth: int) -> Iterator[tuple[str, Array]]:
    for name in group:
        # References of MATLAB's own, and links that lead out of the file, are passed over.
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        item = group[name]
        if isinstance(item, h5py.Group) and depth < _DEEPEST:
            yield from _walk_groups(h5py, item, f"{above}{name}.", depth + 1)
        elif isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub" and 8 * item.size <= _MAX_BYTES:
            stored = item[()]
            array = np.asarray(stored).T  # MATLAB stores columns first
            yield f"{above}{name}", array.reshape(-1) if 1 in array.shape and array.ndim == 2 else array
