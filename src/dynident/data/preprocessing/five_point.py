"""The article's five-point cubic smoothing."""

from __future__ import annotations

from dataclasses import dataclass, replace

from dynident.data.log import Log
from dynident.data.preprocessing._local_polynomials import central_differences, five_point_smoothing
from dynident.data.preprocessing.base import Filter
from dynident.errors import BadOption, LogMismatch
from dynident.plugins import bounded


@dataclass(frozen=True)
class FivePoint(Filter):
    """Five-point cubic smoothing (17), repeated; velocities by central differences.

    Attributes:
        repeats: How often the rule is run over positions and torques.
    """

    repeats: int = bounded(10, most=1_000)

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
        return replace(
            log.with_step(step), q=q, dq=dq, ddq=central_differences(dq, log.rate), torque=torque, raw_torque=log.torque
        )

    def statement(self) -> dict[str, object]:
        return {"kind": "five_point", "cutoff_hz": None, "order": 3, "repeats": self.repeats, "torque": "same"}

    def span(self, rate: float) -> int:
        # Beside the end of a log the rule looks four samples ahead.
        return 4 * self.repeats + 4
