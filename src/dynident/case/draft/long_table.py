"""Long tables: a row for each signal or joint at each time, where a log has one row for each time."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

from dynident.case.draft.column_words import tokens_of
from dynident.case.draft.readings import opened
from dynident.case.draft.time_columns import time_columns
from dynident.data.formats import LogTable
from dynident.data.formats._text_header import cells_of
from dynident.data.formats._text_table import TextTable
from dynident.data.formats.base import MIN_SAMPLES
from dynident.errors import LogFormatError

#: Rows that are looked at, and the signals or joints that they may be of at most.
_ROWS, _MOST = 4000, 256

#: Columns of such a table at most, and rows of one time on average at least.
_WIDEST, _AGAIN = 12, 1.5

#: Words for a column that says what a row is of, where its cells are numbers.
_OF = frozenset(
    "joint joints j axis axes achse gelenk signal channel kanal name id variable var motor drive topic".split()
)


def refuse_long(path: str) -> None:
    """Refuse a text whose rows are of one signal or one joint each, several of one time.

    Raises:
        FileError: The file cannot be read.
        LogFormatError: It is one; the message says how it is reshaped.
    """
    try:
        table = opened(path)
    except LogFormatError:
        return  # said by what reads it next
    header = table.header
    if not isinstance(table, TextTable) or not 3 <= len(header) <= _WIDEST:
        return
    rows = [cells_of(text, table.delimiter) for _, text in islice(table.rows(), _ROWS)]
    times = time_columns(header)
    if len(rows) < MIN_SAMPLES or not times or any(len(row) != len(header) for row in rows):
        return
    columns = {name: [row[k].strip() for row in rows] for k, name in enumerate(header)}
    time = columns[times[0]]
    if len(rows) < _AGAIN * len(set(time)):
        return
    for name in header:
        cells = columns[name]
        if name == times[0] or not 2 <= len(set(cells)) <= _MOST or len(set(zip(time, cells, strict=True))) < len(rows):
            continue
        if _OF.intersection(tokens_of(name)) or not any(map(_is_number, cells)):
            values = [other for other in header if other not in (times[0], name)]
            raise LogFormatError(
                table.path,
                table.line,
                f"a long table: a row for each {name} at each time",
                _step(table, (times[0], name), values),
            )


def _step(table: LogTable, keys: tuple[str, str], values: list[str]) -> str:
    """Return how a long table is reshaped: its time and what its rows are of are ``keys``."""
    time, of = keys
    asked = repr(values[0]) if len(values) == 1 else repr(values)
    read = f"w = pandas.read_csv({Path(table.path).name!r}).pivot_table(index={time!r}, columns={of!r}, values={asked})"
    flat = "w.columns = [f'{value}_{of}' for value, of in w.columns]; " if len(values) > 1 else ""
    return f"reshape it to one row for each time: import pandas; {read}; {flat}w.interpolate().to_csv('wide.csv')"


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True
