"""Scale of the torques: one joint against the others, and all against the masses of the description."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.data.evidence.torques import EXPLAINED, agrees, scale_against
from dynident.diagnosis.causes.column_readings import best_scale, variance_falls
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding
from dynident.identification.problem.regressor_stream import motion_of

#: Gain of the score from which one torque has another scale, and the least factor told.
GAIN, FACTOR = 1.5, 1.25


@dataclass(frozen=True)
class TorqueScale(Check):
    """Gear ratios, gains and units of the torques, and inverted gravity."""

    stage: ClassVar[int] = 2

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        fit = subject.fit
        if fit is None:
            return []
        return [*_one_joint(fit), *_all_joints(fit)]


def _one_joint(fit: QuickFit) -> list[Finding]:
    """Return the joint whose torque fits the others best with another scale; residuals are compared in its own."""
    gain, factor, name = best_scale(fit)
    if gain < GAIN or max(factor, 1 / factor) < FACTOR:
        return []
    evidence = f"with its torque multiplied by {factor:.3g}, {variance_falls(gain)}"
    remedy = (
        "check gear ratio, gain and unit (drives: {JOINT: {gain: ...}}; log: units: {torque: [...]}), and the "
        "kinematic coupling of the drives (coupling)"
    )
    return [Finding("warning", "torque scale", name, evidence, remedy, {"factor": factor, "gain": gain})]


def _all_joints(fit: QuickFit) -> list[Finding]:
    theta = fit.model.nominal()
    if theta is None:
        return []
    ratio, alike = _against_nominal(fit, theta)
    if alike**2 < EXPLAINED:
        return []
    if alike < 0:
        gravity = ", ".join(f"{value + 0.0:.3g}" for value in -np.asarray(fit.model.robot.gravity))
        evidence = (
            f"the robot model's masses give the opposite torque under the stated gravity (correlation {alike:.3f})"
        )
        remedy = f"mounted upside down? state it (gravity: [{gravity}] in the frame of the base)"
        return [Finding("warning", "mounting", "", evidence, remedy, {"correlation": alike})]
    if agrees(ratio):
        return []
    evidence = f"the robot model predicts {1 / ratio:.3g} times the measured torques (correlation {alike:.3f})"
    remedy = (
        "currents or percent read as torques? name them so (log: columns: current and drives: gain, or log: units: "
        "torque)"
    )
    return [Finding("warning", "torque unit", "", evidence, remedy, {"ratio": ratio, "correlation": alike})]


def _against_nominal(fit: QuickFit, theta: Array) -> tuple[float, float]:
    """Return scale and correlation of the fitted torque of the bodies against that of the description."""
    bodies = np.array(theta)
    bodies[fit.model.inertial_count :] = 0.0
    nominal = fit.model.torque(motion_of(fit.rows.prepared.kept), bodies)
    fitted = np.stack(
        [
            block[:, inertial] @ fit.plain.beta[own][inertial]
            for block, own in zip(fit.rows.blocks, fit.rows.columns, strict=True)
            for inertial in [fit.base.independent[own] < fit.model.inertial_count]
        ],
        axis=1,
    )
    return scale_against(nominal - nominal.mean(axis=0), fitted - fitted.mean(axis=0))
