"""What does not look right about an estimate: signs of a wrong unit, sign, order of joints, gravity or filter.

A warning never changes anything. It says what was seen and what to check; the limits are rules of thumb.
"""

from __future__ import annotations

import numpy as np

from dynident.estimation.cutoff.sensitivity import sensitivity_warning
from dynident.estimation.estimate import Estimate
from dynident.estimation.validation import Validation

#: Total relative error of the fit above which a model explains too little.
POOR_FIT = 0.25

#: R2 of a joint below which its channel says little.
POOR_JOINT = 0.5

#: How much worse than the free fit a consistent one may be before the data and any possible robot disagree.
POOR_CONSISTENCY = 0.10

#: How far a joint may leave its limits, in rad or m.
BEYOND_LIMITS = 0.05

#: Condition number with unit columns above which noise decides single parameters.
POOR_CONDITION = 1000.0


def warnings_of(estimate: Estimate, test: Validation | None = None) -> tuple[str, ...]:
    """Return what does not look right, most telling first, each with what to check."""
    found = [*_gaps(estimate), *_limits(estimate), *_torques(estimate.train)]
    total = estimate.train.total_relative_error
    if total > POOR_FIT:
        found.append(f"the model misses {100 * total:.0f} % of the torques of the fit: check units, gains and gravity")
    found += _gains(estimate)
    found += _one_sided(estimate)
    above = estimate.extras.get("residual_above_unconstrained")
    if above is not None and above > POOR_CONSISTENCY:
        worse = f"fit {100 * above:.0f} % worse than" if above < 9 else "leave over ten times the residual of"
        found.append(
            f"possible robots {worse} impossible ones: check signs of torques, order of joints, gravity, gear ratios, "
            "whether a motor turns more than its own joint (coupling), and the friction parts (friction: auto)"
        )
    moved = sensitivity_warning(estimate.extras.get("cutoff_sensitivity") or {})
    if moved:
        found.append(moved)
    if estimate.extras.get("constraints_not_kept"):
        name = estimate.extras["constraints_not_kept"]
        found.append(
            f"'{name}' does not keep the stated constraints: use the estimator 'consistent' where they must hold"
        )
    if estimate.condition_number > POOR_CONDITION:
        size = f"{estimate.condition_number:.3g}"
        found.append(f"condition number {size}: the motion says little about single parameters; excite all joints")
    found += _weak(estimate)
    if test is not None:
        found += _torques(test)
        if test.departure is not None and estimate.envelope is not None and test.departure.leaves():
            found.append(test.departure.sentence(estimate.envelope))
    return tuple(dict.fromkeys(found))


def _gaps(estimate: Estimate) -> list[str]:
    """Name the logs with gaps in time whose rows were left out."""
    return [
        f"{log.get('path') or 'a log'}: {step}"
        for log in estimate.provenance.get("logs", ())
        for step in log.get("steps", ())
        if "near gaps in time" in step
    ]


def _weak(estimate: Estimate) -> list[str]:
    """Name what the robot itself hides, whatever the motion."""
    base = estimate.base
    if not len(base.weak):
        return []
    most = ", ".join(base.names[k] for k in base.weak[:3]) + (", ..." if len(base.weak) > 3 else "")
    return [
        f"{len(base.weak)} of {base.count} base parameters hardly show in any motion, as axes are nearly, but not "
        "exactly, parallel, intersecting or vertical, or friction parts say nearly the same: take the torques, not the "
        f"values of {most} (all: dynident inspect)"
    ]


def _gains(estimate: Estimate) -> list[str]:
    """Say how well the drive gains are known, where that is stated: no residual shows their errors."""
    stated = estimate.extras.get("gain_deviations")
    if not stated:
        return []
    known = [value for value in stated["relative"].values() if value > 0]
    more = int(np.sum(np.asarray(stated["parameters"]) > estimate.deviations))
    span = f"{100 * min(known):.2g} to {100 * max(known):.2g} %" if len(known) > 1 else f"{100 * known[0]:.2g} %"
    return [
        f"drive gains are known to {span} (std) only, which moves {more} of {estimate.base.count} parameters by more "
        "than their own deviations, beside them (extras.gain_deviations)"
    ]


def _one_sided(estimate: Estimate) -> list[str]:
    """Say where a filter acts on the torque and not on the columns of the regressor: no interval knows of that."""
    filter = estimate.preprocessing.filter
    kind, torque = (str(filter.statement()[key]) for key in ("kind", "torque"))
    if torque in ("none", "as given") or filter.reach(1000.0):
        return []
    return [
        f"'{kind}' smooths the torque and not the model's columns: intervals hold the random error, not what that and "
        "the noise of the accelerations make; compare with butterworth"
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


def _torques(validation: Validation) -> list[str]:
    found = []
    for fit in validation.joints:
        if np.isfinite(fit.correlation) and fit.correlation < 0:
            found.append(f"{fit.name}: the model's torque runs against the measured one: check its sign and column")
        elif np.isfinite(fit.r2) and fit.r2 < 0:
            found.append(f"{fit.name}: the model is worse than a constant (R2 {fit.r2:.2f}): check its column and gain")
        elif np.isfinite(fit.r2) and fit.r2 < POOR_JOINT:
            share = f"{100 * fit.r2:.0f} %"
            found.append(f"{fit.name}: the model explains {share} of how its torque changes: its channel says little")
    return found
