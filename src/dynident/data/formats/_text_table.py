"""A table of numbers in a text file: read fast where it is sound, and named line by line where it is not."""

from __future__ import annotations

import codecs
import hashlib
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.data.formats._column_map import shown
from dynident.data.formats._text_header import (
    DELIMITERS,
    NUMBER,
    TextLayout,
    cells_of,
    find_header,
    headless,
    is_stamp,
    opened,
    seconds_of,
)
from dynident.data.formats.base import TOO_LARGE, Blocks, LogTable, check_size
from dynident.errors import LogFormatError
from dynident.files import unreadable

#: Larger files are not read at once, and larger ones still are no logs.
MAX_BYTES, MOST_BYTES = 2 << 30, 1 << 44
MAX_COLUMNS = 4096
CHUNK = 1 << 20

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", re.ASCII)
#: Where a comment begins, which an error value of a spreadsheet (#N/A) does not; a number with signs between thousands.
_COMMENT = re.compile(r"(?<![,;\t])#")
#: What no name in Windows-1252 has: a row of letters beyond ASCII, or a sign that is the first half of a kana.
_FOREIGN = re.compile(rb"[\x80-\xff]{4}|[\x81\x83\x88\x8b\x8d\x8f\x90\x98\x9b\x9d]")
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:(?:[,'\s]\d{3})+\.\d*|(?:[.'\s]\d{3})+,\d*|([.,'\s])\d{3}(?:\1\d{3})+)")


@dataclass(frozen=True, kw_only=True)
class TextTable(LogTable):
    """A text file whose bytes are sound and whose header is known; the rows are read by :meth:`columns`.

    Attributes:
        delimiter: What separates the cells; None for blanks.
        decimal: The decimal sign, ``"."`` or ``","``.
        before: Lines up to the rows: those before the header, and the header.
    """

    delimiter: str | None
    decimal: str
    before: int

    rereads: ClassVar = False

    def columns(self, names: Sequence[str]) -> Array:
        """Return some columns, shape (N, len(names)); every row must have as many cells as the header.

        Raises:
            LogFormatError: No rows, a row with another number of cells, or a cell that is no number.
        """
        check_size(self.path, MAX_BYTES, TOO_LARGE)
        wanted = [self.header.index(name) for name in names]
        try:
            values = self._fast()[:, wanted]
        except (ValueError, IndexError):  # some cell or row is unsound, or only a column that is not asked for
            values = self.careful(wanted, self.rows())
        if not len(values):
            raise LogFormatError(self.path, self.line, "a header and no rows", "record the log again")
        return values

    def batches(self, names: Sequence[str], rows: int) -> Blocks:
        wanted, some = [self.header.index(name) for name in names], False
        with opened(self.path) as stream:
            rest, number = islice(stream, self.before, None), self.before
            while lines := list(islice(rest, rows)):
                values = self._parsed(lines, number, wanted)
                number += len(lines)
                if len(values):
                    some = True
                    yield values
        if not some:
            raise LogFormatError(self.path, self.line, "a header and no rows", "record the log again")
        return ()

    def _parsed(self, lines: Sequence[str], before: int, wanted: Sequence[int]) -> Array:
        """Return the wanted columns of some lines, of which ``before`` stand before them in the file."""
        try:
            return self._loaded(lines if self.decimal == "." else self._with_points(lines))[:, wanted]
        except (ValueError, IndexError):
            return self.careful(wanted, self.held(enumerate(lines, before + 1)))

    def _loaded(self, source: Iterable[str] | str, before: int = 0) -> Array:
        """Return all cells of a file or of lines, of as many columns as the header has, or raise ValueError."""
        stamps = dict[int | str, Callable[[str], float]]((self.header.index(n), seconds_of) for n in self.time_stamps)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="loadtxt: input contained no data")
            how = {"delimiter": self.delimiter, "converters": stamps or None, "ndmin": 2}
            values = np.loadtxt(source, skiprows=before, encoding="latin-1", **how)
        if len(values) and values.shape[1] != len(self.header):
            raise ValueError(f"{values.shape[1]} cells, {len(self.header)} names")
        return values if len(values) else np.empty((0, len(self.header)))

    def fault(self, row: int, evidence: str, step: str) -> LogFormatError:
        """Return the error to raise for a row, with its line; see :meth:`LogTable.fault`."""
        return LogFormatError(self.path, self.line_of(row), evidence, step)

    def line_of(self, row: int) -> int:
        """Return the line of the file, counted from 1, of a row counted from 0."""
        return next(islice(self.rows(), row, None))[0]

    def _fast(self) -> Array:
        """Return all cells, or raise ValueError for the first that is not a number or a ragged row."""
        if self.decimal == ".":
            return self._loaded(str(Path(self.path)), self.before)
        with opened(self.path) as stream:
            return self._loaded(self._with_points(islice(stream, self.before, None)))

    def _with_points(self, lines: Iterable[str]) -> Iterator[str]:
        for line in lines:
            if "." in line:  # 1.234,5 or a file of two minds: the careful reader says which
                raise ValueError(line)
            yield line.replace(",", ".")

    def rows(self) -> Iterator[tuple[int, str]]:
        """Yield number and text of the lines that hold a row: not blank, not only a comment."""
        with opened(self.path) as stream:
            yield from self.held(islice(enumerate(stream, 1), self.before, None))

    def held(self, lines: Iterable[tuple[int, str]]) -> Iterator[tuple[int, str]]:
        """Yield the lines that hold a row."""
        for number, line in lines:
            if (text := _COMMENT.split(line, maxsplit=1)[0].rstrip("\r\n")).strip():
                yield number, text

    def careful(self, wanted: Sequence[int], lines: Iterable[tuple[int, str]]) -> Array:
        """Return the wanted columns, or raise the error that names the first unsound cell."""
        rows = []
        for number, text in lines:
            cells = cells_of(text, self.delimiter)
            if len(cells) != len(self.header):
                raise LogFormatError(self.path, number, *self._ragged(len(cells)))
            rows.append([self._number(cells[k], self.header[k], number) for k in wanted])
        return np.array(rows, dtype=np.float64).reshape(len(rows), len(wanted))

    def _ragged(self, count: int) -> tuple[str, str]:
        word, wanted = DELIMITERS[self.delimiter], len(self.header)
        evidence = f"{count} {word}-separated cells, the header in line {self.line} has {wanted}"
        if self.delimiter == "," and count == 2 * wanted:
            return evidence, "decimal commas need another separator; write decimal points or separate by semicolons"
        return evidence, "correct the line, or write the header with the separator of the rows"

    def _number(self, text: str, name: str, line: int) -> float:
        cell = text.strip()
        plain = cell if self.decimal == "." else cell.replace(",", ".")
        if name in self.time_stamps:
            with suppress(ValueError):
                return seconds_of(cell)
        elif NUMBER.fullmatch(plain) and not (self.decimal == "," and "." in cell):
            return float(plain)
        if not cell:
            return float("nan")
        kind = "a time stamp as in the first row" if name in self.time_stamps else "a number"
        evidence = f"column '{shown(name)}' holds '{shown(cell)}', which is not {kind}"
        if self.decimal == "." and _DECIMAL_COMMA.fullmatch(cell):
            raise LogFormatError(self.path, line, evidence, 'if the commas are decimal signs, declare decimal: ","')
        raise LogFormatError(self.path, line, evidence, self._step(cell, line))

    def _step(self, cell: str, line: int) -> str:
        """Return what to do about a cell that is no number."""
        if re.match(r"\d+[-./:]\d+[-./:]\d", cell):
            return "write the time in seconds, or as in 2024-03-01T10:00:00.125 or 10:00:00.125 in every row"
        if cell.startswith("#"):
            return "leave the cell empty where a value is missing"
        if self.line is not None and line == self.line + 1 and not any(sign.isdigit() for sign in cell):
            return "if the row holds units, remove it and put them into the names, such as q1 [rad]"
        if _THOUSANDS.fullmatch(cell):
            return "write numbers without signs between the thousands (in Excel: format General)"
        return 'with decimal: "," points are refused' if "." in cell and self.decimal == "," else "correct the cell"


def open_table(path: str | Path, decimal: str = ".", names: Sequence[str] = ()) -> TextTable:
    """Return the table in a text file once its bytes and its header are found sound.

    Args:
        path: The file.
        decimal: The decimal sign.
        names: Names of the columns where the file has no header.

    Raises:
        FileError: The file cannot be read at all.
        LogFormatError: It is too large, binary or empty, or its first row is no header of unique names.
    """
    digest, encoding = check_text(path, MOST_BYTES)
    try:
        layout = headless(path, decimal, names) if names else find_header(path, decimal)
    except OSError as error:
        raise unreadable(path, error) from error
    _check_header(path, layout)
    table = TextTable(
        path=str(path),
        sha256=digest,
        header=layout.header,
        how=f"{DELIMITERS[layout.delimiter]}-separated text, decimal '{decimal}'{encoding}{layout.note}",
        line=layout.line,
        delimiter=layout.delimiter,
        decimal=decimal,
        before=layout.before,
    )
    stamps = stamped(layout.header, cells_of(next(table.rows(), (0, ""))[1], layout.delimiter))
    how = f"{table.how}, {', '.join(stamps)} in seconds from time stamps" if stamps else table.how
    return replace(table, time_stamps=stamps, how=how)


def stamped(header: Sequence[str], cells: Sequence[str]) -> tuple[str, ...]:
    """Return the columns that hold time stamps, by the cells of the first row."""
    return tuple(name for name, cell in zip(header, cells, strict=False) if is_stamp(cell))


def check_text(path: str | Path, most: int = MAX_BYTES) -> tuple[str, str]:
    """Return the hash of an ordinary file of text of at most ``most`` bytes, and a remark where it is not UTF-8.

    Raises:
        FileError: It cannot be read at all.
        LogFormatError: It is too large or binary.
    """
    check_size(path, most, "split it into several logs")
    try:
        return _check_bytes(path)
    except OSError as error:
        raise unreadable(path, error) from error


def _check_bytes(path: str | Path) -> tuple[str, str]:
    digest, decoder, line, note = hashlib.sha256(), codecs.getincrementaldecoder("utf-8")(), 1, ""
    with open(path, "rb") as stream:
        if stream.peek(2)[:2] in (b"\xff\xfe", b"\xfe\xff"):
            raise LogFormatError(path, 1, "UTF-16 text, not UTF-8", "save it as CSV UTF-8")
        while chunk := stream.read(CHUNK):
            digest.update(chunk)
            if (at := chunk.find(b"\0")) >= 0:
                where = line + chunk.count(b"\n", 0, at)
                raise LogFormatError(path, where, "a binary file, not text", "give a text file, or name its format")
            try:
                decoder.decode(b"" if note else chunk)
            except UnicodeDecodeError as error:
                note, where = ", read as Windows-1252", line + chunk.count(b"\n", 0, error.start)
                if _FOREIGN.search(chunk, max(error.start - 3, 0)):
                    raise LogFormatError(path, where, "GBK or Shift-JIS, not UTF-8", "save it as CSV UTF-8") from None
            line += chunk.count(b"\n")
    return digest.hexdigest(), note


def _check_header(path: str | Path, layout: TextLayout) -> None:
    header, line = layout.header, layout.line
    if len(header) > MAX_COLUMNS:
        raise LogFormatError(path, line, f"{len(header)} columns", f"at most {MAX_COLUMNS} are read")
    if all(is_stamp(name) or NUMBER.fullmatch(name.replace(",", ".")) for name in header if name):
        step = "add a header row such as t,q1,q2,tau1,tau2, or name the columns (log: format: {csv: {names: [...]}})"
        if layout.comment:
            step = f"if the comment '{shown(layout.comment)}' is the header, remove its '#'"
        raise LogFormatError(path, line, "numbers where the names of the columns should stand", step)
    for name in header:
        if name and header.count(name) > 1:
            evidence = f"{header.count(name)} columns are called '{shown(name)}'"
            raise LogFormatError(path, line, evidence, "give each column a name of its own")
