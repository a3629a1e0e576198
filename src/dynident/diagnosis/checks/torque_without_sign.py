"""Torques whose sign was lost: magnitudes, as of some drives and loggers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.diagnosis.causes.column_readings import GAIN, GOOD, variance_falls
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import CONSEQUENCES, Finding, listed

#: Fits by which signs are looked for at most, and share of the rows whose sign turns from which one was lost.
FITS, TURNED = 8, 0.02

#: What a lost sign looks like besides.
EXPLAINS = (*CONSEQUENCES, "another robot", "torque sign", "torque order", "joint order", "position sign", "coupling")


@dataclass(frozen=True)
class TorqueWithoutSign(Check):
    """Torques that never change sign, and with the sign of what is predicted are explained far better."""

    stage: ClassVar[int] = 2

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        fit, torque = subject.fit, subject.sound.log.torque
        if fit is None or torque is None:
            return []
        one_sided = fit.moves & ((torque.min(axis=0) >= 0.0) | (torque.max(axis=0) <= 0.0))
        if not one_sided.any():
            return []
        signed, turned = with_signs(fit, one_sided)
        lost = (turned > TURNED) & (turned < 1.0 - TURNED)  # all of them: the sign is the other one
        gain = fit.plain.score - signed.plain.score
        if gain < GAIN or not lost.any() or np.any(signed.relative[lost] > GOOD):
            return []
        names = [name for name, is_lost in zip(fit.model.robot.joint_names, lost, strict=True) if is_lost]
        evidence = (
            f"never changes its sign; with the other one in {turned.max():.0%} of the rows, as predicted, "
            f"{variance_falls(gain)}"
        )
        remedy = "log the torque or current with its sign, not its magnitude: no log gives it back for sure"
        numbers = {"gain": gain, "turned": float(turned.max())}
        return [Finding("error", "torque without sign", listed(names), evidence, remedy, numbers, EXPLAINS)]


def with_signs(fit: QuickFit, one_sided: BoolArray) -> tuple[QuickFit, Array]:
    """Return the fit with the signs that it predicts itself at some joints, (n,), and the shares of rows turned (n,).

    The first ones are those of the bodies of the robot model, where these are known.
    """
    rows, theta = fit.rows, fit.model.nominal()
    whole = rows.torque - rows.known
    predicted, signs, found = whole - fit.residual, np.ones_like(whole), fit
    if theta is not None:
        predicted = whole - fit.residual_of(rows, fit.base.from_standard(theta))
    side = np.sign(whole.sum(axis=0))
    for _ in range(FITS):
        before, signs = signs, np.where(one_sided & (predicted * side < 0.0), -1.0, 1.0)
        if np.array_equal(before, signs):
            break
        found = fit.explained_by((1.0 - signs) * rows.torque)
        predicted = found.rows.torque - found.rows.known - found.residual
    return found, np.sum((signs < 0.0) & rows.masks, axis=0) / fit.counts
