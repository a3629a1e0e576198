"""From bodies and connections in any order to a Robot: one tree, fixed bodies merged, followers resolved."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Final, Literal

import numpy as np

from dynident.arrays import Array
from dynident.errors import nearest
from dynident.model.documents.numbers import Place, shown
from dynident.model.inertia import Inertia, impossible_parts
from dynident.model.joint import Drive, Joint, JointLimits, Mimic, rotation_about
from dynident.model.robot import Frame, Link, Robot
from dynident.model.shapes import Shape

#: Largest parameter of a link of next to no mass, as a share of the largest of all links.
NEXT_TO_NONE: Final = 1e-10

#: What the note of a robot says of masses that are no robot's; they are not taken.
PLACEHOLDERS: Final = "masses and inertias are placeholders, taken as not known"

#: Mass of a link between two joints of one body, as a share of that body's, and radius of its ball in m.
_SHARE, _RADIUS = 0.01 * NEXT_TO_NONE, 0.04


def weightless(bodies: Mapping[str, Inertia | None]) -> set[str]:
    """Return the bodies of next to no mass: such a link stands between two joints of one body."""
    sizes = {name: float(np.abs(body.vector).max()) for name, body in bodies.items() if body is not None}
    return {name for name, size in sizes.items() if size <= NEXT_TO_NONE * max(sizes.values())}


def without_placeholders(robot: Robot) -> Robot:
    """Return a robot whose masses are not known where its file states one body for all links, to have a mass at all.

    That is one mass and moment of inertia, its centre in the frame of each link, for most links and most of the mass,
    three of them and more in a row: wheels and propellers may be alike, the links of an arm are not.
    """
    bodies = [(link.inertia.vector if link.inertia is not None else np.zeros(10)).tolist() for link in robot.links]
    heavy = [body for body in bodies if body[9] > 0]
    own = max(heavy, key=heavy.count, default=[0.0] * 10)
    alike = [body == own for body in bodies]
    times = heavy.count(own)
    if times < 3 or any(own[6:9]) or 2 * times <= len(heavy):
        return robot
    row = list[int]()
    for k, joint in enumerate(robot.joints):
        row.append((1 + (row[joint.parent] if joint.parent >= 0 else 0)) * alike[k])
    if max(row) < 3 or 2 * times * own[9] <= sum(body[9] for body in bodies):
        return robot
    note = f"{PLACEHOLDERS}: {times} of {len(bodies)} links state one body of {own[9]:g} kg, its centre in their frame"
    return replace(with_unknown(robot, [link.name for link in robot.links]), note=f"{robot.note}; {note}")


def between_joints(body: Inertia | None) -> Inertia:
    """Return the inertia of a link between two joints of one body, which has no mass in the file.

    It has next to none, so that it is a body with a natural size: what is identified stays as small, and is left out
    when it is written.
    """
    mass = 0.0 if body is None else _SHARE * body.mass
    return Inertia(mass, np.zeros(3), 0.4 * mass * _RADIUS**2 * np.eye(3))


@dataclass(frozen=True)
class Connection:
    """A joint of the file, fixed or moving, between two bodies known by name.

    Attributes:
        name: Name of the joint.
        kind: ``"fixed"``, ``"revolute"`` (also continuous) or ``"prismatic"``.
        parent: Name of the parent body.
        child: Name of the child body.
        rotation: Orientation of the child in the parent at q = 0, shape (3, 3).
        translation: Position of the child in the parent at q = 0, shape (3,), in m.
        axis: Axis in the child's frame, shape (3,).
        limits: Limits.
        mimic: What it follows, or None.
        damping: Viscous friction of the file, or None.
        friction: Coulomb friction of the file, or None.
        drive: What moves it.
    """

    name: str
    kind: Literal["fixed", "revolute", "prismatic"]
    parent: str
    child: str
    rotation: Array
    translation: Array
    axis: Array
    limits: JointLimits
    mimic: Mimic | None = None
    damping: float | None = None
    friction: float | None = None
    drive: Drive = field(default_factory=Drive)


def assemble(
    path: object,
    name: str,
    bodies: Mapping[str, Inertia | None],
    connections: Sequence[Connection],
    note: str,
    shapes: Mapping[str, Sequence[Shape]] | None = None,
    visuals: Mapping[str, Sequence[Shape]] | None = None,
) -> Robot:
    """Return the robot that the bodies (by name, with inertia, shapes and visuals) and connections of a file make.

    Moving links are in depth-first order, children in the order of the file. A fixed body becomes part of the moving
    link that carries it and a named frame on it; those that the base carries are frames of the base.

    Raises:
        DescriptionError: No tree, no moving joint, or a follower that follows nothing that moves.
    """
    root = _root(path, bodies, connections)
    order = _depth_first(path, root, bodies, connections)
    follow = _followers(path, connections)
    places: dict[str, tuple[int, Array, Array]] = {root: (-1, np.eye(3), np.zeros(3))}
    links: list[tuple[str, Inertia | None, list[str]]] = []
    kinds = shapes or {}, visuals or {}
    taken = [tuple(list(kind.get(root, ())) for kind in kinds)]  # by the base and each link
    joints: list[Joint] = []
    frames: dict[str, Frame] = {}
    for joint in order:
        target, turn, shift = places[joint.parent]
        rotation, translation = turn @ joint.rotation, shift + turn @ joint.translation
        inertia, own = bodies[joint.child], tuple(list(kind.get(joint.child, ())) for kind in kinds)
        if joint.kind == "fixed":
            places[joint.child] = (target, rotation, translation)
            frames[joint.child] = Frame(target, rotation, translation)
            for held, more in zip(taken[target + 1], own, strict=True):
                held += [shape.moved(rotation, translation) for shape in more]
            if target >= 0:
                carrier, sofar, merged = links[target]
                links[target] = (carrier, _sum(sofar, inertia, rotation, translation), [*merged, joint.child])
            continue
        places[joint.child] = (len(links), np.eye(3), np.zeros(3))
        links.append((joint.child, inertia, []))
        taken.append(own)
        joints.append(
            Joint(
                joint.name, joint.kind, target, rotation, translation, joint.axis, joint.limits, joint.drive,
                mimic=follow.get(joint.name), damping=joint.damping, friction=joint.friction,
            )
        )  # fmt: skip
    if not joints:
        raise Place(path).error("no joint moves", "give the robot model of an arm with moving joints")
    return Robot(
        name,
        _links(links, taken[1:], bodies),
        tuple(joints),
        base=root,
        frames=frames,
        note=note,
        base_shapes=tuple(taken[0][0]),
    )


def _links(
    links: Sequence[tuple[str, Inertia | None, list[str]]],
    shapes: Sequence[tuple[list[Shape], ...]],
    bodies: Mapping[str, Inertia | None],
) -> tuple[Link, ...]:
    """Return the links from name, inertia and fixed bodies, and from shapes and visuals, of each."""
    whys = {name: impossible_parts({one: bodies[one] for one in (name, *more)}) for name, _, more in links if more}
    return tuple(
        Link(name, inertia, tuple(fixed), *map(tuple, own), impossible=whys.get(name, ""))
        for (name, inertia, fixed), own in zip(links, shapes, strict=True)
    )


def with_unknown(robot: Robot, bodies: Collection[str]) -> Robot:
    """Return a robot of which the links that are or carry one of the bodies have an unknown inertia, not its rest."""
    links = (replace(link, inertia=None) if {link.name, *link.fixed} & set(bodies) else link for link in robot.links)
    return replace(robot, links=tuple(links))


def with_held(joints: Mapping[str, Connection], positions: Mapping[str, float]) -> dict[str, Connection]:
    """Return joints of which some are fixed at a position, in rad or m, and their followers where that puts them."""
    found, waiting = dict(joints), dict(positions)
    while waiting:
        name, position = waiting.popitem()
        found[name] = replace(_held(found[name], position), mimic=None)
        for joint in found.values():
            if joint.mimic is not None and joint.mimic.joint == name:
                waiting[joint.name] = joint.mimic.multiplier * position + joint.mimic.offset
    return found


def _held(joint: Connection, position: float) -> Connection:
    if joint.kind == "prismatic":
        return replace(joint, kind="fixed", translation=joint.translation + position * joint.rotation @ joint.axis)
    return replace(joint, kind="fixed", rotation=joint.rotation @ rotation_about(joint.axis, position))


def tied_by_lengths(
    lengths: Sequence[Mapping[str, float] | None], polynomial: Sequence[float], tied: Collection[str]
) -> tuple[str, str, float, float] | None:
    """Return joint, leader (empty: held still), constant and slope of an equality of tendons; None of a nonlinear one.

    The first length is constant + slope times the second one, 0 where there is none. Of two joints the last one of the
    first length follows, unless it is tied.

    Args:
        lengths: Of each tendon the coefficient of each joint, by name; None of one that is not linear in joints.
        polynomial: Constant, slope and what is of higher order.
        tied: The joints that follow others or are held still.
    """
    constant, slope, *rest = polynomial
    first, *second = lengths
    parts = dict[str, float]()
    for share, length in ((-slope, second[0] if second else {}), (1.0, first)):
        for name, coefficient in (length or {}).items():
            parts[name] = parts.pop(name, 0.0) + share * coefficient
    parts = {name: coefficient for name, coefficient in parts.items() if coefficient}
    if None in lengths or not 1 <= len(parts) <= 2 or (second and any(rest)):
        return None
    (one, ratio), *others = reversed(parts.items())
    if others and one in tied:
        (one, ratio), others = others[0], [(one, ratio)]
    leader, share = others[0] if others else ("", 0.0)
    return one, leader, float(constant / ratio), float(-share / ratio)


def some(names: Sequence[str], most: int = 4) -> str:
    """Return names with commas, the first of many."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def numbered(word: str, number: int, taken: Collection[str]) -> str:
    """Return the word with the first number from ``number`` on that gives a name nothing has."""
    return next(name for one in count(number) if (name := f"{word}{one}") not in taken)


def _sum(own: Inertia | None, more: Inertia | None, rotation: Array, translation: Array) -> Inertia | None:
    if more is None:
        return own
    carried = more.moved(rotation, translation)
    return carried if own is None else own + carried


def _root(path: object, bodies: Iterable[str], connections: Sequence[Connection]) -> str:
    """Return the one body that no joint carries, after a check that each body has at most one parent."""
    carried: dict[str, str] = {}
    for joint in connections:
        if joint.child in carried:
            raise Place(path, f"link {shown(joint.child)}").error(
                f"it is the child of two joints, {shown(carried[joint.child])} and {shown(joint.name)}",
                "keep one of them: each link is the child of one joint",
            )
        carried[joint.child] = joint.name
    roots = [name for name in bodies if name not in carried]
    if not roots:
        raise _loop(path, next(iter(bodies)), connections)
    if len(roots) > 1:
        names = ", ".join(shown(name) for name in roots[:5]) + (", ..." if len(roots) > 5 else "")
        raise Place(path).error(
            f"{len(roots)} links have no parent joint: {names}", "connect all but one with a joint, or remove them"
        )
    return roots[0]


def _depth_first(
    path: object, root: str, bodies: Mapping[str, Inertia | None], connections: Sequence[Connection]
) -> list[Connection]:
    children: dict[str, list[Connection]] = {}
    for joint in connections:
        children.setdefault(joint.parent, []).append(joint)
    order: list[Connection] = []
    waiting = children.get(root, [])[::-1]
    while waiting:
        joint = waiting.pop()
        order.append(joint)
        waiting.extend(children.get(joint.child, [])[::-1])
    reached = {root, *(joint.child for joint in order)}
    for name in bodies:
        if name not in reached:
            raise _loop(path, name, connections)
    return order


def _loop(path: object, start: str, connections: Sequence[Connection]) -> Exception:
    """Return the error for a loop above ``start``, with the loop written out."""
    parents = {joint.child: joint.parent for joint in connections}
    seen: list[str] = []
    name = start
    while name not in seen:
        seen.append(name)
        name = parents[name]
    loop = [name, *seen[seen.index(name) :][::-1]]
    words = " -> ".join(shown(link) for link in loop[:8]) + (" -> ..." if len(loop) > 8 else "")
    return Place(path).error(f"the links form a loop: {words}", "remove one joint of the loop: only trees are read")


def ring(start: str, joints: Mapping[str, Connection]) -> str:
    """Return in words which joints follow each other from one on; empty where that ends."""
    seen = [start]
    while (joint := joints.get(seen[-1])) is not None and joint.mimic is not None and joint.kind != "fixed":
        seen.append(joint.mimic.joint)
        if seen[-1] in seen[:-1]:
            return " -> ".join(map(shown, seen))
    return ""


def _followers(path: object, connections: Sequence[Connection]) -> dict[str, Mimic]:
    """Return what each follower follows in the end; chains q = m1 (m2 q + o2) + o1 are multiplied out."""
    by_name = {joint.name: joint for joint in connections}
    found: dict[str, Mimic] = {}
    for joint in connections:
        if joint.mimic is None or joint.kind == "fixed":
            continue
        place = Place(path, f"joint {shown(joint.name)}")
        if words := ring(joint.name, by_name):
            raise place.error(f"it follows itself: {words}", "let one of them move on its own: remove its <mimic>")
        mimic = joint.mimic
        while True:
            leader = by_name.get(mimic.joint)
            if leader is None:
                step = f"write the name of a joint of this file in <mimic>{nearest(mimic.joint, by_name)}"
                raise place.error(f"it follows {shown(mimic.joint)}, which is no joint", step)
            if leader.kind == "fixed":
                step = "remove the <mimic>, or make the joint fixed"
                raise place.error(f"it follows {shown(mimic.joint)}, which is fixed", step)
            if leader.mimic is None:
                break
            further = leader.mimic
            mimic = Mimic(
                further.joint, mimic.multiplier * further.multiplier, mimic.multiplier * further.offset + mimic.offset
            )
        found[joint.name] = mimic
    return found
