"""The drives of a drafted case file: coupling, gears, gains and what hangs on a vertical slide."""

from __future__ import annotations

import numpy as np

from dynident.case.draft.profile_fit import equally_good
from dynident.case.draft.recognition import Recognised
from dynident.case.draft.yaml_words import asked, offered, plain, quoted
from dynident.data.formats._units import RATED
from dynident.model.joint import Joint
from dynident.model.robot import Robot

#: Share that the robot model has to explain before a rough gain is worth saying.
_SURE = 0.9

#: Share of gravity along an axis about which a turn leaves all upright, and along a slide that carries weight.
_UPRIGHT, _ALONG = 0.9999, 0.9

#: Where the effort of a slide lies within these times its weight, the weight is in it.
_CARRIED = (0.5, 2.0)


def drive_lines(found: Recognised) -> list[str]:
    """Return the keys coupling and drives."""
    if not (found.effort or found.on_motors):
        return []
    return [*_coupling(found), *_drives(found)]


def _coupling(found: Recognised) -> list[str]:
    robot = found.robot
    if robot.is_coupled:
        return []
    text = (
        "does a motor turn more than its own joint (bevel gears of a wrist, parallelograms, belts)? "
        f"Then C with motor speed = C joint speed, a list of {robot.dof} rows"
    )
    return [offered("# coupling:", text)]


def _drives(found: Recognised) -> list[str]:
    moving = found.moving
    columns = found.sources["q"].columns if "q" in found.sources else ()
    names = found.joints.names if len(found.joints.names) == len(columns) else ()
    if not names or moving is None:
        if found.effort == "current" or found.on_motors:
            text = "the drives, as {joint1: {gain: 11.2}, ...}: gear ratio times torque constant"
            return [asked("drives", f"{text}; dynident gains finds them")]
        return []
    by_name = {joint.name: joint for joint in moving.active}
    slides = _vertical_slides(moving) if found.effort else {}
    lines: list[str] = []
    for k, name in enumerate(names):
        if name in found.still:
            continue
        own = [*_gear(found, by_name[name]), *_gain(found, k, by_name[name])]
        if name in slides:
            own += _bias(found, k, name, slides[name], moving)
        if own:
            lines += [f"  {quoted(name)}:", *(f"    {line}" for line in own)]
    if not lines:
        return []
    notes = [] if found.joints.certain else ["of the likely joints"]
    if found.effort == "current" and len(equally_good(found.profiles)) > 1:
        notes.append("take them out where the effort is a torque")
    if found.effort == "current":
        notes.append("gain is gear ratio times torque constant: from a data sheet, or dynident gains finds it")
    comment = f"   # {plain('; '.join(notes))}" if notes else ""
    return [f"drives:{comment}", *lines]


def _gear(found: Recognised, joint: Joint) -> list[str]:
    if not found.on_motors or joint.drive.gear_ratio != 1.0:
        return []
    per = (
        "turns of the motor per turn of the joint"
        if joint.kind == "revolute"
        else "rad of the motor per m of the slide"
    )
    text = f"the gear ratio of {joint.name}, {per}, negative for a reversing gear"
    return [asked("gear_ratio", text)]


def _gain(found: Recognised, k: int, joint: Joint) -> list[str]:
    if found.effort != "current" or joint.drive.gain is not None:
        return []
    column = found.sources["current"].columns[k]
    unit = "N m" if joint.kind == "revolute" else "N"
    stated = _stated_current(found)
    per = stated if stated in RATED else "A" if stated else "unit"
    text = f"the drive gain of {joint.name}, {unit} at the joint per {per} of {column}"
    return [asked("gain", f"{text}{_rough_gain(found, joint.name)}")]


def _rough_gain(found: Recognised, name: str) -> str:
    evidence, moving = found.evidence, found.moving
    if evidence is None or moving is None:
        return ""
    k = moving.joint_names.index(name)
    if evidence.shares[k] < _SURE or evidence.ratios[k] == 0:
        return ""
    amperes = {"mA": 1e-3}.get(_stated_current(found), 1.0)
    return f"; roughly {1.0 / (amperes * evidence.ratios[k]):.2g} by the robot model's masses"


def _stated_current(found: Recognised) -> str:
    """Return the unit of the currents that the header states, which the reader makes amperes of; empty for none."""
    told = found.units.get("current")
    return told.text if told is not None and told.from_header else ""


def _vertical_slides(robot: Robot) -> dict[str, float]:
    """Return the sliding joints that always stand along gravity, with the force in N along each that carries it."""
    gravity = np.asarray(robot.gravity)
    size = float(np.linalg.norm(gravity))
    found: dict[str, float] = {}
    turned: dict[int, np.ndarray | None] = {-1: np.eye(3)}
    for k, joint in enumerate(robot.joints):
        above = turned[joint.parent]
        pose = None if above is None else above @ joint.rotation
        down = 0.0 if pose is None or not size else float((pose @ joint.axis) @ gravity) / size
        along = abs(down)
        # A joint that turns about the vertical leaves what stands on it upright.
        turned[k] = None if joint.kind == "revolute" and along < _UPRIGHT else pose
        if joint.kind == "prismatic" and joint.mimic is None and along > _ALONG:
            masses = [robot.links[i].inertia for i in _above(robot, k)]
            found[joint.name] = -down * size * sum(inertia.mass for inertia in masses if inertia is not None)
    return found


def _above(robot: Robot, link: int) -> list[int]:
    found = [link]
    for k in range(link + 1, len(robot.joints)):
        if robot.joints[k].parent in found:
            found.append(k)
    return found


def _bias(found: Recognised, k: int, name: str, weight: float, moving: Robot) -> list[str]:
    """Return the question whether the effort of a vertical slide carries the weight, a force along its axis."""
    evidence = found.evidence
    if found.effort == "torque" and evidence is not None:
        logged = abs(float(evidence.levels[moving.joint_names.index(name), 0]))
        if _CARRIED[0] * abs(weight) <= logged <= _CARRIED[1] * abs(weight):
            return []
    told = f"{weight:.4g} would carry all of the robot model's weight on it"
    text = (
        f"the bias of {name}: force in N along its axis that the logged effort does not contain, as of a counterweight"
    )
    return [asked("bias", f"{text}; {told}; 0 where the effort carries it")]
