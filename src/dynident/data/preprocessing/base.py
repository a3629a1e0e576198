"""What a filter part is: it turns a uniform log of positions and torques into q, dq, ddq and filtered torques."""

from __future__ import annotations

from abc import ABC, abstractmethod

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing._thinning import Thinning


class Filter(ABC):
    """A pure method on a uniformly sampled log; the fields of the part are its options."""

    @abstractmethod
    def apply(self, log: Log) -> Log:
        """Return the log with q, dq, ddq and torque filtered; raw_torque keeps the torque as it came.

        Args:
            log: Uniformly sampled; dq may be missing.

        Raises:
            LogMismatch: The log is too short or too slow for the filter.
        """

    @abstractmethod
    def statement(self) -> dict[str, object]:
        """Return what must stand beside every figure: at least kind, cutoff_hz, order and torque."""

    def smooth(self, signals: Array, rate: float) -> Array:
        """Return signals, shape (k, N), run through the filter that the torque went through.

        Columns of the regressor pass through it too, so that both sides of the equation are filtered alike. A filter
        that treats only positions returns the signals as they are.
        """
        return signals

    def thinning(self, rate: float, every: int) -> Thinning | None:
        """Return what gives one in ``every`` of the samples of ``smooth`` in less time; None where nothing does."""
        return None

    @property
    def is_open(self) -> bool:
        """Whether identification is to choose its cut-off from the logs."""
        return False

    def with_cutoff(self, hertz: float) -> Filter:
        """Return the filter with a cut-off in Hz of both sides; the same filter where it has no such option."""
        return self

    def sharper(self, rate: float) -> tuple[Filter, float] | None:
        """Return the filter with up to twice the cut-off of positions, and how often as fast velocities follow."""
        return None

    def shared_cutoff(self) -> float | None:
        """Return the stated cut-off in Hz that both sides of the equation have; None where there is none."""
        return None

    def bandwidth(self) -> float | None:
        """Return the highest frequency in Hz that passes; None where the filter states none."""
        return None

    def reach(self, rate: float) -> int:
        """Return over how many samples ``smooth`` looks to either side; 0 where it changes nothing."""
        return 0

    def span(self, rate: float) -> int | None:
        """Return over how many samples ``apply`` looks to either side; None where it needs the whole log.

        Logs that are larger than memory are filtered in windows that overlap by so much.
        """
        return None
