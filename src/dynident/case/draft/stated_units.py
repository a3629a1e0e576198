"""What profiles and headers state of units, before the values are looked at."""

from __future__ import annotations

from dynident.case.draft.column_groups import Group, groups_of_robot
from dynident.case.draft.column_words import FORCE_WORDS, tokens_of
from dynident.case.draft.recognition import Recognised
from dynident.case.draft.signal_units import SignalUnit


def units_of_profile(found: Recognised) -> dict[str, SignalUnit]:
    """Return the units that the profile states."""
    if not found.profiles:
        return {}
    fit = found.profiles[0]
    why = f"profile {fit.name}"
    units = {"time": SignalUnit((fit.profile.time_unit,), True, why)}
    for channel in fit.channels:
        quantity = {"q": "position", "dq": "velocity", "torque": "torque", "current": "current"}.get(channel.signal)
        if quantity and channel.unit:
            units[quantity] = SignalUnit((channel.unit,), True, why)
    return units


def column_groups(found: Recognised) -> list[Group]:
    """Return the sets of columns that the names tell, then those that the values tell."""
    by_values = [] if found.structure is None else found.structure.groups.values()
    return [*groups_of_robot(found.header, found.robot, found.stated), *by_values]


def stated_unit(found: Recognised, signal: str) -> str:
    """Return the unit in the names of the columns of a signal; empty where they state none."""
    if set(units_in_names(found, signal)) == {"N m", "N"}:
        return "N m"
    columns = found.sources[signal].columns
    return next((g.meaning.unit for g in column_groups(found) if set(columns) <= set(g.names)), "")


def units_in_names(found: Recognised, signal: str) -> tuple[str, ...]:
    """Return the units in the names of the columns of a signal where they differ; else nothing."""
    columns = found.sources[signal].columns
    return next((g.units for g in column_groups(found) if g.names == columns), ())


def hinges_of_forces(found: Recognised) -> list[str]:
    """Return the joints that turn whose own columns of torque say force: by the unit N, or by the word and no unit."""
    kinds, units = {joint.name: joint.kind for joint in found.robot.active}, units_in_names(found, "torque")
    columns = found.sources["torque"].columns
    each = units or (stated_unit(found, "torque"),) * len(columns)
    return [
        joint
        for joint, name, unit in zip(found.joints.names, columns, each, strict=False)
        if kinds[joint] == "revolute" and (unit == "N" or (not unit and FORCE_WORDS.intersection(tokens_of(name))))
    ]


def as_header(told: SignalUnit, units: tuple[str, ...]) -> SignalUnit:
    """Return units by the limits of the joints; asked where the header states others column by column."""
    if not units or told.words == units:
        return told
    return SignalUnit(told.words, False, f"the header states [{', '.join(units)}]; {told.why}")


def unit_of_motors(stated: str) -> SignalUnit:
    """Return the unit of positions of motors."""
    if stated:
        return SignalUnit((stated,), True, f"the header states {stated}")
    return SignalUnit((), False, "positions of motors, which no limit of a joint bounds")
