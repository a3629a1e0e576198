"""The scale of one joint's positions as an unknown: a wrong gear ratio, or another number of counts a turn.

Positions of another scale bend the motion of all that the joint carries, so straight lines hold near one alone: the log
is read again at each step of Gauss and Newton. Samples that the scale was not found on judge it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from dynident.diagnosis.causes.cause_figures import figure_beside
from dynident.diagnosis.causes.cause_search import CauseSearch
from dynident.diagnosis.causes.column_readings import Interpretation, feeding
from dynident.diagnosis.causes.held_out import HeldOutErrors, ReadRows, as_stated, predicts_unseen
from dynident.diagnosis.causes.model_error import ModelError
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.robot_misfit import GAIN, SURE
from dynident.diagnosis.causes.torque_scales import JointScale, reading_of
from dynident.diagnosis.causes.trend_texts import Z95
from dynident.diagnosis.causes.trends import STRETCH, Trends

#: Steps at most, the one at which they end, and the largest factor of one.
STEPS, SETTLED, LONGEST = 8, 1e-3, 2.0

#: Least share by which positions are off that is told.
LEAST = 0.02


@dataclass(frozen=True)
class PositionScale:
    """What one joint's positions have to be multiplied by.

    Attributes:
        reading: The log so read.
        gain: By how much it predicts unseen samples better, in log variance.
        is_sure: Whether that is far better, and so it is on samples that the scale was not found on.
    """

    reading: Interpretation
    gain: float
    is_sure: bool


def position_scale(fit: QuickFit, joint: str, other: JointScale | None = None) -> PositionScale | None:
    """Return the scale of a joint's positions; None where it is one, or explains the log no better than another cause.

    Args:
        fit: The fit of the log.
        joint: Name of the joint.
        other: Another scale of one joint's torque that explains the log as well, if there is one.
    """
    factor, read = _found(fit, joint)
    trends = Trends(read)
    beside = [blame.cause for blame in trends.blames if blame.cause.name == "friction curve"]
    off, std = figure_beside(trends.rows, beside, trends.stretch(joint), ModelError.of_fit(read))
    factor, half = factor * (1.0 + off), Z95 * float(np.hypot(std, off)) * factor  # friction moves it by as much
    if abs(factor - 1.0) - half < LEAST or feeding(*read.friction_power(read.plain)).any():
        return None
    held, reading = HeldOutErrors(fit), as_stated(read)
    errors = held.errors(reading)
    gain, spread = held.difference(errors, held.plain)
    rival = ""
    if other is not None:
        ahead, doubt = held.difference(errors, held.errors(reading_of(fit, other)))
        if ahead < 0.0:
            return None
        if ahead < doubt:
            whose = "its torque" if other.joint == joint else f"the torque of {other.joint}"
            rival = f" (not distinguishable from {whose} times {other.factor:.3g})"
    evidence = (
        f"by the torques it moves {factor:.{3 if half < 0.05 else 2}g} +- {half:.2g} times as far as its positions say"
        f"{rival}; so read,"
    )
    remedy = "compare its gear ratio, counts a turn and unit with the data sheet"
    numbers = {"value": factor - 1.0, "half_width": half}
    told = Interpretation(
        STRETCH, (joint,), fit.plain.score - read.plain.score, evidence, remedy, reading, numbers, freedom=1
    )
    is_sure = gain > max(GAIN, SURE * spread) and predicts_unseen(fit, partial(_reading, joint=joint))
    return PositionScale(told, gain, is_sure)


def _reading(fit: QuickFit, joint: str) -> ReadRows:
    return as_stated(_found(fit, joint)[1])


def _found(fit: QuickFit, joint: str) -> tuple[float, QuickFit]:
    """Return the factor of a joint's positions that fits best, and the fit of the log so read."""
    place, factor, read = fit.model.robot.joint_names.index(joint), 1.0, fit
    for _ in range(STEPS):
        trends = Trends(read)
        search = CauseSearch(trends.rows, [trends.stretch(joint)], trends.rows.shared)
        share = float(search.fit([0]).beta[-1])
        factor *= float(np.clip(1.0 + share, 1.0 / LONGEST, LONGEST))
        read = fit.stretched(place, factor)
        if abs(share) < SETTLED:
            break
    return factor, read
