"""The two sides of the equation for filters that smooth positions by other means than a low-pass."""

from __future__ import annotations

from dataclasses import dataclass

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.experiment.log import Log
from dynident.experiment.preprocessing.butterworth import Butterworth


@dataclass(frozen=True)
class TorqueSide:
    """A zero-phase Butterworth of order 4 on torque and regressor alike, or nothing on both.

    Attributes:
        cutoff_hz: Frequency of half amplitude in Hz.
        torque: ``same`` or ``none``.
    """

    cutoff_hz: float
    torque: str

    def __post_init__(self) -> None:
        if not 0 < self.cutoff_hz < float("inf"):
            raise BadOption("cutoff_hz", self.cutoff_hz, "give a frequency in Hz above 0")
        if self.torque not in ("same", "none"):
            raise BadOption("torque", self.torque, "choose 'same' or 'none'")

    @property
    def filter(self) -> Butterworth:
        """The filter of both sides."""
        return Butterworth(self.cutoff_hz)

    def check(self, log: Log) -> None:
        """Refuse a log that is too short or too slow for the filter.

        Raises:
            LogMismatch: It is.
        """
        if self.torque == "same":
            self.filter.check(log)

    def smooth(self, signals: Array, rate: float) -> Array:
        """Return signals, shape (k, N), filtered, or as they are."""
        return self.filter.smooth(signals, rate) if self.torque == "same" else signals

    def measured(self, log: Log) -> Array | None:
        """Return the torque of a log (N, n), filtered as the regressor will be; None where it has none."""
        return None if log.torque is None else self.smooth(log.torque.T, log.rate).T

    def reach(self, rate: float) -> int:
        """Return over how many samples the filter looks to either side."""
        return self.filter.reach(rate) if self.torque == "same" else 0

    def text(self) -> str:
        """Return what is done to both sides in words."""
        return f"both sides at {self.cutoff_hz:g} Hz" if self.torque == "same" else "torque raw"
