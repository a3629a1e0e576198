"""Signs of all joints at once: of torques, positions or both, or gravity; the log tells them, or known bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynident.arrays import Array, vector_text
from dynident.case.evidence.torques import EXPLAINED
from dynident.diagnosis.causes.column_readings import GAIN, PositionReadings, variance_falls
from dynident.diagnosis.causes.held_out import HeldOutErrors, ReadRows, as_stated
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.several_scales import ALIKE, nominal_agreement
from dynident.diagnosis.finding import CONSEQUENCES, Finding, listed
from dynident.identification.problem.regressor_stream import RegressorStream

#: What a wrong reading of torques makes wrong besides: gravity against the masses of the robot model.
READING_CONSEQUENCES = (*CONSEQUENCES, "mounting")


def driven_joints(positions: PositionReadings, share: Array, z: Array) -> Finding:
    """Return that all torques have the wrong sign, or all positions, as friction drives every joint then.

    Torques of another sign leave as much as before. So positions are at fault where these leave far less with another
    sign, the torques where they leave far more. Where neither is sure, the robot model's bodies tell.
    """
    fit, joints = positions.fit, positions.fit.model.robot.joint_names
    mirrored, errors = positions.mirrored(), HeldOutErrors(fit)
    gain, spread = errors.difference(errors.errors(mirrored), errors.plain)
    evidence = f"friction drives every joint instead of braking it (z-scores {z.min():.0f} to {z.max():.0f})"
    is_mirrored = gain > 0.0
    if abs(gain) > max(GAIN, spread):
        evidence += f"; with all positions turned in place of all torques, {variance_falls(gain)}" * is_mirrored
    else:
        by_torques, by_positions = (
            nominal_agreement(fit, one) for one in (ReadRows(fit.rows, -np.eye(len(joints))), mirrored)
        )
        is_mirrored = by_positions - by_torques > EXPLAINED
        if is_mirrored or by_torques - by_positions > EXPLAINED:
            what, sizes = ("positions", "torques")[not is_mirrored], sorted((by_positions, by_torques))
            evidence += (
                f"; with all {what} turned the torques agree with the robot model's masses (mean correlation "
                f"{sizes[1]:.2f}, else {sizes[0]:.2f})"
            )
        else:
            evidence += "; all positions turned in place of all torques explain the log as well: not distinguishable"
    name = "position sign" if is_mirrored else "torque sign"
    remedy = "negate the columns of the positions" if is_mirrored else "negate the columns of the torques, or the gains"
    explains = tuple(each for each in (*READING_CONSEQUENCES, "axis sign", "joint limits") if each != name)
    return Finding("error", name, listed(joints), evidence, remedy, {"share": float(share.min())}, explains)


def opposite_torques(fit: QuickFit) -> list[Finding]:
    """Return which sign makes torques that run against those of the robot model's masses agree with these."""
    robot, stated = fit.model.robot, as_stated(fit)
    plain = nominal_agreement(fit, stated)
    if not plain < 0.0:
        return []
    mirrored, gravity = PositionReadings(fit).mirrored(), -np.asarray(robot.gravity)
    upside = RegressorStream(replace(fit.model, robot=robot.with_gravity(gravity)), fit.base, any_gravity=True)
    inverted, told = -stated.mixing, vector_text(gravity, 3)
    readings = {
        "mounting": (
            replace(stated, rows=fit.rows_under(upside)),
            f"mounted upside down? state it (gravity: [{told}])",
        ),
        "axis sign": (replace(mirrored, mixing=inverted), "turn the signs of positions and torques, or the axes"),
        "torque sign": (replace(stated, mixing=inverted), "turn the signs of the torques"),
        "position sign": (mirrored, "turn the signs of the positions"),
    }
    found = {name: nominal_agreement(fit, reading) for name, (reading, _) in readings.items()}
    best = max(found.values())
    if best**2 < EXPLAINED or best - plain < EXPLAINED:
        return []
    name, *as_good = (name for name in readings if best - found[name] < ALIKE)
    evidence = (
        f"the torques run against those of the robot model's masses (mean correlation over the joints {plain:.2f}); "
        f"with it they agree ({found[name]:.2f})"
    )
    evidence += f"; not distinguishable from {' or '.join(as_good)}" * bool(as_good)
    joints = "" if name == "mounting" else listed(robot.joint_names)
    explains = (*CONSEQUENCES, *(set(readings) - {name}))
    return [Finding("error", name, joints, evidence, readings[name][1], {"correlation": plain}, explains)]
