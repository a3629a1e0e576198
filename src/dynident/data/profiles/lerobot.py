"""LeRobot data sets, version 3: Parquet with lists of joint values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.data.profiles.base import Channel, Profile


@dataclass(frozen=True)
class Lerobot(Profile):
    """LeRobot data set (Parquet): positions at 30 to 50 Hz in units that depend on the robot, and no torque.

    State the unit of the positions and the columns of the torque or current; without one no masses can be identified.
    """

    time: ClassVar = "timestamp"
    channels: ClassVar = (
        Channel("observation.state{}", "q", unit="", needed=True, note="degrees, radians or a share of the range"),
        Channel("action{}", "q_ref", "commanded", unit="", read=False),
    )
    source: ClassVar = "LeRobot data set format, version 3"
