"""The answer about actuators, and motions for servos, as lines and tables.

Of motions: the intervals that they would give, what stays unknown, what to do next.
"""

from __future__ import annotations

from collections.abc import Sequence
from shlex import quote
from typing import Final

import numpy as np

from dynident.actuators.command_files import ServoMotions
from dynident.actuators.directions import EXCHANGED, TURNED, ZEROED
from dynident.actuators.estimate import ActuatorEstimate, JointActuator
from dynident.actuators.followed_log import FollowedJoint
from dynident.actuators.free_bodies import DEVIATION, NORMAL_95, FreeBodies
from dynident.actuators.parameters import FRICTION_MODELS, PARAMETERS, PLACE, unit_for, unit_of
from dynident.actuators.poor_fit import EXTRAPOLATION, MISSED
from dynident.actuators.servo_excitation import JointExcitation
from dynident.actuators.verdict import AS_RATIO, EXPERIMENTS, LITTLE_WEIGHT, MORE_SWINGS, SCALE, Known, lacks_scale
from dynident.results.table_width import wrap_text
from dynident.results.text import (
    MISSING,
    Column,
    Table,
    columns_of,
    counted,
    format_number,
    format_percent,
    format_value,
    pretty_unit,
)


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


#: Parameters whose half width is shown as it is, with the factor and the unit; others as a share of the value.
_ABSOLUTE: Final = {"delay": (1e3, "ms"), "angle_offset": (1e3, "mrad")}

#: Units of what is known together.
_UNITS: Final = {"stiffness": "N m/rad", "damping": "N m s/rad"}

#: Columns of the table over several joints, with short headings.
_SHORT: Final = {
    "full_torque": "torque",
    "stiffness": "stiffness",
    "back_emf": "back-EMF",
    "viscous": "viscous",
    "damping": "damping",
    "coulomb": "Coulomb",
    "load_motor": "load",
    "armature": "armature",
    "delay": "delay",
}


def interval_tables(found: ServoMotions) -> list[Table]:
    """Return the half widths of the 95 % intervals: by motion for one joint, by joint and all motions for several."""
    if len(found.joints) == 1:
        return [_by_motion(found.joints[0])]
    return [_by_joint(found)]


def _half(one: Known | None) -> str:
    """Return a half width: in the unit of _ABSOLUTE, or in % of the value."""
    if one is None:
        return MISSING
    if one.name in _ABSOLUTE:
        return format_number(_ABSOLUTE[one.name][0] * one.half_width, 2)
    return format_percent(one.half_width / abs(one.value), sign=False) if one.value else MISSING


def _by_motion(joint: JointExcitation) -> Table:
    sets, rows = list(joint.known), []
    for name in joint.names:
        value = _value(joint, name)
        unit = pretty_unit(unit_for(_UNITS.get(name) or unit_of(name), joint.slides))
        heading = name.replace("_", " ") + (f", {_ABSOLUTE[name][1]}" if name in _ABSOLUTE else "")
        shown = value if value == MISSING or unit == "1" else f"{value} {unit}"
        rows.append((heading, shown, *(_half(joint.of(name, one)) for one in sets)))
    columns = [Column("parameter"), Column("assumed"), *(Column(name, numeric=True) for name in sets)]
    return Table(tuple(columns), tuple(rows))


def _value(joint: JointExcitation, name: str) -> str:
    shown = [one.value for own in joint.known.values() for one in own if one.name == name]
    return format_number(shown[-1], 2) if shown else MISSING


def _by_joint(found: ServoMotions) -> Table:
    names = [name for name in _SHORT if any(name in joint.names for joint in found.joints)]
    known = [name for name in names if any(joint.best(name) for joint in found.joints)]
    rows = [(joint.joint, *(_half(joint.best(name)) for name in known)) for joint in found.joints]
    heads = [Column(_SHORT[name], _ABSOLUTE[name][1] if name in _ABSOLUTE else "", numeric=True) for name in known]
    columns = [Column("joint"), *heads]
    return Table(tuple(columns), tuple(rows))


def range_heading(found: ServoMotions) -> str:
    """Return what the table of ranges shows, with the units of its joints."""
    kinds = sorted({joint.slides for joint in found.joints})
    units = " or ".join(f"{unit_for('rad', slides)}, {unit_for('rad/s', slides)}" for slides in kinds)
    return f"simulated motion beside the limits ({units})"


def range_table(found: ServoMotions) -> Table:
    """Return where the simulated motions go, beside the limits: by motion for one joint, by joint for several."""
    single = len(found.joints) == 1
    rows = []
    for joint, (lower, upper, speed) in zip(found.joints, found.limits.tolist(), strict=True):
        for part in [[one] for one in joint.motions] if single else [joint.motions]:
            low, high = min(one.lowest for one in part), max(one.highest for one in part)
            ends = [f"{format_number(low, 3)} to {format_number(high, 3)}", _range(lower, upper)]
            speeds = [format_number(max(one.fastest for one in part), 3), format_number(speed, 3)]
            share = format_percent(float(np.mean([one.saturated for one in part])))
            rows.append((part[0].motion.kind if single else joint.joint, *ends, *speeds, share))
    columns = ("motion" if single else "joint", "position", "limits", "speed", "limit", "saturated")
    return Table(tuple(Column(name, numeric=k > 2) for k, name in enumerate(columns)), tuple(rows))


def _range(lower: float, upper: float) -> str:
    return f"{lower:.3g} to {upper:.3g}" if np.isfinite(lower) else "none"


def servo_lines(found: ServoMotions) -> list[str]:
    """Return what is assumed of the servos; what all joints share is said once."""
    lines = []
    for words in dict.fromkeys(word for joint in found.joints for word in joint.servo.words):
        joints = [joint.joint for joint in found.joints if words in joint.servo.words]
        lines += wrapped(f"{_of(joints, found)}{words}")
    for step in dict.fromkeys(joint.resolution for joint in found.joints):
        joints = [joint.joint for joint in found.joints if joint.resolution == step]
        own = next(joint for joint in found.joints if joint.resolution == step)
        size = f"{1e3 * step:.3g} {unit_for('mrad', own.slides)}"
        text = f"encoder in steps of {size} and no other error; friction {own.servo.friction}"
        lines.append(f"{_of(joints, found)}{text}")
    return lines


def _of(joints: Sequence[str], found: ServoMotions) -> str:
    return "" if len(joints) == len(found.joints) else f"{', '.join(joints)}: "


def wrapped(text: str) -> list[str]:
    """Return a text as lines of 80 columns, those behind the first set in."""
    return wrap_text(text, 80, break_long_words=False)


def unknown_lines(found: ServoMotions) -> list[str]:
    """Return what would stay not separable or weak, and what only some of the motions separate."""
    said: dict[tuple[str, str], list[str]] = {}
    for joint in found.joints:
        own: dict[str, list[str]] = {}
        for name, text in _unknown(joint):
            own.setdefault(text, []).append(name.replace("_", " "))
        for text, names in own.items():
            said.setdefault((", ".join(names), text), []).append(joint.joint)
    return [line for (names, text), joints in said.items() for line in wrapped(f"{_of(joints, found)}{names}: {text}")]


def _unknown(joint: JointExcitation) -> list[tuple[str, str]]:
    """Return parameters with what is to be said of them."""
    found = []
    names = [name for name in joint.names if name in PLACE and name != "angle_offset"]
    scaleless = lacks_scale({name: "not separable" for name in names if joint.best(name) is None})
    for name in names:
        best, kinds, remedy = joint.best(name), joint.separated_by(name), EXPERIMENTS.get(name)
        if best is None:
            found.append((name, SCALE if scaleless else f"not separable{f'; {remedy}' if remedy else ''}"))
        elif best.label != "identified":
            found.append((name, f"{best.label}{f'; {remedy}' if remedy else ''}"))
        elif len(kinds) == 1:
            found.append((name, f"separated by {kinds[0]} alone"))
    return found


def next_lines(found: ServoMotions, case: str, folder: str | None) -> list[str]:
    """Return what to do with the files, and what was not looked at."""
    pose = ", ".join(f"{value:.3g}" for value in found.pose)
    seconds = len(found.files) * found.request.seconds
    lines = [f"{counted(len(found.files), 'file')}, {seconds:.0f} s together; a motion begins and ends at {pose}"]
    if len(found.joints) > 1:
        lines[0] += ", where the other joints are held"
    if any(one.motion.has_off for joint in found.joints for one in joint.motions):
        lines.append("release: the drive is off and the joint falls or coasts; keep its range free")
    if found.clearance is None:
        lines.append("not checked: floor, obstacles, the robot itself (the case has no workspace)")
    else:
        lines.append(f"nearest: {found.clearance[1]}, {found.clearance[0]:.3g} m more than the workspace asks for")
    if folder:
        step = f"dynident identify {quote(case)} LOGS"
        lines.append(f"next: record each file of {folder} under its own name, then {step}")
    return lines
