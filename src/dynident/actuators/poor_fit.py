"""Roll-outs that do not follow their logs, and the likely cause: the angle at which the encoder reads zero."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from dynident.actuators.joint_fit import JointData
from dynident.actuators.linear_start import REST, StartRows, duty_of
from dynident.actuators.rollout import mean_errors
from dynident.arrays import Array

#: Share of the motion that roll-outs miss where they do not follow it.
POOR = 0.2

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
    moved = [float(np.mean(np.abs(one.q - np.mean(one.q))[one.used])) for one in data.train]
    share = float(np.sum(mean_errors(data.train, parameters))) / max(float(np.sum(moved)), 1e-9)
    if share <= POOR:
        return ""
    angle = _zero(data)
    told = f" (the weight fits about {angle:.2f} rad more)" if angle else ""
    return (
        f"roll-outs miss {100 * min(share, 9.99):.0f} % of the motion: check the angle where the encoder reads 0"
        f"{told}, log: {{zero: [...]}}, the direction of the axis in the robot model, law and kp"
    )


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
