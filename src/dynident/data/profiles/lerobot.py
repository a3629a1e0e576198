"""LeRobot data sets, version 3: Parquet with lists of joint values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.data.profiles.base import Channel, Profile


@dataclass(frozen=True)
class Lerobot(Profile):
    """LeRobot data set (Parquet): commands and positions at 30 to 50 Hz in units that depend on the robot, no torque.

    State the unit of the positions. Without a column of torque or current the actuators are found, and no masses.
    """

    time: ClassVar = "timestamp"
    channels: ClassVar = (
        Channel(
            "observation.state{}",
            "q",
            unit="",
            needed=True,
            note="degrees, radians; for shares of the range write servo: {calibration: FILE} instead",
        ),
        Channel("action{}", "q_ref", "commanded", unit=""),
    )
    source: ClassVar = "LeRobot data set format, version 3"
