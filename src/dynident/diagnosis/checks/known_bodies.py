"""The torques against known bodies, of the robot model and of an earlier estimate: a payload, a tilt, a scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynident.case.evidence.torques import OFF, agrees
from dynident.diagnosis.causes.against_bodies import OF_ALL, AgainstBodies
from dynident.diagnosis.causes.cause_search import Blame
from dynident.diagnosis.causes.known_bodies import NominalBodies, nominal_bodies, with_rotors
from dynident.diagnosis.causes.position_spectrum import RIPPLE
from dynident.diagnosis.causes.several_scales import nominal_ratios
from dynident.diagnosis.causes.thin_fit import asked_inertias
from dynident.diagnosis.causes.trend_findings import TOLD, believed, standing, sureness, trend_finding
from dynident.diagnosis.causes.trend_texts import NARROW, TRENDS, Z95
from dynident.diagnosis.causes.trends import DELAY, ELASTIC, HYSTERESIS, SCALE, ZERO, Trends
from dynident.diagnosis.checks._torque_unit import (
    FAR_OFF,
    LOADED,
    OF_UNIT,
    ONE_SCALE,
    UNIT,
    are_alike,
    beyond_rotors,
    other_unit,
)
from dynident.diagnosis.checks._torque_unit import SURE as SURE_OF_SHAPE
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.checks.torque_scale import TorqueScale
from dynident.diagnosis.finding import CLOCKS, Finding, Severity

#: Share of the largest torque of the bodies, or of the torque, from which a cause is a warning, and deviations of its
#: figure, in which the errors of the known bodies count, from which it is one.
MATTERS, SURE = 0.1, 5.0

#: Factor of all torques from which it is told although no residual shows it, and likelihood ratio from which it is sure
#: (chance 0.001 of one question, Wilks 1938).
FAR, SURE_FACTOR = 1.5, 10.8

#: Causes of which free bodies may give the better figure, and those that they give alone: friction, which no known
#: bodies have, passes for a delay or an elastic joint, and errors of a robot model's centres of mass for another zero;
#: no bodies pass for a ripple.
FREE = ("time scale", CLOCKS, "tilt", "rotor inertia", SCALE)
FREE_ALONE, FREE_OF_MODELS = (DELAY, ELASTIC, HYSTERESIS, RIPPLE), (ZERO,)


@dataclass(frozen=True)
class KnownBodiesCheck(Check):
    """Load at the flange, counterbalance, spring, scale or tilt, against the robot model and an earlier estimate."""

    stage: ClassVar[int] = 2
    tells: ClassVar[tuple[str, ...]] = (*TRENDS, "load at the flange")

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        trends, earlier = subject.trends, subject.known
        if trends is None:
            return []
        found, against = list[Finding](), subject.against_earlier
        if against is not None:
            found = _findings(subject, trends, against, "against the earlier estimate: ")
        model, base, robot = trends.fit.model, trends.fit.base, subject.case.robot
        nominal = nominal_bodies(model, base, robot, asked_inertias(subject.case))
        theta = model.nominal()
        if nominal is None or theta is None:
            return found
        if earlier is not None and not earlier.agrees(base.from_standard(with_rotors(theta, model, robot))):
            return found  # what the earlier estimate says of the bodies is what the torques are held against
        return [*found, *_findings(subject, trends, AgainstBodies(trends, nominal), "against the robot model: ")]


def _findings(subject: CheckedLog, trends: Trends, against: AgainstBodies, words: str) -> list[Finding]:
    free = {
        _key(one): one
        for one in trends.blames
        if one.cause.name in FREE and (one.cause.name != SCALE or believed(one, subject.trend_scale) is not None)
    }
    is_model = isinstance(against.known, NominalBodies)
    if is_model and subject.known is None and (unit := _unit(against)):
        return unit
    common = _common(against, words) if is_model else []
    frames, blames = standing(trends, against.blames)
    is_scaled = any(_key(each) == OF_ALL for blame in blames for each in (blame, *blame.rivals))
    is_unit = bool(common or is_scaled) and TorqueScale.tells_unit(subject)  # which says the same of all torques
    left_out = FREE_ALONE + (FREE_OF_MODELS if is_model else ())
    return [*([] if is_unit else common), *frames] + [
        _finding(each, None if each is blame else blame, against, words)
        for blame in blames
        if blame.cause.name not in left_out
        for each in (blame, *blame.rivals)
        if each.cause.name not in left_out
        and not ((common or is_unit) and _key(each) == OF_ALL)
        and not _is_better(free.get(_key(each)), each)
        and each.cause.name not in subject.described
        and believed(each) is not None
        and sureness(each) > TOLD
    ]


def _key(blame: Blame) -> tuple[str, str]:
    return blame.cause.name, blame.cause.joint


def _is_better(free: Blame | None, held: Blame) -> bool:
    """Return whether free bodies give the better figure of a cause; of a rotor inertia, the narrower interval."""
    is_rotor = held.cause.name == "rotor inertia"
    return free is not None and (not is_rotor or bool(free.half_widths[0] < held.half_widths[0]))


def _finding(blame: Blame, better: Blame | None, against: AgainstBodies, words: str) -> Finding:
    """Return what is said of a cause; ``better`` is the likelier one that the log does not tell it from."""
    found = _load(blame, against) if blame.cause.name == "load at the flange" else trend_finding(blame, against.fit)
    if blame.cause.name == SCALE and not blame.cause.joint and blame.size > MATTERS and sureness(blame) > SURE:
        found = replace(found, severity="warning")  # known bodies take a part of a scale in: no residual tells it
    if better is None:
        return replace(found, evidence=words + found.evidence)
    beside = f"{better.cause.name}{f' ({better.cause.joint})' * bool(better.cause.joint)}"
    evidence = f"{words}not distinguishable from {beside}: {found.evidence}"
    return replace(found, severity="note", evidence=evidence, beside=beside)


def _is_common(blame: Blame, errors: float, beyond: float) -> bool:
    """Return whether the robot model's bodies are surely right in another size alone, by a factor beyond another one.

    One factor is asked for, so no other causes count: by chance its likelihood is as good once in a thousand logs.
    """
    ratio, half = 1.0 + float(blame.values[0]), float(blame.half_widths[0])
    is_sure = blame.certainty**2 > SURE_FACTOR and errors < ONE_SCALE - 1.0
    return ratio > 0.0 and is_sure and abs(np.log(ratio)) - half / ratio > np.log(beyond)


def _unit(against: AgainstBodies) -> list[Finding]:
    """Return that all torques are in another unit, where the robot model's bodies are right in another size alone.

    The joints need not ask for one factor, for which another check stands: a load at the flange makes torques larger,
    those of most joints up to thrice. No joint may ask for less than that factor.
    """
    blame, errors = against.scale_of_all
    if not _is_common(blame, errors, OFF):
        return []
    ratio, half = 1.0 + float(blame.values[0]), float(blame.half_widths[0])
    fit, ratios = against.fit, nominal_ratios(against.fit, SURE_OF_SHAPE**2)
    if 1.0 < ratio < FAR_OFF and not beyond_rotors(fit, against.bodies).any():
        return []
    told = ratios[np.isfinite(ratios)] / ratio
    if are_alike(fit, ratios) or not len(told) or told.min() < 1.0 / FAR or np.median(told) > LOADED * ONE_SCALE:
        return []
    evidence = (
        f"whatever load the flange carries, the torques are {ratio:.3g} (+- {half:.2g}) times "
        f"those of the robot model's masses (t = {blame.certainty:.0f})"
    )
    return [Finding("error", UNIT, "", evidence, other_unit(fit, ratio), {"ratio": ratio, "half_width": half}, OF_UNIT)]


def _common(against: AgainstBodies, words: str) -> list[Finding]:
    """Return that all torques are those of the robot model's bodies times one factor, far from one.

    Masses that are all off by it do the same, and no log tells these apart. It is a note where the factor is not sure.
    """
    blame, errors = against.scale_of_all
    ratio, half = 1.0 + float(blame.values[0]), float(blame.half_widths[0])
    far = agrees(ratio) and abs(np.log(ratio)) > max(np.log(FAR), half / ratio)  # beyond, another check tells a unit
    if not far or blame.certainty < TOLD:
        return []
    evidence = (
        f"{words}torques of all joints are {ratio:.3g} (+- {half:.2g}) times those of its masses (t = "
        f"{blame.certainty:.0f}); a log cannot tell this from masses that are all off by as much"
    )
    told = trend_finding(blame, against.fit)
    severity: Severity = "warning" if _is_common(blame, errors, ONE_SCALE) else "note"
    weighed = "'dynident payload ESTIMATE LOG' of a load that you have weighed tells which: its mass is off by as much"
    if against.fit.effort != "torque":
        weighed = "'dynident gains --load LOG --mass KG' with a load that you have weighed tells which"
    return [Finding(severity, SCALE, "", evidence, f"{told.remedy}; {weighed}", told.numbers)]


def _load(blame: Blame, against: AgainstBodies) -> Finding:
    mass, deviation, half = (float(each[-1]) for each in (blame.values, blame.deviations, blame.half_widths))
    end, joint = against.error_of_end(blame.cause.joint), blame.cause.joint
    half, deviation = float(np.hypot(half, Z95 * end)), float(np.hypot(deviation, end))
    told = f"of {mass:+.3g} kg (+- {half:.2g} kg)"
    known = half <= abs(mass) <= against.masses.sum()  # no arm carries more than it weighs
    if not known:  # moments are sure, the mass is not
        strongest = int(np.argmax(blame.taken))  # of the whole torque, bodies that are not known may take any share off
        felt = against.fit.model.robot.active[strongest]
        unit = "N" if felt.kind == "prismatic" else "N m"
        told = f"of {blame.taken[strongest]:.3g} {unit} rms at {felt.name}, its mass is not determined"
    place = f"at the flange{f' of the branch that ends in {joint}' * bool(joint)}"
    evidence = f"a load {place} {told} (t = {blame.certainty:.0f})"
    remedy = (
        "remove the payload or tool, or add it to the robot model; 'dynident payload ESTIMATE LOG' weighs it, with an "
        "estimate without it; check the last link"
    )
    if known and mass < 0:
        evidence = f"{-mass:.3g} kg (+- {half:.2g} kg) less {place} (t = {blame.certainty:.0f})"
        remedy = "take a tool that is not mounted out of the robot model, or correct the mass of the last link"
    bodies = np.sqrt(np.mean(against.bodies**2, axis=0))
    large = float(blame.torque.max()) > MATTERS * float(bodies.max())
    heavy = known and large and half < NARROW * abs(mass)
    severity: Severity = "warning" if heavy else "note"
    numbers = {"mass_kg": mass, "std_kg": deviation, "t": blame.certainty, "share": blame.share}
    return Finding(severity, "load at the flange", joint, evidence, remedy, numbers)
