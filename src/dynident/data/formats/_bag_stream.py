"""Messages of a recording as rows in constant memory, where each message carries all columns.

Stamps may run back by less than a second for messages that only arrived out of order, so the messages of the last
second are held back until later ones have come.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Iterator

import numpy as np

from dynident.arrays import Array, IntArray

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
