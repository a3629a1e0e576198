"""How one log becomes a training and a test part, and how a file of several recordings becomes several logs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.errors import BadOption, LogMismatch

#: Column of the number of the recording, as LeRobot data sets have it.
EPISODE = "episode_index"


@dataclass(frozen=True)
class Split:
    """How one log becomes a training and a test part.

    Attributes:
        first: Share of the duration that trains; None where samples are stated.
        train: Samples start:stop that train.
        test: Samples start:stop that test.
    """

    first: float | None = None
    train: tuple[int, int] = (0, 0)
    test: tuple[int, int] = (0, 0)

    @classmethod
    def parse(cls, text: str) -> Split:
        """Read ``first:0.67`` or ``samples:0:24750,29250:45000``, which was once written ``rows:...``.

        Raises:
            BadOption: Neither of the two.
        """
        kind, _, rest = text.strip().partition(":")
        try:
            if kind == "first" and 0 < float(rest) < 1:
                return cls(first=float(rest))
            if kind in ("samples", "rows"):
                (a, b), (c, d) = (tuple(int(n) for n in part.split(":")) for part in rest.split(","))
                if 0 <= a < b and 0 <= c < d and (b <= c or d <= a):
                    return cls(train=(a, b), test=(c, d))
        except ValueError:
            pass
        step = "write first:0.67 (share of the duration) or samples:0:24750,29250:45000 (that train, that test)"
        raise BadOption("split", text, step)

    def __str__(self) -> str:
        if self.first is not None:
            return f"first:{self.first:g}"
        (a, b), (c, d) = self.train, self.test
        return f"samples:{a}:{b},{c}:{d}"

    def apply(self, log: Log) -> tuple[Log, Log]:
        """Return the training and the test part of a log.

        Raises:
            LogMismatch: The log has fewer samples than the split names.
        """
        if self.first is not None:
            return log.split(self.first)
        self.check(log.samples, log.name)
        train, test = (log.part(a, b, f"samples {a} to {b} of {log.samples}") for a, b in (self.train, self.test))
        return replace(train, source=replace(train.source, split=str(self))), test

    def check(self, rows: int, name: str) -> None:
        """Refuse a log with fewer samples than the split names.

        Raises:
            LogMismatch: It has.
        """
        last = max(self.train[1], self.test[1])
        if last > rows:
            raise LogMismatch(name, f"{rows} samples, the split ends at {last}", "state samples that the log has")


def episode_rows(numbers: Array) -> list[slice]:
    """Return the rows of each recording; a recording ends where the number, shape (N,), changes."""
    cuts = np.flatnonzero(np.diff(numbers)) + 1
    return [slice(int(a), int(b)) for a, b in zip([0, *cuts], [*cuts, len(numbers)], strict=True)]
