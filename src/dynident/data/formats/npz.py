"""Logs as NumPy archives, vectors and arrays (N, n) by name, and as one bare array."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tokenize import TokenError
from typing import IO, ClassVar

import numpy as np
from numpy.lib import format as npy

from dynident.arrays import Array
from dynident.data.formats._arrays import ArrayTable, checked_file, columns_of
from dynident.data.formats._column_map import NUMBERED
from dynident.data.formats.base import LogFormat, written_table
from dynident.data.log import Log
from dynident.errors import LogFormatError
from dynident.files import write_atomically

_STEP = "write it with numpy.savez(path, t=t, q=q, tau=tau)"
MAX_BYTES = 1 << 44
MAX_MEMBERS = 4096
_PIECE = 1 << 20

#: What lets the reading of an archive end that is none, or is damaged.
_DAMAGE = (
    zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, OSError, OverflowError, ValueError, struct.error,
    zlib.error,
)  # fmt: skip


@dataclass(frozen=True)
class Npz(LogFormat):
    """NumPy archive (numpy.savez): t (N,), q (N, n), tau (N, n); the columns of an array q are called q1, ..., qn.

    Objects and pickles are refused, and so are archives that unpack to more than they should. One array alone
    (numpy.save, .npy) is the columns c1, ..., ck.
    """

    suffixes: ClassVar = (".npz", ".npy")

    def open(self, path: str | Path) -> ArrayTable:
        digest = checked_file(path, MAX_BYTES)
        if str(path).lower().endswith(".npy"):
            return _bare(path, digest)
        try:
            with zipfile.ZipFile(path) as archive:
                members = archive.infolist()
                if len(members) > MAX_MEMBERS or sum(member.file_size for member in members) > MAX_BYTES:
                    raise LogFormatError(path, None, "it unpacks to more than a log can hold", "write it again")
                all_shapes = {each.filename.removesuffix(".npy"): _shape(path, archive, each) for each in members}
        except _DAMAGE as error:
            raise LogFormatError(path, None, f"no NumPy archive ({error})", _STEP) from error
        shapes = {name: shape for name, shape in all_shapes.items() if shape is not None}
        found = columns_of(path, shapes, number_vectors=True)
        return replace(ArrayTable.of(path, digest, "NumPy archive", found), parts=partial(_parts, path, found[1]))

    def write(self, log: Log, path: str | Path) -> None:
        """Write t (N,) and one array (N, n) per signal; see :meth:`LogFormat.write`."""
        if str(path).lower().endswith(".npy"):
            raise LogFormatError(path, None, "one array has no names of signals", "write an archive, .npz")
        written_table(log)  # refuses what is not finite
        arrays = {NUMBERED[name]: values for name, values in log.signals().items()}
        content = io.BytesIO()
        np.savez_compressed(content, t=log.time, **arrays)  # type: ignore[arg-type]
        write_atomically(path, content.getvalue())


def _bare(path: str | Path, digest: str) -> ArrayTable:
    """Return the table of one array, which stays on the disk; its columns are c1, ..., ck."""
    try:
        array = npy.open_memmap(path, mode="r")
    except _DAMAGE as error:
        raise LogFormatError(path, None, f"no NumPy array of numbers ({error})", _STEP) from error
    found = columns_of(path, {"c": array.shape} if array.dtype.kind in "fiub" else {}, number_vectors=True)
    return replace(ArrayTable.of(path, digest, "NumPy array", found), load=lambda _: array)


def _shape(path: str | Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> tuple[int, ...] | None:
    """Return the shape of a member of real numbers; None for others. The header must agree with the size."""
    if not member.filename.endswith(".npy"):
        return None
    try:
        with archive.open(member) as stream:
            shape, _, kind = _npy_header(stream)
            start = stream.tell()
    except (ValueError, TypeError, SyntaxError, TokenError) as error:  # the header is a dictionary in Python's words
        raise LogFormatError(path, None, f"'{member.filename}' is no array ({error})", _STEP) from error
    if kind.hasobject:
        raise LogFormatError(path, None, f"'{member.filename}' holds Python objects", "save plain arrays of numbers")
    if kind.kind not in "fiub":
        return None
    if start + int(np.prod(shape, dtype=object)) * kind.itemsize != member.file_size:
        evidence = f"'{member.filename}' states the shape {shape} but not as many bytes"
        raise LogFormatError(path, None, evidence, _STEP)
    return shape


def _npy_header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    version = npy.read_magic(stream)
    if version == (1, 0):
        return npy.read_array_header_1_0(stream)
    if version == (2, 0):
        return npy.read_array_header_2_0(stream)
    raise ValueError(f"a header of version {version}")


def _parts(path: str | Path, count: int, name: str, rows: int) -> Iterator[Array]:
    """Yield blocks of rows (rows, k) of a member, whichever way it is laid out; memory holds one block."""
    try:
        with zipfile.ZipFile(path) as archive:
            with archive.open(f"{name}.npy") as stream:
                shape, by_columns, kind = _npy_header(stream)
                begin = stream.tell()
            width = int(np.prod(shape)) // count
            # Numbers that follow each other are a row, or a column where the array is laid out the other way.
            apart = width > 1 and (by_columns == (shape[0] == count))
            starts = [begin + k * count * kind.itemsize for k in range(width)] if apart else [begin]
            streams = [archive.open(f"{name}.npy") for _ in starts]
            for start, one in zip(starts, streams, strict=True):
                _skip(one, start)
            for first in range(0, count, rows):
                size = min(rows, count - first)
                cells = size if apart else size * width
                found = [np.frombuffer(_exactly(one, cells * kind.itemsize), kind) for one in streams]
                yield np.stack(found, axis=1) if apart else found[0].reshape(size, width)
            for one in streams:
                one.close()
    except _DAMAGE as error:
        raise LogFormatError(path, None, f"a damaged NumPy archive ({error})", _STEP) from error


def _skip(stream: IO[bytes], size: int) -> None:
    """Read on by so many bytes: `seek` in members beside each other goes astray on Python 3.12.1 and 3.13.0."""
    while size:
        size -= len(_exactly(stream, min(size, _PIECE)))


def _exactly(stream: IO[bytes], size: int) -> bytes:
    data = stream.read(size)
    if len(data) < size:
        raise EOFError("it ends early")
    return data
