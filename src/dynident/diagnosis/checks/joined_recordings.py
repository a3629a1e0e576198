"""Recordings joined under one clock: positions of several joints that jump within one step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import CONSEQUENCES, Finding, listed

#: Steps before and after one that say how far a joint moves there, and how many times as far a jump goes at least.
AROUND, FARTHER = 5, 10.0

#: Steps longer than so many median ones are gaps, over which a joint may go anywhere.
GAP = 2.0

#: Speeds of a jump over the usual one (90 % of the steps) of a joint: at least, and where no speed limit matters.
FASTER, FASTEST = 3.0, 10.0

#: Joints that jump at once at least; of one alone its counter may have been reset.
SEVERAL = 2

#: Places that are named at most.
NAMED = 5

#: What jumps make wrong besides.
EXPLAINS = (
    "spikes",
    "velocity scale",
    "velocity lag",
    "velocity mismatch",
    "velocity unit",
    "another robot",
    "mounting",
)


@dataclass(frozen=True)
class JoinedRecordings(Check):
    """Episodes or runs in one log whose clock runs on: no robot moves so far within one step."""

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        log = subject.sound.log
        limits = np.array([joint.limits.velocity for joint in subject.case.robot.active])
        ends, jumps = joined_at(log.time, log.q, limits)
        if not len(ends):
            return []
        names = [name for name, moved in zip(log.joints, np.atleast_1d(jumps.any(axis=0)), strict=True) if moved]
        places = [subject.sound.place(int(row)) for row in ends[:NAMED]]
        more = f" and {len(ends) - NAMED} more" if len(ends) > NAMED else ""
        steps = np.abs(log.q[ends] - log.q[ends - 1])
        place, joint = np.unravel_index(int(np.argmax(np.where(jumps, steps, 0.0))), steps.shape)
        seconds = float(log.time[ends[place]] - log.time[ends[place] - 1])
        unit = "m" if subject.case.robot.active[joint].kind == "prismatic" else "rad"
        evidence = (
            f"positions of several joints jump at once into {', '.join(places)}{more}: {log.joints[joint]} by "
            f"{steps[place, joint]:.3g} {unit} within {seconds:.3g} s, at other speeds before and after"
        )
        remedy = (
            "split the log there and give the recordings as a list of logs (train: [first.csv, second.csv]; in Python "
            "[log1, log2]); spikes, a delay, another robot and wrong masses follow from such jumps"
        )
        numbers = {"places": len(ends), "jump": float(steps[place, joint])}
        return [
            Finding("error", "joined recordings", listed(names), evidence, remedy, numbers, (*EXPLAINS, *CONSEQUENCES))
        ]


def joined_at(time: Array, q: Array, limits: Array | None = None) -> tuple[IntArray, BoolArray]:
    """Return the rows that positions jump into, shape (K,), and which joints do there, shape (K, n).

    A joint jumps where one step goes far beyond what it does in the steps before and after, scaled to the time since
    it moved last, and beyond its usual speed and speed limit. Rows that hold the positions of the row before are left
    out, and so are gaps in time.

    Args:
        time: Time of the rows in s, shape (N,), running forward.
        q: Positions, shape (N, n).
        limits: Speed limit of each joint, shape (n,); values that are not finite or not positive state none.
    """
    none = np.zeros(0, int), np.zeros((0, q.shape[1]), bool)
    rows = np.concatenate([[0], 1 + np.flatnonzero((np.diff(q, axis=0) != 0).any(axis=1))])
    if len(rows) < 2 * AROUND + 2 or q.shape[1] < SEVERAL:
        return none
    moved, seconds = np.abs(np.diff(q[rows], axis=0)), np.diff(time[rows])
    changed = np.maximum.accumulate(np.where(moved > 0, time[rows[1:], None], time[0]), axis=0)
    waited = time[rows[1:], None] - np.vstack([np.full(q.shape[1], time[0]), changed[:-1]])  # since its joint moved
    middle = float(np.median(seconds))
    seconds = np.maximum(seconds, middle)  # a coarse clock makes no speed
    speeds = moved / seconds[:, None]
    usual = np.array([np.quantile(each[each > 0], 0.9) if (each > 0).any() else 0.0 for each in speeds.T])
    fast = FASTER * usual
    if limits is not None:
        stated = np.isfinite(limits) & (limits > 0)
        fast = np.where(stated, np.clip(limits, fast, FASTEST * usual), fast)
    places = np.flatnonzero(((speeds > fast).sum(axis=1) >= SEVERAL) & (np.diff(time)[rows[1:] - 1] <= GAP * middle))
    places = places[(places >= AROUND) & (places < len(moved) - AROUND)]
    around = places[:, None] + np.r_[-AROUND:0, 1 : AROUND + 1]
    allowed = (moved[around] * np.maximum(waited[places, None] / seconds[around][:, :, None], 1.0)).max(axis=1)
    jumps = (moved[places] > FARTHER * allowed) & (speeds[places] > fast)
    several = jumps.sum(axis=1) >= SEVERAL
    return rows[places[several] + 1], jumps[several]
