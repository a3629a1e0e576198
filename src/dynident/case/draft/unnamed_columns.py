"""Columns whose names do not tell the positions: what their values say, beside what names say of the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.case.draft.column_groups import groups_of
from dynident.case.draft.joint_choice import choose_joints
from dynident.case.draft.recognition import Recognised, SignalSource
from dynident.case.draft.signal_choice import choose_signals
from dynident.case.draft.structure import ROWS, structure_of
from dynident.case.draft.yaml_words import listed
from dynident.data.formats import LogTable
from dynident.data.formats._clocked_table import with_clock
from dynident.errors import LogFormatError


def by_structure(found: Recognised, tables: Sequence[LogTable]) -> tuple[Recognised, Sequence[LogTable]]:
    """Return what the values of columns without telling names say, and the tables, with the rate that they have."""
    if len(found.header) <= found.robot.dof:
        return found, tables
    header = (found.time, *found.header) if found.is_clocked else found.header
    try:
        values = next(tables[0].batches(header, ROWS), np.empty((0, len(header))))
    except LogFormatError:  # some column holds words
        return found, tables
    told = structure_of(found.robot, header, values, found.time)
    if "q" not in told.groups:
        return replace(found, time=found.time or told.time), tables
    refused = {name for group, _ in found.refused for name in group.names}
    sources = {
        signal: SignalSource(group.names, "", "link", told.evidence[signal])
        for signal, group in told.groups.items()
        if (signal not in told.rivals or signal == "q") and not refused.intersection(group.names)
    }
    named = _named_efforts(found, told.groups["q"].count)
    if named:  # what a name says stands, whatever else fits
        sources = {signal: source for signal, source in sources.items() if signal != "torque"} | named
    left_out = {**found.left_out, **told.left_out}
    time, is_clocked = found.time or told.time, found.is_clocked
    if not time and told.rate_hz:
        time, is_clocked = f"{np.format_float_positional(told.rate_hz, trim='-')} Hz", True
        tables = [with_clock(table, time, told.rate_hz) for table in tables]
    rivals = {key: groups for key, groups in told.rivals.items() if key != "q" and not (named and key == "torque")}
    joints = choose_joints(found.robot, told.groups["q"], np.zeros((1, told.groups["q"].count)))
    likely = listed(told.likely_effort) if told.likely_effort and not named else ""
    found = replace(
        found, likely_effort=likely, time=time, is_clocked=is_clocked, sources=sources, rivals=rivals, joints=joints
    )
    return replace(found, left_out=left_out, structure=told), tables


def _named_efforts(found: Recognised, count: int) -> dict[str, SignalSource]:
    """Return the torques, or else the currents, of so many joints that names tell where they do not tell positions."""
    efforts = choose_signals(groups_of(found.header, found.robot.joint_names), count, True).groups
    for signal in ("torque", "current"):
        if signal in efforts and efforts[signal].count == count:
            return {signal: SignalSource.of_group(efforts[signal])}
    return {}
