"""Text of a log that is still being written: a header, then rows one at a time, as from a pipe."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

from dynident.data.formats._clocked_table import with_made
from dynident.data.formats._column_map import ColumnMap
from dynident.data.formats._text_header import cells_of, delimiter_of
from dynident.data.formats._text_table import TextTable, stamped
from dynident.data.formats.base import Blocks, Checked, LogTable, names_of
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
    told = ((k, line) for k, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#"))
    header, first = next(told, None), next(told, None)
    if header is None or first is None:
        raise LogFormatError(NAME, None, "it ended before its first row", "send a header and then a row a sample")
    texts = [header[1].removeprefix("\ufeff").strip(), first[1].strip()]
    sign = delimiter_of(texts, columns.decimal, None)
    names, cells = ([cell.strip() for cell in cells_of(text, sign)] for text in texts)
    table = with_made(_LiveTable(
        path=NAME, sha256="", header=tuple(names), how="text", line=header[0], time_stamps=stamped(names, cells),
        delimiter=sign, decimal=columns.decimal, before=header[0], rest=chain((first,), told),
    ), columns)  # fmt: skip
    chosen = columns.resolved(table.header, NAME, table.line)
    checked = Checked(table, chosen)
    for values in table.batches(names_of(chosen), 1):
        yield checked.block(values)


@dataclass(frozen=True, kw_only=True)
class _LiveTable(TextTable):
    """Lines as they come with their numbers, each read once."""

    rest: Iterator[tuple[int, str]]
    fault = LogTable.fault  # what has come cannot be read again

    def batches(self, names: Sequence[str], rows: int) -> Blocks:
        places = [self.header.index(name) for name in names]
        for row in self.rest:
            yield self.careful(places, self.held(((row[0], row[1].strip()),)))
        return ()
