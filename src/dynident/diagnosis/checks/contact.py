"""A short part of a log that torques from outside have spoiled: a contact, a crash, a hand on the arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.log import Log
from dynident.diagnosis.causes.quick_fit import FEWEST_ROWS, QuickFit
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import CONSEQUENCES, UNLIKE_OTHERS, Finding, Severity, listed, spells_in_words
from dynident.identification.problem.regressor_stream import motion_of

#: Length of a window in s, shares of all windows that may be left out, in few parts or else in one, and fits by which
#: they are found.
WINDOW_S, MOST, MOST_OF_ONE, FITS = 0.25, 0.05, 0.2, 6

#: Time in s at either end of such a part that belongs to it: less of it shows there.
REACH_S = 0.1

#: Parts that follow each other at most, of those far apart from the rest, and times of the rest's speed up to which
#: they are alike in motion: where a log is at rest but for a few samples, these are its motion.
PARTS, PARTS_FAR_APART, SWIFT = 3, 8, 3.0

#: Share of its usual speed, weighted by the residual, below which a joint rests and dry friction holds it.
RESTS = 0.4

#: Least residual there, over the deviation of the torque: less is no contact that matters.
LARGE = 0.1

#: Root mean square residual of a part over that of the rest from which it is apart; share of the largest such ratio
#: from which it belongs to the same fault, which braking beside a contact does not; the median's for a first look.
APART, ALIKE, LOOK = 6.0, 0.2, 3.0

#: Times by which the residual variance of all other rows is smaller, over the joints, once the windows are left out. Or
#: else share of the squares of a joint's residual in the windows, and residual there over that of the rest: a fit of
#: many rows bends little for a few.
SPOILED, HELD, FAR_APART = 2.0, 0.8, 20.0

#: Estimators for which such a part is no reason to doubt the others.
ROBUST = ("huber", "tukey", "irls", "l1")


@dataclass(frozen=True)
class Contact(Check):
    """Windows whose residual is far above the rest, and without which a fit explains all other rows far better."""

    stage: ClassVar[int] = 2

    #: What such a part looks like besides.
    explains: ClassVar[tuple[str, ...]] = (
        *(name for name in CONSEQUENCES if name != "end stop"),
        *(UNLIKE_OTHERS, "another robot", "torque scale of all", "coupling", "robot model differs"),
    )

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        fit = subject.fit
        tries = [] if fit is None else [_spoiled(fit, MOST, PARTS), _spoiled(fit, MOST_OF_ONE, 1)]
        told = [each for each in tries if each is not None and not _is_of_spikes(subject.sound.log, fit, *each[:2])]
        if fit is None or not told:
            return []
        left_out, ratios, fall = max(told, key=lambda each: each[2])
        spans = subject.spans(fit, left_out, WINDOW_S, REACH_S)
        places = spells_in_words(spans, PARTS_FAR_APART)
        names = [fit.model.robot.joint_names[k] for k in np.flatnonzero(ratios >= max(APART, ALIKE * ratios.max()))]
        evidence = (
            f"{places} after the start the residual is up to {ratios.max():.0f} times that of all other samples; "
            f"fitted without that part, theirs is {np.sqrt(fall):.2g} times smaller"
        )
        remedy = (
            "look at that part (a contact, a crash, a hand on the arm, a load for a while, a fault of the recording): "
            f"{subject.without(fit, spans)}, or state estimator: huber"
        )
        numbers = {"first": spans[0][0], "last": spans[-1][1], "ratio": float(ratios.max()), "fall": fall}
        severity: Severity = "note" if subject.case.estimator.name in ROBUST else "error"
        return [Finding(severity, "contact", listed(names), evidence, remedy, numbers, self.explains)]


def _is_of_spikes(log: Log, fit: QuickFit | None, told: BoolArray, ratios: Array) -> bool:
    """Return whether single samples far off, smeared by the filter, make these rows (N,), at the joint told most."""
    if fit is None or log.torque is None or len(fit.starts) > 1:
        return False
    joint, time = int(np.argmax(ratios)), np.asarray(fit.rows.prepared.kept.time)[told]
    near = np.abs(time[np.clip(np.searchsorted(time, log.time), 0, len(time) - 1)] - log.time) <= WINDOW_S
    torque = np.asarray(log.torque)[near, joint]
    windows = np.lib.stride_tricks.sliding_window_view(torque, 5) if len(torque) >= 5 else np.zeros((0, 5))
    alone = np.abs(windows[:, 2] - np.median(windows, axis=1))
    return bool(np.max(alone, initial=0.0) > np.max(np.abs(fit.residual[told, joint])))


def _spoiled(fit: QuickFit, most: float, parts: int) -> tuple[BoolArray, Array, float] | None:
    """Return rows (N,), each joint's residual there over that of the rest (n,), and the fall of the rest's variance."""
    rows, some = fit.rows, fit.moves
    windows: IntArray = np.unique(np.floor(rows.prepared.kept.time / WINDOW_S), return_inverse=True)[1]
    whole = np.where(rows.masks, fit.residual, np.nan)[:, some]
    residual, left_out = whole, np.zeros(len(windows), bool)
    for _ in range(FITS):
        before, left_out = left_out, _outliers(residual, windows, most)
        if not left_out.any() or np.array_equal(before, left_out):
            break
        rest = fit.solve(fit.products_of(replace(rows, masks=rows.masks & ~left_out[:, None])))
        residual = np.where(rows.masks, fit.residual_of(rows, rest.beta), np.nan)[:, some]
    if not left_out.any():
        return None
    size = np.nanvar(np.where(rows.masks, rows.torque, np.nan)[:, some], axis=0)
    outside, was = (_squares(each[~left_out]) for each in (residual, whole))
    known = np.isfinite(residual[~left_out]).sum(axis=0) >= FEWEST_ROWS
    fall = float(np.exp(np.mean(np.where(known, np.log(was / outside), 0.0))))
    own = np.flatnonzero(left_out)
    each = np.split(own, np.flatnonzero(np.diff(windows[own]) > 1) + 1)
    inside = np.array([_squares(residual[part]) for part in each])
    times = np.where(known & (inside > LARGE**2 * size), np.sqrt(inside / outside), 0.0)
    told, ratios, chosen = np.zeros(len(windows), bool), np.zeros(len(some)), times.max(axis=1)
    chosen = chosen >= max(APART, ALIKE * chosen.max())
    if not chosen.any():
        return None
    told[np.concatenate([part for part, is_one in zip(each, chosen, strict=True) if is_one])] = True
    ratios[some] = times[chosen].max(axis=0)
    joint = int(np.argmax(ratios[some]))
    held = np.nansum(whole[told, joint] ** 2) / np.nansum(whole[:, joint] ** 2)
    is_far = held >= HELD and ratios.max() >= FAR_APART
    if not is_far and fall < SPOILED:
        return None
    speed = np.abs(motion_of(rows.prepared.kept).dq)[:, np.flatnonzero(some)[joint]]
    there = np.nansum(residual[told, joint] ** 2 * speed[told]) / np.nansum(residual[told, joint] ** 2)
    is_far &= bool(there > RESTS * np.median(speed))  # at rest dry friction holds what the motor asks for
    kept, most_parts = (told, PARTS_FAR_APART) if is_far else (told if parts == 1 else left_out, parts)
    return (told, ratios, fall) if _is_alike_in_motion(fit, kept, windows, most_parts) else None


def _is_alike_in_motion(fit: QuickFit, left_out: BoolArray, windows: IntArray, parts: int) -> bool:
    """Return whether rows (N,) are few parts of a log that moves as fast without them."""
    speed = np.abs(motion_of(fit.rows.prepared.kept).dq)
    speed = (speed / np.maximum(speed.max(axis=0), 1e-300)).max(axis=1)
    each = np.bincount(windows, speed) / np.bincount(windows)
    inside = np.unique(windows[left_out])
    rest = np.median(np.delete(each, inside))
    apart = np.sum(np.diff(inside) > (2 if parts == 1 else 1))  # one window of a long part may be as the rest by chance
    return bool(apart < parts and np.mean(each[inside]) <= SWIFT * rest)


def _squares(residual: Array) -> Array:
    """Return the mean squares of the rows that count, shape (k,), of no rows next to nothing."""
    count = np.maximum(np.isfinite(residual).sum(axis=0), 1)
    return np.maximum(np.nansum(residual**2, axis=0) / count, 1e-300)


def _outliers(residual: Array, windows: IntArray, most: float) -> BoolArray:
    """Return the rows of windows, no more than may be left out, whose residual is far above that of the others (N,)."""
    scaled = residual**2 / np.maximum(np.nanmedian(residual**2, axis=0), 1e-300)
    count = np.bincount(windows)
    size = np.sqrt(np.bincount(windows, np.nanmax(np.nan_to_num(scaled), axis=1)) / count)
    order = np.argsort(size)[::-1][: int(most * len(size))]
    far = order[size[order] > LOOK * np.median(size)]
    return np.isin(windows, far)
