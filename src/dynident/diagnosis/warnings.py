"""Warnings about an estimate: wrong unit, sign, order of joints, gravity or filter, and poor excitation.

A warning changes nothing. It states the evidence and what to check; the limits are rules of thumb.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dynident.diagnosis.finding import brakes_closed
from dynident.diagnosis.new_log import NewLog, check_command, unlike
from dynident.diagnosis.verdict import check_lines, is_too_short, model_doubt, quality_of
from dynident.identification.consistency.log_cholesky_fit import UNFINISHED
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.identification.problem.choices import Choices
from dynident.model.friction import called
from dynident.model.friction.stribeck import Stribeck

#: Total relative error of the fit above which a model explains too little.
POOR_FIT = 0.25

#: R2 of a joint below which its channel says little.
POOR_JOINT = 0.5

#: How far a joint may leave its limits, in rad or m.
BEYOND_LIMITS = 0.05

#: Condition number with unit columns above which noise decides single parameters.
POOR_CONDITION = 1000.0

#: Least share of the load that friction takes for its direction to matter, and how near that of the robot model the
#: scale of the bodies then is for it not to, as a share of what it could be off by.
LEAST_SHARE, AGREES = 0.02, 0.1

#: Half-width of the interval of a friction level at breakaway, as a share of it, from which it is not determined.
LEVEL = 0.1

#: Deviations, at the cut-off that knows less, beyond which a parameter that moves so far is worth a warning.
FAR = 3.0


def warnings_of(estimate: Estimate, test: Validation | None = None, new: NewLog | None = None) -> tuple[str, ...]:
    """Return the warnings, the most important first, each with what to check.

    Args:
        estimate: The estimate.
        test: Its comparison with logs that had no part in the fit.
        new: What these logs say, where it is known.
    """
    told = "" if new is None else new.warning
    if new is None and test is not None:
        case = str(estimate.provenance.get("case", {}).get("path", ""))
        told = ": ".join(filter(None, unlike(estimate, test, check_command(test.logs, case=case))))
    causes = [told, ": ".join(filter(None, model_doubt(estimate)))]
    torques = {**_torques(estimate.train), **({} if test is None else _torques(test))}.values()
    is_short = is_too_short(estimate)
    found = [
        *filter(None, causes * (not is_short)),
        *check_lines(quality_of(estimate) or ()),
        *_gaps(estimate),
        *_limits(estimate),
        *(() if is_short else torques),
    ]
    total = estimate.train.total_relative_error
    if total > POOR_FIT:
        found.append(f"relative error {100 * total:.0f} % on the training data: check units, gains and gravity")
    found += _unfinished(estimate)
    found += _gains(estimate)
    found += _position_noise(estimate)
    found += _one_sided(estimate)
    moved = _sensitivity(estimate.choices)
    if moved:
        found.append(moved)
    if name := estimate.choices.constraints_not_kept:
        found.append(f"'{name}' violates the stated constraints: use the estimator 'consistent' to enforce them")
    if estimate.condition_number > POOR_CONDITION:
        size = f"{estimate.condition_number:.3g}"
        found.append(f"condition number {size}: single parameters are poorly determined; excite all joints")
    found += _weak(estimate)
    found += _at_ends(estimate)
    found += _springs_beside_load(estimate)
    found += _one_load_friction(estimate)
    found += _static_friction(estimate)
    if test is not None and test.departure is not None and estimate.envelope is not None and test.departure.leaves():
        found.append(test.departure.sentence(estimate.envelope))
    found += () if test is None else start_sentences(test.start_states)
    cold = "; the fit takes them as cold: give logs that follow each other as one, or leave this one out"
    found += [f"training log {line}{cold}" for line in start_sentences(estimate.train.start_states)]
    return tuple(dict.fromkeys(found))


def _one_load_friction(estimate: Estimate) -> list[str]:
    """Warn where load friction that differs by the direction of the power would pass for mass.

    A gear that loses a share a of the load as it drives and b as it is driven, alike at all joints, has the torques of
    masses 1 + (a - b) / 2 times as large with one share c. Masses of the robot model that agree say that a = b.
    """
    names, robot = [called(part) for part in estimate.model.friction], estimate.model.robot
    shares = [p["value"] for p in estimate.parameters() if p["name"].startswith("Fl[")]
    if "load" not in names or len(shares) < robot.dof or not (share := min(shares)) > LEAST_SHARE:
        return []
    told = f"masses from {1 - share:.2f} to {1 + share:.2f} times those identified fit the logs alike"
    if robot.nominal is not None:
        model, bodies = estimate.model, ~estimate.base.is_friction
        padded = np.concatenate([robot.nominal, np.zeros(len(model.parameters) - model.inertial_count)])
        nominal, own = estimate.base.from_standard(padded)[bodies], estimate.beta[bodies]
        weighed = np.linalg.pinv(estimate.covariance[np.ix_(bodies, bodies)], hermitian=True) @ nominal
        scale = float(weighed @ own / (weighed @ nominal))
        if abs(scale - 1.0) < AGREES * share:
            return []
        forth, back = (1 + share) * scale - 1, 1 - (1 - share) * scale
        if min(forth, back) > 0:
            told += (
                f", those of the robot model with Fl+ {forth:.2f} and Fl- {back:.2f} (identified: {scale:.2f} of them)"
            )
    width = min(float(part.options["width"]) for part in estimate.model.friction if called(part) == "load")
    remedy = (
        f"state load_directional: {{velocity: 100, width: {width:.3g}}} in the place of load, whose intervals hold that"
    )
    return [
        f"load friction {share:.2f} may differ between driving and being driven; then {told}: {remedy}, or weigh a link"
    ]


def _static_friction(estimate: Estimate) -> list[str]:
    """Name the drives whose friction at breakaway is what a chosen curve says at speeds that the logs do not tell.

    A reversal that is shorter than the filter resolves shows what a Stribeck effect takes in all, not how high and how
    narrow it is: then velocity and exponent are found, and with them the level at speed 0 is not.
    """
    found = {p["name"]: k for k, p in enumerate(estimate.parameters())}
    told, slow = list[tuple[float, str]](), 0.0
    for part in (part for part in estimate.model.friction if isinstance(part, Stribeck)):
        for name in (estimate.model.robot.joint_names[j] for j in estimate.model.drives_of(part)):
            places = [found[key] for key in (f"Fc[{name}]", f"Fs[{name}]") if key in found]
            level = float(estimate.beta[places].sum())
            half = 1.96 * float(np.sqrt(max(estimate.covariance[np.ix_(places, places)].sum(), 0.0)))
            if half > LEVEL * level > 0.0:
                told.append((half / level, f"{name} {level:.3g} +- {half:.2g} at least"))
                slow = max(slow, part.velocity)
    if not told:
        return []
    others = f", and {len(told) - 1} more" * (len(told) > 1)
    return [
        f"static friction is not determined ({max(told)[1]}{others}): reversals are too short to show how the Stribeck "
        "effect goes on towards speed 0, and a simulator would stick at a wrong torque; add a log whose joints stay "
        f"below {slow:.2g} rad/s or m/s for seconds at a time"
    ]


def start_sentences(states: Sequence[Mapping[str, Any]]) -> list[str]:
    """Say how warm the drives were taken to be at the start of logs, which no log states."""
    by_log: dict[str, list[Mapping[str, Any]]] = {}
    for each in states:
        by_log.setdefault(str(each["log"]), []).append(each)
    lines = []
    for log, own in by_log.items():
        part, share = own[0]["part"], f"{100 * own[0]['share']:.3g} %"
        values = ", ".join(f"{one['joint']} {one['value']:.2g} {one['unit']}" for one in own if one["value"])
        found = f"{part} found from its torques ({values}), which reduces the squared error by {share}"
        cold = f"{part} taken to begin cold, as no other start explains its torques better"
        lines.append(f"{log} does not state how warm the drives were at its start: {found if values else cold}")
    return lines


def _at_ends(estimate: Estimate) -> list[str]:
    """Name the fields of friction whose best value is an end of the range that was searched, and what would find it."""
    lines, parts = [], {called(part): part for part in estimate.model.friction}
    for each in estimate.choices.non_linear or ():
        span = parts[each.part].ranges[each.field]
        remedy = "state a value, or leave the part out"
        if each.end < 0 and span.is_distance and each.value > 1.001 * span.low:
            remedy = f"the resolution of the positions: log finer positions at a higher rate, or {remedy}"
        elif each.end > 0 and each.value < 0.999 * span.high:
            kinds = ((span.is_distance, "range", "larger"), (span.is_duration, "duration", "longer"))
            what, more = next((own[1:] for own in kinds if own[0]), ("speed", "faster"))
            remedy = f"by the {what} of the logs: log {more} motions, or {remedy}"
        if each.end:
            end = "least" if each.end < 0 else "largest"
            lines.append(f"{each.part} {each.field} {each.value:.3g} is the {end} value that was tried, {remedy}")
    for held in estimate.choices.chosen_fields or ():
        own = getattr(parts.get(held.part), held.field, held.best)  # off its start the logs have found a value
        if held.not_tried and held.best != held.stated and math.isclose(own, held.best) and held.part in parts:
            finer = "finer positions at a higher rate" if held.best > held.stated else "larger motions"
            more = finer if parts[held.part].ranges[held.field].is_distance else "longer from a cold start"
            where = f" ({', '.join(held.joints)})" if held.joints else ""
            start = f"{held.part}{where}: the given {held.field} {held.not_tried}; the search began at {held.best:.3g}"
            lines.append(f"{start}: log {more} to identify it")
    return lines


def _springs_beside_load(estimate: Estimate) -> list[str]:
    """Name the drives whose load friction leaves a spring of theirs out of the load."""
    model = estimate.model
    loaded = {j for part in model.friction if "torque" in part.needs for j in model.drives_of(part)}
    springs = {j: called(part) for part in model.friction if part.is_spring for j in model.drives_of(part)}
    named = ", ".join(
        f"{name} ({springs[j]})" for j, name in enumerate(model.robot.joint_names) if j in loaded & {*springs}
    )
    what = "load friction takes the torque of links and rotors alone as the load of the drive, without the spring"
    return [f"{named}: {what}; leave it out of these joints, or take its coefficient as a fit only"] if named else []


def _unfinished(estimate: Estimate) -> list[str]:
    """Return that a search ended far from the optimum that is proven of the same problem."""
    run = estimate.run.data()
    if run.get("verdict") != UNFINISHED:
        return []
    times = f"{1 + run['gap']:.3g} times the objective of the proven optimum"
    return [
        f"'{estimate.estimator}' did not converge: it ended at {times}; use the estimator 'consistent', which finds it"
    ]


def _gaps(estimate: Estimate) -> list[str]:
    """Name the logs of whose samples some were left out by themselves: near gaps in time, or with closed brakes."""
    return [
        f"{log.get('path') or 'a log'}: {log['gap_samples']} samples near gaps in time"
        f"{' or ' + brakes_closed(log['braked']) if log.get('braked') else ''} left out"
        for log in estimate.provenance.get("logs", ())
        if log.get("gap_samples") and not any(step.endswith(" s left out") for step in log.get("steps", ()))
    ]


def _weak(estimate: Estimate) -> list[str]:
    """Name the base parameters that no motion excites."""
    base = estimate.base
    if not len(base.weak):
        return []
    most = ", ".join(base.names[k] for k in base.weak[:3]) + (", ..." if len(base.weak) > 3 else "")
    return [
        f"{len(base.weak)} of {base.count} base parameters are nearly unidentifiable in any motion: axes are nearly, "
        "but not exactly, parallel, intersecting or vertical, or friction parts are nearly collinear. Use the torques, "
        f"not the values of {most} (all: dynident inspect)"
    ]


def _gains(estimate: Estimate) -> list[str]:
    """Warn of uncertain drive gains, where their uncertainty is stated: residuals do not contain their errors."""
    stated = estimate.choices.gain_std
    if stated is None:
        return []
    known = [value for value in stated.relative.values() if value > 0]
    more = int(np.sum(np.asarray(stated.parameters) > estimate.std))
    ends = dict.fromkeys(f"{100 * value:.2g}" for value in (min(known), max(known)))
    span = f"{' to '.join(ends)} %"
    return [
        f"drive gains have a relative std of {span}: it shifts {more} of {estimate.base.count} parameters by more than "
        "their stated standard deviations, which do not contain it (extras.gain_std)"
    ]


def _position_noise(estimate: Estimate) -> list[str]:
    """Warn of noise of the positions that biases parameters by more than the residual lets one see."""
    found = estimate.choices.position_noise
    if found is None:
        return []
    bias = found.left * np.abs(found.parameters)
    own = np.sqrt(np.maximum(np.diag(estimate.covariance) - bias**2, 0.0))
    moved = np.flatnonzero(bias > own)
    if not len(moved):
        return []
    worst, largest = estimate.base.names[int(np.argmax(bias / own))], dict[str, tuple[float, str]]()
    for joint, noise in zip(estimate.model.robot.active, found.positions, strict=True):
        unit = "m" if joint.kind == "prismatic" else "rad"
        largest[unit] = max(largest.get(unit, (0.0, "")), (float(noise), joint.name))
    size = " and ".join(f"{noise:.2g} {unit} of {name}" for unit, (noise, name) in largest.items())
    return [
        f"noise of the positions (std {size}) may bias {len(moved)} of {estimate.base.count} parameters by more than "
        f"their other errors (errors-in-variables bias, most {worst}), which their intervals allow for: lower the "
        "cut-off, or positions_hz of butterworth to twice the cut-off, or use 'didim' with the controller's gains"
    ]


def _one_sided(estimate: Estimate) -> list[str]:
    """Warn where a filter acts on the torque and not on the regressor: the intervals do not contain its bias."""
    filter = estimate.preprocessing.filter
    kind, torque = (str(filter.statement()[key]) for key in ("kind", "torque"))
    if torque in ("none", "as given") or filter.reach(1000.0):
        return []
    return [
        f"'{kind}' filters the torque and not the regressor: the intervals contain the random error, not the bias of "
        "this and of noisy accelerations; compare with butterworth"
    ]


def _limits(estimate: Estimate) -> list[str]:
    found: list[str] = []
    if not len(estimate.train.q):
        return found
    span = zip(estimate.model.robot.active, estimate.train.q.min(axis=0), estimate.train.q.max(axis=0), strict=True)
    for joint, low, high in span:
        if low < joint.limits.lower - BEYOND_LIMITS or high > joint.limits.upper + BEYOND_LIMITS:
            limits = f"limits {joint.limits.lower:.4g} to {joint.limits.upper:.4g}"
            found.append(
                f"{joint.name} moves from {low:.4g} to {high:.4g}, {limits}: check units, zero, sign and order"
            )
    return found


def _torques(validation: Validation) -> dict[str, str]:
    """Return a warning for each joint whose torque is not explained, by its name."""
    found = {}
    for fit in validation.joints:
        if np.isfinite(fit.correlation) and fit.correlation < 0:
            found[fit.name] = "negative correlation of predicted and measured torque: check its sign and column"
        elif np.isfinite(fit.r2) and fit.r2 < 0:
            found[fit.name] = f"the model is worse than a constant (R2 {fit.r2:.2f}): check its column and gain"
        elif np.isfinite(fit.r2) and fit.r2 < POOR_JOINT:
            share = f"{100 * fit.r2:.0f} %"
            found[fit.name] = (
                f"the model explains {share} of its torque variance (R2): check torque signal and friction"
            )
    return {name: f"{name}: {text}" for name, text in found.items()}


def _sensitivity(choices: Choices) -> str:
    """Return a warning where a parameter moves far with the cut-off, else nothing."""
    found, is_noisy = choices.cutoff_sensitivity, choices.position_noise is not None
    far = [row for row in (found.table if found is not None else ()) if row.beyond_chance > FAR]
    if found is None or not far:
        return ""
    worst = max(far, key=lambda row: row.beyond_chance)
    return (
        f"{worst.farthest} moves by {worst.beyond_chance:.2g} of its standard deviations where the cut-off is "
        f"{worst.cutoff_hz:g} Hz in place of {found.cutoff_hz:g} Hz: "
        f"{'noise of the positions or ' * is_noisy}the model error (friction, flexible joints, time delay) is larger "
        f"than the noise explains{'' if is_noisy and worst.cutoff_hz > found.cutoff_hz else '; intervals allow for it'}"
        "; compare cut-offs"
        f"{', or use cutoff_hz: auto' * (choices.cutoff_choice is None)}"
    )
