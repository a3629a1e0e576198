"""Torques cut off at a limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding, listed

#: A flat top lasts this many times longer than values within the range do, and at least this many samples.
LONGER, SHORTEST = 6.0, 5

#: A torque counts as at its limit of effort within this share of it, from this share of the rows on. Where as many are
#: beyond the limit by more than the last share, the drive has another one than the description states.
NEAR, AT_LIMIT, BEYOND = 0.005, 0.002, 0.02


@dataclass(frozen=True)
class Saturation(Check):
    """Saturation of the torque by drive, sensor or converter."""

    stage: ClassVar[int] = 1

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        log = subject.sound.log
        if log.torque is None:
            return []
        joints, most = [], 0.0
        for joint, column in zip(subject.case.robot.active, log.torque.T, strict=True):
            share = max(flat_share(column), flat_share(-column))
            share = max(share, limit_share(column, joint.limits.effort))
            if share:
                joints.append(joint.name)
                most = max(most, share)
        if not joints:
            return []
        evidence = f"the torque is constant at its extreme in up to {100 * most:.2g} % of the rows"
        remedy = "leave these rows out, or record a slower motion: the drive was saturated"
        return [Finding("warning", "torque saturation", listed(joints), evidence, remedy, {"share": most})]


def limit_share(column: Array, limit: float) -> float:
    """Return the share of the samples (N,) at a limit of effort; 0 for few, and where the torque goes beyond it."""
    near, beyond = (float(np.mean(np.abs(column) >= part * limit)) for part in (1 - NEAR, 1 + BEYOND))
    return near if near > AT_LIMIT and beyond <= AT_LIMIT else 0.0


def flat_share(column: Array) -> float:
    """Return the share of the samples (N,) in long runs at exactly the highest value; 0 where there are none."""
    top = column == column.max()
    edges = np.diff(np.pad(top.astype(np.int8), 1))
    runs = np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)
    changes = np.count_nonzero(np.diff(column))
    if not changes:
        return 0.0
    usual = (len(column) - top.sum()) / max(changes, 1)  # mean length of a run of equal values below the top
    long = runs[runs >= max(SHORTEST, LONGER * usual)]
    return float(long.sum()) / len(column)
