"""Velocities and accelerations by central differences, nothing smoothed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynident.data.log import Log
from dynident.data.preprocessing.base import Filter
from dynident.errors import LogMismatch


@dataclass(frozen=True)
class CentralDifferences(Filter):
    """dq = (q[k+1] - q[k-1]) / 2h and ddq = (q[k+1] - 2 q[k] + q[k-1]) / h^2; the ends have their neighbours' ddq."""

    def apply(self, log: Log) -> Log:
        if log.samples < 5:
            raise LogMismatch(log.name, f"{log.samples} samples", "central differences need at least 5")
        step = log.time[1] - log.time[0]
        inner = (log.q[2:] - 2 * log.q[1:-1] + log.q[:-2]) / step**2
        ddq = np.pad(inner, ((1, 1), (0, 0)), mode="edge")
        dq = np.gradient(log.q, step, axis=0, edge_order=2)
        return replace(log.with_step("central differences"), dq=dq, ddq=ddq, raw_torque=log.torque)

    def statement(self) -> dict[str, object]:
        return {"kind": "central_differences", "cutoff_hz": None, "order": None, "torque": "as given"}

    def span(self, rate: float) -> int:
        return 2
