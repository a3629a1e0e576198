"""Columns of two joints that are the same: one of them was named twice, or written twice by the logger."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding, Severity, listed

#: Signals in which two joints cannot agree in each sample, in words and as keys of the case file; two fingers of a
#: gripper may move alike, but no two sensors have the same noise.
SIGNALS: tuple[tuple[str, str, str, Severity], ...] = (
    ("torque", "torques", "torque", "error"),
    ("current", "currents", "current", "error"),
    ("q", "positions", "q", "warning"),
)


@dataclass(frozen=True)
class EqualColumns(Check):
    """Torques, currents or positions of two joints that are equal in all samples."""

    stage: ClassVar[int] = 0

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        log = subject.sound.log
        found = []
        for name, words, key, severity in SIGNALS:
            for joints in _equal(log.joints, log.signals().get(name)):
                evidence = f"the {words} of these joints are the same in all {log.samples} samples"
                remedy = f"name the own column of each joint (log: columns: {key}), or look at what wrote the log"
                found.append(Finding(severity, "equal columns", listed(joints), evidence, remedy))
        return found


def _equal(joints: Sequence[str], values: Array | None) -> Iterator[tuple[str, str]]:
    """Yield pairs of joints whose columns (N, n) vary and are equal."""
    if values is None:
        return
    moving = np.flatnonzero(np.nanmax(values, axis=0, initial=-np.inf) > np.nanmin(values, axis=0, initial=np.inf))
    for i, k in combinations(moving.tolist(), 2):
        if np.array_equal(values[:, i], values[:, k], equal_nan=True):
            yield joints[i], joints[k]
