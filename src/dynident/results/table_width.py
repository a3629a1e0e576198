"""Tables and lines in a terminal of limited width: names stay whole, details go first, the rest stands below."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from dynident.results.text import Table, display_width, heading_text

#: Blanks between two columns.
GAP = 2

#: Stands behind each wide character while lines are wrapped, so that it counts twice.
_HALF = "\0"


def wrap_text(text: str, width: int, break_long_words: bool = True) -> list[str]:
    """Return a text as lines of at most ``width`` columns of a terminal, those behind the first set in by two.

    Args:
        text: The text; wide characters take two columns.
        width: Columns of a line.
        break_long_words: Whether a word that is wider than a line is broken; else it stands whole.
    """
    counted = "".join(letter + _HALF * (display_width(letter) - 1) for letter in text)
    width -= _HALF in counted  # a word may be broken within a letter, which then stands in the next line
    lines = textwrap.wrap(
        counted, width, subsequent_indent="  ", break_long_words=break_long_words, break_on_hyphens=False
    )
    return [line.replace(_HALF, "") for line in lines]


@dataclass(frozen=True)
class FittedTable:
    """A table as it fits a width.

    Attributes:
        parts: Tables to print below each other, each with the column of names.
        widths: Width of each column of each part, in columns of the terminal.
        left_out: Headings of the details that have no place.
    """

    parts: tuple[Table, ...]
    widths: tuple[tuple[int, ...], ...]
    left_out: tuple[str, ...]


def fit_width(table: Table, width: int) -> FittedTable:
    """Return a table as it fits a terminal.

    Cells wrap at blanks only, so that no name and no number is cut. Where that does not suffice, columns that are
    details are left out from the right, then the rest is divided into parts, each with the column of names.

    Args:
        table: The table.
        width: Columns of the terminal. A single column that is wider stays as it is.
    """
    kept = list(range(len(table.columns)))
    least, most = _least_widths(table), _natural_widths(table)
    left_out: list[int] = []
    for k in [k for k in reversed(kept) if table.columns[k].detail]:
        if _total(least, kept) <= width:
            break
        kept.remove(k)
        left_out.insert(0, k)
    groups = _groups(kept, least, width, _names_column(table))
    parts = tuple(_columns_of(table, group) for group in groups)
    widths = tuple(_shared([least[k] for k in group], [most[k] for k in group], width) for group in groups)
    return FittedTable(parts, widths, tuple(table.columns[k].heading for k in left_out))


def _natural_widths(table: Table) -> list[int]:
    lines = [tuple(map(heading_text, table.columns)), *table.lined_up()]
    return [max(display_width(line[k]) for line in lines) for k in range(len(table.columns))]


def _least_widths(table: Table) -> list[int]:
    """Return the width of the longest word of each column; numbers stay in one line, with their blanks."""
    widths = []
    rows = table.lined_up()
    for k, column in enumerate(table.columns):
        words = heading_text(column).split()
        for row in rows:
            words += [row[k]] if column.numeric else row[k].split()
        widths.append(max(map(display_width, words), default=0))
    return widths


def _names_column(table: Table) -> int:
    return next((k for k, column in enumerate(table.columns) if not column.numeric), 0)


def _total(widths: Sequence[int], kept: Sequence[int]) -> int:
    return sum(widths[k] for k in kept) + GAP * (len(kept) - 1)


def _groups(kept: Sequence[int], least: Sequence[int], width: int, names: int) -> list[list[int]]:
    """Return the columns of each part, filled from the left; the column of names begins each further one."""
    groups: list[list[int]] = [[]]
    for k in kept:
        if groups[-1] not in ([], [names]) and _total(least, [*groups[-1], k]) > width:
            groups.append([names])
        if k not in groups[-1]:
            groups[-1].append(k)
    return groups


def _columns_of(table: Table, kept: Sequence[int]) -> Table:
    rows = tuple(tuple(row[k] for k in kept) for row in table.rows)
    return Table(tuple(table.columns[k] for k in kept), rows, table.note)


def _shared(least: Sequence[int], most: Sequence[int], width: int) -> tuple[int, ...]:
    """Return widths between the least and the natural ones: what is left goes to the narrowest of those that wrap."""
    widths = list(least)
    free = width - sum(widths) - GAP * (len(widths) - 1)
    while free > 0 and any(now < full for now, full in zip(widths, most, strict=True)):
        k = min((k for k in range(len(widths)) if widths[k] < most[k]), key=lambda k: widths[k])
        widths[k] += 1
        free -= 1
    return tuple(widths)
