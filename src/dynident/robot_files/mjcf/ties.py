"""What an MJCF says of joints outside of its bodies: equality constraints, actuators, tendons, flexible bodies.

Names in these stand for one element or for several: those of replicas and of attached models.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from dynident.errors import nearest
from dynident.model.documents.numbers import shown
from dynident.model.joint import Drive, Mimic
from dynident.robot_files.mjcf.bodies import LOOPS, WORLD, MjcfTree, is_limited
from dynident.robot_files.mjcf.document import MjcfDocument
from dynident.robot_files.mjcf.schema import ACTUATORS
from dynident.robot_files.mjcf.scope import Copy, MjcfScope
from dynident.robot_files.tree import Connection, ring, tied_by_lengths, with_held
from dynident.robot_files.xml_elements import Element, Values

_RIGID: Final = "arms of rigid links moved by joints are read"
_LEAST_GEAR: Final = 1e-12
_ENDS: Final = {kind: (f"{kind}1", f"{kind}2") for kind in ("joint", "tendon", "body")}
_JOINTS: Final = ("joint", "jointinparent")
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
    for element in tree.scopes[0].document.each("contact"):
        for key in _ENDS["body"] if element.tag == "exclude" else ():
            if element.attributes.get(key, WORLD) != WORLD:
                copies_named(Values(element.place, element.attributes), "body", key, tree.scopes[0])
    tendons = {name: one for scope in tree.scopes for name, one in _tendons(scope, document, tree)}
    joints = tree.connections if "equality" in document.disabled else _followed(tree, tendons)
    joints = _driven(tree, joints)
    damped, rubs = "damper" not in document.disabled, "frictionloss" not in document.disabled
    return [
        replace(joint, damping=joint.damping if damped else 0.0, friction=joint.friction if rubs else 0.0)
        for joint in joints
    ]


def _tendons(scope: MjcfScope, document: MjcfDocument, tree: MjcfTree) -> Iterator[tuple[str, Tendon]]:
    """Yield the tendons of a model by name; those with a torque of their own are noted."""
    noted = list[Element]()
    for name, tendon in tendons_in(scope):
        if all(tendon.element is not one for one in noted):
            noted.append(tendon.element)
            _note_tendon(document, scope.own.values(tendon.element, "", "tendon"), tendon.element, tree)
        yield name, tendon


def _followed(tree: MjcfTree, tendons: Mapping[str, Tendon]) -> list[Connection]:
    joints = {joint.name: joint for joint in tree.connections}
    ties: dict[str, Element] = {}
    still: dict[str, float] = {}
    for element, given, held in _equalities(tree):
        if element.tag == "tendon":
            values = _of_joints(given, held, tendons, ties)
        elif element.tag == "joint":
            names = {key: held.named(given.text(key)) for key in _ENDS["joint"] if key in given}
            values = Values(given.place, {**given.given, **names})
        elif mocap := _mocap(given, held, tree):  # a handle of the simulator
            tree.note("what ties it to mocap bodies", mocap[0])
            continue
        else:
            step = f'{LOOPS}; remove it, or write active="false", where it carries no load'
            raise given.place.error(f"the equality constraint <{element.tag}> closes a loop of bodies", step)
        one = values.text("joint1")
        if one in ties:
            evidence = f"joint {shown(one)} is tied twice, at line {ties[one].line} too: redundant equalities"
            raise values.place.error(evidence, "keep one of the two")
        ties[one] = element
        tie = _tie(values, joints[one], tree)
        if isinstance(tie, Mimic):
            joints[one] = replace(joints[one], mimic=tie)
        else:
            still[one] = tie
    _check_rings(ties, joints)
    return list(with_held(joints, still).values())


def _mocap(values: Values, scope: MjcfScope, tree: MjcfTree) -> list[str]:
    """Return the mocap bodies that an equality names, as the whole model calls them."""
    keys = [key for key in _ENDS["body"] if key in values]
    copies = ((scope.within(copy), key) for key in keys for copy in scope.copies("body", values.text(key)))
    names = (held.named(values.text(key)) for held, key in copies)
    return [name for name in names if tree.sources[name].element.attributes.get("mocap") == "true"]


def _each(tree: MjcfTree, section: str) -> Iterator[tuple[Element, MjcfScope]]:
    """Yield the elements of a section, of the model and of those attached to it, with what holds for them."""
    for scope in tree.scopes:
        yield from ((element, scope) for element in scope.document.each(section))


def _of_joints(values: Values, held: MjcfScope, tendons: Mapping[str, Tendon], tied: Collection[str]) -> Values:
    """Return the equality of one or two ``<fixed>`` tendons over one or two joints as that of the joints."""
    lengths = [tendons[held.named(values.text(key))].parts for key in _ENDS["tendon"] if key in values]
    polynomial = values.numbers("polycoef", 1, 5) if "polycoef" in values else np.zeros(0)
    tie = tied_by_lengths(lengths, [*polynomial, *(0.0, 1.0)[len(polynomial) :]], tied)
    if tie is None:
        step = 'write active="false", or couple two joints by an equality of joints (<joint joint1= joint2= polycoef=>)'
        raise values.place.error("an equality of tendons, other than a linear one of two joints by <fixed>", step)
    one, leader, constant, slope = tie
    follows = {"joint2": leader, "polycoef": f"{constant!r} {slope!r}"} if leader else {"polycoef": f"{constant!r}"}
    return Values(values.place, {"joint1": one, **follows})


def _equalities(tree: MjcfTree) -> Iterator[tuple[Element, Values, MjcfScope]]:
    """Yield the active equalities, those in a ``<replicate>`` once a copy, with the part of the model of each."""
    for element, scope in _each(tree, "equality"):
        values = scope.own.values(element, "", "equality")
        if not values.flag("active", True) or is_left(values, scope):
            continue
        kind = element.tag
        held = parts_with(values, kind, _ENDS[kind], scope) if kind in ("joint", "tendon") else [scope]
        yield from ((element, values, one) for one in held)


def _tie(values: Values, joint: Connection, tree: MjcfTree) -> Mimic | float:
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
    other = values.text("joint2")
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
        values = scope.own.values(element, "")
        if is_left(values, scope):
            continue
        words = {values.text(name, "") for name in _PARAMETERS}
        if element.tag == "muscle" or "muscle" in words:
            raise values.place.error("a muscle is not read", f"replace it by a motor of the joint: {_RIGID}")
        key = next((key for key in _JOINTS if values.text(key, "")), "")
        states = [key for key in ("armature", "damping") if key in values and np.any(values.numbers(key, 1, 3))]
        if element.tag not in ACTUATORS or not key:
            if states:
                tree.note("armature and damping of actuators beside joints", values.text("name", element.tag))
            continue
        motor = _motor(values, element, scope)
        if motor is None:
            continue
        for held in parts_with(values, "joint", (key,), scope):
            name = held.named(values.text(key))
            motors.setdefault(name, []).append(motor)
            if "damping" in states and np.any(values.numbers("damping", 1, 3)[1:]):
                tree.note("damping of second and third order", name)
            if states:
                tree.motors.setdefault(name, []).append((element, states))
    tree.driven.update(motors)
    return [_moved(joint, motors.get(name, [])) for name, joint in found.items()]


class _Motor(NamedTuple):
    """An actuator: its gear ratio, and rotor inertia, damping and largest force before the gear."""

    gear: float
    rotor: float
    damping: float
    force: float


def _motor(values: Values, element: Element, scope: MjcfScope) -> _Motor | None:
    """Return what an actuator states; None for one that gives no torque."""
    gear = float(values.numbers("gear", 1, 6)[0]) if "gear" in values else 1.0
    if abs(gear) < _LEAST_GEAR:
        return None
    damping = float(values.numbers("damping", 1, 3)[0]) if "damping" in values else 0.0
    force = np.inf
    if is_limited(values, scope, "forcelimited", "forcerange"):
        force = float(np.abs(values.numbers("forcerange", 2)).max())
    elif element.tag == "motor" and is_limited(values, scope, "ctrllimited", "ctrlrange"):
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


#: The attributes that name something, by its kind.
_NAMING: Final = {
    "joint": ("joint", "jointinparent", "joint1", "joint2"),
    "body": ("body", "body1", "body2"),
    "site": ("site", "site1", "site2", "cranksite", "slidersite", "refsite"),
    "tendon": ("tendon", "tendon1", "tendon2"),
}


@dataclass(frozen=True)
class Tendon:
    """A tendon, as one of the replicas that it stands in has it.

    Attributes:
        element: Its element.
        parts: Coefficient of each joint, by its name in the whole model; None of one that is not ``<fixed>``.
    """

    element: Element
    parts: dict[str, float] | None


def copies_named(values: Values, kind: str, key: str, scope: MjcfScope) -> list[Copy]:
    """Return the copies of what an attribute names; none where an attached model has it and it is not attached.

    Raises:
        DescriptionError: The main model has none of this name.
    """
    name = values.text(key)
    found = scope.copies(kind, name)
    if not found and scope.outer is None:
        step = f"correct the name{nearest(name, scope.names.of(kind))}"
        raise values.place.error(f"{key} {shown(name)} is no {kind}", step)
    return found


def parts_with(values: Values, kind: str, keys: Sequence[str], scope: MjcfScope) -> list[MjcfScope]:
    """Return the parts of the model in which an element stands for one, as it names joints or tendons that are copied.

    Raises:
        DescriptionError: It names none, one that the main model has not, or two that not the same replicas copy.
    """
    values.text(keys[0])
    keys = [key for key in keys if key in values]
    copies = [copies_named(values, kind, key, scope) for key in keys]
    if not all(copies):
        return []
    first = [one[0] for one in copies]
    if any([replica.source for replica in one] != [replica.source for replica in first[0]] for one in first):
        evidence = f"no <replicate> copies both of its {kind}s"
        pairs = zip(keys, first, strict=True)
        names = " and ".join(scope.within(one).named(values.text(key)).removeprefix(scope.prefix) for key, one in pairs)
        raise values.place.error(evidence, f"name those of copies, such as {names}")
    return [scope.within(one) for one in copies[0] if all(one in others for others in copies)]


def is_left(values: Values, scope: MjcfScope) -> bool:
    """Return whether an element of an attached model stays behind, as what it names is not attached."""
    named = ((kind, values.text(key)) for kind, keys in _NAMING.items() for key in keys if key in values)
    return scope.outer is not None and not all(scope.copies(*one) for one in named)


def tendons_in(scope: MjcfScope) -> Iterator[tuple[str, Tendon]]:
    """Yield the tendons of a model by their names in the whole one, and note the names.

    Each replica with a part of a tendon has one of its own; the parts outside of the replica are in all of these.

    Raises:
        DescriptionError: A tendon of the main model has a joint that is not there, or two in different replicas.
    """
    for element in scope.document.each("tendon"):
        parts = [Values(one.place, one.attributes) for one in element.children]
        for held in _with_tendon(element, parts, scope):
            name = held.named(element.attributes.get("name", ""))
            held.keep("tendon", name)
            coefficients = dict[str, float]()
            for part in (part for part in parts if "joint" in part):
                depth = len(scope.copies("joint", part.text("joint"))[0])
                joint = held.within(held.replicas[:depth]).named(part.text("joint"))
                if joint in coefficients:
                    evidence = f"the tendon has joint {shown(joint)} twice"
                    raise part.place.error(evidence, "write the sum of both coef once")
                coefficients[joint] = part.number("coef")
            yield name, Tendon(element, coefficients if element.tag == "fixed" else None)


def _with_tendon(element: Element, parts: Sequence[Values], scope: MjcfScope) -> list[MjcfScope]:
    """Return the parts of a model in which a tendon stands for one."""
    named = [(kind, part) for kind in ("joint", "site") for part in parts if kind in part]
    copies = [copies_named(part, kind, kind, scope) for kind, part in named]
    if not all(copies):
        return []
    deepest = max(copies, key=lambda one: len(one[0]), default=[()])
    around = {replica.source for replica in deepest[0]}
    for kind, part in named:
        if around & scope.names.makers[kind, part.text(kind)]:
            evidence = (
                f"{kind} {shown(part.text(kind))} is a copy, made with the copies of another one that it runs over"
            )
            raise element.place.error(evidence, "name a copy of each, or what is copied of each")
    found = [one for one in deepest if all(one[: len(other[0])] in other for other in copies)]
    if not found and scope.outer is None:
        step = "couple those of one <replicate>, and write the rest as bodies of their own"
        raise element.place.error("no <replicate> copies all that it runs over", step)
    return [scope.within(one) for one in found]
