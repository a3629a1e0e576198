"""Columns whose names do not tell positions or torques: what their values say, beside what names say of the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.case.draft.column_groups import groups_of_robot, joint_columns
from dynident.case.draft.column_words import ENABLED, is_pressure, tokens_of
from dynident.case.draft.joint_choice import choose_joints
from dynident.case.draft.recognition import Recognised, SignalSource
from dynident.case.draft.signal_choice import choose_signals
from dynident.case.draft.structure import ROWS, STANDS, TableStructure, structure_of
from dynident.case.draft.time_columns import clock_columns
from dynident.case.draft.yaml_words import listed
from dynident.data.formats import LogTable
from dynident.data.formats._clocked_table import with_clock
from dynident.errors import LogFormatError


def clock_by_values(header: Sequence[str], table: LogTable) -> str:
    """Return the first column that may be the time by its name and runs forward, as a duration does not; or empty."""
    for name in clock_columns(header):
        try:
            values = next(table.batches([name], ROWS), np.empty((0, 1)))
        except LogFormatError:
            continue
        if len(values) > 1 and np.mean(~(np.diff(values[:, 0]) > 0)) <= STANDS:
            return name
    return ""


def by_structure(found: Recognised, tables: Sequence[LogTable]) -> tuple[Recognised, Sequence[LogTable]]:
    """Return what the values of columns without telling names say, and the tables, with the rate that they have."""
    if len(found.header) <= found.robot.dof:
        return found, tables
    told = _structure(found, tables[0])
    if told is None:
        return found, tables
    if "q" not in told.groups:
        return replace(found, time=found.time or told.time), tables
    refused = _refused(found)
    sources = {
        signal: SignalSource(group.names, "", "link", told.evidence[signal])
        for signal, group in told.groups.items()
        if (signal not in told.rivals or signal == "q") and not refused.intersection(group.names)
    }
    named = _named_efforts(found, told.groups["q"].count)
    if named:  # what a name says stands, whatever else fits
        sources = {signal: source for signal, source in sources.items() if signal != "torque"} | named
    left_out = {**found.left_out, **told.left_out}
    found, tables = _timed(found, told, tables)
    rivals = {key: groups for key, groups in told.rivals.items() if key != "q" and not (named and key == "torque")}
    joints = choose_joints(found.robot, told.groups["q"], np.zeros((1, told.groups["q"].count)))
    likely = listed(told.likely_effort) if told.likely_effort and not named else ""
    found = replace(found, likely_effort=likely, sources=sources, rivals=rivals, joints=joints)
    return replace(found, left_out=left_out, structure=told), tables


def with_missing_signals(found: Recognised, tables: Sequence[LogTable]) -> tuple[Recognised, Sequence[LogTable]]:
    """Return what is recognised, and the tables, with the time and torques by values where names give positions alone.

    Velocities are the derivative of the positions by the time: a column that runs forward in even steps, or a rate.
    Torques are asked for: their names are not known, and say nothing of their unit.
    """
    positions, effort = found.sources.get("q"), {"torque", "current"}
    known = {found.time, *_refused(found), *(name for source in found.sources.values() for name in source.columns)}
    free = [name for name in found.header if name not in known and not ENABLED.fullmatch(name)]
    has_effort = bool(effort & (found.sources.keys() | found.rivals.keys()))
    if positions is None or (found.time and (has_effort or len(free) < len(positions.columns))):
        return found, tables
    told = _structure(found, tables[0])
    if told is None or "q" not in told.groups or told.groups["q"].names != positions.columns:
        return found, tables
    if not found.time and "dq" in told.groups:
        found, tables = _timed(found, told, tables)
        found = replace(found, structure=replace(told, groups={}, rivals={})) if found.is_clocked else found
    columns = told.groups["torque"].names if "torque" in told.groups and "torque" not in told.rivals else ()
    places = {name: joint for joint, own in joint_columns(columns, found.joints.names).items() for name in own}
    if any(places[name] != k for k, name in enumerate(columns) if name in places):
        columns = ()  # by their names they are those of other joints
    if columns and not has_effort and set(free).issuperset(columns):
        words = tuple(dict.fromkeys(word for name in columns for word in tokens_of(name) if not word.isdigit()))
        torque = SignalSource(columns, "", "link", told.evidence["torque"], words)
        found = replace(found, sources={**found.sources, "torque": torque}, structure=replace(told, rivals={}))
    return found, tables


def _timed(
    found: Recognised, told: TableStructure, tables: Sequence[LogTable]
) -> tuple[Recognised, Sequence[LogTable]]:
    """Return what is recognised with the time or the rate that values tell, where it has none, and the tables."""
    if found.time or told.time or not told.rate_hz:
        return replace(found, time=found.time or told.time), tables
    time = f"{np.format_float_positional(told.rate_hz, trim='-')} Hz"
    found = replace(found, time=time, is_clocked=True)
    return found, [with_clock(table, time, told.rate_hz) for table in tables]


def _structure(found: Recognised, table: LogTable) -> TableStructure | None:
    """Return what the values of a log say; None where some column holds words."""
    header = (found.time, *found.header) if found.is_clocked else found.header
    header = tuple(name for name in header if not is_pressure(name))
    try:
        values = next(table.batches(header, ROWS), np.empty((0, len(header))))
    except LogFormatError:
        return None
    return structure_of(found.robot, header, values, found.time)


def _refused(found: Recognised) -> set[str]:
    return {name for group, _ in found.refused for name in group.names}


def with_named_efforts(found: Recognised) -> Recognised:
    """Return what is recognised with the torques or currents that names tell, where positions are not known."""
    return replace(found, sources={**_named_efforts(found, found.robot.dof), **found.sources})


def _named_efforts(found: Recognised, count: int) -> dict[str, SignalSource]:
    """Return the torques, or else the currents, of so many joints that names tell where they do not tell positions."""
    efforts = choose_signals(groups_of_robot(found.header, found.robot, found.stated), count, True).groups
    for signal in ("torque", "current"):
        if signal in efforts and efforts[signal].count == count:
            return {signal: SignalSource.of_group(efforts[signal])}
    return {}
