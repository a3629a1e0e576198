"""A joint that rests against an end stop or an obstacle in spells: its torque then pushes outward, beyond the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.diagnosis.causes.quick_fit import FEWEST_ROWS, QuickFit
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.checks.contact import Contact
from dynident.diagnosis.finding import Finding, Severity, spells_in_words

#: Outward residual in the outermost rows, this share of all, over that of all rows, from which a fit without is made.
FIRST, OUTWARD = 0.03, 1.0

#: Share of the rows that such a fit leaves out, and time in s about them to which a filter spreads them.
MOST, REACH_S = 0.3, 0.2

#: Residual at the stop over that of the rest of the joint, mean outward residual over it, and least share of the rows
#: there that are apart by themselves: so many times the rest, and so large a part of nearly the largest.
APART, ONE_SIDED, EACH, TOGETHER, PART = 8.0, 0.6, 0.6, 2.0, 0.15

#: Least residual there over the deviation of the joint's torque, and over its Coulomb friction, which holds at rest.
LARGE, FRICTION = 0.1, 2.0

#: Largest depth of the spells, as a share of the joint's travel, and fewest spells: one is a contact.
DEPTH, SPELLS = 0.1, 2

#: Times by which the joint's residual variance elsewhere falls without these rows, from which the result is wrong.
SPOILED, WORSE = 2.0, 1.1


@dataclass(frozen=True)
class _Stop:
    """Where a joint stands.

    Attributes:
        joint: Its number.
        side: 1 at the upper end of its travel, -1 at the lower.
        bound: Position in rad or m beyond which all these rows are.
        rows: Which of the kept rows, shape (N,).
        push: Mean outward torque there that the model has not, in N m or N.
        ratio: Residual there over that of the joint's other rows.
        fall: Residual variance of its other rows with the rows in the fit, over that without.
    """

    joint: int
    side: float
    bound: float
    rows: BoolArray
    push: float
    ratio: float
    fall: float


@dataclass(frozen=True)
class EndStop(Check):
    """A joint at the end of its travel, in spells, with a residual that points outward and is far above the rest."""

    stage: ClassVar[int] = 2

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        fit = subject.fit
        if fit is None:
            return []
        stops = (_stop(fit, int(k), side) for k in np.flatnonzero(fit.moves) for side in (1.0, -1.0))
        return [_finding(subject, fit, stop) for stop in stops if stop is not None]


def _finding(subject: CheckedLog, fit: QuickFit, stop: _Stop) -> Finding:
    joint = fit.model.robot.active[stop.joint]
    unit, effort = ("rad", "N m") if joint.kind == "revolute" else ("m", "N")
    spans = subject.spans(fit, stop.rows, REACH_S, REACH_S)
    end, way = ("upper", "beyond") if stop.side > 0 else ("lower", "below")
    evidence = (
        f"it stands at {stop.bound:.4g} {unit}, the {end} end of its travel, in {len(spans)} spells, and pushes "
        f"outward with {stop.push:.3g} {effort} that the model does not explain, {stop.ratio:.0f} times its residual "
        f"elsewhere: {spells_in_words(spans, 6)} after the start"
    )
    beside = [(max(first - REACH_S, 0.0), last + REACH_S) for first, last in spans]
    remedy = (
        f"it rests against an end stop or an obstacle {way} {stop.bound:.4g} {unit}: keep motions away, and "
        f"{subject.without(fit, beside)}"
    )
    severity: Severity = "error" if stop.fall >= SPOILED else "warning" if stop.fall >= WORSE else "note"
    numbers = {"position": stop.bound, "push": stop.push, "ratio": stop.ratio, "fall": stop.fall}
    numbers |= {"first": spans[0][0], "last": spans[-1][1], "share": float(np.mean(stop.rows))}
    return Finding(severity, "end stop", joint.name, evidence, remedy, numbers, (*Contact.explains, "contact"))


def _stop(fit: QuickFit, joint: int, side: float) -> _Stop | None:
    """Return where a joint stands against an end of its travel; None where it does not."""
    counts, places = fit.rows.masks[:, joint], side * np.asarray(fit.rows.prepared.kept.q)[:, joint]
    whole = side * fit.residual[:, joint]
    first = places >= np.quantile(places, 1.0 - FIRST)
    if np.mean(whole[first]) < OUTWARD * np.sqrt(np.mean(whole[counts] ** 2)):
        return None
    beyond, rest, residual = places >= np.quantile(places, 1.0 - MOST), counts, whole
    outside = friction = least = 0.0
    for _ in range(3):  # from a wide guess of the rows to those that are apart
        rest = counts & ~_near(fit, beyond)
        if rest.sum() < FEWEST_ROWS:
            return None
        residual, friction = _without(fit, joint, rest)
        residual = side * residual
        outside = max(float(np.sqrt(np.mean(residual[rest] ** 2))), 1e-300)
        least = max(TOGETHER * outside, PART * float(np.quantile(residual[beyond], 0.9)))
        apart = beyond & (residual > least)
        if not apart.any():
            return None
        beyond = places >= np.quantile(places[apart], 0.05)
    inside = residual[beyond]
    size, push = float(np.sqrt(np.mean(inside**2))), float(np.mean(inside))
    scale = float(np.std(fit.rows.torque[rest, joint]))
    spells = 1 + np.count_nonzero(np.diff(np.asarray(fit.rows.prepared.kept.time)[beyond]) > REACH_S)
    deep = np.ptp(places[beyond]) > DEPTH * np.ptp(places)
    if deep or spells < SPELLS or np.mean(inside > least) < EACH or push < ONE_SIDED * size:
        return None
    if size < APART * outside or push < max(LARGE * scale, FRICTION * friction):
        return None
    fall = float(np.mean(whole[rest] ** 2)) / outside**2
    return _Stop(joint, side, float(side * places[beyond].min()), beyond, push, size / outside, fall)


def _near(fit: QuickFit, rows: BoolArray) -> BoolArray:
    """Return rows (N,) and those about them to which a filter spreads what they have."""
    time = np.asarray(fit.rows.prepared.kept.time)
    count = np.concatenate([[0], np.cumsum(rows)])
    ends: IntArray = np.searchsorted(time, [time - REACH_S, time + REACH_S])
    return count[ends[1]] > count[ends[0]]


def _without(fit: QuickFit, joint: int, rest: BoolArray) -> tuple[Array, float]:
    """Return a joint's residual (N,) under a fit with these of its rows (N,) alone, and its Coulomb friction there."""
    masks = np.array(fit.rows.masks)
    masks[:, joint] = rest
    solved = fit.solve(fit.products_of(replace(fit.rows, masks=masks)))
    name = fit.model.robot.joint_names[joint]
    symbols = {c.symbol for part in fit.model.friction for c in part.coefficients if c.in_simulators == "friction"}
    own = [fit.base.parameters[index] for index in fit.base.independent]
    dry = [solved.beta[k] for k, one in enumerate(own) if one.owner == name and one.symbol in symbols]
    return fit.residual_of(fit.rows, solved.beta)[:, joint], float(np.abs(dry).sum())
