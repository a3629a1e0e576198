"""The line of the case file that obeys a finding about signs or scales of columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from dynident.data.formats._column_map import ColumnMap
from dynident.data.formats._units import QUANTITY, UNITS, counted_unit
from dynident.diagnosis.finding import ABSOLUTE, CLOCKS, Finding
from dynident.model.robot import Robot

#: Units that stand for SI, of joints that turn and of those that slide.
_SI = {
    "position": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
    "acceleration": ("rad/s^2", "m/s^2"),
    "torque": ("N m", "N"),
}

#: Velocity over the derivative of the position between that of degrees and that of millimetres.
TURNED = 200.0


def has_case_line(finding: Finding) -> bool:
    """Return whether a line of the case file may obey a finding."""
    told = finding.name in ("position zero", ABSOLUTE, CLOCKS)
    return told or _stated(finding) is not None or bool(_factors(finding))


def with_case_line(finding: Finding, columns: ColumnMap, robot: Robot, found: Sequence[Finding] = ()) -> Finding:
    """Return a finding whose remedy has the line of the case file, where units, signs or scales are at fault.

    Args:
        finding: The finding.
        columns: The columns of the log, resolved.
        robot: The robot of the case.
        found: All findings of the log: zeros of several joints stand in one line.
    """
    if (stated := _stated(finding)) is not None:
        signal, unit = stated
        only = finding.joint.split(", ") if finding.numbers.get("alone") else columns.joints
        units = dict.fromkeys(only, unit) if unit else _position_units(finding.numbers)
        line = f"log: units: {{{QUANTITY[signal]}: {_in_unit(signal, units, columns, robot)}}}"
        return replace(finding, remedy=f"state the unit in the case file ({line})")
    if _is_zero(finding, columns):
        off = {one.joint: one.numbers["value"] for one in (*reversed(found), finding) if _is_zero(one, columns)}
        line = _zeros(columns, off)
        return replace(finding, remedy=f"{finding.remedy}; where the positions are off, state it ({line})")
    if finding.name == ABSOLUTE and (line := _sums(finding, columns)):
        return replace(finding, remedy=f"name the sum of both columns as its position ({line})")
    if finding.name == CLOCKS:
        ratio = columns.torque_clock * (1.0 + finding.numbers["value"])
        line = f"log: torque_clock: {ratio:.6g}, with preprocessing: delay_s: auto"
        return replace(finding, remedy=f"record both with the clock of one computer, or state it ({line})")
    line = _turned(finding, columns, robot)
    if not line:
        return finding
    remedy = {
        "axis sign": f"{finding.remedy}; the signs turned: {line}",
        "position sign": f"turn {'the signs' if ', ' in finding.joint else 'its sign'}, {line}, or the axis",
        "torque sign": f"turn the sign in the case file ({line})",
    }.get(finding.name, f"{finding.remedy}; where the columns have another scale, state it ({line})")
    return replace(finding, remedy=remedy)


def _sums(finding: Finding, columns: ColumnMap) -> str:
    """Return the line with a position that is the sum of two columns; empty where zeros or gears stand between."""
    places = {name: k for k, name in enumerate(columns.joints)}
    ((before, way),) = (
        (name.removeprefix("of "), way) for name, way in finding.numbers.items() if name.startswith("of ")
    )
    if not {before, finding.joint} <= places.keys() or columns.zero or "q" in columns.motor:
        return ""
    signals = dict[str, str]()
    for signal in ("q", "dq", "q_ref", "dq_ref"):
        names = [*(getattr(columns, signal) or ())]
        if not names:
            continue
        (scales,) = columns.to_si(signal, np.ones((1, len(names))))
        factor = way * scales[places[before]] / scales[places[finding.joint]]
        times = "" if abs(factor) == 1.0 else f"{abs(factor):.6g} * "
        names[places[finding.joint]] += f" {'+' if factor > 0 else '-'} {times}{names[places[before]]}"
        signals[signal] = ", ".join("'" + name.replace("'", "''") + "'" for name in names)
    return f"log: columns: {{{', '.join(f'{signal}: [{names}]' for signal, names in signals.items())}}}"


def _is_zero(finding: Finding, columns: ColumnMap) -> bool:
    return finding.name == "position zero" and finding.joint in columns.joints and not finding.beside


def _turned(finding: Finding, columns: ColumnMap, robot: Robot) -> str:
    """Return the line that turns signs or scales back; empty where the finding or the columns do not tell it."""
    factors, moved, is_scale = _factors(finding), ("q", "dq", "ddq"), finding.name == "position scale"
    of_positions = {"position sign": moved, "position scale": moved, "axis sign": (*moved, "torque")}
    turned = of_positions.get(finding.name, ("torque",))
    of_motors = robot.is_coupled and not {*turned}.isdisjoint(columns.motor)
    if not factors or not set(factors) <= set(columns.joints) or of_motors:
        return ""
    if is_scale and "q" in columns.motor and "torque" not in columns.motor:
        return f"drives: {{{_ratios(robot, factors)}}}"
    units = [_counts(signal, columns, robot, factors) for signal in turned if getattr(columns, signal)]
    lines = [f"log: units: {{{', '.join(units)}}}"] if units else []
    if columns.zero and "q" in turned and not is_scale:
        lines.append(_zeros(columns, {}, factors))
    if "torque" in turned and not columns.torque:
        gains = _gains(robot, factors)
        if not gains:
            return ""
        lines.append(f"drives: {{{gains}}}")
    return "; ".join(lines)


def _zeros(columns: ColumnMap, added: Mapping[str, float], factors: Mapping[str, float] = MappingProxyType({})) -> str:
    """Return the line with the zeros of all joints, some of them multiplied or with a value added."""
    pairs = zip(columns.joints, columns.zero or [0.0] * len(columns.joints), strict=True)
    zeros = (zero * factors.get(name, 1.0) + added.get(name, 0.0) for name, zero in pairs)
    return f"log: zero: [{', '.join(f'{zero:.6g}' for zero in zeros)}]"


def _stated(finding: Finding) -> tuple[str, str] | None:
    """Return the signal and the unit that a finding tells of it, empty for one of each joint; None for none."""
    if finding.name == "velocity unit":
        return "dq", "mm/s" if finding.numbers["ratio"] > TURNED else "deg/s"
    if finding.name == "position unit" and _position_units(finding.numbers):
        return "q", ""
    words = {"positions in degrees": "deg", "positions in millimetres": "mm", "positions in radians": "rad"}
    return ("q", words[finding.name]) if finding.name in words else None


def _position_units(numbers: Mapping[str, float]) -> dict[str, str]:
    """Return the unit of each joint whose positions are to be multiplied by a factor."""
    factors = {key.removeprefix("factor "): value for key, value in numbers.items() if key.startswith("factor ")}
    return {
        name: ("deg" if factor > 1e-2 else "mm") if factor < 1.0 else "rad" if factor < 100.0 else "m"
        for name, factor in factors.items()
    }


def _in_unit(signal: str, units: Mapping[str, str], columns: ColumnMap, robot: Robot) -> str:
    """Return the units of a signal where it is in another one at joints that may have it; stated signs stay."""
    kinds, plain = {joint.name: joint.kind for joint in robot.active}, list[str]()
    for name, count, own in _own_units(signal, columns, robot):
        fits = name in units and kinds.get(name) == UNITS[QUANTITY[signal]][units[name]][1]
        plain.append(_counted(-1.0 if count < 0.0 else 1.0, units[name]) if fits else _counted(count, own))
    return plain[0] if len(set(plain)) == 1 else f"[{', '.join(plain)}]"


def _factors(finding: Finding) -> dict[str, float]:
    """Return what the columns of joints are to be multiplied by; nothing where the finding does not tell."""
    names = finding.joint.split(", ") if finding.joint else []
    if finding.name in ("torque sign", "position sign", "axis sign"):
        return dict.fromkeys(names, -1.0)
    if finding.name == "torque scale" and finding.severity == "error" and len(names) == 1:
        return {names[0]: finding.numbers["factor"]} if "factor" in finding.numbers else {}
    if finding.name == "position scale" and len(names) == 1 and not finding.beside:
        return {names[0]: 1.0 + finding.numbers["value"]}
    if finding.name == "torque scales":
        return {name: finding.numbers[f"factor {name}"] for name in names}
    return {}


def _counts(signal: str, columns: ColumnMap, robot: Robot, factors: Mapping[str, float]) -> str:
    """Return the units of a signal, those of some joints counted anew, such as ``torque: [N m, -N m]``."""
    own = _own_units(signal, columns, robot)
    words = [_counted(count * factors.get(name, 1.0), unit) for name, count, unit in own]
    return f"{QUANTITY[signal]}: [{', '.join(words)}]"


def _own_units(signal: str, columns: ColumnMap, robot: Robot) -> Iterator[tuple[str, float, str]]:
    """Yield the joint, the number and the unit of each column of a signal, ``SI`` spelled out."""
    quantity = QUANTITY[signal]
    for name, word in zip(columns.joints, columns.units.of(quantity, len(columns.joints)), strict=True):
        count, unit = counted_unit(word)
        if unit == "SI":
            unit = _SI[quantity][any(joint.name == name and joint.kind == "prismatic" for joint in robot.active)]
        yield name, count, unit


def _counted(count: float, unit: str) -> str:
    """Return a unit behind the number of it that one count is."""
    return unit if count == 1.0 else f"-{unit}" if count == -1.0 else f"{count:.4g} {unit}"


def _ratios(robot: Robot, factors: Mapping[str, float]) -> str:
    """Return the gear ratios of drives whose joints move so many times as far."""
    ratios = {joint.name: joint.drive.gear_ratio for joint in robot.active}
    return ", ".join(f"{name}: {{gear_ratio: {ratios[name] / factor:.4g}}}" for name, factor in factors.items())


def _gains(robot: Robot, factors: Mapping[str, float]) -> str:
    """Return the drive gains of some joints, multiplied; nothing where one has none."""
    gains: Mapping[str, float | None] = {joint.name: joint.drive.gain for joint in robot.active}
    if any(gains.get(name) is None for name in factors):
        return ""
    return ", ".join(f"{name}: {{gain: {(gains[name] or 0.0) * factor:.6g}}}" for name, factor in factors.items())
