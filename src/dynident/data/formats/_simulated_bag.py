"""A recording of ROS by the virtual cell, whose columns a case that names none reads under their numbered names.

In recordings of robots the effort is what a driver puts there, so that a case has to say what it is. The virtual cell
states in the header of its messages that it is what the case calls tau1, tau2, ...
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dynident.arrays import Array
from dynident.data.formats._bag_table import BagTable
from dynident.data.formats._column_map import NUMBERED, ColumnMap
from dynident.data.formats.base import Blocks, LogTable, TableOfTable

#: Frame in the headers of states of joints that the virtual cell has written.
FRAME = "dynident simulate"

#: Signals of a state of joints, by the words that its columns end in.
_WORDS = {"q": "position", "dq": "velocity", "torque": "effort"}


@dataclass(frozen=True, kw_only=True)
class RenamedTable(TableOfTable):
    """A table with other names for some columns.

    Attributes:
        own: Names in the file, by those in the header.
    """

    own: Mapping[str, str]

    def read(self, names: Sequence[str]) -> tuple[Array, tuple[str, ...]]:
        return self.inner.read(self._inside(names))

    def batches(self, names: Sequence[str], rows: int) -> Blocks:
        return self.inner.batches(self._inside(names), rows)

    def _inside(self, names: Sequence[str]) -> list[str]:
        return [self.own.get(name, name) for name in names]


def numbered(table: LogTable, columns: ColumnMap) -> LogTable:
    """Return a table with numbered names, where the virtual cell wrote it and the map of columns names no positions."""
    if not isinstance(table, BagTable) or columns.q is not None or table.source.frame(table.topics[0]) != FRAME:
        return table
    words = {
        f"{joint}.{word}": f"{NUMBERED[signal]}{k}"
        for signal, word in _WORDS.items()
        for k, joint in enumerate(columns.joints, start=1)
    }
    header = tuple(words.get(name, name) for name in table.header)
    own = dict(zip(header, table.header, strict=True))
    how = f"{table.how}, joints by name"
    return RenamedTable(path=table.path, sha256=table.sha256, header=header, how=how, inner=table, own=own)
