"""Logs of Beckhoff TwinCAT Scope, exported as text: a time column for each channel."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.data.formats._alignment import TIME, Series, aligned, chosen
from dynident.data.formats._column_map import shown
from dynident.data.formats._text_header import DELIMITERS, NUMBER, cells_of, opened
from dynident.data.formats._text_table import check_text
from dynident.data.formats.base import LogFormat, LogTable
from dynident.errors import BadOption, LogFormatError

#: Lines in which the header must end.
_HEADER_LINES = 200

_STEP = "export the recording from TwinCAT Scope as CSV, with its header"


@dataclass(frozen=True, kw_only=True)
class ScopeTable(LogTable):
    """Channels of an export, each with its own time in ms.

    Attributes:
        places: Column of the time of each channel; that of its values is the next.
        delimiter: What separates the cells.
        decimal: The decimal sign.
        before: Lines before the rows.
    """

    places: Mapping[str, int]
    delimiter: str
    decimal: str
    before: int

    def columns(self, names: Sequence[str]) -> Array:
        return self.read(names)[0]

    def read(self, names: Sequence[str]) -> tuple[Array, tuple[str, ...]]:
        """Return some columns and what was done to get them; see :meth:`LogTable.read`.

        The rows are those of the channels that share one time most often; others are interpolated linearly.
        """
        wanted = [name for name in names if name != TIME]
        cells = self._cells([self.places[name] for name in wanted])
        groups: list[tuple[list[str], Array, list[Array]]] = []
        for k, name in enumerate(wanted):
            there = np.isfinite(cells[:, 2 * k])
            time, values = cells[there, 2 * k], cells[there, 2 * k + 1]
            for group in groups:
                if np.array_equal(group[1], time):
                    group[0].append(name)
                    group[2].append(values)
                    break
            else:
                groups.append(([name], time, [values]))
        # Times are given in ms with few digits: nanoseconds keep all of them.
        found = [Series(tuple(g[0]), np.rint(g[1] * 1e6).astype(np.int64), np.stack(g[2], axis=1)) for g in groups]
        base, others = chosen(found, names)
        stamps, blocks, notes = aligned(base, others)
        places = {name: block[:, k] for columns, block in blocks for k, name in enumerate(columns)}
        places[TIME] = stamps / 1e9
        return np.stack([places[name] for name in names], axis=1), tuple(notes)

    def _cells(self, places: Sequence[int]) -> Array:
        """Return times and values in pairs, shape (N, 2 k); NaN where a channel has ended."""
        found = []
        for number, text in self._rows():
            cells = cells_of(text, self.delimiter)
            pairs = [cell for place in places for cell in (*cells[place : place + 2], "", "")[:2]]
            found.append([self._number(cell, number) for cell in pairs])
        return np.array(found, dtype=np.float64).reshape(len(found), 2 * len(places))

    def _rows(self) -> Iterator[tuple[int, str]]:
        with opened(self.path) as stream:
            for number, line in enumerate(stream, 1):
                text = line.rstrip("\r\n")
                if number > self.before and text.strip() and text.strip() != "EOF":
                    yield number, text

    def _number(self, text: str, line: int) -> float:
        cell = text.strip()
        if not cell or cell == "EOF":
            return np.nan
        plain = cell if self.decimal == "." else cell.replace(",", ".")
        if NUMBER.fullmatch(plain) and not (self.decimal == "," and "." in cell):
            return float(plain)
        step = 'if the commas are decimal signs, declare decimal: ","' if "," in cell else "correct the cell"
        raise LogFormatError(self.path, line, f"'{shown(cell)}' is not a number", step)


@dataclass(frozen=True)
class TwincatScope(LogFormat):
    """Text export of TwinCAT Scope View: columns ``t`` and the names of the channels; name this format in the case.

    Channels of other sample times than the first are interpolated linearly. Scale factors of the header are in the
    values already.

    Attributes:
        decimal: The decimal sign of the numbers, ``.`` or ``,``, which follows the language of the computer.
    """

    decimal: str = "."

    suffixes: ClassVar = ()

    def __post_init__(self) -> None:
        if self.decimal not in (".", ","):
            raise BadOption("decimal", self.decimal, "choose '.' or ','")

    def open(self, path: str | Path) -> ScopeTable:
        digest, encoding = check_text(path)
        number, cells, delimiter, before = _header(path)
        channels = [name.strip() for name in cells[1::2]]
        twice = [name for name in channels if channels.count(name) > 1]
        if twice or TIME in channels:
            evidence = f"the channel '{shown((twice or [TIME])[0])}'"
            evidence += f" stands there {len(twice)} times" if twice else " has the name of the time"
            raise LogFormatError(path, number, evidence, "give each channel a name of its own")
        return ScopeTable(
            path=str(path),
            sha256=digest,
            header=(TIME, *channels),
            how=f"TwinCAT Scope export, decimal '{self.decimal}'{encoding}",
            line=number,
            places={name: 2 * k for k, name in enumerate(channels)},
            delimiter=delimiter,
            decimal=self.decimal,
            before=before,
        )


def _header(path: str | Path) -> tuple[int, list[str], str, int]:
    """Return line, cells and separator of the names of the channels, and the line of the blank one after them.

    The names are the second line ``Name;a;Name;b``.
    """
    names, seen = None, 0
    with opened(path) as stream:
        for number, line in enumerate(stream, 1):
            text = line.rstrip("\r\n")
            if names is not None and not text.strip(" \t;,"):
                return *names, number
            if names is None and text.startswith("Name"):
                seen += 1
                delimiter = next((sign for sign in DELIMITERS if sign is not None and f"Name{sign}" in text), None)
                if seen == 2 and delimiter is not None:
                    cells = cells_of(text, delimiter)
                    if set(map(str.strip, cells[::2])) <= {"Name", ""} and len(cells) > 1:
                        names = number, cells[: 2 * (len(cells) // 2)], delimiter
            if names is None and number > _HEADER_LINES:
                break
    why = "no header of a TwinCAT Scope export" if names is None else "a header and no rows"
    raise LogFormatError(path, None if names is None else names[0], why, _STEP)
