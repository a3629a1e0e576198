"""Torques cut off at a limit, and torques that stop changing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.data.log import Log
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding, Severity, listed

#: A torque is held where it repeats one value this long in s while its joint moves by this far in rad or m, and this
#: many times longer than all but one of its other values, which a dead zone of the sensor repeats as well; from this
#: share of the rows on that is an error.
HELD_S, HELD_MOVED, HELD_LONGER, HELD_SHARE = 1.0, 0.02, 10.0, 0.02


@dataclass(frozen=True)
class Saturation(Check):
    """Saturation of the torque by drive, sensor or converter."""

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        log = subject.sound.log
        if log.torque is None:
            return []
        joints, held = list[str](), _held(log, subject.case.robot.joint_names)
        flat = limited = 0.0
        shares = subject.saturated.mean(axis=2).T.tolist()
        for name, (top, bottom, bound) in zip(subject.case.robot.joint_names, shares, strict=True):
            if top or bottom or bound:
                joints.append(name)
                flat, limited = max(flat, top, bottom), max(limited, bound)
        if not joints:
            return held
        where = "at its extreme" if flat >= limited else "within 0.5 % of its limit of effort"
        evidence = f"the torque is constant {where} in up to {100 * max(flat, limited):.2g} % of the rows"
        remedy = "record a slower motion: the drive was saturated; estimator: huber gives these rows little weight"
        numbers = {"share": max(flat, limited)}
        return [*held, Finding("warning", "torque saturation", listed(joints), evidence, remedy, numbers)]


def _held(log: Log, names: Sequence[str]) -> list[Finding]:
    """Return the torques that stop changing while their joints move, as of a channel that died."""
    found = []
    for name, position, column in zip(names, log.q.T, np.asarray(log.torque).T, strict=True):
        edges = np.append(np.flatnonzero(np.diff(column, prepend=np.nan)), len(column))
        runs = np.diff(edges)
        longest = int(np.argmax(runs))
        first, last = edges[longest], edges[longest + 1] - 1
        others = np.sort(np.delete(runs, longest))
        lasts, value = float(log.time[last] - log.time[first]), column[first]
        if lasts < HELD_S or not len(others) or runs[longest] < HELD_LONGER * others[max(len(others) - 2, 0)]:
            continue
        if np.ptp(position[first : last + 1]) < HELD_MOVED or value in {column.min(), column.max()} - {0.0}:
            continue  # at the extreme it is saturated
        share = runs[longest] / len(column)
        evidence = (
            f"its torque is {value:.6g} in all {runs[longest]} rows from {log.time[first]:.6g} s to "
            f"{log.time[last]:.6g} s ({100 * share:.2g} % of the log), while the joint moves"
        )
        remedy = "leave these rows out (a log that ends before, or begins after), and look for the channel that died"
        explains = ("friction drift", "drift", "another robot") if share >= HELD_SHARE else ()
        severity: Severity = "error" if share >= HELD_SHARE else "warning"
        numbers = {"start": float(log.time[first]), "share": float(share)}
        found.append(Finding(severity, "torque held", name, evidence, remedy, numbers, explains))
    return found
