"""Text whose columns stand between upright strokes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.data.formats import LogFormat, LogTable
from dynident.data.formats.base import written_table
from dynident.data.log import Log
from dynident.errors import LogFormatError
from dynident.files import sha256_of, unreadable, write_atomically

_STEP = "write names and numbers with | between them"


@dataclass(frozen=True, kw_only=True)
class PipeTable(LogTable):
    """Rows of text, cut into cells."""

    cells: tuple[tuple[str, ...], ...]

    def columns(self, names: Sequence[str]) -> Array:
        places = [self.header.index(name) for name in names]
        try:
            return np.array([[float(row[place]) for place in places] for row in self.cells])
        except (ValueError, IndexError) as error:
            raise LogFormatError(self.path, None, f"a cell that is no number ({error})", _STEP) from error


@dataclass(frozen=True)
class Pipes(LogFormat):
    """Text with a header row and | between the columns."""

    suffixes: ClassVar = (".pipes",)

    def open(self, path: str | Path) -> PipeTable:
        try:
            lines = Path(path).read_text("utf-8").splitlines()
        except OSError as error:
            raise unreadable(path, error) from error
        except UnicodeDecodeError as error:
            raise LogFormatError(path, None, "it is no text", _STEP) from error
        rows = [tuple(line.split("|")) for line in lines]
        if len(rows) < 2 or len(rows[0]) < 2:
            raise LogFormatError(path, 1, "no columns between strokes", _STEP)
        digest = sha256_of(path)
        return PipeTable(path=str(path), sha256=digest, header=rows[0], how="text with |", cells=tuple(rows[1:]))

    def write(self, log: Log, path: str | Path) -> None:
        header, values = written_table(log)
        write_atomically(path, "\n".join("|".join(row) for row in [header, *[map(repr, r) for r in values.tolist()]]))
