"""Zero-phase Butterworth filter with central differences."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing._local_polynomials import central_differences
from dynident.data.preprocessing._thinning import Thinning, thinning
from dynident.data.preprocessing._zero_phase import butterworth, zero_phase
from dynident.data.preprocessing.base import Filter
from dynident.errors import BadOption, LogMismatch

#: Slower logs than this, in Hz, are taken for times in another unit.
SLOW = 2.0

#: Shorter logs of more samples a second, in Hz, too.
FAST = 5e4

#: The cut-off in Hz where none is stated and none is chosen.
STATED_HZ = 5.0

#: Frequency of half amplitude of central differences, as a share of the sampling rate: sin(x) / x = 1 / 2.
DIFFERENCES = 0.302

#: Positions are filtered this many times higher than both sides of the equation, where not stated otherwise.
POSITION_FACTOR = 5.0


@dataclass(frozen=True)
class Butterworth(Filter):
    """Zero-phase Butterworth low-pass on both sides of the equation: on the torque and on every regressor column.

    Run forwards and backwards, so the attenuation at the cut-off is one half and the phase is zero. Positions are
    filtered with a higher cut-off first and differentiated centrally; the regressor made of them is filtered like the
    torque, so that what the filter takes from the torque (a friction step, say) it takes from the model as well.

    Attributes:
        cutoff_hz: Frequency of half amplitude of both sides, in Hz; ``auto`` (None): identification chooses it from its
            logs, and what does not choose takes 5 Hz.
        order: Order of the one-way filter.
        positions_hz: Frequency of half amplitude of the positions, in Hz; None for five times ``cutoff_hz``, at most
            0.4 of the sampling rate, or ``cutoff_hz`` itself where the torque is left as it is.
        torque: ``same`` filters both sides, ``none`` leaves torque and regressor as they are.
    """

    cutoff_hz: float | None = None
    order: int = 4
    positions_hz: float | None = None
    torque: str = "same"

    def __post_init__(self) -> None:
        for name in ("cutoff_hz", "positions_hz"):
            value: float | None = getattr(self, name)
            if value is not None and not 0 < value < np.inf:
                raise BadOption(name, value, "give a frequency in Hz above 0")
        if not 1 <= self.order <= 20:
            raise BadOption("order", self.order, "give an order from 1 to 20")
        if self.torque not in ("same", "none"):
            raise BadOption("torque", self.torque, "choose 'same' or 'none'")

    def apply(self, log: Log) -> Log:
        positions = self._positions_cutoff(log.rate)
        self.check(log)
        q = _zero_phase(log.q.T, positions, self.order, log.rate).T
        dq = central_differences(q, log.rate)
        torque = None if log.torque is None else self.smooth(log.torque.T, log.rate).T
        sides = f"both sides at {self._cutoff:g} Hz" if self.torque == "same" else "torque raw"
        step = f"zero-phase Butterworth, order {self.order}, positions at {positions:.4g} Hz, {sides}"
        return replace(
            log.with_step(step), q=q, dq=dq, ddq=central_differences(dq, log.rate), torque=torque, raw_torque=log.torque
        )

    def check(self, log: Log) -> None:
        """Refuse a log that is too short or too slow for the filter.

        Raises:
            LogMismatch: It is.
        """
        for cutoff in (self._cutoff, self._positions_cutoff(log.rate)):
            _check_length(log, cutoff)

    def statement(self) -> dict[str, object]:
        return {
            "kind": "butterworth",
            "cutoff_hz": self._cutoff,
            "order": self.order,
            "torque": self.torque,
            "positions_hz": self._positions_cutoff(np.inf),
        }

    def smooth(self, signals: Array, rate: float) -> Array:
        return signals if self.torque == "none" else _zero_phase(signals, self._cutoff, self.order, rate)

    def thinning(self, rate: float, every: int) -> Thinning | None:
        if self.torque == "none" or every < 2:
            return None
        cutoff = self._cutoff
        return thinning(cutoff, self.order, rate, every, _memory(cutoff, self.order, rate), _pad(cutoff, rate))

    @property
    def is_open(self) -> bool:
        return self.cutoff_hz is None

    def with_cutoff(self, hertz: float) -> Butterworth:
        return replace(self, cutoff_hz=hertz)

    def sharper(self, rate: float) -> tuple[Butterworth, float] | None:
        own = self._positions_cutoff(rate)
        higher = min(2.0 * own, 0.4 * rate)
        widths = (np.hypot(1.0 / cutoff, 1.0 / (DIFFERENCES * rate)) for cutoff in (own, higher))  # times of velocities
        return (replace(self, positions_hz=higher), float(np.divide(*widths))) if higher > 1.5 * own else None

    def shared_cutoff(self) -> float | None:
        return self.cutoff_hz if self.torque == "same" else None

    def bandwidth(self) -> float:
        return self._cutoff

    def reach(self, rate: float) -> int:
        return 0 if self.torque == "none" else _memory(self._cutoff, self.order, rate)

    @property
    def _cutoff(self) -> float:
        """The cut-off as a number."""
        return STATED_HZ if self.cutoff_hz is None else self.cutoff_hz

    def span(self, rate: float) -> int:
        cutoffs = (self._cutoff, self._positions_cutoff(rate))
        return max(_memory(cutoff, self.order, rate) for cutoff in cutoffs) + 4  # two differences beside

    def _positions_cutoff(self, rate: float) -> float:
        if self.positions_hz is not None:
            return self.positions_hz
        if self.torque == "none":
            return self._cutoff
        return min(POSITION_FACTOR * self._cutoff, 0.4 * rate)


def _check_length(log: Log, cutoff: float) -> None:
    if cutoff >= log.rate / 2:
        evidence = f"{log.rate:.4g} samples a second cannot carry a cut-off of {cutoff:g} Hz"
        step = f"choose a cut-off below {log.rate / 2:.4g} Hz"
        if log.rate < SLOW:
            step = "state the unit of the time column (units: {time: ms}, us or ns) in the case file"
        raise LogMismatch(log.name, evidence, step)
    if log.samples <= _pad(cutoff, log.rate) + 1:
        evidence = f"{log.samples} samples are too few for a cut-off of {cutoff:g} Hz"
        step = f"it takes more than {_pad(cutoff, log.rate) + 1:.6g}; give a longer log"
        if log.rate > FAST:
            evidence = f"steps of {1.0 / log.rate:.3g} s, {log.duration:.3g} s in all"
            step = (
                "no log is as fast: is the time of this file in another unit than units: {time: ...} of the case says?"
            )
        raise LogMismatch(log.name, evidence, step)


def _memory(cutoff: float, order: int, rate: float) -> int:
    """Return the samples after which the slowest pole has decayed to 1e-12, also near the Nyquist frequency."""
    radius = float(np.max(np.abs(butterworth(order, min(cutoff / rate, 0.49), 1.0).poles)))
    return int(np.ceil(max(3.0 * order * rate / cutoff, -28.0 / np.log(radius))))


def _pad(cutoff: float, rate: float) -> int:
    return int(3 * rate / cutoff)


def _zero_phase(signals: Array, cutoff: float, order: int, rate: float) -> Array:
    return zero_phase(signals, butterworth(order, cutoff, rate), min(_pad(cutoff, rate), signals.shape[-1] - 1))
