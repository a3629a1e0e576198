"""Roll-outs that do not follow their logs, and the likely cause: the angle at which the encoder reads zero."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.optimize import nnls

from dynident.actuators.joint_fit import JointData
from dynident.actuators.linear_start import REST, StartRows, duty_of
from dynident.actuators.rollout import mean_errors
from dynident.arrays import Array, BoolArray

#: Share of the motion that roll-outs miss where they do not follow it.
POOR = 0.2

#: Logs in which a joint moves by less than this share of its most motion are not looked at one by one, and logs named.
_MOVES, _NAMED = 0.25, 3

#: First words of what is said then.
MISSED = "roll-outs miss"

#: Share of the samples in motion with the drive on whose duty is at its limit, from which that is told as the cause.
_LIMITED = 0.75

#: An angle of the encoder's zero is told where it leaves this share of the error of the torques at most.
_EXPLAINS = 0.5

#: Angles of the encoder's zero that are tried, and delay in s of the torques there.
_ANGLES, _DELAY_S = 144, 0.01

_COLUMNS = ("full_torque", "back_emf", "viscous", "coulomb", "armature")


def poor_fit(data: JointData, parameters: Array) -> str:
    """Return that roll-outs of the training logs do not follow them, and what to check; empty where they do.

    Args:
        data: The joint.
        parameters: Shape (COUNT,).
    """
    moved = np.array([float(np.mean(np.abs(one.q - np.mean(one.q))[one.used])) for one in data.train])
    errors = mean_errors(data.train, parameters)
    looked = moved >= _MOVES * moved.max()
    bad = looked & (errors > POOR * moved)
    if not bad.any():
        return ""
    if 2 * bad.sum() <= looked.sum():
        return _unlike(data, bad, errors / np.maximum(moved, 1e-9))
    share = float(errors.sum() / max(moved.sum(), 1e-9))
    missed, limited = f"{MISSED} {100 * min(share, 9.99):.0f} % of the motion", _limited(data)
    if limited > _LIMITED:
        return (
            f"{missed}: by kp and the drive law the duty is at its limit in {100 * limited:.0f} % of it; correct kp, "
            "error_gain and limit, or log slower and smaller motions, or a lower kp"
        )
    angle = _zero(data)
    told = f" (the weight fits about {angle:.2f} rad more)" if angle else ""
    return (
        f"{missed}: check the angle where the encoder reads 0{told}, log: {{zero: [...]}}, the direction of the axis "
        "in the robot model, law and kp"
    )


def _unlike(data: JointData, bad: BoolArray, shares: Array) -> str:
    """Return which logs roll-outs do not follow where they follow most, and what to state; each array (logs,)."""
    found = np.flatnonzero(bad)
    names = [Path(data.train[k].name).name for k in found[:_NAMED]]
    more = f", {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    most = 100 * min(float(shares[found].max()), 9.99)
    return (
        f"roll-outs do not follow {len(found)} of {len(bad)} logs ({', '.join(names)}{more}; up to {most:.0f} % of "
        "the motion missed): was the drive off in a part (servo: {enabled: COLUMN}), another gain set, a load carried, "
        "the motor hot? State it, or leave these logs out"
    )


def _limited(data: JointData) -> float:
    """Return the share of the samples in motion with the drive on whose duty is at its limit."""
    moving = [(np.abs(one.motion.dq[:, one.joint]) > REST) & (one.on > 0.5) for one in data.rows]
    near = [duty_of(one, _DELAY_S, np.inf)[1] for one in data.rows]
    return float(np.concatenate(near)[np.concatenate(moving)].mean()) if any(map(np.any, moving)) else 0.0


def _zero(data: JointData) -> float:
    """Return the angle in rad at which the weight fits the torques best; 0 where none is clearly better than 0.

    Bias torque and its derivative along the motion give it at any other zero: b(q + d) = b(q) cos d + b'(q) sin d.
    """
    blocks = [_block(one) for one in data.rows]
    matrix, target, bias, slope = (np.concatenate([block[k] for block in blocks]) for k in range(4))
    if len(target) < len(_COLUMNS) + 3:
        return 0.0
    factor = np.asarray(np.linalg.qr(np.column_stack([matrix, target, bias, slope]), mode="r"))
    matrix, target, bias, slope = factor[:, :-3], factor[:, -3], factor[:, -2], factor[:, -1]
    angles = np.linspace(-np.pi, np.pi, _ANGLES, endpoint=False)
    errors = []
    for angle in angles:
        own = target + (np.cos(angle) - 1.0) * bias + np.sin(angle) * slope
        errors.append(nnls(matrix, own)[1] / np.linalg.norm(own))
    best = int(np.argmin(errors))
    return float(angles[best]) if errors[best] < _EXPLAINS * errors[_ANGLES // 2] else 0.0


def _block(rows: StartRows) -> tuple[Array, Array, Array, Array]:
    """Return columns, target, bias torque and its derivative of a log, in motion and not saturated."""
    duty, near = duty_of(rows, _DELAY_S, np.inf)
    keep = (np.abs(rows.motion.dq[:, rows.joint]) > REST) & ~near
    rows.fixed.pop("full_torque", None)
    columns = np.column_stack([rows.column(name, duty, 0.0) for name in _COLUMNS])
    rows.fixed.pop("full_torque", None)
    bias, slope = rows.motion.filtered(-rows.external), rows.motion.filtered(rows.slope)
    return columns[keep], rows.target[keep], bias[keep], slope[keep]
