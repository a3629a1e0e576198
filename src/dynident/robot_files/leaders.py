"""Joints that follow others: which of them leads, and what the leader carries of its followers."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from dynident.errors import BadOption, UnknownChoice
from dynident.model.joint import Drive, Joint, JointLimits, Mimic
from dynident.model.robot import Robot


def carried_by_leaders(joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """Return joints of which those that are followed have the rotor inertia and friction of their followers too.

    A follower that turns m times as fast as its leader has m^2 of its rotor inertia and damping there, and m of its
    Coulomb friction (without its sign); it has none itself then.
    """
    found = {joint.name: joint for joint in joints}
    for joint in joints:
        if joint.mimic is None:
            continue
        leader, ratio = found[joint.mimic.joint], joint.mimic.multiplier
        rotor, damping, friction = joint.drive.reflected_inertia, joint.damping or 0.0, joint.friction or 0.0
        if rotor or damping or friction:
            gear = leader.drive.gear_ratio
            found[leader.name] = replace(
                leader,
                drive=replace(leader.drive, rotor_inertia=leader.drive.rotor_inertia + (ratio / gear) ** 2 * rotor),
                damping=(leader.damping or 0.0) + ratio**2 * damping,
                friction=(leader.friction or 0.0) + abs(ratio) * friction,
            )
            found[joint.name] = replace(joint, drive=Drive(), damping=0.0, friction=0.0)
    return tuple(found.values())


def led_by(robot: Robot, name: str) -> Robot:
    """Return the robot in which a follower moves on its own and what it followed, q = m q' + o, follows it.

    The torque of the one that moves on its own is that of the drive at its own joint: 1 / m of that at the other one,
    by virtual work. It has the rotor inertia and friction of all that follow it. Limits that it does not have are those
    of the joint that it followed.

    Args:
        robot: No motor of it moves more than its own joint.
        name: The follower; a joint that moves on its own already stays as it is.

    Raises:
        UnknownChoice: No such joint.
        BadOption: It follows with the ratio 0, or motors are coupled.
    """
    by_name = {joint.name: joint for joint in robot.joints}
    if name not in by_name:
        raise UnknownChoice("joint", name, list(by_name))
    rule, own = by_name[name].mimic, by_name[name].limits
    if rule is None:
        return robot
    if rule.multiplier == 0.0 or robot.is_coupled:
        raise BadOption("joints", name, f"it follows '{rule.joint}', and cannot lead it: name '{rule.joint}'")
    ratio, offset, limits = rule.multiplier, rule.offset, by_name[rule.joint].limits
    low, high = sorted(ratio * end + offset for end in (limits.lower, limits.upper))
    bounds = JointLimits(
        lower=own.lower if np.isfinite(own.lower) else low,
        upper=own.upper if np.isfinite(own.upper) else high,
        velocity=min(own.velocity, abs(ratio) * limits.velocity),
        acceleration=min(own.acceleration, abs(ratio) * limits.acceleration),
        jerk=min(own.jerk, abs(ratio) * limits.jerk),
        effort=min(own.effort, limits.effort / abs(ratio)),
        effort_rate=min(own.effort_rate, limits.effort_rate / abs(ratio)),
    )
    ties: dict[str, Mimic | None] = {name: None, rule.joint: Mimic(name, 1.0 / ratio, -offset / ratio)}
    for joint in robot.joints:
        if joint.mimic is not None and joint.mimic.joint == rule.joint:
            share = joint.mimic.multiplier / ratio
            ties.setdefault(joint.name, Mimic(name, share, joint.mimic.offset - share * offset))
    own_limits = {name: bounds}
    joints = [
        replace(each, mimic=ties.get(each.name, each.mimic), limits=own_limits.get(each.name, each.limits))
        for each in robot.joints
    ]
    return replace(robot, joints=carried_by_leaders(joints), coupling=None)


def led_by_drives(robot: Robot, driven: Collection[str]) -> Robot:
    """Return the robot in which what has a drive moves on its own, where a joint without one led it alone.

    Args:
        robot: As its file ties joints.
        driven: Names of the joints with a drive.
    """
    for leader in robot.joint_names:
        followers = (joint for joint in robot.joints if joint.mimic is not None and joint.mimic.joint == leader)
        mine = [joint.name for joint in followers if joint.name in driven]
        if len(mine) == 1 and leader not in driven:
            robot = led_by(robot, mine[0])
    return robot


def followed(joint: Joint) -> str:
    """Return in words what a joint follows; empty for one that moves on its own."""
    rule = joint.mimic
    if rule is None:
        return ""
    offset = f" {'+' if rule.offset > 0 else '-'} {abs(rule.offset):.6g}" if rule.offset else ""
    return f"{joint.name} = {rule.multiplier:.6g} {rule.joint}{offset}"
