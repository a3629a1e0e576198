"""A residual that is constant: the zero of torque sensors, or the offset of friction, is another one than in training.

A load, another robot or unit and a motion beyond the training range change the residual along the motion as well. So it
is told only where what is left beside the constants is that of the fit, in all joints that move.
"""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.identification.estimate.estimate import Estimate

#: Share of the squares of a joint's residual from which a constant explains most of it.
MOST = 0.5

#: Share of a joint's torque (rms) from which a constant matters.
MATTERS = 0.05

#: Residual beside the constant over that of the fit, up to which it is as in the fit.
AS_IN_THE_FIT = 1.5

#: Standard deviations of a constant from which it is one: of the parameters, and of the means of so many parts.
SURE, PARTS = 3.0, 10

#: Joints that are named, those with the largest constants beside their residual in the fit.
NAMED = 3

#: Samples in motion below which nothing is said of a joint.
FEW = 100


def constant_residual(
    estimate: Estimate, measured: Array, predicted: Array, dq: Array, standstill: float, deviations: Array | None = None
) -> str:
    """Return in words which joints have a constant residual that the fit had not; empty for none.

    Args:
        estimate: The estimate.
        measured: Torque, shape (N, n), in N m or N.
        predicted: That of the model, shape (N, n).
        dq: Velocities, shape (N, n).
        standstill: Speed below which a joint rests, in rad/s or m/s; friction holds any torque there.
        deviations: Standard deviation of the torque of the model by its parameters, shape (N, n).
    """
    found, slides = list[tuple[float, str]](), False
    for i, (joint, fit) in enumerate(zip(estimate.model.robot.active, estimate.train.moving, strict=True)):
        moves = np.abs(dq[:, i]) > standstill
        values = (measured - predicted)[moves, i]
        if len(values) < FEW or not fit.rmse > 0:
            continue
        size = float(np.sqrt(np.mean(measured[moves, i] ** 2)))
        mean, rest = float(np.mean(values)), float(np.std(values))
        if rest > AS_IN_THE_FIT * fit.rmse:
            return ""
        means = np.std([part.mean() for part in np.array_split(values, PARTS)], ddof=1) / np.sqrt(PARTS)
        own = 0.0 if deviations is None else float(np.sqrt(np.mean(deviations[moves, i] ** 2)))
        is_sure = abs(mean) > max(fit.rmse, MATTERS * size, SURE * float(np.hypot(means, own)))
        if is_sure and mean**2 > MOST * (mean**2 + rest**2):
            found.append((abs(mean) / fit.rmse, f"{joint.name} {mean:.2g} {joint.unit}"))
            slides |= joint.kind == "prismatic"
    if not found:
        return ""
    names = ", ".join(name for _, name in sorted(found, reverse=True)[:NAMED])
    more = f" and {len(found) - NAMED} more" if len(found) > NAMED else ""
    load = ", on a vertical slide a load as well" if slides else ""
    what = f"zero of the torque sensors, or offset of friction, not that of the training{load}"
    return f"residual mostly constant ({names}{more}): {what}; zero the sensors, or train on a log of that day"
