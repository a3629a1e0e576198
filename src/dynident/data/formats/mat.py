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
from dynident.data.formats._mat_values import MOST_STRUCTS, read_values
from dynident.data.formats.base import LogFormat
from dynident.errors import LogFormatError, MissingDependency

_MAX_BYTES, _MOST_BYTES = 1 << 30, 1 << 44
_STEP = "save plain arrays in MATLAB: save('log.mat', 't', 'q', 'tau'); tables and timeseries objects cannot be read"
_EXPORT = (
    "save 'Structure With Time', or arrays: t = x.Time; q = squeeze(x.Data); of each timeseries x, which of a Dataset "
    "is x = logsout{1}.Values"
)
_HDF5 = b"\x89HDF\r\n\x1a\n"
_DEEPEST = 8


@dataclass(frozen=True)
class Mat(LogFormat):
    """MATLAB or HDF5 file; a matrix q is the columns q1, ..., qn, a field of a struct or what a group holds is data.q.

    Signals of Simulink's structures have their labels, ``ScopeData.q1``, else ``ScopeData.signals(1).values1``.
    HDF5, which is MATLAB's version 7.3, needs the extra ``mat``.
    """

    suffixes: ClassVar = (".mat", ".h5", ".hdf5")

    def open(self, path: str | Path) -> ArrayTable:
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
    walked = dict(_walk_values(data, "", 0))
    arrays = {name: value for name, value in walked.items() if not isinstance(value, bytes)}
    objects = [f"{name} ({value.decode('latin-1')})" for name, value in walked.items() if isinstance(value, bytes)]
    how = "MATLAB file" + f"; left out: {', '.join(objects)}: {_EXPORT}" * bool(objects)
    if objects and not arrays:
        raise LogFormatError(path, None, f"it holds objects of MATLAB alone: {', '.join(objects[:4])}", _EXPORT)
    found = columns_of(path, {name: array.shape for name, array in arrays.items()}, number_vectors=False)
    return replace(ArrayTable.of(path, digest, how, found), load=arrays.__getitem__)


def _walk_values(data: dict[str, Any], above: str, depth: int) -> Iterator[tuple[str, Array | bytes]]:
    """Yield name and values of every array of numbers, and the class of every object."""
    for name, value in data.items() if depth < _DEEPEST else ():
        many = value if isinstance(value, list) else [value]
        labels = [_label(one.get("label")) if isinstance(one, dict) and "values" in one else "" for one in many]
        for k, (one, label) in enumerate(zip(many, labels, strict=True), 1):
            if label not in ("", *data) and labels.count(label) == 1 and isinstance(one["values"], np.ndarray):
                yield f"{above}{label}", one["values"]
            elif isinstance(one, dict):
                yield from _walk_values(one, f"{above}{name}{f'({k})' * (len(many) > 1)}.", depth + 1)
            elif isinstance(one, bytes) or (isinstance(one, np.ndarray) and one.dtype.kind in "fiub"):
                yield f"{above}{name}", one


def _label(text: object) -> str:
    """Return the label of a signal as the name of a column; empty for none."""
    return " ".join(text.strip("<> ").split()) if isinstance(text, str) else ""


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
    """Yield name and data set of every array of numbers; those of arrays of structs are behind references."""
    labels = [_label("".join(map(chr, np.ravel(one[()])))) for one in _structs(h5py, group, "label")]
    for name in group:
        if isinstance(name, bytes):
            raise ValueError(f"the name {name[:60]!r} is not UTF-8")
        # References of MATLAB's own, and links that lead out of the file, are passed over.
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        item = group[name]
        if isinstance(item, h5py.Group) and depth < _DEEPEST:
            yield from _walk_groups(h5py, item, f"{above}{name}.", depth + 1)
        items = _structs(h5py, group, name)
        for k, one in enumerate(items):
            if name == "values" and labels[k : k + 1] not in ([], [""]) and labels.count(labels[k]) == 1:
                yield f"{above[: above.rfind('.', 0, -1) + 1]}{labels[k]}", one
            else:
                yield f"{above[:-1]}({k + 1}).{name}" if len(items) > 1 else f"{above}{name}", one


def _structs(h5py: Any, group: Any, name: str) -> list[Any]:
    """Return the data set of numbers of a field; of arrays of structs, where references stand, one of each."""
    item = group.get(name)
    if not isinstance(item, h5py.Dataset) or "MATLAB_object_decode" in item.attrs:
        return []
    is_array = h5py.check_ref_dtype(item.dtype) is not None and item.size <= MOST_STRUCTS
    items = [group.file[one] for one in np.ravel(item[()]) if one] if is_array else [item]
    return [one for one in items if isinstance(one, h5py.Dataset) and one.dtype.kind in "fiub"]
