"""What the masses of the robot model say about the torques or currents of a log: unit, sign, rough gain.

The torque of the robot model is a column beside friction; a joint tells something where that column explains most of
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

#: Share of the variance left by friction that the robot model must explain where its scale says something.
EXPLAINED = 0.5

#: Factor between torques and those of the masses from which a unit is suspected: robot models are off by less.
OFF = 2.5

#: Share of the heaviest mass, and size in m, of which the errors of a body are shares at least.
LIGHT, SMALL = 1e-3, 0.02

#: Samples a second that are enough for this, and rows at most.
_RATE, _ROWS = 50.0, 4000


@dataclass(frozen=True)
class TorqueEvidence:
    """The torque of the robot model beside the log, joint by joint.

    Attributes:
        ratios: Logged torque or current over the robot model's torque, shape (n,).
        shares: Share of what friction leaves of the log that the robot model explains, shape (n,).
        levels: Mean of the log beside the mean of the robot model, by joint: what is constant, shape (n, 2).
    """

    ratios: Array
    shares: Array
    levels: Array

    @property
    def telling(self) -> tuple[bool, ...]:
        """Which joints' ratios say something."""
        return tuple(bool(share >= EXPLAINED) for share in self.shares)


def torque_evidence(robot: Robot, time: Array, q: Array, effort: Array, cutoff_hz: float) -> TorqueEvidence | None:
    """Return what the robot model says about torques or currents; None where it has no masses or the log is too poor.

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
    rows = filtered_rows(robot, time, q, effort, cutoff_hz)
    if rows is None:
        return None
    motion, torque = rows[0].rows(slice(0, _ROWS)), rows[1][:_ROWS]
    dq, described = motion.dq, model.torque(motion, nominal)
    pairs = np.array([_ratio(dq[:, k], described[:, k], torque[:, k]) for k in range(robot.dof)])
    levels = np.column_stack([torque.mean(axis=0), described.mean(axis=0)])
    return TorqueEvidence(pairs[:, 0], pairs[:, 1], levels)


def filtered_rows(robot: Robot, time: Array, q: Array, effort: Array, cutoff_hz: float) -> tuple[Motion, Array] | None:
    """Return motion and torques of a log on equal steps; None where it is too poor for any."""
    try:
        log = Log(robot.joint_names, time, q, torque=effort)
        how = Preprocessing(FILTERS.make("butterworth", {"cutoff_hz": cutoff_hz}), rate_hz=_RATE, longest_gap_s=BRIDGED)
        rows = preprocess(log, how).kept
    except (DynidentError, ValueError):  # the reader of the case says what is wrong with the log
        return None
    if rows.dq is None or rows.ddq is None or rows.torque is None:
        return None
    return Motion(rows.q, np.asarray(rows.dq), np.asarray(rows.ddq)), np.asarray(rows.torque)


def _friction(dq: Array) -> Array:
    """Return the columns of offset, viscous and Coulomb friction at a speed (N,), shape (N, 3)."""
    return np.column_stack([np.ones(len(dq)), dq, np.tanh(dq / 0.02)])


def _ratio(dq: Array, described: Array, logged: Array) -> tuple[float, float]:
    """Return the factor of the robot model's torque beside friction, and the share that it alone explains."""
    friction = _friction(dq)
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


def body_errors(bodies: Array) -> Array:
    """Return the size of an error of one of each parameter of some bodies (l, 10), shape (10 l,).

    Its mass; of first moments mass times size, of moments of inertia mass times size squared, with the radius of
    gyration about the origin of the link's frame for the size.
    """
    mass = np.maximum(bodies[:, -1], LIGHT * bodies[:, -1].max(initial=0.0))
    spread = np.maximum(bodies[:, [0, 3, 5]].sum(axis=1), 0.0) / np.where(mass > 0, mass, 1.0)
    size = np.maximum(np.sqrt(0.5 * spread), SMALL)
    return np.repeat(np.stack([mass * size**2, mass * size, mass], axis=1), [6, 3, 1], axis=1).ravel()
