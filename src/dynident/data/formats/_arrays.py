"""Files of named arrays as tables: which arrays are columns, and what each column is called."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynident.arrays import Array
from dynident.data.formats.base import MAX_CELLS, TOO_LARGE, Blocks, LogTable, check_size
from dynident.errors import LogFormatError
from dynident.files import sha256_of

#: Rows that are taken at a time from files that give them in parts.
_ROWS = 1 << 15

#: Columns of one array at most: more is a matrix of another kind.
MAX_WIDTH = 256

#: Groups of files that hold one recording each, such as ``demo_0``.
_RECORDING = re.compile(r"(?:^|\.)(?:demo|ep|episode|traj|trajectory|rollout|run|trial|log)_?\d+\.", re.IGNORECASE)


@dataclass(frozen=True)
class ArrayPlace:
    """Where a column stands: an array, and an index of its second (``across``) or first dimension; None in a vector."""

    array: str
    index: int | None = None
    across: bool = True


@dataclass(frozen=True, kw_only=True)
class ArrayTable(LogTable):
    """Columns out of named arrays that are loaded when they are asked for.

    Attributes:
        places: Where each column stands.
        rows: Number of rows.
        load: Returns an array by its name; asked where there are no ``parts``.
        parts: Returns blocks of rows of an array by its name, each (rows, k), where that takes no more memory.
    """

    places: Mapping[str, ArrayPlace]
    rows: int
    load: Callable[[str], Array] | None = None
    parts: Callable[[str, int], Iterator[Array]] | None = None

    @classmethod
    def of(cls, path: str | Path, digest: str, how: str, found: tuple[Mapping[str, ArrayPlace], int]) -> ArrayTable:
        """Return the table of a file whose columns :func:`columns_of` found, yet without ``load`` and ``parts``."""
        places, rows = found
        return cls(path=str(path), sha256=digest, header=tuple(places), how=how, places=places, rows=rows)

    def columns(self, names: Sequence[str]) -> Array:
        if self.rows * len(names) > MAX_CELLS:
            evidence = f"{self.rows:,} rows of {len(names)} columns, more than are read at once"
            raise LogFormatError(self.path, None, evidence, TOO_LARGE)
        if self.parts is not None:
            whole, start = np.empty((self.rows, len(names))), 0
            for block in self.batches(names, _ROWS):
                whole[start : start + len(block)] = block
                start += len(block)
            return whole
        arrays: dict[str, Array] = {}
        found = []
        for name in names:
            place = self.places[name]
            if place.array not in arrays:
                assert self.load is not None
                arrays[place.array] = self.load(place.array)
            array = arrays[place.array]
            column = array if place.index is None else array[:, place.index] if place.across else array[place.index]
            found.append(np.asarray(column, dtype=np.float64).reshape(-1))
        return np.stack(found, axis=1)

    def batches(self, names: Sequence[str], rows: int) -> Blocks:
        if self.parts is None:
            return (yield from super().batches(names, rows))
        places = [self.places[name] for name in names]
        arrays = list(dict.fromkeys(place.array for place in places))
        for blocks in zip(*(self.parts(name, rows) for name in arrays), strict=True):
            there = dict(zip(arrays, blocks, strict=True))
            yield np.stack([there[p.array][:, p.index or 0] for p in places], axis=1).astype(np.float64, copy=False)
        return ()


def columns_of(
    path: str | Path, shapes: Mapping[str, tuple[int, ...]], number_vectors: bool
) -> tuple[dict[str, ArrayPlace], int]:
    """Return the columns of a file of arrays, and the number of their rows.

    A vector of N numbers is a column of its own name; an array (N, k) or (k, N) is the columns name1, ..., namek. N is
    the length that most arrays have, which of a log with fewer rows than joints the vectors say; arrays of other shapes
    are passed over.

    Args:
        path: The file, for messages.
        shapes: Shape of every array of real numbers.
        number_vectors: Whether (N, 1) is called ``name1``; else ``name``, for formats in which a vector is (N, 1).

    Raises:
        LogFormatError: No array is as long as a log, or the file holds several.
    """
    vectors = {shape[0] for shape in shapes.values() if len(shape) == 1}  # matrices by row: square, or as many as times
    cubes = [s for s in shapes.values() if len(s) == len(set(s)) == 3 and (s[1] == max(s) or max(s) not in vectors)]
    pairs = {pair for shape in cubes for pair in (shape[:2], shape[1:])}
    if len({group[0] for name in shapes if (group := _RECORDING.search(name))}) > 1 or (
        pairs and all(len(shape) != 2 or shape in pairs for shape in shapes.values())
    ):
        step = "save each as a file of its own, with a row per sample, and give these files as logs"
        raise LogFormatError(path, None, f"it holds several recordings: {', '.join(list(shapes)[:3])}, ...", step)
    lengths = Counter(max(shape) for shape in shapes.values() if len(shape) in (1, 2) and max(shape, default=0) > 1)
    if not lengths:
        step = "save time, positions and torques as arrays with a row per sample, such as t (N,), q (N, n), tau (N, n)"
        raise LogFormatError(path, None, "it holds no arrays of numbers over time", step)
    most = max(lengths.values())
    count = _rows_by_vectors(shapes, max(length for length, times in lengths.items() if times == most))
    found: dict[str, ArrayPlace] = {}
    for name, shape in shapes.items():
        if len(shape) == 1 and shape[0] == count:
            found[name] = ArrayPlace(name)
        elif len(shape) == 2 and count in shape:
            across = shape[0] == count
            width = shape[1] if across else shape[0]
            if width > MAX_WIDTH:
                continue
            single = width == 1 and not number_vectors
            found |= {name if single else f"{name}{k + 1}": ArrayPlace(name, k, across) for k in range(width)}
    return found, count


def _rows_by_vectors(shapes: Mapping[str, tuple[int, ...]], longest: int) -> int:
    """Return the number of rows: the longest side of most arrays, or a shorter one that vectors have and all of these.

    No vector has then the length ``longest``, as the time does where that is the number of rows.
    """
    sides = [shape for shape in shapes.values() if len(shape) == 2 and min(shape) > 1 and longest in shape]
    vectors = {max(shape) for shape in shapes.values() if shape and max(shape) == np.prod(shape)}
    shorter = {length for length in vectors if sides and all(length in shape for shape in sides)}
    return longest if longest in vectors else max(shorter, default=longest)


def checked_file(path: str | Path, most: int) -> str:
    """Return the hash of an ordinary file that is not larger than ``most`` bytes.

    Raises:
        FileError: It cannot be read, or is no ordinary file.
        LogFormatError: It is larger.
    """
    check_size(path, most, "split it into several logs")
    return sha256_of(path)
