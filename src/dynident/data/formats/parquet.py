"""Logs as Parquet: columns of numbers, and columns of lists with one number per joint."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.data.formats._arrays import MAX_WIDTH, ArrayPlace, checked_file
from dynident.data.formats.base import MAX_CELLS, TOO_LARGE, Blocks, LogFormat, LogTable, written_table
from dynident.data.log import Log
from dynident.errors import LogFormatError, MissingDependency
from dynident.files import write_atomically

_MAX_BYTES = 1 << 44

#: Rows that are unpacked at a time, and bytes of the file that are read at a time.
_BATCH, _BUFFER = 1 << 16, 1 << 20


@dataclass(frozen=True, kw_only=True)
class ParquetTable(LogTable):
    """Columns of a Parquet file, read in batches of rows.

    Attributes:
        rows: Number of rows.
        places: Where each column stands.
    """

    rows: int
    places: Mapping[str, ArrayPlace]

    def columns(self, names: Sequence[str]) -> Array:
        if self.rows * len(names) > MAX_CELLS:
            evidence = f"{self.rows:,} rows of {len(names)} columns, more than are read at once"
            raise LogFormatError(self.path, None, evidence, TOO_LARGE)
        found, start = np.empty((self.rows, len(names))), 0
        for block in self.batches(names, _BATCH):
            found[start : start + len(block)] = block[: self.rows - start]
            start += len(block)
        if start != self.rows:
            evidence = f"it states {self.rows:,} rows and holds {start:,}"
            raise LogFormatError(self.path, None, evidence, "record or convert it again")
        return found

    def batches(self, names: Sequence[str], rows: int) -> Blocks:
        """Yield some columns in blocks; see :meth:`LogTable.batches`. Memory holds one block and its pages."""
        places, start = [self.places[name] for name in names], 0
        file = _opened(self.path, _BUFFER)
        for batch in unpacked(self.path, file, rows, list(dict.fromkeys(p.array for p in places))):
            arrays = {name: self._numbers(batch.column(name), name, start) for name in batch.schema.names}
            found = np.empty((len(names), batch.num_rows)).T  # each column in one piece
            for k, place in enumerate(places):
                array = arrays[place.array]
                found[:, k] = array if place.index is None else array[:, place.index]
            yield found
            start += batch.num_rows
        return ()

    def _numbers(self, column: Any, name: str, start: int) -> Array:
        """Return the numbers of a column of one batch, (rows,) or (rows, k); null becomes NaN."""
        import pyarrow as pa

        if pa.types.is_timestamp(column.type):
            units = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
            return column.cast(pa.int64()).to_numpy(zero_copy_only=False) / units[column.type.unit]
        if not _is_list(column.type):
            return column.to_numpy(zero_copy_only=False).astype(np.float64)
        width = sum(place.array == name for place in self.places.values())
        flat = column.flatten().to_numpy(zero_copy_only=False)
        if len(flat) != width * len(column) or column.null_count:
            lengths = column.value_lengths().to_numpy(zero_copy_only=False)
            row = int(np.argmax(lengths != width))
            raise self.fault(
                start + row, f"'{name}' is not a list of {width} numbers as in row 1", "repair the recording"
            )
        return flat.astype(np.float64).reshape(len(column), width)


@dataclass(frozen=True)
class Parquet(LogFormat):
    """Apache Parquet; a column of lists, such as ``observation.state``, is the columns observation.state1, ...

    Timestamps become seconds. Needs the extra ``parquet``.
    """

    suffixes: ClassVar = (".parquet", ".pq")

    def open(self, path: str | Path) -> ParquetTable:
        digest = checked_file(path, _MAX_BYTES)
        file = _opened(path)
        if file.metadata.num_rows < 0:
            evidence = f"a damaged Parquet file ({file.metadata.num_rows} rows)"
            raise LogFormatError(path, None, evidence, "record or convert it again")
        places = _places(path, file)
        if not places:
            raise LogFormatError(path, None, "it holds no columns of numbers", "write time, positions and torques")
        return ParquetTable(
            path=str(path),
            sha256=digest,
            header=tuple(places),
            how="Parquet",
            rows=int(file.metadata.num_rows),
            places=places,
        )

    def write(self, log: Log, path: str | Path) -> None:
        pa, pq = _package()
        header, values = written_table(log)
        table = pa.table({name: column for name, column in zip(header, values.T, strict=True)})
        sink = pa.BufferOutputStream()
        pq.write_table(table, sink)
        write_atomically(path, sink.getvalue().to_pybytes())


def _places(path: str | Path, file: Any) -> dict[str, ArrayPlace]:
    """Return where the columns of numbers stand."""
    import pyarrow as pa

    found: dict[str, ArrayPlace] = {}
    for item in file.schema_arrow:
        kind = item.type
        if pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_timestamp(kind):
            found[item.name] = ArrayPlace(item.name)
        elif _is_list(kind) and (pa.types.is_integer(kind.value_type) or pa.types.is_floating(kind.value_type)):
            width = kind.list_size if pa.types.is_fixed_size_list(kind) else _first_length(path, file, item.name)
            if 0 < width <= MAX_WIDTH:
                found |= {f"{item.name}{k + 1}": ArrayPlace(item.name, k) for k in range(width)}
    return found


def _first_length(path: str | Path, file: Any, name: str) -> int:
    for batch in unpacked(path, file, 1, [name]):
        return len(batch.column(0)[0].as_py() or ())
    return 0


def unpacked(path: str | Path, file: Any, rows: int, names: list[str]) -> Iterator[Any]:
    """Yield the batches of some columns; damage of a page ends in an error that names the file."""
    import pyarrow as pa

    batches = file.iter_batches(rows, columns=names)
    while True:
        try:
            batch = next(batches, None)
            if batch is None:
                return
            batch.validate(full=True)
        except (pa.ArrowException, OSError, ValueError, OverflowError, MemoryError) as error:
            evidence = f"a damaged Parquet file ({' '.join(str(error).split())[:200]})"
            raise LogFormatError(path, None, evidence, "record or convert it again") from error
        yield batch


def _is_list(kind: Any) -> bool:
    import pyarrow as pa

    return pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind) or pa.types.is_large_list(kind)


def _opened(path: str | Path, buffer: int = 0) -> Any:
    """Return the file; with a buffer, it is read page by page. Unless told, the package reads ahead without end."""
    pa, pq = _package()
    try:
        return pq.ParquetFile(path, buffer_size=buffer, pre_buffer=False)
    except (pa.ArrowException, OSError, ValueError) as error:
        evidence = f"no Parquet file ({' '.join(str(error).split())[:200]})"
        raise LogFormatError(path, None, evidence, "record or convert it again") from error


def _package() -> tuple[Any, Any]:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise MissingDependency("reading Parquet", "pyarrow", "parquet") from error
    return pa, pq
