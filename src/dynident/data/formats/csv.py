"""Logs as delimited text: comma, semicolon, tab or blanks, one header row, or none where names are stated."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from dynident.data.formats._text_table import TextTable, open_table
from dynident.data.formats.base import LogFormat, written_table
from dynident.data.log import Log
from dynident.errors import BadOption
from dynident.files import write_atomically


@dataclass(frozen=True)
class Csv(LogFormat):
    """Delimited text with a header row; the separator is found in the header, lines that start with # are skipped.

    Attributes:
        decimal: The decimal sign of the numbers, ``.`` or ``,``; it is never guessed.
        names: Names of the columns of a file without a header row, in order; or one such as ``c{}`` for the names c1,
            c2, ... of as many columns as there are.
    """

    decimal: str = "."
    names: tuple[str, ...] = ()

    suffixes: ClassVar = (".csv", ".txt", ".tsv", ".dat")

    def __post_init__(self) -> None:
        if self.decimal not in (".", ","):
            raise BadOption("decimal", self.decimal, "choose '.' or ','")
        if isinstance(self.names, str):
            raise BadOption("names", self.names, "give a list of names, one for each column, or one such as [c{}]")
        object.__setattr__(self, "names", tuple(self.names))

    def open(self, path: str | Path) -> TextTable:
        return open_table(path, self.decimal, self.names)

    def write(self, log: Log, path: str | Path) -> None:
        """Write the log; .tsv is separated by tabs, decimal commas by semicolons; see :meth:`LogFormat.write`."""
        header, values = written_table(log)
        mark, separator = self.decimal, self._separator(path)
        lines = [separator.join(header)]
        for cells in values.tolist():
            text = separator.join(map(repr, cells))
            lines.append(text if mark == "." else text.replace(".", ","))
        write_atomically(path, "\n".join(lines) + "\n")

    def _separator(self, path: str | Path) -> str:
        if Path(path).suffix.lower() == ".tsv":
            return "\t"
        return "," if self.decimal == "." else ";"
