"""Universal Robots: CSV of the RTDE client."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.data.profiles.base import Channel, Profile


@dataclass(frozen=True)
class UrRtde(Profile):
    """Universal Robots RTDE, as ``record.py`` of the RTDE client writes it: motor currents in A, no torque by default.

    Currents need drive gains. ``actual_current_as_torque_{0}`` (PolyScope 5.23, 10.11 and later) is a torque in N m;
    read it with ``columns: {torque: "actual_current_as_torque_{0}", current: none}``.
    """

    time: ClassVar = "timestamp"
    channels: ClassVar = (
        Channel("actual_q_{0}", "q", needed=True),
        Channel("actual_qd_{0}", "dq"),
        Channel("actual_current_{0}", "current", side="motor", unit="A", needed=True, note="a current, not a torque"),
        Channel("actual_current_as_torque_{0}", "torque", read=False),
        Channel("joint_temperatures_{0}", "temperature", unit="degC"),
        Channel("target_q_{0}", "q_ref", "commanded"),
        Channel("target_qd_{0}", "dq_ref", "commanded"),
        Channel("target_qdd_{0}", "ddq", "commanded", read=False),
        Channel("target_current_{0}", "current", "commanded", "motor", "A", read=False),
        Channel("joint_control_output_{0}", "current", "commanded", "motor", "A", read=False),
        Channel(
            "target_moment_{0}", "torque", "model", read=False, note="the controller's own dynamic model computes it"
        ),
    )
    source: ClassVar = "RTDE_Python_Client_Library: csv_writer.py, record_configuration.xml; RTDE guide"
