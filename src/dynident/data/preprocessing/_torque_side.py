"""Filters that smooth positions by other means than a low-pass: what they do to torque and regressor."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing._thinning import Thinning
from dynident.data.preprocessing.base import Filter
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.errors import BadOption


class PositionSmoother(Filter):
    """A zero-phase Butterworth of order 4 on torque and regressor alike, or nothing on both.

    The part that derives from it has the fields ``cutoff_hz``, frequency of half amplitude in Hz, and ``torque``,
    ``same`` or ``none``.
    """

    cutoff_hz: float
    torque: str

    @abstractmethod
    def apply(self, log: Log) -> Log: ...

    def check_sides(self) -> None:
        """Refuse a cut-off that is no frequency, and another word for the torque.

        Raises:
            BadOption: Either of them.
        """
        if not 0 < self.cutoff_hz < float("inf"):
            raise BadOption("cutoff_hz", self.cutoff_hz, "give a frequency in Hz above 0")
        if self.torque not in ("same", "none"):
            raise BadOption("torque", self.torque, "choose 'same' or 'none'")

    def check_length(self, log: Log) -> None:
        """Refuse a log that is too short or too slow for the filter of the torque.

        Raises:
            LogMismatch: It is.
        """
        if self._sides is not None:
            self._sides.check(log)

    def measured(self, log: Log) -> Array | None:
        """Return the torque of a log (N, n), filtered as the regressor will be; None where it has none."""
        return None if log.torque is None else self.smooth(log.torque.T, log.rate).T

    def sides_text(self) -> str:
        """Return what is done to both sides in words."""
        return f"both sides at {self.cutoff_hz:g} Hz" if self._sides is not None else "torque raw"

    def smooth(self, signals: Array, rate: float) -> Array:
        return signals if self._sides is None else self._sides.smooth(signals, rate)

    def thinning(self, rate: float, every: int) -> Thinning | None:
        return None if self._sides is None else self._sides.thinning(rate, every)

    def bandwidth(self) -> float | None:
        return None if self._sides is None else self.cutoff_hz

    def reach(self, rate: float) -> int:
        return 0 if self._sides is None else self._sides.reach(rate)

    @cached_property
    def _sides(self) -> Butterworth | None:
        """The filter of both sides; None where they stay as they are."""
        return Butterworth(self.cutoff_hz) if self.torque == "same" else None
