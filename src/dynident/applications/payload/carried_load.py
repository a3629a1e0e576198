"""CarriedLoad: what a run with a payload says about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.model.inertia import TEN, Inertia

IDENTIFIED, WEAK, NOT_DETERMINED, IMPOSSIBLE = "identified", "weak", "not determined", "impossible"
CONTRADICTED = "contradicted"


@dataclass(frozen=True)
class LoadParameter:
    """One number about the payload.

    Attributes:
        name: One of TEN, or ``cx``, ``cy``, ``cz`` for the centre of mass.
        value: In its unit, as found, whether or not a body can have all of them; NaN where it is not determined.
        half_width: Half the width of its interval; infinite where it is not determined.
        unit: kg, kg m, kg m^2 or m.
        label: ``identified``, ``weak`` (the interval is wider than what payloads of its mass differ by),
            ``not determined``, ``impossible`` where the mass is below 0 for sure, or ``contradicted`` where the log
            contradicts a stated mass, or any payload.
    """

    name: str
    value: float
    half_width: float
    unit: str
    label: str

    @property
    def verdict(self) -> str:
        """Its label; of a number that is identified and may be 0, with that."""
        return f"{self.label}, near 0" if self.known and abs(self.value) <= self.half_width else self.label

    @property
    def known(self) -> bool:
        """Whether the log determines it well enough to use it."""
        return self.label == IDENTIFIED

    def figures(self) -> dict[str, Any]:
        """Return it as plain data; None for what is not determined."""
        determined = self.label != NOT_DETERMINED
        return {
            "name": self.name,
            "value": self.value if determined else None,
            "half_width": self.half_width if determined else None,
            "unit": self.unit,
            "label": self.label,
        }


@dataclass(frozen=True)
class CarriedLoad:
    """A payload found as the difference between a run with it and the robot without.

    Attributes:
        frame: The flange: name of the link or frame that everything is stated in.
        link: Name of the link that carries it.
        placement: Pose of the flange in the frame of that link, shape (4, 4).
        parameters: The ten about the origin of the flange, in its axes.
        centre: The centre of mass, three numbers.
        covariance: Of the ten, shape (10, 10); rows and columns of what is not determined are zero.
        parts: Standard deviation of the mass by source: ``noise``, ``robot``, ``friction``, ``gains``, ``stated``.
        body: The possible body nearest to the ten; what is not determined is that of a small ball.
        distance: Mahalanobis distance of ``body`` from the ten: how far they are from possible.
        rows: ``motion`` or ``poses``.
        samples: Rows (postures) used.
        level: Confidence of the intervals.
        residual: Root mean square of what is left, by joint: torque without the payload, with it.
        logs: Names of the logs.
        remarks: What has to be said.
        contradiction: How the log contradicts a stated mass, or any payload; empty where it does not.
    """

    frame: str
    link: str
    placement: Array
    parameters: tuple[LoadParameter, ...]
    centre: tuple[LoadParameter, ...]
    covariance: Array
    parts: Mapping[str, float]
    body: Inertia
    distance: float
    rows: str
    samples: int
    level: float
    residual: Mapping[str, tuple[float, float]]
    logs: tuple[str, ...]
    remarks: tuple[str, ...]
    contradiction: str = ""

    @property
    def mass(self) -> LoadParameter:
        """The mass, in kg."""
        return self.parameters[TEN.index("m")]

    @property
    def place(self) -> str:
        """Where the flange is, in words: its name, and its pose in the frame of the link that carries it."""
        if self.frame == self.link:
            return f"the frame of the last moving link, {self.frame}"
        turn = float(np.degrees(np.arccos(np.clip((np.trace(self.placement[:3, :3]) - 1) / 2, -1, 1))))
        x, y, z = np.round(self.placement[:3, 3], 4) + 0.0
        axes = f"axes turned by {turn:.3g}°" if turn > 0.05 else "axes alike"
        return f"the frame {self.frame}, which is at [{x:g}, {y:g}, {z:g}] m in that of {self.link}, {axes}"

    @property
    def inertia_known(self) -> bool:
        """Whether all six second moments are identified, so that ``body``'s inertia is the log's."""
        return all(one.known for one in self.parameters[:6])

    @property
    def placed(self) -> bool:
        """Whether mass and centre of mass are identified."""
        return not self.unknown

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of mass and coordinates of the centre of mass that are not identified; all with a contradicted mass."""
        return tuple(one.name for one in (self.mass, *self.centre) if not one.known)

    def contradicted(self, why: str) -> CarriedLoad:
        """Return it with nothing identified for a reason, as the log contradicts a stated mass; itself without one."""
        if not why:
            return self
        told = [replace(one, label=CONTRADICTED) if one.known else one for one in (*self.parameters, *self.centre)]
        count = len(self.parameters)
        return replace(self, parameters=tuple(told[:count]), centre=tuple(told[count:]), contradiction=why)

    def figures(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return {
            "frame": self.frame,
            "link": self.link,
            "placement": np.asarray(self.placement).tolist(),
            "parameters": [one.figures() for one in self.parameters],
            "centre": [one.figures() for one in self.centre],
            "covariance": np.asarray(self.covariance).tolist(),
            "mass_std_by_source": dict(self.parts),
            "consistent_body": {
                "mass": self.body.mass,
                "centre": self.body.centre_of_mass.tolist(),
                "inertia_about_centre": self.body.about_centre.tolist(),
                "distance": self.distance,
            },
            "rows": self.rows,
            "samples": self.samples,
            "level": self.level,
            "residual": {name: list(pair) for name, pair in self.residual.items()},
            "logs": list(self.logs),
            "remarks": list(self.remarks),
        }
