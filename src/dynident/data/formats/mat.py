"""Logs as MATLAB files, version 4 to 7.3, and HDF5: vectors and matrices by name, also inside structs.

Values of versions 4 and 5 (6, 7) are arrays of real numbers, structs of them, and text.
Read here and not by a parser in compiled code, where a damaged file can end the process. Every count in the file is
held against the bytes that are there before anything is made of it. Layout: MathWorks, "MAT-File Format" (R2023b).
"""

from __future__ import annotations

import io
import math
import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.data.formats._arrays import ArrayTable, checked_file, columns_of
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


#: Bytes that the compressed variables of a file may unpack to, all together.
MOST_UNPACKED = 1 << 31

MOST_STRUCTS = 1 << 12
_MATRIX, _COMPRESSED = 14, 15
_STRUCT, _TEXT, _NUMERIC, _OBJECT = 2, 4, range(6, 16), 17
_ENCODINGS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16"}
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_COMPLEX = 0x0800
_KINDS_4 = ("f8", "f4", "i4", "i2", "u2", "u1")


def read_values(path: str | Path) -> dict[str, Any]:
    """Return the arrays of real numbers and the text of a file by name, those of structs in dictionaries by field.

    Arrays of structs are lists of these. Dimensions of 1 are left out, as far as a vector. Objects are the names of
    their classes, in bytes. Cells, complex and sparse arrays and single numbers are passed over.

    Raises:
        OSError: The file cannot be read.
        ValueError: It is no such file, or damaged; the message says where.
    """
    with open(path, "rb") as stream:
        head = stream.read(128)
        size = os.fstat(stream.fileno()).st_size
        if len(head) >= 4 and 0 in head[:4]:
            return dict(_read_4(stream, size))
        order = {b"IM": "<", b"MI": ">"}.get(head[126:128])
        if order is None:
            raise ValueError("no header of a MATLAB file")
        return dict(_read_5(stream, size, order))


def _read_5(stream: Any, size: int, order: str) -> Iterator[tuple[str, Any]]:
    unpacked = 0
    stream.seek(128)
    while (place := stream.tell()) < size:
        tag = stream.read(8)
        if len(tag) < 8:
            raise ValueError(f"it ends inside a variable (byte {place})")
        kind, count = (int(x) for x in np.frombuffer(tag, f"{order}u4"))
        if kind not in (_MATRIX, _COMPRESSED) or count > size - stream.tell():
            raise ValueError(f"no variable, or not all of it, at byte {place}")
        content = memoryview(stream.read(count))
        if kind == _COMPRESSED:
            content = memoryview(_unpacked(content, MOST_UNPACKED - unpacked))
            unpacked += len(content)
            inner, length, content, _ = _element(content, order)
            if inner != _MATRIX or length == 0:
                raise ValueError(f"no variable at byte {place}")
        found = _matrix(content, order, 0)
        if found is not None and found[0]:
            yield found


def _unpacked(content: memoryview, most: int) -> bytes:
    machine = zlib.decompressobj()
    try:
        data = machine.decompress(content, most + 1)
    except zlib.error as error:
        raise ValueError(f"a compressed variable is damaged ({error})") from error
    if len(data) > most:
        raise ValueError(f"its variables unpack to more than {MOST_UNPACKED >> 30} GiB")
    if not machine.eof:
        raise ValueError("a compressed variable is cut")
    return data


def _element(data: memoryview, order: str) -> tuple[int, int, memoryview, memoryview]:
    """Return type, size and content of the first element, and what follows it."""
    if len(data) < 8:
        raise ValueError("an element is cut")
    kind, count = (int(x) for x in np.frombuffer(data[:8], f"{order}u4"))
    if kind >> 16:
        count, kind = kind >> 16, kind & 0xFFFF
        if count > 4:
            raise ValueError("a small element of more than 4 bytes")
        return kind, count, data[4 : 4 + count], data[8:]
    if count > len(data) - 8:
        raise ValueError("an element states more bytes than its variable holds")
    end = 8 + count
    return kind, count, data[8:end], data[min(len(data), end + (-count % 8 if kind != _COMPRESSED else 0)) :]


def _numbers(data: memoryview, order: str) -> tuple[Array, memoryview]:
    kind, count, content, rest = _element(data, order)
    if kind not in _STORED:
        raise ValueError(f"an element of the type {kind} where numbers should be")
    form = np.dtype(f"{order}{_STORED[kind]}")
    if count % form.itemsize:
        raise ValueError("numbers are cut")
    return np.frombuffer(content, form), rest


def _matrix(data: memoryview, order: str, depth: int) -> tuple[str, Any] | None:
    """Return name and value of a variable; None where it is of a kind that is passed over."""
    flags, data = _numbers(data, order)
    if len(flags) < 1:
        raise ValueError("a variable without flags")
    group = int(flags[0]) & 0xFF
    if group == _OBJECT:
        _, _, label, data = _element(data, order)
        return bytes(label).decode("latin-1"), bytes(_element(_element(data, order)[3], order)[2])
    if group not in (_STRUCT, _TEXT, *_NUMERIC):
        return None
    dimensions, data = _numbers(data, order)
    shape = tuple(int(x) for x in dimensions)
    label, data = _numbers(data, order)
    name = label.astype(np.uint8).tobytes().decode("latin-1")
    if len(shape) < 2 or min(shape) < 0:
        raise ValueError(f"'{name[:60]}' has no dimensions")
    if group == _STRUCT:
        is_read = depth < _DEEPEST and math.prod(shape) <= MOST_STRUCTS
        return (name, _fields(data, order, depth + 1, math.prod(shape))) if is_read else None
    if group == _TEXT:
        kind, _, content, _ = _element(data, order)
        encoding = _ENCODINGS.get(kind, "latin-1")
        ordered = encoding + {"<": "-le", ">": "-be"}[order] * (encoding == "utf-16")
        return name, bytes(content).decode(ordered, errors="replace")
    if int(flags[0]) & _COMPLEX:
        return None
    values, _ = _numbers(data, order)
    if len(values) != math.prod(shape):
        raise ValueError(f"'{name[:60]}' states the shape {shape} and holds {len(values)} numbers")
    return _shaped(name, values, shape)


def _shaped(name: str, values: Array, shape: tuple[int, ...]) -> tuple[str, Array] | None:
    narrow = tuple(x for x in shape if x != 1)
    return (name, values.reshape(narrow, order="F")) if narrow else None


def _fields(data: memoryview, order: str, depth: int, count: int) -> Any:
    """Return the fields of a struct by name; of an array of so many structs a list of them."""
    lengths, data = _numbers(data, order)
    kind, _, names, data = _element(data, order)
    width = int(lengths[0]) if len(lengths) else 0
    if kind not in (1, 2) or width < 1 or len(names) % width:
        raise ValueError("a struct without names of its fields")
    found = list[dict[str, Any]]()
    for _ in range(count if len(names) else 0):
        found.append({})
        for start in range(0, len(names), width):
            name = bytes(names[start : start + width]).split(b"\0")[0].decode("latin-1")
            kind, size, content, data = _element(data, order)
            if kind != _MATRIX:
                raise ValueError(f"the field '{name[:60]}' is no variable")
            value = _matrix(content, order, depth) if size else None
            if value is not None:
                found[-1][name] = value[1]
    return found[0] if len(found) == 1 else found


def _read_4(stream: io.BufferedReader, size: int) -> Iterator[tuple[str, Any]]:
    """Yield the variables of a file of version 4: a header of five numbers each, the name, and its values."""
    stream.seek(0)
    order = ""
    while (place := stream.tell()) < size:
        head = stream.read(20)
        if len(head) < 20:
            raise ValueError(f"it ends inside a variable (byte {place})")
        if not order:
            order = "<" if 0 <= int(np.frombuffer(head[:4], "<i4")[0]) < 5000 else ">"
        kind, rows, columns, imaginary, length = (int(x) for x in np.frombuffer(head, f"{order}i4"))
        precision, text = kind // 10 % 10, kind % 10
        if not 0 <= kind < 5000 or precision >= len(_KINDS_4) or min(rows, columns) < 0 or not 0 < length <= 1024:
            raise ValueError(f"no header of a variable at byte {place}")
        name = stream.read(length).split(b"\0")[0].decode("latin-1")
        form = np.dtype(order + _KINDS_4[precision])
        bulk = rows * columns * form.itemsize
        if bulk * (2 if imaginary else 1) > size - stream.tell():
            raise ValueError(f"'{name[:60]}' states more bytes than the file holds")
        values = np.frombuffer(stream.read(bulk), form)
        if imaginary:
            stream.seek(bulk, os.SEEK_CUR)
        elif text == 0 and (found := _shaped(name, values, (rows, columns))) is not None:
            yield found
