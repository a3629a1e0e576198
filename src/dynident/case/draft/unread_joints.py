"""Joints whose columns a draft does not read, such as grippers: they jump, or have no torques. They are locked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.case.draft.joint_choice import JointChoice
from dynident.case.draft.readings import read_rows
from dynident.case.draft.recognition import Recognised, SignalSource
from dynident.case.draft.signal_units import position_factors, position_unit
from dynident.case.draft.yaml_words import few
from dynident.case.evidence.positions import STILL, steps
from dynident.data.formats import LogTable
from dynident.data.profiles import pattern_names
from dynident.model.robot import Robot

#: How far, in m, the centre of mass of a link may shift by a joint at its end that is locked while it moves: no model
#: knows the centre of mass of a link better.
SHIFT = 0.003


def without_grippers(found: Recognised) -> Recognised:
    """Return what was recognised without the joints that nothing can be identified of, and where those are locked.

    Those that jump between a few positions: no acceleration can be made of such a column, and its steps have power up
    to the sampling rate, which would set the cut-off of all joints. And those whose torques or currents have one value
    in all rows, as drivers write them for fingers, where their motion changes next to nothing for the arm.
    """
    names = found.joints.names
    q = np.concatenate([reading.signals["q"] for reading in found.readings])
    if not found.joints.certain or not found.effort or len(names) != q.shape[1] or found.on_motors:
        return found
    moves = np.ptp(q, axis=0) >= STILL
    jumps = moves & np.array([steps(column) for column in q.T])  # what stands may have the noise of its encoder
    out: list[int] = np.flatnonzero(jumps | (moves & ~jumps & _unmeasured(found, q))).tolist()
    keep = [k for k in range(len(names)) if k not in out]
    if not out or not np.any(moves[keep]):
        return found
    sources = {signal: _narrowed(source, names, keep) for signal, source in found.sources.items()}
    if found.profiles and not all(source.pattern for source in sources.values()):
        return found  # the numbers of a profile's columns are those of its joints
    readings = tuple(
        replace(
            reading, signals={signal: _kept(values, keep, len(names)) for signal, values in reading.signals.items()}
        )
        for reading in found.readings
    )
    grippers = {}
    for k in out:
        low, high = _range(found, q, k)
        why = f"jumps between {len(np.unique(q[:, k]))} positions, of which no acceleration can be made"
        why = why if jumps[k] else f"has one value of {found.effort} in all rows, and hardly moves a mass"
        grippers[names[k]] = (0.5 * (low + high), why)
    why = f"{found.joints.why}; without {few(list(grippers), 4)}, of which nothing can be identified"
    left = tuple(names[k] for k in keep)
    return replace(found, sources=sources, readings=readings, grippers=grippers, joints=JointChoice(left, True, why))


def _range(found: Recognised, q: Array, k: int) -> tuple[float, float]:
    """Return the lowest and the highest position of a joint in rad or m; q (N, n) is in the file's units."""
    joints = {joint.name: joint for joint in found.robot.active}
    unit = position_unit(q[:, [k]], [joints[found.joints.names[k]]], "")
    factor = position_factors(unit, 1)[0]
    return float(factor * q[:, k].min()), float(factor * q[:, k].max())


def _unmeasured(found: Recognised, q: Array) -> BoolArray:
    """Return which joints have one value of torque or current and can be locked without harm, shape (n,)."""
    names = found.joints.names
    efforts = np.concatenate([reading.signals[found.effort] for reading in found.readings])
    if efforts.shape != q.shape:
        return np.zeros(len(names), dtype=bool)
    flat = np.ptp(efforts, axis=0) == 0
    return np.array(
        [bool(flat[k]) and _is_light(found.robot, names[k], *_range(found, q, k)) for k in range(len(names))]
    )


def _is_light(robot: Robot, name: str, low: float, high: float) -> bool:
    """Return whether a joint carries no other that moves and shifts the centre of mass of its link by next to nothing.

    Joints that follow it go with it: two fingers that open shift none.
    """
    if robot.dof < 2:
        return False
    shut, wide = robot.locked({name: low}), robot.locked({name: high})
    if name in shut.held:
        return False
    own = next(link.name for link, joint in zip(robot.links, robot.joints, strict=True) if joint.name == name)
    for one, other in zip(shut.links, wide.links, strict=True):
        if one.inertia is None or other.inertia is None:
            if own in one.fixed:
                return False
            continue
        shift = np.linalg.norm(one.inertia.first_moment - other.inertia.first_moment)
        if shift > SHIFT * one.inertia.mass:
            return False
    return True


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
