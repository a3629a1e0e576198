"""The answer about actuators as lines and tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynident.actuators.directions import EXCHANGED, TURNED, ZEROED
from dynident.actuators.estimate import ActuatorEstimate, JointActuator
from dynident.actuators.followed_log import FollowedJoint
from dynident.actuators.free_bodies import DEVIATION, NORMAL_95, FreeBodies
from dynident.actuators.parameters import FRICTION_MODELS, PARAMETERS, PLACE, unit_for, unit_of
from dynident.actuators.poor_fit import EXTRAPOLATION, MISSED
from dynident.actuators.verdict import AS_RATIO, EXPERIMENTS, LITTLE_WEIGHT, MORE_SWINGS, SCALE, lacks_scale
from dynident.results.text import MISSING, Table, columns_of, format_number, format_value, pretty_unit


def parameter_table(joint: JointActuator) -> Table:
    """Return the parameters of one joint with their intervals and labels."""
    rows, has_ratio = [], any(one.ratio is not None for one in joint.known)
    for one in joint.known:
        name = one.name.replace("_", " ")
        label = one.label if not one.together else f"{one.label}, only with {one.together.replace('_', ' ')}"
        half = MISSING if not np.isfinite(one.half_width) else format_number(one.half_width, 2)
        width = one.half_width if np.isfinite(one.half_width) or one.ratio is None else one.ratio
        value = format_value(one.value, width)[0] if np.isfinite(width) else format_number(one.value, 4)
        value = "0" if one.label == "at its bound" and _is_none(one.name, one.value) else value
        ratio = [MISSING if one.ratio is None else format_number(one.ratio, 2)] * has_ratio
        rows.append((name, value, half, *ratio, pretty_unit(unit_of(one.name, joint.slides)), label))
    for one in joint.combinations:
        ratio = [MISSING] * has_ratio
        half, is_known = one.half_width, bool(np.isfinite(one.half_width))
        value = format_value(one.value, half)[0] if is_known else format_number(one.value, 4)
        width = format_number(half, 2) if is_known else MISSING
        unit, per, gain = one.unit.partition(" per ")
        rows.append((one.name, value, width, *ratio, f"{pretty_unit(unit)}{per}{gain}", "known together"))
    columns = columns_of("parameter", ">value", ">half width (95 %)", *[">as a ratio"] * has_ratio, "unit", "verdict")
    return Table(columns, tuple(rows))


def bodies_table(bodies: FreeBodies) -> Table:
    """Return mass and centre of mass of each link beside those of the robot model, with what the mass stands on."""
    rows = []
    for name, theta, nominal, deviations, labels in zip(
        bodies.names, bodies.theta, bodies.nominal, bodies.deviations, bodies.labels, strict=True
    ):
        centres = [
            ", ".join(f"{1e3 * value:.0f}" for value in own[6:9] / own[9]) if own[9] > 0 else MISSING
            for own in (theta, nominal)
        ]
        half = NORMAL_95 * float(deviations[9])
        cells = [format_value(float(theta[9]), half)[0], format_number(half, 2), format_number(float(nominal[9]), 3)]
        rows.append((name, *cells, *centres, labels[9]))
    columns = columns_of(
        "link",
        ">mass [kg]",
        ">half width (95 %) [kg]",
        ">robot model [kg]",
        ">centre of mass [mm]",
        ">robot model [mm]",
        "mass is",
    )
    return Table(columns, tuple(rows))


def scale_lines(estimate: ActuatorEstimate) -> list[str]:
    """Return what the scale of torques, armature and friction is: that of masses, stated or found."""
    if estimate.bodies is None:
        known = (one for joint in estimate.joints for one in joint.known)
        has_scale = any(one.name == "full_torque" and np.isfinite(one.half_width) for one in known)
        taken = "half widths take the masses of the robot model, payloads and stated torques as exact"
        return [f"{taken}: masses 10 % larger make torque, armature and friction 10 % larger"] if has_scale else []
    half = 100.0 * NORMAL_95 * estimate.bodies.scale
    if estimate.bodies.is_scaled:
        return [f"one scale of all masses, torques and friction: from the logs with a payload, to {half:.2g} %"]
    return [
        "one scale of all masses, torques and friction is that of the robot model (no log without a known payload "
        f"determines it): half width {half:.0f} % where its masses are known to {100 * DEVIATION:g} %",
        "as a ratio: half widths beside that scale; a known payload gives it (servo: payloads)",
    ]


def bodies_warnings(bodies: FreeBodies) -> list[str]:
    """Return at which bounds the masses ended, and what to state in their place."""
    found = []
    for words in bodies.bounds:
        link, _, rest = words.rpartition(": ")
        key = f"links: {{{link}: {{mass: ...}}}}" if link else "total_mass: ..."
        whole = f"the mass of {link} ended at its bound, {rest}" if link else f"the masses ended at the bound {rest}"
        found.append(
            f"{whole}: the bodies of the robot model are too {'light' if '<=' in rest else 'heavy'} for these logs; "
            f"correct them or the payload, or state what is known (constraints: {{{key}}}, a number or {{max: ...}})"
        )
    return found


def joint_lines(joint: JointActuator) -> list[str]:
    """Return what has to be said of one joint beside its table."""
    law = joint.law.name or "stated in the case file"
    lines = [f"friction {joint.friction}: {FRICTION_MODELS[joint.friction].words}; drive law {law}"]
    thousandth = thousandth_of([joint])
    if joint.folds:
        folds = ", ".join(f"{name} {1e3 * value:.3g}" for name, value in joint.folds.items())
        lines.append(f"cross-validation error of the roll-outs in {thousandth} (geometric mean over logs): {folds}")
    for title, errors in (("training", joint.train), ("test", joint.test)):
        if errors:
            lines.append(f"{title} error of the roll-outs: {_spread(list(errors.values()), thousandth)}")
    kind = "test" if joint.test else "training"
    lines.append(f"{kind} error of the linear start: {1e3 * joint.mean_error(joint.linear_test):.3g} {thousandth}")
    slew = joint.parameters[PLACE["slew_limit"]]
    if not np.isfinite(slew):
        lines.append("slew limit of the goal: none found")
    if joint.saturated > 0:
        lines.append(f"saturated: {100 * joint.saturated:.2g} % of the training samples")
    return lines


def thousandth_of(joints: Sequence[JointActuator | FollowedJoint]) -> str:
    """Return the unit of small errors of joints that turn, or slide."""
    return " or ".join({unit_for("mrad", joint.slides): None for joint in joints})


def _spread(errors: list[float], unit: str) -> str:
    sizes = [1e3 * value for value in errors]
    text = f"{np.mean(sizes):.3g} {unit}"
    more = f" (median {np.median(sizes):.3g}, largest {max(sizes):.3g}, {len(sizes)} logs)"
    return text if len(sizes) == 1 else text + more


#: Parameters that no servo has at 0, and what makes them end there.
_NEVER_ZERO = {
    "full_torque": "the joint does not follow its command: check its sign and the torque-enable column",
    "armature": "the bodies of the robot model may be too heavy, or its rotor inertia part of theirs",
    "delay": "positions may be stamped later than they were read, or commands earlier than sent: check the clock, or "
    "state delay_s",
}


#: Labels of what a joint without weight leaves without scale.
_UNSCALED = ("not separable", AS_RATIO)


def joint_warnings(joint: JointActuator) -> list[str]:
    """Return what speaks against trusting the actuator of a joint."""
    found = list(joint.remarks)
    if any(text.startswith((MISSED, TURNED, ZEROED, EXCHANGED)) for text in found):  # no experiment mends a wrong model
        return found
    for one in joint.combinations:
        found.append(f"{one.name} is known only as a whole ({one.words})")
    scaleless = lacks_scale({one.name: one.label for one in joint.known})
    if scaleless:
        names = ", ".join(one.name.replace("_", " ") for one in joint.known if one.label in _UNSCALED)
        found.append(f"{names}: {SCALE}")
    partners = {one.name: one.together for one in joint.known if one.label == "weak"}
    is_light = (partners.get("full_torque"), partners.get("armature")) == ("armature", "full_torque")
    if is_light:
        found.append(f"full torque and armature are weak, each known only with the other: {LITTLE_WEIGHT}")
    swings = any(one.name == "back_emf" for one in joint.known)  # found only where the logs have some
    for one in joint.known:
        if (scaleless and one.label in _UNSCALED) or (is_light and one.together in ("full_torque", "armature")):
            continue
        if one.label in ("weak", "not separable") and one.name in EXPERIMENTS and not joint.combinations:
            step = MORE_SWINGS if swings and one.name in ("viscous", "back_emf") else EXPERIMENTS[one.name]
            found.append(f"{one.name.replace('_', ' ')} is {one.label}: {step}")
    bound = [one.name.replace("_", " ") for one in joint.known if one.label == "at its bound" and one.value != 0.0]
    real = [name for name in bound if not _is_none(name, joint.value(name.replace(" ", "_")))]
    for name, cause in _NEVER_ZERO.items():
        known = [one for one in joint.known if one.name == name and one.label == "at its bound"]
        if known and _is_none(name, known[0].value):
            found.append(f"{name.replace('_', ' ')} ended at its bound 0: {cause}")
    if "angle offset" in real:
        real.remove("angle offset")
        step = "state log: zero, the joint's angle where the log counts 0, or turn the axis in the robot model"
        found.append(
            f"the weight asks for another zero than the log's, by more than an angle offset makes up for: {step}"
        )
    if real:
        found.append(f"{', '.join(real)} ended at a bound: check the drive law and the inertias of the robot model")
    return found


def all_warnings(joints: Sequence[JointActuator]) -> list[str]:
    """Return the warnings of all joints, each once with the joints that it is about."""
    about: dict[str, list[str]] = {}
    for joint in joints:
        for text in joint_warnings(joint):
            about.setdefault(text, []).append(joint.name)
    return [f"{', '.join(names)}: {text}" for text, names in about.items()]


def _is_none(name: str, value: float) -> bool:
    """Return whether a parameter that ended at a bound is 0: the search stops a little inside."""
    return abs(value) <= 0.01 * PARAMETERS[PLACE[name.replace(" ", "_")]].scale


def headline(estimate: ActuatorEstimate) -> str:
    """Return the first line of the answer."""
    count = len(estimate.joints)
    tested = [joint.mean_error(joint.test) for joint in estimate.joints if joint.test]
    unit = thousandth_of(estimate.joints)
    error = f"; test error {1e3 * float(np.mean(tested)):.3g} {unit}" if tested else "; no test logs"
    if any(text.startswith(EXTRAPOLATION) for joint in estimate.joints for text in joint.remarks):
        error += f" ({EXTRAPOLATION} to another kp)"
    return f"{estimate.robot}: actuators of {count} joint{'s' * (count > 1)} from commands and positions{error}"
