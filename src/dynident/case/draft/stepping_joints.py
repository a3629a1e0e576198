"""Joints that jump between positions, such as grippers, or have no torques: they are locked and not in the draft."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.case.draft.joint_choice import JointChoice
from dynident.case.draft.readings import read_rows
from dynident.case.draft.recognition import Recognised, SignalSource
from dynident.case.draft.signal_units import position_factors, position_unit
from dynident.case.draft.yaml_words import few
from dynident.case.evidence.positions import STILL, steps
from dynident.data.formats import LogTable
from dynident.data.profiles import pattern_names


def without_steps(found: Recognised) -> Recognised:
    """Return what was recognised without the joints that jump between a few positions, and where those are locked.

    No acceleration can be made of such a column, and its steps have power up to the sampling rate: it would set the
    cut-off of all joints.
    """
    names = found.joints.names
    q = np.concatenate([reading.signals["q"] for reading in found.readings])
    if not found.joints.certain or not found.effort or len(names) != q.shape[1] or found.on_motors:
        return found
    moves = np.ptp(q, axis=0) >= STILL
    jumps = moves & np.array([steps(column) for column in q.T])  # what stands may have the noise of its encoder
    if not jumps.any() or not np.any(moves & ~jumps):
        return found
    keep: list[int] = np.flatnonzero(~jumps).tolist()
    left = [names[k] for k in keep]
    sources = {signal: _narrowed(source, names, keep) for signal, source in found.sources.items()}
    if found.profiles and not all(source.pattern for source in sources.values()):
        return found  # the numbers of a profile's columns are those of its joints
    readings = tuple(
        replace(
            reading, signals={signal: _kept(values, keep, len(names)) for signal, values in reading.signals.items()}
        )
        for reading in found.readings
    )
    out: list[int] = np.flatnonzero(jumps).tolist()
    joints = {joint.name: joint for joint in found.robot.active}
    unit = [position_unit(q[:, [k]], [joints[names[k]]], "") for k in out]
    middle = [0.5 * (q[:, k].min() + q[:, k].max()) * position_factors(u, 1)[0] for k, u in zip(out, unit, strict=True)]
    stepping = {names[k]: (float(at), len(np.unique(q[:, k]))) for k, at in zip(out, middle, strict=True)}
    why = f"{found.joints.why}; without {few(list(stepping), 4)}, which jump between few positions"
    return replace(
        found, sources=sources, readings=readings, stepping=stepping, joints=JointChoice(tuple(left), True, why)
    )


def _narrowed(source: SignalSource, names: Sequence[str], keep: list[int]) -> SignalSource:
    """Return a signal with the columns of some joints; its pattern where that still names them."""
    if len(source.columns) != len(names):
        return source
    columns = tuple(source.columns[k] for k in keep)
    is_told = source.pattern and pattern_names(source.pattern, [names[k] for k in keep]) == columns
    return replace(source, columns=columns, pattern=source.pattern if is_told else "")


def _kept(values: Array, keep: list[int], count: int) -> Array:
    return values[:, keep] if values.shape[1] == count else values


def with_held(found: Recognised, tables: Sequence[LogTable]) -> Recognised:
    """Return where the joints stand that have neither torques nor currents: in the middle of their positions."""
    if not found.without_effort:
        return found
    columns = [column for column, _ in found.without_effort.values()]
    values = np.concatenate([read_rows(table, found.time, {"q": columns}).signals["q"] for table in tables])
    told = found.units["position"]
    factors = position_factors(replace(told, words=told.words[:1]), len(columns))
    middles = (factors * np.median(values, axis=0)).tolist()
    held = dict(zip(found.without_effort, zip(columns, middles, strict=True), strict=True))
    why = f"by their names; no torques or currents of {few(list(held), 4)}"
    return replace(found, without_effort=held, joints=replace(found.joints, why=why))
