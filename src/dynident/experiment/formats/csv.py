"""Logs as delimited text: comma, semicolon, tab or blanks, one header row."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, LogFormatError, LogMismatch
from dynident.experiment.formats._text_table import DELIMITERS, TextTable, open_table
from dynident.experiment.formats.base import NUMBERED, ColumnMap, LogFormat
from dynident.experiment.log import Log, Source
from dynident.files import write_atomically

#: Fewer rows than this are no log.
MIN_SAMPLES = 10


@dataclass(frozen=True)
class Csv(LogFormat):
    """Delimited text with a header row; the separator is found in the header, lines that start with # are skipped.

    Attributes:
        decimal: The decimal sign of the numbers, ``.`` or ``,``; it is never guessed.
    """

    decimal: str = "."

    suffixes: ClassVar = (".csv", ".txt", ".tsv")

    def __post_init__(self) -> None:
        if self.decimal not in (".", ","):
            raise BadOption("decimal", self.decimal, "choose '.' or ','")

    def header(self, path: str | Path) -> tuple[str, ...]:
        """Return the names of the columns; see :meth:`LogFormat.header`."""
        return open_table(path, self.decimal).header

    def read(self, path: str | Path, columns: ColumnMap) -> Log:
        """Return the log; see :meth:`LogFormat.read`."""
        table = open_table(path, self.decimal)
        chosen = columns.resolved(table.header, path, table.line)
        stated = chosen.stated()
        names = [chosen.time, *(name for signal in stated.values() for name in signal)]
        values = table.columns(names)
        if len(values) < MIN_SAMPLES:
            step = "an identification needs seconds of motion"
            raise LogFormatError(path, table.line, f"only {len(values)} rows", step)
        time = chosen.time_to_si(values[:, 0])
        _check_time(table, chosen.time, time)
        count = len(chosen.joints)
        blocks = {name: values[:, 1 + k * count : 1 + (k + 1) * count] for k, name in enumerate(stated)}
        signals = {name: chosen.to_si(name, block) for name, block in blocks.items()}
        how = f"read as {DELIMITERS[table.delimiter]}-separated text, decimal '{self.decimal}'"
        steps = tuple(filter(None, (how, chosen.conversions())))
        source = Source(str(path), table.sha256, len(values), steps)
        return Log(chosen.joints, time, source=source, **signals)

    def write(self, log: Log, path: str | Path) -> None:
        """Write the log; .tsv is separated by tabs, decimal commas by semicolons; see :meth:`LogFormat.write`."""
        signals = log.signals()
        header = ["t", *(f"{NUMBERED[name]}{k + 1}" for name in signals for k in range(len(log.joints)))]
        values = np.column_stack([log.time, *signals.values()])
        bad = ~np.isfinite(values)
        if np.any(bad):
            row = int(np.argmax(bad.any(axis=1)))
            evidence = f"{header[int(np.argmax(bad[row]))]} of sample {row + 1} is not finite"
            raise LogMismatch(log.name, evidence, "leave such rows out before writing")
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


def _check_time(table: TextTable, column: str, time: Array) -> None:
    """Refuse time that runs back or stands still."""
    steps = np.diff(time)
    for wrong, what, step in (
        (steps < 0, "runs back", "split the log there, or sort its rows if they are only out of order"),
        (steps == 0, "repeats", "leave the repeated rows out, or write the time with more digits"),
    ):
        if np.any(wrong):
            row = int(np.argmax(wrong)) + 1
            count = int(wrong.sum())
            many = f" ({count} such rows)" if count > 1 else ""
            evidence = f"time in column '{column}' {what}: {time[row - 1]:.9g} s, then {time[row]:.9g} s{many}"
            raise LogFormatError(table.path, table.line_of(row), evidence, step)
