"""The header of a text table: where it stands, what separates its cells, and what stands before it."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TextIO

from dynident.errors import LogFormatError

#: Bytes that are not UTF-8 are those of Windows-1252, in which much software on Windows writes units such as °.
_WINDOWS = "windows"

#: Delimiters in the order in which a header is searched for them; None splits at blanks and tabs.
DELIMITERS: dict[str | None, str] = {"\t": "tab", ";": "semicolon", ",": "comma", None: "space"}

#: A cell that is a number, with a decimal point.
NUMBER = re.compile(r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|nan|inf|infinity)", re.ASCII | re.IGNORECASE)

#: A time that reads one way only: by ISO 8601, with the day before points, or a time of day; and a date alone.
_STAMP = re.compile(r"(?:\d{4}-\d\d-\d\d[T ]|\d\d\.\d\d\.\d{4} )?\d?\d:\d\d:\d\d(?!\d|:)", re.ASCII)
DATE = re.compile(r"\d{4}[-/.]\d\d?[-/.]\d\d?|\d\d?[-/.]\d\d?[-/.]\d{4}", re.ASCII)

#: Units; a cell of a row of units, blanks and points taken out; a name that ends in one.
_WORDS = r"(?:s|sec|[mµu]s|ns|(?:rad|deg|grad|°|m?m)(?:/s(?:\^?2|²|/s)?|s(?:\^?-[12]))?|m?n ?m|n|m?[av]|%|‰|°?c)"
_UNIT = re.compile(rf"[\[(]?(?:{_WORDS}|-|)[\])]?", re.IGNORECASE)
_NAMED = re.compile(rf".*[\[(]{_WORDS}[\])]", re.IGNORECASE)

_MAX_LINE = 1 << 20

#: Lines that are searched for a header that other lines stand before.
_SEARCHED = 64

#: What spreadsheets write in the first line to name the separator.
_SEPARATOR = re.compile(r"sep=(.)", re.IGNORECASE)


def _as_windows(bad: UnicodeError) -> tuple[str, int]:
    assert isinstance(bad, UnicodeDecodeError)
    return bad.object[bad.start : bad.end].decode("cp1252", "replace"), bad.end


codecs.register_error(_WINDOWS, _as_windows)


@dataclass(frozen=True)
class TextLayout:
    """Where the header of a text table is and how it reads.

    Attributes:
        line: Line of the header, counted from 1.
        header: Names of the columns.
        delimiter: What separates the cells; None for blanks.
        before: Lines up to the rows.
        comment: The comment before the header.
        note: What is unusual about it, for the provenance; begins with a comma.
    """

    line: int
    header: tuple[str, ...]
    delimiter: str | None
    before: int
    comment: str = ""
    note: str = ""


@dataclass(frozen=True)
class _Line:
    number: int
    text: str


def find_header(path: str | Path, decimal: str) -> TextLayout:
    """Return where the header of a text file stands.

    It is the first line that is no comment; or, where most of the next lines have another number of cells, the first
    line without numbers that two rows with as many cells follow; or a comment right before the first row of numbers,
    with as many names as the row has cells. ``sep=;`` in the first line names the separator.

    Raises:
        LogFormatError: The file is empty, holds only comments, or a line is too long for a table.
    """
    lines, comment, stated = _first_lines(path)
    layout = _layout(lines, comment, decimal, stated)
    after = [line for line in lines if line.number > layout.before]
    units = _units(*(_names(line.text, layout.delimiter) for line in after[:2])) if len(after) > 1 else ()
    if not units or len(units) != len(layout.header):
        return layout
    pairs = zip(layout.header, units, strict=True)
    header = tuple(name if not unit or _NAMED.fullmatch(name) else f"{name} [{unit}]" for name, unit in pairs)
    note = f"{layout.note}, the units in line {after[0].number} put into the names"
    return replace(layout, header=header, before=after[0].number, note=note)


def _units(cells: Sequence[str], below: Sequence[str]) -> tuple[str, ...]:
    """Return the units in a row of units, without brackets, where two are no words above time stamps; else nothing."""
    cells = ["-" if is_stamp(row) and not is_stamp(cell) else cell for cell, row in zip(cells, below, strict=False)]
    is_units = all(_UNIT.fullmatch(re.sub(r"[\s.·*]", "", cell)) for cell in cells)
    found = tuple(cell.strip("[]()- ") for cell in cells)
    return found if is_units and sum(map(bool, found)) > 1 else ()


def _layout(lines: Sequence[_Line], comment: _Line | None, decimal: str, stated: str | None) -> TextLayout:
    """Return where the header stands among the first lines."""
    first = lines[0]
    delimiter = delimiter_of([line.text for line in lines], decimal, stated)
    names = _names(first.text, delimiter)
    if comment is not None and all(_is_number(name, decimal) for name in names):
        inside = _names(comment.text.lstrip("#%"), delimiter_of([comment.text.lstrip("#%")], decimal, stated))
        if len(inside) == len(names) and not any(_is_number(name, decimal) for name in inside):
            note = ", its header in a comment"
            return TextLayout(comment.number, inside, delimiter, first.number - 1, comment.text, note)
    shown = comment.text if comment is not None else ""
    others = sum(len(cells_of(line.text, delimiter)) != len(names) for line in lines)
    words = not any(_is_number(_names(line.text, delimiter)[0], decimal) for line in lines[1:3])
    if len(names) == 1 or 2 * others > len(lines) or words:
        for k in range(1, len(lines) - 2):
            if found := _header_at(lines[k : k + 3], decimal, stated):
                note = f", {k} lines before the header passed over"
                return TextLayout(lines[k].number, *found, lines[k].number, shown, note)
    return TextLayout(first.number, names, delimiter, first.number, shown)


def headless(path: str | Path, decimal: str, names: Sequence[str]) -> TextLayout:
    """Return the layout of a text file that begins with its first row of numbers.

    Raises:
        LogFormatError: The file is empty, its first row has not as many cells as there are names, or is a header.
    """
    lines, _, stated = _first_lines(path)
    first, delimiter = lines[0], delimiter_of([line.text for line in lines], decimal, stated)
    cells = _names(first.text, delimiter)
    if len(names) == 1 and "{}" in names[0]:
        names = [names[0].replace("{}", str(k + 1)) for k in range(len(cells))]
    if len(cells) != len(names):
        step = "give one name for each column (log: format: {csv: {names: [...]}})"
        raise LogFormatError(path, first.number, f"{len(cells)} cells and {len(names)} names", step)
    for cell, row in zip(cells, _names(lines[-1].text, delimiter), strict=False):
        if not _is_number(cell, decimal) and _is_number(row, decimal):
            step = "the file has a header: leave the names out, or map its columns with columns:"
            raise LogFormatError(path, first.number, f"'{cell}' in the first row is no number", step)
    return TextLayout(first.number, tuple(names), delimiter, first.number - 1, note=", its columns named by the case")


def opened(path: str | Path) -> TextIO:
    """Return the text of a file; bytes that are not UTF-8 are read as Windows-1252."""
    return open(path, encoding="utf-8-sig", errors=_WINDOWS)


def cells_of(text: str, delimiter: str | None) -> list[str]:
    """Return the cells of one line, quotes taken off."""
    if '"' not in text:
        return text.split(delimiter)
    plain = text if delimiter is not None else " ".join(text.split())
    try:
        return next(csv.reader([plain], delimiter=delimiter or " "))
    except csv.Error:  # a cell of more than 131072 characters
        return text.split(delimiter)


def _header_at(lines: Sequence[_Line], decimal: str, stated: str | None) -> tuple[tuple[str, ...], str | None] | None:
    """Return names and delimiter where the first of three lines is the header of the two others."""
    texts = [line.text for line in lines]
    delimiter = delimiter_of(texts, decimal, stated)
    names, *rows = (_names(text, delimiter) for text in texts)
    if len(names) < 2 or any(len(row) != len(names) for row in rows):
        return None
    if any(_is_number(name, decimal) for name in names) or not all(_is_number(row[0], decimal) for row in rows[1:]):
        return None
    return (names, delimiter) if _is_number(rows[0][0], decimal) or _units(*rows[:2]) else None


def delimiter_of(texts: Sequence[str], decimal: str, stated: str | None) -> str | None:
    """Return the separator that gives most cells of those under which the next row has as many; else the first."""
    if stated is not None:
        return stated
    header, *others = texts
    there = [sign for sign in DELIMITERS if sign is None or (sign in header and sign != decimal)]
    counts = {sign: len(cells_of(header, sign)) for sign in there}
    fitting = [sign for sign in there if others and 1 < counts[sign] == len(cells_of(others[0], sign))]
    return max(fitting, key=counts.__getitem__) if fitting else there[0]


def _names(text: str, delimiter: str | None) -> tuple[str, ...]:
    return tuple(name.strip() for name in cells_of(text, delimiter))


def _is_number(cell: str, decimal: str) -> bool:
    return bool(is_stamp(cell) or DATE.fullmatch(cell) or NUMBER.fullmatch(cell.replace(decimal, ".")))


def is_stamp(cell: str) -> bool:
    """Return whether a cell holds a time that reads one way only: with a date, or a time of day."""
    return _STAMP.match(cell.strip()) is not None


def seconds_of(cell: str) -> float:
    """Return the seconds of a time stamp: since 1970, by UTC where it names no zone; or of the day.

    Raises:
        ValueError: It is none.
    """
    if not is_stamp(cell):
        raise ValueError(cell)
    text = re.sub(r"^(\d\d)\.(\d\d)\.(\d{4})", r"\3-\2-\1", cell.strip()).replace(",", ".")
    found = datetime.fromisoformat(text if text[4] == "-" else "1970-01-01T" + "0" * (text[1] == ":") + text)
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()


def _first_lines(path: str | Path) -> tuple[list[_Line], _Line | None, str | None]:
    """Return the first lines that are no comments, the comment before the first, and the separator that is stated."""
    found: list[_Line] = []
    comment: _Line | None = None
    stated: str | None = None
    with opened(path) as stream:
        number = 0
        while len(found) < _SEARCHED and (line := stream.readline(_MAX_LINE)):
            number += 1
            if len(line) >= _MAX_LINE:
                if found:
                    break
                raise LogFormatError(path, number, f"a line of more than {_MAX_LINE} characters", "is it a table?")
            text = line.strip()
            if number == 1 and (named := _SEPARATOR.fullmatch(line.rstrip("\r\n"))) and named[1] in DELIMITERS:
                stated = named[1]
            elif text.startswith("#"):
                comment = comment if found else _Line(number, text)
            elif text:
                found.append(_Line(number, line.partition("#")[0].rstrip("\r\n") if found else line.rstrip("\r\n")))
    if found:
        return found, comment, stated
    if comment is not None:
        raise LogFormatError(path, None, "only comments", "give a header row and rows of numbers")
    raise LogFormatError(path, None, "the file is empty", "record the log again")
