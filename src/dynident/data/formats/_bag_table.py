"""A recording as a table: messages that carry some of the columns each become rows that carry all of them.

Where each message carries all columns, messages are rows in constant memory.
Stamps may run back by less than a second for messages that only arrived out of order, so the messages of the last
second are held back until later ones have come.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import ClassVar

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.formats._alignment import TIME, Series, aligned, chosen, unused
from dynident.data.formats._bag_messages import DYNAMIC, JOINTS, Layout, columns_of
from dynident.data.formats._bag_source import BagSource
from dynident.data.formats._column_map import shown
from dynident.data.formats.base import MAX_CELLS, TOO_LARGE, Blocks, LogTable
from dynident.errors import LogFormatError, NoNumbers

#: Messages of each topic that are looked at for the names of the columns.
_LOOKED_AT = 500

#: Share of the messages whose numbers may be not finite; these are left out, and counted.
_MOST_NOT_FINITE = 0.05


@dataclass(frozen=True, kw_only=True)
class BagTable(LogTable):
    """Columns out of messages of a recording, decoded when they are asked for.

    Attributes:
        source: The recording.
        topics: The topics that are read.
        stamps: ``header`` or ``receive``.
    """

    source: BagSource
    topics: tuple[str, ...]
    stamps: str

    rereads: ClassVar = False
    has_frames: ClassVar = True

    def columns(self, names: Sequence[str]) -> Array:
        return self.read(names)[0]

    def read(self, names: Sequence[str]) -> tuple[Array, tuple[str, ...]]:
        """Return some columns and what was done to get them; see :meth:`LogTable.read`.

        The rows are those of the messages that carry most of the columns. Columns of other messages are taken at the
        same stamps, by linear interpolation where they have others.
        """
        gathered = self._gathered([name for name in names if name != TIME])
        collected = [self._series(key, part) for key, part in gathered.parts.items()]
        notes = list(filter(None, (gathered.note(self.source), *(note for _, note in collected))))
        base, others = chosen([series for series, _ in collected], names)
        notes += unused([series for series, _ in collected], [base, *others])
        stamps, blocks, more = aligned(base, others)
        notes += more
        places = {name: block[:, k] for columns, block in blocks for k, name in enumerate(columns)}
        if len(stamps):
            notes.append(f"time counted from the stamp {stamps[0]} ns")
            places[TIME] = (stamps - stamps[0]) / 1e9
        else:
            places[TIME] = np.empty(0)
        return np.stack([places[name] for name in names], axis=1), tuple(notes)

    def batches(self, names: Sequence[str], rows: int) -> Blocks:
        """Yield some columns in blocks; see :meth:`LogTable.batches`.

        Where no message carries all columns, messages are put together at their stamps, which takes all rows at once.
        """
        wanted = tuple(name for name in names if name != TIME)
        if not any(self._carried(topic, wanted) for topic in self.topics):
            return (yield from super().batches(names, rows))
        held, found = Held(wanted), _Gathered()
        order = [wanted.index(name) if name != TIME else len(wanted) for name in names]
        for stamp, numbers in self._carriers(wanted, found):
            held.add(stamp, numbers)
            if len(held) >= 2 * rows:
                for block in held.rows():
                    yield self._block(held, block, order)
        for block in held.rows(end=True):
            yield self._block(held, block, order)
        if held.unsound > _MOST_NOT_FINITE * held.taken:
            raise self._not_finite(held.not_finite, held.taken)
        notes = [found.note(self.source, held.taken), "; ".join(held.notes())]
        notes += [f"{n} messages with {len(some)} of the columns only left out" for some, n in found.partial.items()]
        if held.first is not None:
            notes.append(f"time counted from the stamp {held.first} ns")
        return tuple(filter(None, notes))

    def _carried(self, topic: str, wanted: Sequence[str]) -> bool:
        """Return whether one of the first messages of a topic carries all wanted columns."""
        messages = islice(self.source.messages([topic]), _LOOKED_AT)
        return any(set(wanted) <= set(self._names(topic, found.layout)) for _, _, found in messages)

    def _picks(self, wanted: Sequence[str], found: _Gathered) -> Iterator[tuple[tuple[str, ...], int, Array]]:
        """Yield the wanted columns of each message that has any, its stamp and numbers; the others are counted."""
        picks: dict[tuple[str, Layout], tuple[tuple[str, ...], IntArray]] = {}
        for topic, received, (layout, numbers, own) in self.source.messages(self.topics):
            if (topic, layout) not in picks:
                picks[topic, layout] = _picked(self._names(topic, layout), wanted)
            columns, places = picks[topic, layout]
            if not columns:
                found.other[topic] += 1
                continue
            stamp = own if self.stamps == "header" else received
            if stamp is None:
                found.headless[topic] += 1
                stamp = received
            yield columns, stamp, numbers[places]

    def _carriers(self, wanted: tuple[str, ...], found: _Gathered) -> Iterator[tuple[int, Array]]:
        """Yield stamp and numbers of the messages that carry all wanted columns; the others are counted."""
        for columns, stamp, numbers in self._picks(wanted, found):
            if len(columns) < len(wanted):
                found.partial[columns] += 1
                continue
            yield stamp, numbers

    def _block(self, held: Held, block: tuple[IntArray, Array], order: Sequence[int]) -> Array:
        """Return rows in the order of the wanted columns, the time from the first stamp on."""
        stamps, values = block
        if self.stamps == "header" and not stamps.any():
            raise self._no_stamps()
        return np.column_stack([values, (stamps - (held.first or 0)) / 1e9])[:, order]

    def _no_stamps(self) -> LogFormatError:
        step = "read it by the times at which messages were received: format: {rosbag: {stamps: receive}}"
        return LogFormatError(self.path, None, "the stamps in the headers are all 0", step)

    def _not_finite(self, bad: Counter[str], messages: int) -> NoNumbers:
        worst, count = bad.most_common(1)[0]
        evidence = f"'{shown(worst)}' is not finite in {count} of {messages} messages"
        empty = [name for name, count in bad.items() if count >= (1.0 - _MOST_NOT_FINITE) * messages]
        return NoNumbers(self.path, None, empty, evidence, "record one publisher only, or read another column")

    def _gathered(self, wanted: Sequence[str]) -> _Gathered:
        """Return the numbers of all messages that carry any of the wanted columns."""
        found = _Gathered()
        cells = 0
        for columns, stamp, numbers in self._picks(wanted, found):
            part = found.parts.setdefault(columns, (array("q"), array("d")))
            part[0].append(stamp)
            part[1].frombytes(numbers.tobytes())
            cells += len(columns)
            if cells > MAX_CELLS:
                evidence = f"more than {MAX_CELLS:,} numbers, more than are read at once"
                raise LogFormatError(self.path, None, evidence, TOO_LARGE)
        return found

    def _names(self, topic: str, layout: Layout) -> tuple[str, ...]:
        return prefixed(topic, columns_of(layout), self.topics)

    def _series(self, columns: tuple[str, ...], part: tuple[array[int], array[float]]) -> tuple[Series, str]:
        """Return the sound messages of a kind in the order of their stamps, and a note of what was left out."""
        stamps = np.frombuffer(part[0], dtype=np.int64)
        values = np.frombuffer(part[1], dtype=np.float64).reshape(len(stamps), len(columns))
        stamps, values = self._finite(columns, stamps, values)
        if self.stamps == "header" and len(stamps) and not stamps.any():
            raise self._no_stamps()
        back = np.diff(stamps)
        swapped = int(np.sum(back < 0)) if back.min(initial=0) >= -MOST_BACK else 0
        if swapped:
            order = np.argsort(stamps, kind="stable")
            stamps, values = stamps[order], values[order]
        same = np.zeros(len(stamps), dtype=bool)
        same[1:] = (np.diff(stamps) == 0) & np.all(np.diff(values, axis=0) == 0, axis=1)
        notes = notes_of(len(part[0]) - len(stamps), len(part[0]), swapped, int(same.sum()))
        return Series(columns, stamps[~same], values[~same]), "; ".join(notes)

    def _finite(self, columns: tuple[str, ...], stamps: IntArray, values: Array) -> tuple[IntArray, Array]:
        bad = ~np.isfinite(values)
        rows: BoolArray = np.any(bad, axis=1)
        if rows.sum() <= _MOST_NOT_FINITE * len(rows):
            return stamps[~rows], values[~rows]
        raise self._not_finite(Counter(dict(zip(columns, bad.sum(axis=0).tolist(), strict=True))), len(rows))


@dataclass(frozen=True)
class _Gathered:
    """Stamps and numbers by the columns that messages carry, and the messages of each topic that were passed over."""

    parts: dict[tuple[str, ...], tuple[array[int], array[float]]] = field(default_factory=dict)
    other: Counter[str] = field(default_factory=Counter)
    headless: Counter[str] = field(default_factory=Counter)
    partial: Counter[tuple[str, ...]] = field(default_factory=Counter)

    def note(self, source: BagSource, streamed: int = 0) -> str:
        """Return what is to be known about the messages, for the provenance; ``streamed`` ones are not kept here."""
        used = streamed + self.partial.total() + sum(len(stamps) for stamps, _ in self.parts.values())
        texts = [f"the file is cut: {used + self.other.total()} messages recovered"] if source.cut else []
        texts += [f"{count} messages of {topic} carry none of the columns" for topic, count in self.other.items()]
        texts += [f"no headers in {topic}: receive times" for topic in self.headless]
        return "; ".join(texts)


def header_of(path: str, source: BagSource, topics: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the columns that the first messages of the topics carry.

    Raises:
        LogFormatError: They carry no numbers.
    """
    found: dict[str, None] = {TIME: None}
    for topic in topics:
        for _, _, numbers in islice(source.messages([topic]), _LOOKED_AT):
            found |= dict.fromkeys(prefixed(topic, columns_of(numbers.layout), topics))
    if len(found) == 1:
        evidence = f"no numbers in the messages of {', '.join(topics)}"
        raise LogFormatError(path, None, evidence, "name another topic")
    return tuple(found)


def prefixed(topic: str, names: Sequence[str], topics: Sequence[str]) -> tuple[str, ...]:
    """Return the names of columns, with their topic in front where several topics are read."""
    return tuple(names) if len(topics) == 1 else tuple(f"{topic}:{name}" for name in names)


def _picked(names: Sequence[str], wanted: Sequence[str]) -> tuple[tuple[str, ...], IntArray]:
    """Return the wanted columns that are among the names, and where."""
    places = {name: k for k, name in enumerate(names)}
    found = tuple(name for name in wanted if name in places)
    return found, np.array([places[name] for name in found], dtype=np.int64)


def state_topics(topics: Mapping[str, str]) -> list[str]:
    """Return the topics with states of joints; those with signals by name only where there are no others."""
    found = ([topic for topic, own in topics.items() if own == kind] for kind in (JOINTS, DYNAMIC))
    return next(filter(None, found), [])


def topic_problem(path: str, topics: Mapping[str, str]) -> LogFormatError:
    """Return the error to raise where it is not clear which topic is to be read."""
    states = state_topics(topics)
    listed = ", ".join(f"{topic} ({kind})" for topic, kind in list(topics.items())[:20])
    evidence = f"{len(states)} topics with states of joints" if states else "no topic with states of joints"
    how = "format: {rosbag: {topics: [...]}}, to init with --format rosbag --format-option topics=TOPIC"
    step = f"name topics with {how}; there are {listed or 'none'}"
    return LogFormatError(path, None, evidence, step)


#: How far stamps may run back, in ns, for messages that only arrived out of order.
MOST_BACK = 1_000_000_000

#: Messages that are held back at most; a second never has so many.
_MOST_HELD = 1 << 20


def notes_of(unsound: int, taken: int, swapped: int, repeated: int) -> list[str]:
    """Return in words how many messages of those taken were left out or moved."""
    texts = [f"{unsound} of {taken} messages left out: numbers not finite"] if unsound else []
    texts += [f"{swapped} messages put into the order of their stamps"] if swapped else []
    return texts + ([f"{repeated} messages left out that repeat the one before"] if repeated else [])


class Held:
    """Messages that wait to be put into the order of their stamps.

    Attributes:
        columns: Names of the k columns.
        taken: Messages taken.
        not_finite: By column, messages left out whose number is not finite.
        unsound: Messages left out because of numbers that are not finite.
        swapped: Messages that came after one with a later stamp.
        repeated: Messages left out that repeat the one before.
        first: Stamp of the first row, in ns.
    """

    def __init__(self, columns: tuple[str, ...]) -> None:
        self.columns = columns
        self.taken = self.unsound = self.swapped = self.repeated = 0
        self.not_finite: Counter[str] = Counter()
        self.first: int | None = None
        self._stamps, self._values = array("q"), array("d")
        self._last: tuple[int, Array] | None = None

    def __len__(self) -> int:
        return len(self._stamps)

    def add(self, stamp: int, numbers: Array) -> None:
        """Take a message with its numbers (k,)."""
        self.taken += 1
        # One number tells for all, at a fifth of the time; it is not finite for huge ones either.
        if not math.isfinite(numbers.dot(numbers)) and not np.isfinite(numbers).all():
            self.unsound += 1
            self.not_finite.update(
                name for name, fine in zip(self.columns, np.isfinite(numbers), strict=True) if not fine
            )
            return
        if self._stamps and stamp < self._stamps[-1]:
            self.swapped += 1
        self._stamps.append(stamp)
        self._values.frombytes(numbers.tobytes())

    def rows(self, end: bool = False) -> Iterator[tuple[IntArray, Array]]:
        """Yield stamps (m,) and numbers (m, k) of the messages whose turn has come, or at the end of all."""
        stamps = np.frombuffer(self._stamps, dtype=np.int64)
        values = np.frombuffer(self._values, dtype=np.float64).reshape(len(stamps), len(self.columns))
        if np.all(np.diff(stamps) >= -MOST_BACK):  # else the clock was set back, which is for the reader to see
            order = np.argsort(stamps, kind="stable")
            stamps, values = stamps[order], values[order]
        count = len(stamps) if end or not len(stamps) else int(np.searchsorted(stamps, stamps[-1] - MOST_BACK))
        if not end and len(stamps) > _MOST_HELD:
            count = max(count, len(stamps) // 2)
        self._stamps, self._values = array("q", stamps[count:].tobytes()), array("d", values[count:].tobytes())
        if not count:
            return
        stamps, values = stamps[:count], values[:count]
        before = self._last or (int(stamps[0]) - 1, values[0])
        known, numbers = np.append(before[0], stamps), np.vstack([before[1], values])
        same = (np.diff(known) == 0) & np.all(np.diff(numbers, axis=0) == 0, axis=1)
        self.repeated += int(same.sum())
        self._last = int(stamps[-1]), values[-1].copy()
        if self.first is None:
            self.first = int(stamps[0])
        yield stamps[~same], values[~same]

    def notes(self) -> list[str]:
        """Return in words what was left out or moved."""
        return notes_of(self.unsound, self.taken, self.swapped, self.repeated)
