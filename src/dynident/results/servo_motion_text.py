"""Motions for servos as tables and lines: the intervals that they would give, what stays unknown, what to do next."""

from __future__ import annotations

from collections.abc import Sequence
from shlex import quote
from typing import Final

import numpy as np

from dynident.actuators.command_files import ServoMotions
from dynident.actuators.parameters import PLACE, unit_for, unit_of
from dynident.actuators.servo_excitation import JointExcitation
from dynident.actuators.verdict import EXPERIMENTS, SCALE, Known, lacks_scale
from dynident.results.table_width import wrap_text
from dynident.results.text import MISSING, Column, Table, counted, format_number, format_percent, pretty_unit

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
