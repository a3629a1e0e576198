"""What the masses of the robot model say about the torques or currents of a log: unit, sign, rough gain, gravity.

The torque of the description is a column beside friction; a joint tells something where that column explains most of
what friction leaves. Nothing is converted by it: it supports a unit, or stands as the likely answer to a question.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import BRIDGED, FILTERS, Preprocessing, preprocess
from dynident.errors import DynidentError
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.robot import Robot

#: Share of the variance left by friction that the description must explain where its scale says something.
EXPLAINED = 0.5

#: Factor between torques and those of the masses from which a unit is suspected: robot models are off by less.
OFF = 2.5

#: Rows a second that are enough for this, and rows at most.
_RATE, _ROWS = 50.0, 4000


@dataclass(frozen=True)
class TorqueEvidence:
    """The torque of the description beside the log, joint by joint.

    Attributes:
        ratios: Logged torque or current over the description's torque, shape (n,).
        shares: Share of what friction leaves of the log that the description explains, shape (n,).
        levels: Mean of the log beside the mean of the description, by joint: what is constant, shape (n, 2).
    """

    ratios: Array
    shares: Array
    levels: Array

    @property
    def telling(self) -> tuple[bool, ...]:
        """Which joints' ratios say something."""
        return tuple(bool(share >= EXPLAINED) for share in self.shares)


def torque_evidence(robot: Robot, time: Array, q: Array, effort: Array, cutoff_hz: float) -> TorqueEvidence | None:
    """Return what the description says about torques or currents; None where it has no masses or the log is too poor.

    Args:
        robot: With the joints of the columns only.
        time: In s, shape (N,).
        q: Positions in rad or m, shape (N, n).
        effort: Torques or currents in the unit of the file, shape (N, n).
        cutoff_hz: Cut-off of the filter.
    """
    model = DynamicModel(robot)
    nominal = model.nominal()
    if nominal is None or not np.any(nominal):
        return None
    try:
        log = Log(robot.joint_names, time, q, torque=effort)
        how = Preprocessing(FILTERS.make("butterworth", cutoff_hz=cutoff_hz), rate_hz=_RATE, longest_gap_s=BRIDGED)
        rows = preprocess(log, how).kept
    except (DynidentError, ValueError):  # the reader of the case says what is wrong with the log
        return None
    if rows.dq is None or rows.ddq is None or rows.torque is None:
        return None
    rows = rows.rows(slice(0, _ROWS), "the first ones")
    q, dq, ddq, torque = rows.q, np.asarray(rows.dq), np.asarray(rows.ddq), np.asarray(rows.torque)
    described = model.torque(Motion(q, dq, ddq), nominal)
    pairs = np.array([_ratio(dq[:, k], described[:, k], torque[:, k]) for k in range(robot.dof)])
    levels = np.column_stack([torque.mean(axis=0), described.mean(axis=0)])
    return TorqueEvidence(pairs[:, 0], pairs[:, 1], levels)


def _ratio(dq: Array, described: Array, logged: Array) -> tuple[float, float]:
    """Return the factor of the description's torque beside friction, and the share that it alone explains."""
    friction = np.column_stack([np.ones(len(dq)), dq, np.tanh(dq / 0.02)])
    left = [x - friction @ np.linalg.lstsq(friction, x, rcond=None)[0] for x in (described, logged)]
    if not float(left[0] @ left[0]) > 1e-12 * max(float(described @ described), 1e-12):
        return float("nan"), 0.0
    ratio, correlation = scale_against(*left)
    return ratio, correlation**2


def scale_against(described: Array, logged: Array) -> tuple[float, float]:
    """Return the scale of a torque against the described one, and their correlation; both less their means."""
    product, size = float(np.sum(described * logged)), float(np.sum(described**2))
    return product / max(size, 1e-300), product / max(float(np.sqrt(size * np.sum(logged**2))), 1e-300)


def agrees(ratio: float) -> bool:
    """Return whether a scale is one that the errors of a robot model explain; its sign counts."""
    return 1 / OFF <= ratio <= OFF
