"""Which joints of the robot the columns of a log are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.case.draft.column_groups import Group, groups_of, joint_columns
from dynident.case.draft.yaml_words import few
from dynident.case.evidence.positions import is_within
from dynident.errors import nearest
from dynident.model.joint import Joint
from dynident.model.robot import Robot


@dataclass(frozen=True)
class JointChoice:
    """The joints of the columns.

    Attributes:
        names: In the order of the columns; the likely ones where they are asked for, empty where none is likely.
        certain: Whether the names of the columns, or their number, say so.
        why: What speaks for it.
        in_si: Whether the limits of some joints in a row hold the positions as rad or m.
        by_names: Whether the log names each joint; numbers alone leave their order in some doubt.
    """

    names: tuple[str, ...]
    certain: bool
    why: str
    in_si: bool = False
    by_names: bool = False


def choose_joints(robot: Robot, group: Group, q: Array) -> JointChoice:
    """Return the joints of the positions' columns.

    Args:
        robot: With all its joints.
        group: The positions.
        q: Their values, shape (N, k), in rad or m if they are in SI units.
    """
    if group.named:
        names = tuple(robot.joint_names[k] for k in sorted(group.columns))
        told = f"by {group.told_by}" if group.told_by else "by their names"
        return JointChoice(names, True, f"{told}{lacking(robot, names)}", by_names=True)
    if group.count == robot.dof:
        return JointChoice(robot.joint_names, True, f"{group.shown()} in the order of the chain")
    if group.count > robot.dof:
        likely = robot.joint_names
        return JointChoice(likely, False, f"{group.count} columns for the {robot.dof} joints of the robot")
    windows = _windows(robot, group.count)
    fitting = [joints for joints in windows if _within(joints, q)]
    if len(fitting) == 1:
        names = tuple(joint.name for joint in fitting[0])
        return JointChoice(names, False, "the only joints in a row whose limits hold the positions", True)
    runs = " or ".join(f"{run[0].name} to {run[-1].name}" for run in fitting[:4])
    many = f"the limits of {len(fitting) or 'no'} runs of {group.count} joints hold the positions"
    return JointChoice((), False, f"{many}{f': {runs}' if runs else ''}", bool(fitting))


def lacking(robot: Robot, names: Sequence[str]) -> str:
    """Return in words which joints of a robot are not among those named; empty for none."""
    missing = [name for name in robot.joint_names if name not in names]
    return f"; the log lacks {few(missing, 4)}" if missing else ""


def without_positions(robot: Robot, header: Sequence[str], positions: Sequence[str]) -> dict[str, str]:
    """Return the joints that a log has by name and no positions of: their columns, and the likely one, in words.

    Args:
        robot: With all its joints.
        header: Names of the columns.
        positions: The columns of the positions, told by names of joints.
    """
    groups = [group for group in groups_of(header, robot.joint_names) if group.named]
    own = next((group for group in groups if set(group.names) == set(positions)), None)
    if own is None:
        return {}
    known = {name for group in groups for name in group.names}
    found, alone = {}, joint_columns(header, robot.joint_names)
    for k, name in enumerate(robot.joint_names):
        others = [group.columns[k] for group in groups if k in group.columns] or alone.get(k, [])
        if others and k not in own.columns:
            like = [column.replace(robot.joint_names[j], name) for j, column in own.columns.items()]
            near = nearest(like[0], (column for column in header if column not in known), 0.7)
            perhaps = f" (perhaps {near.removeprefix('; did you mean ').rstrip('?')})" if near else ""
            found[name] = f"the log has {few(others, 3)} and no positions of {name}{perhaps}"
    return found


def outside_limits(joints: Sequence[Joint], q: Array) -> list[str]:
    """Return in words which joints leave the limits of the robot model, q of shape (N, n) in rad or m."""
    found = []
    for joint, low, high in zip(joints, q.min(axis=0), q.max(axis=0), strict=True):
        if not is_within(joint, float(low), float(high)):
            limits = f"limits {joint.limits.lower:.4g} to {joint.limits.upper:.4g}"
            found.append(f"{joint.name} leaves its limits ({low:.4g} to {high:.4g}, {limits})")
    return found


def _windows(robot: Robot, count: int) -> list[tuple[Joint, ...]]:
    """Return the runs of ``count`` moving joints that follow each other from the base to a leaf."""
    found: list[tuple[Joint, ...]] = []
    for tip in robot.tips:
        path = [robot.joints[k] for k in reversed(robot.carriers(tip)) if robot.joints[k].mimic is None]
        found += [tuple(path[start : start + count]) for start in range(len(path) - count + 1)]
    unique = {tuple(joint.name for joint in window): window for window in found}
    return list(unique.values())


def _within(joints: Sequence[Joint], q: Array) -> bool:
    return bool(np.all(np.isfinite(q))) and not outside_limits(joints, q)
