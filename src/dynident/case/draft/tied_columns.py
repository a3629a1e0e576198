"""Columns of tied joints: which joint moves on its own by the columns that a log has, and which are left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from dynident.case.draft.column_groups import groups_of
from dynident.case.draft.joint_choice import JointChoice
from dynident.case.draft.recognition import Recognised
from dynident.case.draft.yaml_words import listed
from dynident.data.formats import LogTable
from dynident.model.robot import Robot
from dynident.robot_files.leaders import followed, led_by

#: Rows that are looked at.
_ROWS = 1 << 15

#: Torque of a joint without a drive, as a share of that of the drive of the joint that it is tied to.
_IDLE = 0.2

#: What a follower may stray from the motion of its leader, as a share of that motion.
_STRAYS = 0.05


#: The columns of two joints that are tied, and the ratio of the follower: leader, follower.
Pair: TypeAlias = tuple[str, str, float]


def led_by_columns(robot: Robot, table: LogTable) -> tuple[Robot, list[str], list[Pair]]:
    """Return the robot in which those of tied joints move on their own whose columns a log has, and remarks.

    The last are the columns of torques of tied joints that both have some.

    Where a log has the positions of both, the torques tell which has the drive: those of the other one are noise, or
    are not there.

    Args:
        robot: As its file ties joints.
        table: The log; its columns have the names of joints.
    """
    remarks, pairs = list[str](), list[Pair]()
    positions, efforts = _named_columns(robot, table) if robot.dof < len(robot.joints) else ({}, {})
    for name in [joint.name for joint in robot.joints if joint.name in positions]:
        joint = next(joint for joint in robot.joints if joint.name == name)
        rule = joint.mimic
        if rule is None or not rule.multiplier:
            continue
        leader = rule.joint
        own, other = (_size(table, efforts.get(one, "")) for one in (name, leader))
        own *= abs(rule.multiplier)
        is_driven = other < _IDLE * own if leader in positions else leader not in efforts or other < _IDLE * own
        if is_driven:
            robot = led_by(robot, name)
            what = "torque" if leader in positions else "positions"
            remarks.append(f"{name} moves on its own and {leader} follows it: the log has the {what} of {name}")
        elif own > _IDLE * other > 0.0:
            pairs.append((efforts[leader], efforts[name], rule.multiplier))
    return robot, remarks, pairs


def with_sums(found: Recognised, pairs: Sequence[Pair]) -> Recognised:
    """Return what was found with the torques of tied joints as those of the joint that moves on its own.

    By virtual work that is the sum of both, that of the follower times its ratio. ``qfrc`` of MuJoCo are forces at each
    joint for sure; of other columns one may be a copy of the other, and it is asked.
    """
    source = found.sources.get(found.effort)
    pairs = [] if source is None else [pair for pair in pairs if pair[0] in source.columns]
    if source is None or not pairs:
        return found
    columns = {leader: leader for leader in source.columns}
    for leader, follower, ratio in pairs:
        factor = "" if abs(ratio) == 1.0 else f"{abs(ratio):.6g} * "
        columns[leader] += f" {'-' if ratio < 0 else '+'} {factor}{follower}"
    names = " and ".join(name for leader, follower, _ in pairs for name in (leader, follower))
    doubt = f"are {names} the forces of drives of their own at joints that are tied? Then the joint that leads has the "
    doubt += f"sum, the follower's times its ratio; where one is a copy of the other, {listed(source.columns)}"
    is_sure = all("qfrc" in name for leader, follower, _ in pairs for name in (leader, follower))
    how = f"{source.how}; of joints that are tied the sum, by virtual work"
    made = replace(source, columns=tuple(columns.values()), pattern="", how=how, doubt="" if is_sure else doubt)
    return replace(found, sources={**found.sources, found.effort: made})


def without_followers(found: Recognised) -> tuple[Recognised, list[Pair]] | None:
    """Return what was found without the columns of followers, where numbers name the columns of all joints.

    With it go the columns of torques of tied joints that both have some. None where numbers do not name them: other
    counts, or values that do not follow as the robot model says.
    """
    robot, source, count = found.robot, found.sources["q"], len(found.robot.joints)
    if count == robot.dof or len(source.columns) != count:
        return None
    place = {joint.name: k for k, joint in enumerate(robot.joints)}
    for joint, rule in [(joint.name, joint.mimic) for joint in robot.joints if joint.mimic is not None]:
        one, other = place[joint], place[rule.joint]
        for signals in (reading.signals for reading in found.readings):
            ours, theirs = signals["q"][:, one], rule.multiplier * signals["q"][:, other]
            if np.std(ours - theirs) > _STRAYS * max(np.std(ours), np.std(theirs)):
                return None
        effort = found.readings[0].signals.get(found.effort, np.empty((0, 0)))
        is_whole = effort.shape[1] == count and rule.joint in robot.joint_names
        if is_whole and np.std(effort[:, other]) < _IDLE * abs(rule.multiplier) * np.std(effort[:, one]):
            robot = led_by(robot, joint)
    pairs = _pairs(robot, found) if found.effort and len(found.sources[found.effort].columns) == count else []
    kept = [k for k, joint in enumerate(robot.joints) if joint.mimic is None]
    is_first = kept == list(range(len(kept)))
    sources = {
        key: replace(one, columns=tuple(one.columns[k] for k in kept), pattern=one.pattern * is_first)
        if len(one.columns) == count
        else one
        for key, one in found.sources.items()
    }
    readings = tuple(
        replace(
            reading,
            signals={key: each[:, kept] if each.shape[1] == count else each for key, each in reading.signals.items()},
        )
        for reading in found.readings
    )
    ties = ", ".join(filter(None, map(followed, robot.joints)))
    why = f"{source.shown()} in the order of the chain, and their values have {ties}"
    joints = JointChoice(robot.joint_names, True, why)
    return replace(found, robot=robot, sources=sources, readings=readings, joints=joints), pairs


def _pairs(robot: Robot, found: Recognised) -> list[Pair]:
    """Return the columns of torques, in the order of all joints, of tied joints that both have some."""
    names, sizes = found.sources[found.effort].columns, np.std(found.readings[0].signals[found.effort], axis=0)
    place = {joint.name: k for k, joint in enumerate(robot.joints)}
    rules = [(k, joint.mimic) for k, joint in enumerate(robot.joints) if joint.mimic is not None]
    return [
        (names[place[rule.joint]], names[k], rule.multiplier)
        for k, rule in rules
        if abs(rule.multiplier) * sizes[k] > _IDLE * sizes[place[rule.joint]] > 0.0
    ]


def _named_columns(robot: Robot, table: LogTable) -> tuple[Mapping[str, str], Mapping[str, str]]:
    """Return the columns of positions, and of torques or currents, by the name of the joint."""
    names = [joint.name for joint in robot.joints]
    positions, efforts = dict[str, str](), dict[str, str]()
    for group in groups_of(table.header, names):
        known = {"q": positions, "torque": efforts, "current": efforts}.get(group.meaning.signal)
        if known is not None and group.named and group.meaning.kind in ("", "measured"):
            for place, column in group.columns.items():
                known.setdefault(names[place], column)
    return positions, efforts


def _size(table: LogTable, column: str) -> float:
    """Return how much a column varies; 0 where there is none, or no number in it."""
    if not column:
        return 0.0
    values = next(table.batches([column], _ROWS), np.zeros((1, 1)))
    numbers = values[np.isfinite(values)]
    return float(np.std(numbers)) if len(numbers) else 0.0
