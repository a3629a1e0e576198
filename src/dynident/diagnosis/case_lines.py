"""The line of the case file that obeys a finding about signs or scales of columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from dynident.data.formats._units import counted_unit
from dynident.data.formats.base import QUANTITY, ColumnMap
from dynident.diagnosis.finding import Finding
from dynident.model.robot import Robot

#: Units that stand for SI, of joints that turn and of those that slide.
_SI = {
    "position": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
    "acceleration": ("rad/s^2", "m/s^2"),
    "torque": ("N m", "N"),
}


def with_case_line(finding: Finding, columns: ColumnMap, robot: Robot) -> Finding:
    """Return a finding whose remedy has the line of the case file, where signs or scales of columns are at fault.

    Args:
        finding: The finding.
        columns: The columns of the log, resolved.
        robot: The robot of the case.
    """
    factors = _factors(finding)
    if not factors or not set(factors) <= set(columns.joints):
        return finding
    if finding.name == "position sign":
        lines = [_units(signal, columns, robot, factors) for signal in ("q", "dq", "ddq") if getattr(columns, signal)]
        return replace(finding, remedy=f"turn its sign, log: units: {{{', '.join(lines)}}}, or the axis")
    if finding.name == "axis sign":
        lines = [_units(signal, columns, robot, factors) for signal in ("q", "dq", "ddq") if getattr(columns, signal)]
        lines += [_units("torque", columns, robot, factors)] if columns.torque else []
        gains = "" if columns.torque else _gains(robot, factors)
        line = f"log: units: {{{', '.join(lines)}}}" + f"; drives: {{{gains}}}" * bool(gains)
        return replace(finding, remedy=f"{finding.remedy}; the signs turned: {line}")
    if columns.torque and not (robot.is_coupled and "torque" in columns.motor):
        line = f"log: units: {{{_units('torque', columns, robot, factors)}}}"
    elif gains := _gains(robot, factors):
        line = f"drives: {{{gains}}}"
    else:
        return finding
    if finding.name == "torque sign":
        return replace(finding, remedy=f"turn the sign in the case file ({line})")
    return replace(finding, remedy=f"{finding.remedy}; where the columns have another scale, state it ({line})")


def _factors(finding: Finding) -> dict[str, float]:
    """Return what the columns of joints are to be multiplied by; nothing where the finding does not tell."""
    names = finding.joint.split(", ") if finding.joint else []
    if finding.name in ("torque sign", "position sign", "axis sign"):
        return dict.fromkeys(names, -1.0)
    if finding.name == "torque scale" and finding.severity == "error" and len(names) == 1:
        return {names[0]: finding.numbers["factor"]} if "factor" in finding.numbers else {}
    if finding.name == "torque scales":
        return {name: finding.numbers[f"factor {name}"] for name in names}
    return {}


def _units(signal: str, columns: ColumnMap, robot: Robot, factors: Mapping[str, float]) -> str:
    """Return the units of a signal, those of some joints counted anew, such as ``torque: [N m, -N m]``."""
    quantity = QUANTITY[signal]
    words = []
    for name, word in zip(columns.joints, columns.units.of(quantity, len(columns.joints)), strict=True):
        count, unit = counted_unit(word)
        if unit == "SI":
            slides = any(joint.name == name and joint.kind == "prismatic" for joint in robot.active)
            unit = _SI[quantity][slides]
        words.append(_counted(count * factors.get(name, 1.0), unit))
    return f"{quantity}: [{', '.join(words)}]"


def _counted(count: float, unit: str) -> str:
    """Return a unit behind the number of it that one count is."""
    return unit if count == 1.0 else f"-{unit}" if count == -1.0 else f"{count:.4g} {unit}"


def _gains(robot: Robot, factors: Mapping[str, float]) -> str:
    """Return the drive gains of some joints, multiplied; nothing where one has none."""
    gains: Mapping[str, float | None] = {joint.name: joint.drive.gain for joint in robot.active}
    if any(gains.get(name) is None for name in factors):
        return ""
    return ", ".join(f"{name}: {{gain: {(gains[name] or 0.0) * factor:.6g}}}" for name, factor in factors.items())
