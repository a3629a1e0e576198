"""Which of several groups of columns that say torque are measured: those of a model have no friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.case.draft.column_groups import Group, groups_of_robot
from dynident.case.draft.readings import cutoff_from, longest_part, read_rows
from dynident.case.draft.recognition import Recognised
from dynident.case.draft.signal_choice import why_refused
from dynident.case.draft.structure import explained_shares
from dynident.data.formats import LogTable
from dynident.errors import LogFormatError

#: First rows that are looked at for columns that never change.
ROWS = 1 << 16

#: Correlation with the torques that are read from which columns are another reading of them, at half of the joints, and
#: difference from these, of their size, below which they are the same, filtered or rounded.
ALIKE, SAME = 0.5, 0.02

#: Difference of what bodies without friction leave of two sets up to which these are one torque, filtered otherwise.
SAME_FRICTION = 0.1

#: Share of the variance that bodies without friction leave of a model's torques at most (those of a commanded motion
#: left 0.01, measured ones of three arms 0.17 and more), times by which they leave more of measured ones, and share of
#: that which friction explains: else it is noise, or a filter, of torques without friction.
OF_MODEL, MORE, BY_FRICTION = 0.03, 5.0, 0.5


def measured_torques(found: Recognised, tables: Sequence[LogTable]) -> tuple[Recognised, Mapping[str, str]]:
    """Return what is recognised where several groups of columns say torque, and the columns that a model computed.

    Args:
        found: With its joints, units and readings.
        tables: The opened logs.

    Returns:
        What is recognised, with the question which columns are measured where values do not tell; and columns that are
        left out, each with the reason.
    """
    if found.profiles or found.structure is not None or found.sample is None or found.effort != "torque":
        return found, {}
    robot, log = found.sample
    place = max(range(len(tables)), key=lambda k: found.readings[k].duration)
    order = [found.joints.names.index(name) for name in robot.joint_names]
    read, others = np.asarray(log.torque), list[tuple[Group, Array]]()
    for group in _others(found):
        try:
            reading = read_rows(tables[place], found.time, {"torque": group.names})
        except LogFormatError:
            continue
        rows = longest_part(reading.time * found.to_seconds)
        values = reading.signals["torque"][rows][:, order]
        if values.shape == read.shape and _is_rival(read, values):
            others.append((group, values))
    if not others:
        return found, {}
    cutoff = cutoff_from(found.band_hz, 1.0 / float(np.median(np.diff(log.time))))
    each = [read, *(values for _, values in others)]
    left, beside = (
        [1.0 - share for share in explained_shares(robot, log.time, log.q, each, cutoff, has_friction=friction)]
        for friction in (False, True)
    )
    most = max((a for a, b in zip(left, beside, strict=True) if a - b >= BY_FRICTION * a), default=0.0)
    names = [found.sources["torque"].columns, *(group.names for group, _ in others)]
    measured = [k for k in range(len(left)) if not (left[k] < OF_MODEL and MORE * left[k] < most)]
    computed = {
        name: f"torques of a model: bodies without friction explain {100 * (1 - left[k]):.4g} % of them"
        for k in range(len(left))
        if k not in measured
        for name in names[k]
    }
    measured = [k for k in measured if k == 0 or abs(left[k] - left[0]) > SAME_FRICTION * left[0]]
    if 0 in measured and len(measured) > 1:
        shown = [found.sources["torque"].shown(), *(group.shown() for group, _ in others)]
        told = ", ".join(f"{100 * left[k]:.3g} % of {shown[k]}" for k in measured)
        doubt = (
            f"which columns are the measured torques: {' or '.join(shown[k] for k in measured)}? Bodies without "
            f"friction leave {told}"
        )
        found = replace(found, sources={**found.sources, "torque": replace(found.sources["torque"], doubt=doubt)})
    return found, computed


def without_change(rivals: Mapping[str, Sequence[Group]], table: LogTable) -> list[Group]:
    """Return the groups that may be torques or currents and whose columns never change."""
    groups = [group for signal in ("torque", "current") for group in rivals.get(signal, ())]
    try:
        values = next(table.batches([name for group in groups for name in group.names], ROWS), None)
    except LogFormatError:
        return []
    if values is None or not len(values):
        return []
    ends = np.cumsum([len(group.names) for group in groups])
    each = np.split(np.ptp(values, axis=0), ends[:-1])
    return [group for group, ranges in zip(groups, each, strict=True) if not ranges.any()]


def _others(found: Recognised) -> list[Group]:
    """Return further groups of columns that say torque and may be measured, one column per joint that is read."""
    source = found.sources["torque"]
    return [
        group
        for group in groups_of_robot(
            tuple(n for n in found.header if n not in source.columns), found.robot, found.stated
        )
        if group.meaning.signal == "torque"
        and group.meaning.side in ("", source.side)
        and len(group.names) == len(source.columns)
        and not why_refused(group)
    ]


def _is_rival(read: Array, values: Array) -> bool:
    """Return whether columns follow the torques that are read, shape (N, n) each, and are others."""
    own, other = read - read.mean(axis=0), values - values.mean(axis=0)
    sizes, theirs = np.linalg.norm(own, axis=0), np.linalg.norm(other, axis=0)
    if np.all(np.linalg.norm(own - other, axis=0) <= SAME * sizes) or not np.all(np.isfinite(values)):
        return False
    moved = (sizes > 0) & (theirs > 0)
    alike = np.abs(np.sum(own * other, axis=0))[moved] / (sizes * theirs)[moved]
    return bool(2 * np.count_nonzero(alike > ALIKE) > len(sizes))
