"""What an MJCF says of joints outside of its bodies: equality constraints, actuators, tendons, flexible bodies."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from dynident.errors import nearest
from dynident.model.documents.numbers import shown
from dynident.model.robot import Drive, Mimic
from dynident.robot_files.mjcf.bodies import MjcfTree
from dynident.robot_files.mjcf.defaults import ACTUATORS
from dynident.robot_files.mjcf.document import MjcfDocument
from dynident.robot_files.mjcf.scope import MjcfScope
from dynident.robot_files.tree import Connection, ring, with_held
from dynident.robot_files.xml_elements import Element
from dynident.robot_files.xml_values import Values

_RIGID: Final = "arms of rigid links moved by joints are read"
_LEAST_GEAR: Final = 1e-12
_ENDS: Final = ("joint1", "joint2")
_JOINTS: Final = ("joint", "jointinparent")
_BODIES: Final = ("body", "body1", "body2")
_SITES: Final = ("site", "site1", "site2", "cranksite", "slidersite", "refsite")
_TENDONS: Final = ("tendon", "tendon1", "tendon2")
_PARAMETERS: Final = ("dyntype", "gaintype", "biastype")


def tied(document: MjcfDocument, tree: MjcfTree) -> list[Connection]:
    """Return the joints with what follows another, what is held still, gears and limits of torque.

    Raises:
        DescriptionError: A muscle, a flexible body, an equality constraint that closes a loop, is redundant or is not
            linear.
    """
    for element, _ in _each(tree, "deformable"):
        if element.tag == "flex":
            raise element.place.error("a flexible body is not read", f"remove it: {_RIGID}")
    joints = tree.connections if "equality" in document.disabled else _followed(tree)
    for element, scope in _each(tree, "tendon"):
        if not _is_left_tendon(element, scope, tree):
            _note_tendon(document, scope.defaults.values(element, "", "tendon"), element, tree)
    joints = _driven(tree, joints)
    damped, rubs = "damper" not in document.disabled, "frictionloss" not in document.disabled
    return [
        replace(joint, damping=joint.damping if damped else 0.0, friction=joint.friction if rubs else 0.0)
        for joint in joints
    ]


def _followed(tree: MjcfTree) -> list[Connection]:
    joints = {joint.name: joint for joint in tree.connections}
    ties: dict[str, Element] = {}
    still: dict[str, float] = {}
    for element, scope, suffix in _equalities(tree):
        values = scope.defaults.values(element, "", "equality")
        if element.tag == "tendon":
            values = _of_joints(values, scope, tree, ties)
        elif element.tag != "joint":
            bodies = [scope.named(values.text(key)) for key in _BODIES if key in values]
            mocap = [name for name in bodies if _is_mocap(name, tree)]
            if mocap:  # a handle of the simulator
                tree.note("what ties it to mocap bodies", mocap[0])
                continue
            step = 'remove it, or write active="false": loops of bodies are not read'
            raise values.place.error(f"the equality constraint <{element.tag}> closes a loop of bodies", step)
        names = {key: scope.prefix + values.text(key) + suffix for key in _ENDS if key in values}
        values = replace(values, given={**values.given, **names})
        one = _joint_named(values, "joint1", joints, tree)
        if one in ties:
            evidence = f"joint {shown(one)} is tied twice, at line {ties[one].line} too: redundant equalities"
            raise values.place.error(evidence, "keep one of the two")
        ties[one] = element
        tie = _tie(values, joints, joints[one], tree)
        if isinstance(tie, Mimic):
            joints[one] = replace(joints[one], mimic=tie)
        else:
            still[one] = tie
    _check_rings(ties, joints)
    return list(with_held(joints, still).values())


def _is_mocap(name: str, tree: MjcfTree) -> bool:
    return name in tree.sources and tree.sources[name].element.attributes.get("mocap") == "true"


def _each(tree: MjcfTree, section: str) -> Iterator[tuple[Element, MjcfScope]]:
    """Yield the elements of a section, of the model and of those attached to it, with what holds for them."""
    for scope in tree.scopes:
        yield from ((element, scope) for element in scope.document.each(section))


def _is_left(values: Values, scope: MjcfScope, tree: MjcfTree) -> bool:
    """Return whether an element of an attached model stays behind, as what it names is not attached."""
    if not scope.is_attached:
        return False
    if any(not _endings(values.text(key), scope, tree) for key in (*_JOINTS, *_ENDS) if key in values):
        return True
    tendons = [
        one for one in scope.document.each("tendon") if one.attributes.get("name") in map(values.given.get, _TENDONS)
    ]
    if any(_is_left_tendon(one, scope, tree) for one in tendons):
        return True
    for keys, known in ((_BODIES, tree.sources), (_SITES, tree.sites)):
        for name in (scope.prefix + values.text(key) for key in keys if key in values):
            if not any(one.startswith(name) and one.endswith(scope.suffix) for one in known):
                return True
    return False


def _is_left_tendon(element: Element, scope: MjcfScope, tree: MjcfTree) -> bool:
    return any(_is_left(Values(one.place, one.attributes), scope, tree) for one in element.children)


def _of_joints(values: Values, scope: MjcfScope, tree: MjcfTree, tied: Collection[str]) -> Values:
    """Return the equality of a tendon over one or two joints as that of the joints.

    The length of ``<fixed>`` is the sum of coef * (q - ref); the second joint follows the first, unless it follows one.
    """
    tendons = {one.attributes.get("name", ""): one for one in scope.document.each("tendon")}
    name = values.text("tendon1")
    if name not in tendons:
        raise values.place.error(f"there is no tendon {shown(name)}", f"correct the name{nearest(name, tendons)}")
    rows = [Values(one.place, one.attributes) for one in tendons[name].children]
    parts = {row.text("joint"): row.number("coef") for row in rows if "joint" in row}
    plain = tendons[name].tag == "fixed" and len(parts) == len(rows) <= 2 and all(parts.values())
    is_copied = any(_endings(part, scope, tree) != [scope.suffix] for part in parts)
    if "tendon2" in values or not plain or is_copied:
        step = 'write active="false", or couple two joints by an equality of joints (<joint joint1= joint2= polycoef=>)'
        raise values.place.error("an equality of tendons, other than a <fixed> one of two joints", step)
    (one, ratio), *other = reversed(parts.items())
    if other and scope.named(one) in tied:
        (one, ratio), other = other[0], [(one, ratio)]
    constant = values.numbers("polycoef", 1, 5)[0] / ratio if "polycoef" in values else 0.0
    given = {"joint1": one, "polycoef": f"{float(constant)!r}"}
    for leader, share in other:
        given |= {"joint2": leader, "polycoef": f"{float(constant)!r} {-share / ratio!r}"}
    return Values(values.place, given)


def _equalities(tree: MjcfTree) -> Iterator[tuple[Element, MjcfScope, str]]:
    """Yield the active equalities, of joints in a ``<replicate>`` once a copy, with what names there end with."""
    for element, scope in _each(tree, "equality"):
        values = scope.defaults.values(element, "", "equality")
        if not values.flag("active", True) or _is_left(values, scope, tree):
            continue
        ends = [_endings(values.text(key), scope, tree) for key in _ENDS if key in values]
        if len(ends) == 2 and ends[0] != ends[1]:
            evidence = "no <replicate> copies both of its joints"
            names = f"{values.text('joint1')}{ends[0][0]} and {values.text('joint2')}{ends[1][0]}"
            raise values.place.error(evidence, f"name those of copies, such as {names}")
        yield from ((element, scope, suffix) for suffix in (ends[0] if ends else [scope.suffix]))


def _endings(name: str, scope: MjcfScope, tree: MjcfTree) -> list[str]:
    """Return what the names of the copies of a joint end with; of an attached model, none where it is not attached."""
    known = tree.copies.get(scope.prefix + name, [scope.suffix])
    ends = [end for end in known if end.endswith(scope.suffix)]
    return [end for end in ends if scope.prefix + name + end in tree.joints] if scope.is_attached else ends


def _joint_named(values: Values, key: str, joints: Mapping[str, Connection], tree: MjcfTree) -> str:
    name = values.text(key)
    if name not in tree.joints:
        known = [joint for joint in joints if joint in tree.joints]
        raise values.place.error(f"{key} {shown(name)} is no joint", f"correct the name{nearest(name, known)}")
    return name


def _tie(values: Values, joints: Mapping[str, Connection], joint: Connection, tree: MjcfTree) -> Mimic | float:
    """Return how a joint follows another, or at what position an equality constraint holds it still."""
    coefficients = np.array([0.0, 1.0, 0.0, 0.0, 0.0])
    given = values.numbers("polycoef", 1, 5) if "polycoef" in values else coefficients
    coefficients[: len(given)] = given
    constant, slope = float(coefficients[0]), float(coefficients[1])
    zero = tree.joints[joint.name].ref
    if "joint2" not in values:
        return zero + constant
    if np.any(coefficients[2:]):
        step = "write a linear one: the last three numbers of polycoef are 0"
        raise values.place.error(f"polycoef {shown(values.text('polycoef'))} is not linear", step)
    other = _joint_named(values, "joint2", joints, tree)
    if slope == 0.0:
        step = "remove joint2 to hold the joint still, or correct polycoef"
        raise values.place.error(f"polycoef {shown(values.text('polycoef'))} does not follow joint2", step)
    offset = zero + constant - slope * tree.joints[other].ref
    return Mimic(other, slope, offset)


def _check_rings(ties: Mapping[str, Element], joints: Mapping[str, Connection]) -> None:
    """Refuse joints that follow each other in a ring: one of their equalities is redundant."""
    for start in ties:
        if words := ring(start, joints):
            evidence = f"joints follow each other: {words}: redundant equalities"
            raise ties[start].place.error(evidence, "remove one of them")


def _note_tendon(document: MjcfDocument, values: Values, element: Element, tree: MjcfTree) -> None:
    """Keep that a tendon has a torque of its own."""
    for key, flag in (("stiffness", "spring"), ("damping", "damper"), ("frictionloss",) * 2, ("armature", "")):
        if key in values and flag not in document.disabled and np.any(values.numbers(key, 1, 3)):
            tree.note("tendons", element.attributes.get("name", f"line {element.line}"))
            return


def _driven(tree: MjcfTree, joints: list[Connection]) -> list[Connection]:
    """Return the joints with the gears, rotor inertia, damping and limits of torque of their actuators."""
    found = {joint.name: joint for joint in joints}
    motors: dict[str, list[_Motor]] = {}
    for element, scope in _each(tree, "actuator"):
        values = scope.defaults.values(element, "")
        if _is_left(values, scope, tree):
            continue
        words = {values.text(name, "") for name in _PARAMETERS}
        if element.tag == "muscle" or "muscle" in words:
            raise values.place.error("a muscle is not read", f"replace it by a motor of the joint: {_RIGID}")
        name = next((values.text(key) for key in _JOINTS if key in values), "")
        states = [key for key in ("armature", "damping") if key in values and np.any(values.numbers(key, 1, 3))]
        if element.tag not in ACTUATORS or not name:
            if states:
                tree.note("armature and damping of actuators beside joints", values.text("name", element.tag))
            continue
        names = [scope.prefix + name + end for end in _endings(name, scope, tree)]
        if names and names[0] not in tree.joints:
            step = f"correct the name{nearest(name, tree.joints)}"
            raise values.place.error(f"its joint {shown(name)} is not there", step)
        motor = _motor(values, element)
        if motor is None:
            continue
        for name in names:
            motors.setdefault(name, []).append(motor)
            if "damping" in states and np.any(values.numbers("damping", 1, 3)[1:]):
                tree.note("damping of second and third order", name)
            if states:
                tree.motors.setdefault(name, []).append(element)
    return [_moved(joint, motors.get(name, [])) for name, joint in found.items()]


class _Motor(NamedTuple):
    """An actuator: its gear ratio, and rotor inertia, damping and largest force before the gear."""

    gear: float
    rotor: float
    damping: float
    force: float


def _motor(values: Values, element: Element) -> _Motor | None:
    """Return what an actuator states; None for one that gives no torque."""
    gear = float(values.numbers("gear", 1, 6)[0]) if "gear" in values else 1.0
    if abs(gear) < _LEAST_GEAR:
        return None
    damping = float(values.numbers("damping", 1, 3)[0]) if "damping" in values else 0.0
    force = np.inf
    if "forcerange" in values and values.text("forcelimited", "auto") != "false":
        force = float(np.abs(values.numbers("forcerange", 2)).max())
    elif element.tag == "motor" and "ctrlrange" in values and values.text("ctrllimited", "auto") != "false":
        force = float(np.abs(values.numbers("ctrlrange", 2)).max())
    return _Motor(gear, values.at_least_zero("armature", 0.0), damping, force if force > 0 else np.inf)


def _moved(joint: Connection, motors: list[_Motor]) -> Connection:
    """Return a joint with the values of its actuators; several of one joint have no one gear."""
    if not motors:
        return joint
    gear = motors[0].gear if len(motors) == 1 else 1.0
    rotor = joint.drive.reflected_inertia + sum(motor.gear**2 * motor.rotor for motor in motors)
    damping = sum(motor.gear**2 * motor.damping for motor in motors)
    effort = min(joint.limits.effort, sum(abs(motor.gear) * motor.force for motor in motors))
    return replace(
        joint,
        drive=Drive(gear, rotor / gear**2),
        damping=(joint.damping or 0.0) + damping,
        limits=replace(joint.limits, effort=effort),
    )
