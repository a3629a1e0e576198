"""Positions against the limits of their joints, joints that do not move, and commanded positions."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.data.log import smallest_step
from dynident.model.joint import Joint

#: How far a joint may leave its limits, in rad or m.
SLACK = 0.05

#: A joint that travels less than this, in rad or m, over a whole log does not move.
STILL = 1e-3

#: Positions of a joint without limits beyond these, in rad and m, are of another unit: three turns, ten metres.
LARGEST_TURN, LARGEST_SLIDE = 6 * np.pi, 10.0

#: Travel in rad and m over a whole log below which the unit of a joint's positions may be another.
LITTLE_TURN, LITTLE_SLIDE = 0.2, 5e-3

#: Positions of fewer values than this over their range say little of a motion.
FEW_VALUES = 64

#: Share of its range that a joint passes from one sample to the next where it jumps; no motion is sampled so coarsely.
JUMP = 0.1

#: Root mean square of q - q_ref as a share of the motion's own above which a joint does not follow.
STRAYS = 0.2


def turns_into_limits(joint: Joint, low: float, high: float) -> float:
    """Return the whole turns, in rad, that bring a range of positions nearest to the middle of the joint's limits."""
    middle = 0.5 * (joint.limits.lower + joint.limits.upper)
    return 2 * np.pi * round((middle - 0.5 * (low + high)) / (2 * np.pi)) if np.isfinite(middle) else 0.0


def is_within(joint: Joint, low: float, high: float) -> bool:
    """Return whether a range of positions in rad or m is within the limits of a joint."""
    return low >= joint.limits.lower - SLACK and high <= joint.limits.upper + SLACK


def is_plausible(joint: Joint, low: float, high: float) -> bool:
    """Return whether a range of positions can be in rad or m: within the limits; not too far where there are none."""
    if np.isfinite(joint.limits.lower) or np.isfinite(joint.limits.upper):
        return is_within(joint, low, high)
    return max(abs(low), abs(high)) <= (LARGEST_TURN if joint.kind == "revolute" else LARGEST_SLIDE)


def travel(q: Array) -> Array:
    """Return how far each joint travels, shape (n,), single values far off left out."""
    return np.quantile(q, 0.995, axis=0) - np.quantile(q, 0.005, axis=0)


def steps(column: Array) -> bool:
    """Return whether a position (N,) stands at a few values, each many times, and jumps from one to another."""
    values = np.unique(column)
    if not 1 < len(values) < min(FEW_VALUES, len(column) / 4):
        return False
    return bool(np.abs(np.diff(column)).max() >= JUMP * (values[-1] - values[0]))


def strays(q: Array, q_ref: Array) -> BoolArray:
    """Return which joints do not follow their commanded positions, shape (n,)."""
    return np.sqrt(np.mean((q - q_ref) ** 2, axis=0)) > STRAYS * np.maximum(q_ref.std(axis=0), STILL)


def steps_of(column: Array) -> float:
    """Return how many of its smallest steps a signal (N,) spans between its 1st and 99th percentile; 0 for none.

    Infinite where it has no levels (:func:`smallest_step`).
    """
    low, high = np.quantile(column, [0.01, 0.99])
    if high <= low:
        return 0.0
    step = smallest_step(column)
    return float((high - low) / step) if step else np.inf


def rounding_share(time: Array, column: Array, steps: float, cutoff: float) -> float:
    """Return the acceleration that rounding makes over that of a motion, root mean squares, below a cut-off.

    The error of rounding has the variance of a step squared over 12, white up to the rate at which steps are taken
    (Widrow and Kollar 2008); the acceleration is the squared speed over the deviation, as of one harmonic.

    Args:
        time: In s, shape (N,).
        column: Positions, shape (N,).
        steps: Steps that they span between the 1st and the 99th percentile.
        cutoff: In Hz.
    """
    low, high = np.quantile(column, [0.01, 0.99])
    rate, step = 1.0 / float(np.median(np.diff(time))), float(high - low) / steps
    lag = min(max(1, round(rate / (2.0 * cutoff))), len(column) - 1)
    speed = float(np.sqrt(np.mean((column[lag:] - column[:-lag]) ** 2))) * rate / lag
    taken = max(min(rate, speed / step), 2.0 * cutoff)
    noise = step / np.sqrt(12.0) * (2.0 * np.pi * cutoff) ** 2 * np.sqrt(2.0 * cutoff / (5.0 * taken))
    return float(noise * np.std(column) / max(speed, 1e-300) ** 2)
