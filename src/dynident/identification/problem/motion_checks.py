"""What is refused of preprocessed logs before any row is made: each raises LogMismatch with evidence and remedy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynident.data.preprocessing import Prepared
from dynident.errors import LogMismatch
from dynident.model.dynamic_model import DynamicModel


def check_temperature(model: DynamicModel, logs: Sequence[Prepared]) -> None:
    """Refuse logs without the temperatures that a friction part asks for."""
    for log in logs:
        if "temperature" in model.needs and log.log.temperature is None:
            step = "map them in the case file (log: columns: temperature), or leave the friction part out"
            raise LogMismatch(log.log.name, "no temperatures of the drives", step)


def check_motion(model: DynamicModel, logs: Sequence[Prepared]) -> None:
    """Name the joints that never move: their friction cannot be known, and the case must say that they are locked."""
    span = np.max([np.ptp(log.log.q, axis=0) for log in logs], axis=0)
    still = [name for name, moved in zip(model.robot.joint_names, span, strict=True) if moved < 1e-3]
    if still:
        names, ranges = ", ".join(still), ", ".join(f"{s:.2g}" for s in span[span < 1e-3])
        raise LogMismatch(
            ", ".join(log.log.name for log in logs),
            f"{names} never moved (range {ranges} rad or m)",
            "lock it in the case file (locked: {" + still[0] + ": 0}) or record a motion of all joints",
        )


def check_torque(model: DynamicModel, logs: Sequence[Prepared]) -> None:
    """Name the joints whose torque is one and the same number: no sensor says that of a joint that moves."""
    torques = [log.log.torque if log.log.raw_torque is None else log.log.raw_torque for log in logs]
    known = [torque for torque in torques if torque is not None]
    if not known:
        return
    low, high = (pick([pick(torque, axis=0) for torque in known], axis=0) for pick in (np.min, np.max))
    for name, unit, least, most in zip(model.robot.joint_names, model.robot.units, low, high, strict=True):
        if most - least <= 1e-12 * abs(most):
            evidence = f"{name} moves but its torque is {most:.4g} {unit} throughout"
            step = "map the right column, or leave the joint out (locked:)"
            raise LogMismatch(", ".join(log.log.name for log in logs), evidence, step)
