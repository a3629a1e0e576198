"""Franka: CSV of libfranka's log, ``logToCSV``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.data.profiles.base import Channel, Profile


@dataclass(frozen=True)
class Franka(Profile):
    """Franka FR3 and FER, libfranka's ``logToCSV``: link-side torque sensors with gravity; time in ms.

    ``tau_J`` is measured behind the gear, so most of the motors' friction and rotor inertia is not in it.
    """

    time: ClassVar = "time"
    time_unit: ClassVar = "ms"
    channels: ClassVar = (
        Channel("state.q[{0}]", "q", needed=True),
        Channel("state.dq[{0}]", "dq"),
        Channel("state.tau_J[{0}]", "torque", needed=True, note="link-side sensor, gravity included"),
        Channel("state.q_d[{0}]", "q_ref", "commanded"),
        Channel("state.dq_d[{0}]", "dq_ref", "commanded"),
        Channel("state.tau_ext_hat_filtered[{0}]", "torque", "model", read=False, note="estimated external torque"),
        Channel("cmd.tau_J_d[{0}]", "torque", "commanded", read=False, note="commanded, without gravity"),
        Channel("state.tau_J_d[{0}]", "torque", "commanded", read=False, note="commanded, without gravity"),
        Channel("tau_J_d[{0}]", "torque", "commanded", read=False, note="commanded, without gravity"),
        Channel("tau_J_d{0}", "torque", "commanded", read=False, note="commanded, without gravity"),
        Channel("tau_J_d_{0}", "torque", "commanded", read=False, note="commanded, without gravity"),
    )
    source: ClassVar = "libfranka: robot_state.h, log.cpp"
