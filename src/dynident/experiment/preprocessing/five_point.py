"""The article's five-point cubic smoothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, LogMismatch
from dynident.experiment.log import Log
from dynident.experiment.preprocessing.base import Filter
from dynident.experiment.preprocessing.butterworth import central_differences


@dataclass(frozen=True)
class FivePoint(Filter):
    """Five-point cubic smoothing (17), repeated; velocities by central differences.

    Attributes:
        repeats: How often the rule is run over positions and torques.
    """

    repeats: int = 10

    def __post_init__(self) -> None:
        if self.repeats < 1:
            raise BadOption("repeats", self.repeats, "give 1 or more")

    def apply(self, log: Log) -> Log:
        if log.samples < 5:
            raise LogMismatch(log.name, f"{log.samples} samples", "five-point smoothing takes at least 5 samples")
        q = five_point_smoothing(log.q, self.repeats)
        dq = central_differences(q, log.rate)
        torque = None if log.torque is None else five_point_smoothing(log.torque, self.repeats)
        step = f"five-point cubic smoothing, {self.repeats} times"
        return log.with_step(
            step, q=q, dq=dq, ddq=central_differences(dq, log.rate), torque=torque, raw_torque=log.torque
        )

    def statement(self) -> dict[str, object]:
        return {"kind": "five_point", "cutoff_hz": None, "order": 3, "repeats": self.repeats, "torque": "same"}

    def span(self, rate: float) -> int:
        # Beside the end of a log the rule looks four samples ahead.
        return 4 * self.repeats + 4


def five_point_smoothing(signal: Array, repeats: int = 1) -> Array:
    """Return (17) applied ``repeats`` times to each column: the local cubic least-squares fit over five samples.

    Args:
        signal: Shape (N,) or (N, n) with N >= 5.
        repeats: How often.
    """
    y = np.asarray(signal, dtype=float)
    for _ in range(repeats):
        out = np.empty_like(y)
        out[0] = (69 * y[0] + 4 * (y[1] + y[3]) - 6 * y[2] - y[4]) / 70
        out[1] = (2 * (y[0] + y[4]) + 27 * y[1] + 12 * y[2] - 8 * y[3]) / 35
        out[2:-2] = (-3 * (y[:-4] + y[4:]) + 12 * (y[1:-3] + y[3:-1]) + 17 * y[2:-2]) / 35
        out[-2] = (2 * (y[-5] + y[-1]) - 8 * y[-4] + 12 * y[-3] + 27 * y[-2]) / 35
        out[-1] = (-y[-5] + 4 * (y[-4] + y[-2]) - 6 * y[-3] + 69 * y[-1]) / 70
        y = out
    return y
