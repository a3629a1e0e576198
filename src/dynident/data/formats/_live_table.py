"""Text of a log that is still being written: a header, then rows one at a time, as from a pipe."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from dynident.arrays import Array
from dynident.data.formats._table import Blocks, Checked, LogTable, names_of
from dynident.data.formats._text_header import cells_of, delimiter_of
from dynident.data.formats.base import ColumnMap, shown
from dynident.data.log import Log
from dynident.errors import LogFormatError

#: What messages call the text.
NAME = "standard input"


def live_rows(lines: Iterable[str], columns: ColumnMap) -> Iterator[Log]:
    """Yield each row of a text as a log of one sample in SI units, as soon as it has come.

    The text is that of a CSV file: a header, one row a sample, comments after # and blank lines passed over.

    Args:
        lines: The lines, such as ``sys.stdin``.
        columns: Which columns are which signals, and their units.

    Raises:
        LogFormatError: No header, a column that is missing, a cell that is no finite number, time that stands still.
    """
    told = (line for line in lines if line.strip() and not line.lstrip().startswith("#"))
    header, first = next(told, None), next(told, None)
    if header is None or first is None:
        raise LogFormatError(NAME, None, "it ended before its first row", "send a header and then a row a sample")
    header = header.removeprefix("\ufeff").strip()
    sign = delimiter_of([header, first.strip()], columns.decimal, None)
    names = tuple(name.strip() for name in cells_of(header, sign))
    table = _LiveTable(
        path=NAME, sha256="", header=names, how="text", line=1, first=first, rest=told, sign=sign, mark=columns.decimal
    )
    chosen = columns.resolved(names, NAME, 1)
    checked = Checked(table, chosen)
    for values in table.batches(names_of(chosen), 1):
        yield checked.block(values)


@dataclass(frozen=True, kw_only=True)
class _LiveTable(LogTable):
    """Lines as they come, each read once."""

    first: str
    rest: Iterator[str]
    sign: str | None
    mark: str

    def columns(self, names: Sequence[str]) -> Array:
        return np.concatenate(list(self.batches(names, 1)))

    def batches(self, names: Sequence[str], rows: int) -> Blocks:
        places = [self.header.index(name) for name in names]
        for number, line in enumerate(chain((self.first,), self.rest)):
            yield self._row(line, number, places)
        return ()

    def _row(self, line: str, number: int, places: Sequence[int]) -> Array:
        cells = cells_of(line.strip(), self.sign)
        if len(cells) != len(self.header):
            evidence = f"{len(cells)} cells where the header has {len(self.header)}"
            raise self.fault(number, evidence, "send whole rows")
        values = []
        for place in places:
            text = cells[place] if self.mark == "." else cells[place].replace(",", ".")
            try:
                values.append(float(text))
            except ValueError:
                evidence = f"column '{shown(self.header[place])}' holds '{shown(cells[place])}', which is no number"
                raise self.fault(number, evidence, "send numbers, with the decimal sign of the case file") from None
        return np.array([values])
