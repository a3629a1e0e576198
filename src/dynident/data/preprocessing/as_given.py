"""No filter: positions, velocities, accelerations and torques as the log has them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from dynident.data.log import Log
from dynident.data.preprocessing.base import Filter
from dynident.errors import LogMismatch


@dataclass(frozen=True)
class AsGiven(Filter):
    """Take dq, ddq and torque as logged; for logs that were filtered before, and for exact ones."""

    def apply(self, log: Log) -> Log:
        missing = [name for name in ("dq", "ddq") if getattr(log, name) is None]
        if missing:
            step = "name their columns in the case file, or choose a filter that differentiates (butterworth)"
            raise LogMismatch(log.name, f"no {' and no '.join(missing)}", step)
        return replace(log.with_step("signals as given"), raw_torque=log.torque)

    def statement(self) -> dict[str, object]:
        return {"kind": "as_given", "cutoff_hz": None, "order": None, "torque": "as given"}

    def span(self, rate: float) -> int:
        return 0
