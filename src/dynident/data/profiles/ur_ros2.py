"""Universal Robots: joint states of the ROS drivers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.data.profiles.base import Channel, Profile


@dataclass(frozen=True)
class UrRos2(Profile):
    """Universal Robots under ROS 1 or 2: ``effort`` of /joint_states is motor current in A by default.

    With ``use_currents_as_efforts:=false`` (PolyScope 5.23, 10.11 and later) it is a torque in N m; read it with
    ``columns: {torque: "{joint}.effort", current: none}``.
    """

    time: ClassVar = "t"
    channels: ClassVar = (
        Channel("{joint}.position", "q", needed=True),
        Channel("{joint}.velocity", "dq"),
        Channel("{joint}.effort", "current", side="motor", unit="A", needed=True, note="a current by default"),
    )
    source: ClassVar = "Universal_Robots_ROS2_Driver: issue 794, pull requests 1551 and 1918"
