"""Any robot under ROS: sensor_msgs/JointState, its effort taken for a torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.data.profiles.base import Channel, Profile


@dataclass(frozen=True)
class JointStates(Profile):
    """Joint states of ROS as their message defines them: effort in N m or N.

    Some drivers publish something else there, such as currents (``ur_ros2``) or commands: read the driver's manual.
    """

    time: ClassVar = "t"
    channels: ClassVar = (
        Channel("{joint}.position", "q", needed=True),
        Channel("{joint}.velocity", "dq"),
        Channel("{joint}.effort", "torque", needed=True, note="drivers differ: see their manual"),
    )
    source: ClassVar = "sensor_msgs/JointState.msg"
