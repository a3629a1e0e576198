"""DriveGains: the gain of each drive with its interval, whether the logs determine it, and what that stands on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.arrays import Array

IDENTIFIED, REVERSED, NOT_DETERMINED = "identified", "reversed", "not determined"

#: Gains that differ by a smaller share are the same.
SAME = 0.02


@dataclass(frozen=True)
class DriveGain:
    """The gain of one drive, or of one sign of its current.

    Attributes:
        joint: Name of the joint.
        sign: ``"+"`` or ``"-"`` where each sign of the current has a gain of its own, else empty.
        value: In N m/A or N/A at the joint.
        low: Lower end of its interval; -inf where there is none.
        high: Upper end; inf where there is none.
        deviation: Relative standard deviation; infinite where nothing determines it.
        label: ``identified``, ``reversed`` (identified, and below zero) or ``not determined``.
        reason: Why it is not determined or reversed, and what to do; empty where it is identified.
        driven: Root mean square current that what sets the scale (payload, description) asks of it, in A.
        residual: Root mean square of the current that the fit leaves, in A.
        current: Root mean square of the current, in A.
        unit: ``"N m/A"`` or ``"N/A"``; percent or permille in place of A where the currents are.
    """

    joint: str
    sign: str
    value: float
    low: float
    high: float
    deviation: float
    label: str
    reason: str
    driven: float
    residual: float
    current: float
    unit: str = "N m/A"

    @property
    def known(self) -> bool:
        """Whether the logs determine it."""
        return self.label != NOT_DETERMINED

    def is_apart_from(self, other: DriveGain) -> bool:
        """Whether no value is in both intervals, by a difference that matters."""
        apart = self.low > other.high or self.high < other.low
        return apart and abs(self.value - other.value) > SAME * abs(other.value)

    @property
    def name(self) -> str:
        """The joint, with the sign of the current where there is one."""
        return f"{self.joint} ({self.sign})" if self.sign else self.joint

    def figures(self) -> dict[str, Any]:
        """Return it as plain data; None for what is infinite."""
        ends = {"low": self.low, "high": self.high, "relative_std": self.deviation}
        return {
            "joint": self.joint,
            "sign": self.sign or None,
            "gain": self.value,
            **{key: value if np.isfinite(value) else None for key, value in ends.items()},
            "unit": self.unit,
            "label": self.label,
            "reason": self.reason or None,
            "current_of_known_bodies": self.driven,
            "residual_current": self.residual,
            "current": self.current,
        }


@dataclass(frozen=True)
class DriveGains:
    """The drive gains of a robot.

    Attributes:
        gains: By drive, or by drive and sign.
        method: How they were found.
        scale: What sets their scale, in words.
        level: Confidence of the intervals.
        covariance: Of their relative errors, shape (G, G).
        logs: Names of the logs by run.
        delays: By how much the current of each log was found to lag, in s; empty where that was not asked.
        found: What was found beside the gains about the body that sets the scale, by name: value; empty for none.
        remarks: What else has to be said.
        filter: What the filter did, and which rows were used.
    """

    gains: tuple[DriveGain, ...]
    method: str
    scale: str
    level: float
    covariance: Array
    logs: tuple[tuple[str, ...], ...]
    delays: tuple[float, ...]
    found: Mapping[str, float]
    remarks: tuple[str, ...]
    filter: Mapping[str, object]

    @property
    def complete(self) -> bool:
        """Whether the logs determine all gains."""
        return all(gain.known for gain in self.gains)

    def by_joint(self) -> dict[str, DriveGain]:
        """Return the gains that are determined, by joint; empty of joints with one for each sign."""
        return {gain.joint: gain for gain in self.gains if gain.known and not gain.sign}

    def figures(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return {
            "method": self.method,
            "scale": self.scale,
            "level": self.level,
            "complete": self.complete,
            "gains": [gain.figures() for gain in self.gains],
            "covariance": np.asarray(self.covariance).tolist(),
            "logs": [list(run) for run in self.logs],
            "delays": list(self.delays),
            "found": dict(self.found),
            "remarks": list(self.remarks),
            "filter": dict(self.filter),
        }
