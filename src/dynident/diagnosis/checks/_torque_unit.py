"""Torques in another unit: what they are called, when joints ask for one factor, and what to do about it."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.case.evidence.torques import OFF
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.finding import CONSEQUENCES
from dynident.diagnosis.new_log import IN_MEMORY
from dynident.identification.problem.regressor_stream import motion_of

#: Correlation with the torque of the robot model's masses from which it has their shape for certain.
SURE = 0.9

#: Units of torques and their size in N m; factor within which the masses ask for one.
TORQUES = (("N mm", 1e-3), ("N cm", 1e-2), ("kgf cm", 0.0980665), ("lbf in", 0.112985), ("kgf m", 9.80665))
NEAR = 1.6

#: Name of the finding of torques in another unit, and what follows from it.
UNIT = "torque unit"
OF_UNIT = tuple(name for name in CONSEQUENCES if name != UNIT)

#: Factor within which the joints ask for one scale: a wrong unit leaves 1.01, one body ten times too heavy 1.5.
ONE_SCALE = 1.3

#: Times by which a load that is not known, of the arm's own weight at its end, makes torques larger: thrice.
LOADED = 3.0

#: Factor against the masses of the robot model beyond which the unit is wrong for certain: no robot model is off by as
#: much.
FAR_OFF = 20.0

#: Share of a joint's torque below which what no rotor makes of it tells nothing.
LEAST = 0.1


def are_alike(fit: QuickFit, ratios: Array) -> bool:
    """Return whether most joints ask for one factor: one wrong body, or masses that are guessed, ask for several.

    A load that is not known, of up to the arm's own weight, makes torques larger, and may do so at all joints alike.
    """
    logs = np.log(ratios[np.isfinite(ratios)])
    if len(logs) < max(3, fit.moves.sum() / 2) or not np.ptp(logs) < np.log(ONE_SCALE):
        return False
    return not 0.0 < float(np.median(logs)) < np.log(LOADED * OFF)


def other_unit(fit: QuickFit, ratio: float) -> str:
    """Return what to do about torques that are so many times those of known bodies."""
    kinds = {joint.kind for joint in fit.model.robot.active}
    word = "SI" if len(kinds) > 1 else "N" if kinds == {"prismatic"} else "N m"
    near = [
        f"{name}, torque = torque * {size:g}"
        if fit.log.source.path in IN_MEMORY
        else f"{name}, log: units: {{torque: {'mN m' if (size, word) == (1e-3, 'N m') else f'{size:g} {word}'}}}"
        for name, size in TORQUES
        if 1 / NEAR < size * ratio < NEAR
    ]
    return (
        f"another unit ({' or '.join(near) or 'log: units'}), torques of the other side of the gears (log: side), or "
        "currents or percent read as torques? name them so (log: columns: current and drives: gain)"
    )


def beyond_rotors(fit: QuickFit, torque: Array) -> Array:
    """Return torques (N, n) less what a constant and an inertia of each drive alone, as of a rotor, would take of them.

    Torques of an axis that carries no weight may be several times those of its links by its rotor.
    """
    motion, found = motion_of(fit.rows.prepared.kept), np.zeros_like(torque)
    for i, (own, mask) in enumerate(zip(np.asarray(motion.ddq).T, fit.rows.masks.T, strict=True)):
        if not mask.any():
            continue
        columns = np.column_stack([np.ones(len(own)), own])[mask]
        left = torque[mask, i] - columns @ np.linalg.lstsq(columns, torque[mask, i])[0]
        found[mask, i] = left * (np.sum(left**2) > LEAST**2 * np.var(torque[mask, i]) * len(left))
    return found
