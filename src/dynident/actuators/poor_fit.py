"""Roll-outs that do not follow their logs, and the likely cause: a gain that is not so large."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import nnls

from dynident.actuators.joint_fit import JointData
from dynident.actuators.linear_start import StartRows, duty_of, has_weight
from dynident.actuators.rollout import encoder_step, mean_errors
from dynident.arrays import Array, BoolArray

#: Share of the motion that roll-outs miss where they do not follow it.
POOR = 0.2

#: A log with an error of this many medians is unlike the others, from this share of the motion on.
_MEDIANS, _LEAST = 5.0, 0.02

#: Logs named.
_NAMED = 3

#: First words of what is said then.
MISSED = "roll-outs miss"

#: First word of what is said of test logs whose position gain is outside those of the training logs.
EXTRAPOLATION = "extrapolation"

#: A cause is told where it leaves this share of the error of the torques at most.
_EXPLAINS = 0.5

#: Delay in s of the torques that is assumed.
_DELAY_S = 0.01

#: Place of the limit of the duty among the numbers of a drive law.
_MOST = 1

_COLUMNS = ("full_torque", "back_emf", "viscous", "coulomb", "armature")


def poor_fit(data: JointData, parameters: Array) -> str:
    """Return that roll-outs of the training logs do not follow them, and what to check; empty where they do.

    Args:
        data: The joint.
        parameters: Shape (COUNT,).
    """
    train = [one for one in data.train if not one.is_held] or data.train
    moved = np.array([float(np.mean(np.abs(one.q - np.mean(one.q))[one.used])) for one in train])
    errors = mean_errors(train, parameters)
    step = encoder_step(train)
    bad = errors > POOR * moved + step / 4.0  # the mean error of a reading by the encoder's step alone
    bad |= errors > np.maximum(_MEDIANS * np.median(errors), _LEAST * moved + step)
    if not bad.any():
        return ""
    if 2 * bad.sum() <= len(train):
        return _unlike([one.name for one in train], bad, errors / np.maximum(moved, 1e-9))
    share = float(errors.sum() / max(moved.sum(), 1e-9))
    missed, (limited, is_told) = f"{MISSED} {100 * min(share, 9.99):.0f} % of the motion", _limited(data)
    at_limit = f"by kp and the drive law the duty is at its limit in {100 * limited:.0f} % of it"
    if is_told:
        return f"{missed}: {at_limit}, by the torques it is not; correct kp, error_gain and limit"
    return (
        f"{missed}: check the angle where the encoder reads 0, log: {{zero: [...]}}, the direction of the axis "
        f"in the robot model and of the commands, law and kp{f' ({at_limit})' if limited else ''}"
    )


def unseen_weight(data: JointData) -> tuple[str, ...]:
    """Return that logs show no weight of a joint on which the robot model hangs one; nothing where it has none."""
    if not has_weight(data.rows):
        return ()
    weight = max(float(np.abs(one.external).max()) for one in data.rows)
    return (
        f"the robot model hangs a weight of up to {weight:.2g} N m on it, of which logs show none: friction hides it, "
        "or the direction of its axis, the angle where its encoder reads 0 (log: zero) or gravity is another",
    )


def _unlike(logs: Sequence[str], bad: BoolArray, shares: Array) -> str:
    """Return which logs roll-outs do not follow where they follow most, and what to state; each array (logs,)."""
    found = np.flatnonzero(bad).tolist()
    names = [Path(logs[k]).name for k in found[:_NAMED]]
    more = f", {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    most = 100 * min(float(shares[found].max()), 9.99)
    return (
        f"roll-outs do not follow {len(found)} of {len(bad)} logs ({', '.join(names)}{more}; up to {most:.0f} % of "
        "the motion missed): was the drive off in a part (servo: {enabled: COLUMN}), another gain set, a load carried, "
        "an end stop reached, the motor hot? State it. If not, the logs are right and the model lacks something: wrong "
        "masses (bodies: plausible finds them), another drive law or friction"
    )


def _limited(data: JointData) -> tuple[float, bool]:
    """Return the share of the samples at the limit of the duty, and whether a duty without one explains the torques.

    The share is of samples in motion with the drive on; explained are the torques where much less of them is left.
    """
    (matrix, target), limited = _rows(data.rows)
    if len(target) < len(_COLUMNS) + 3:
        return limited, False
    free = [replace(one, law=np.where(np.arange(4) == _MOST, np.inf, one.law), fixed={}) for one in data.rows]
    return limited, bool(nnls(*_rows(free)[0])[1] < _EXPLAINS * nnls(matrix, target)[1])


def _rows(rows: Sequence[StartRows]) -> tuple[tuple[Array, Array], float]:
    """Return columns and target in motion, (K, 5) and (K,), and the share at the limit."""
    blocks, near = [], []
    for one in rows:
        duty, is_near = duty_of(one, _DELAY_S, np.inf)
        moves = np.abs(one.motion.dq[:, one.joint]) > one.rest
        one.fixed.pop("full_torque", None)
        columns = np.column_stack([one.column(name, duty, 0.0) for name in _COLUMNS])
        one.fixed.pop("full_torque", None)
        blocks.append((columns[moves], one.target[moves]))
        near.append(is_near[moves & (one.on > 0.5)])
    share = np.concatenate(near)
    matrix, target = (np.concatenate(part) for part in zip(*blocks, strict=True))
    return (matrix, target), float(share.mean()) if len(share) else 0.0
