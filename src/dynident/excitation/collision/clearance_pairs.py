"""Which pairs of bodies are tested against each other, and how fast their distance can change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.excitation.collision.covering import travel
from dynident.excitation.collision.workspace import Workspace, body_of, link_names
from dynident.model.joint import Joint
from dynident.model.robot import Robot
from dynident.model.shapes import Capsule

#: Kinds of tests, as in clearance_kernel.py, which is not imported for them: it brings numba.
CAPSULE, BOX, PLANE, INSIDE = 0, 1, 2, 3


#: Sine of an angle that is rounding only.
ROUNDING = 1e-12


@dataclass(frozen=True)
class Pair:
    """Two things whose distance is kept.

    Attributes:
        name: Their names.
        required: Distance to be kept, in m.
        tests: Kind, capsule and other shape of each test, as indices into the tables of the kernels.
        links: Whether both are links.
        near: Whether both are links with one link between them.
        mounting: Whether one is fixed to the room and the other hangs on the base.
    """

    name: str
    required: float
    tests: tuple[tuple[int, int, int], ...]
    links: bool = False
    near: bool = False
    mounting: bool = False


def surroundings(workspace: Workspace) -> tuple[Array, Array]:
    """Return the boxes (k, 15), the region last, and the half-spaces (h, 4) as tables of the kernels."""
    boxes = [*workspace.boxes.values(), *([] if workspace.region is None else [workspace.region])]
    rows = [np.r_[box.rotation.ravel(), box.translation, 0.5 * box.size] for box in boxes]
    planes = [np.r_[plane.normal, plane.offset] for plane in workspace.half_spaces.values()]
    return np.array(rows).reshape(-1, 15), np.array(planes).reshape(-1, 4)


def pairs_of(
    robot: Robot, workspace: Workspace, capsules: Sequence[Sequence[Capsule]]
) -> tuple[list[Pair], dict[str, str], tuple[int, Capsule] | None]:
    """Return the pairs, those that are left out by their place or on request, and the tool point.

    Args:
        robot: The robot.
        workspace: Its workspace.
        capsules: Capsules of the base and of each link, 1 + l of them; numbered through in this order in the tests.

    Returns:
        The pairs; why others are left out; the body and, as a capsule, the tool point that stays in the region, which
        is numbered last, or None.

    Raises:
        UnknownChoice: A name to be ignored that is not there.
    """
    names = link_names(robot)
    numbers = np.split(np.arange(sum(map(len, capsules))), np.cumsum([len(own) for own in capsules])[:-1])
    wanted = {frozenset(body_of(robot, workspace, name) for name in pair) for pair in workspace.ignore}
    found: list[Pair] = []
    out: dict[str, str] = {}

    def offer(first: str, second: str, pair: Pair, reason: str = "") -> None:
        reason = reason or ("listed under ignore" if frozenset((first, second)) in wanted else "")
        if reason and pair.tests:
            out[pair.name] = reason
        elif pair.tests:
            found.append(pair)

    for a in range(len(names)):
        for b in range(a + 1, len(names)):
            tests = tuple((CAPSULE, int(i), int(j)) for i in numbers[a] for j in numbers[b])
            name = f"{names[a]} | {names[b]}"
            above = robot.joints[b - 1].parent
            joined = "a joint connects them" if above == a - 1 else ""
            near = above >= 0 and (robot.joints[above].parent == a - 1)
            offer(names[a], names[b], Pair(name, workspace.self_clearance, tests, links=True, near=near), joined)
    for kind, others in ((PLANE, tuple(workspace.half_spaces)), (BOX, tuple(workspace.boxes))):
        for k, other in enumerate(others):
            for a in range(1, len(names)):
                tests = tuple((kind, int(i), k) for i in numbers[a])
                mounting = robot.joints[a - 1].parent == -1
                offer(names[a], other, Pair(f"{names[a]} | {other}", workspace.clearance, tests, mounting=mounting))
    if workspace.region is None:
        return found, out, None
    place = workspace.tool_frame(robot)
    offset, radius = (np.zeros(3), 0.0) if workspace.tool is None else (workspace.tool.offset, workspace.tool.radius)
    tip = place.rotation @ offset + place.translation
    last = sum(map(len, capsules))
    found.append(Pair("tool | region", 0.0, ((INSIDE, last, len(workspace.boxes)),)))
    return found, out, (place.link + 1, Capsule(tip, tip, radius))


def levers(robot: Robot, pairs: Sequence[Pair], ends: Array, bodies: IntArray, normals: Array) -> Array:
    """Return a bound of |d distance / dq_i| of each pair over all postures, shape (c, n).

    A joint that moves one of two bodies moves its points no faster than the sum of the lengths between its axis and
    them; a joint below both moves them as one. A joint on the base changes the distance from a half-space by no more
    than its motion along the normal: none, where a floor is square to its axis. For pairs with several tests the
    largest bound counts.

    Args:
        robot: The robot.
        pairs: The c pairs.
        ends: Ends of the capsules in the frames of their links, shape (m, 6).
        bodies: The link that carries each, l for the base, shape (m,).
        normals: Unit normals of the half-spaces, shape (h, 3).
    """
    reach, chain = _Reach(robot), robot.chain
    out = np.zeros((len(pairs), robot.dof))
    known: dict[int, dict[int, float]] = {}
    for row, pair in enumerate(pairs):
        for kind, first, second in pair.tests:
            sides = [first, second] if kind == CAPSULE else [first]
            for capsule in sides:
                if capsule not in known:
                    known[capsule] = reach.of(int(bodies[capsule]), ends[capsule].reshape(2, 3))
            moved = [known[capsule] for capsule in sides]
            both = moved[0].keys() & moved[1].keys() if len(moved) == 2 else set()
            bound = np.zeros(robot.dof)
            for side in moved:
                for link, length in side.items():
                    if link not in both:
                        part = _along(robot.joints[link], normals[second]) if kind == PLANE else 1.0
                        if part > 0.0:
                            bound[chain.joint[link]] += abs(float(chain.multiplier[link])) * part * length
            out[row] = np.maximum(out[row], bound)
    return out


def _along(joint: Joint, normal: Array) -> float:
    """Return which part of the motion of a joint can be along a normal that is fixed to the base, 0..1."""
    if joint.parent >= 0:
        return 1.0
    axis = joint.rotation @ joint.axis
    part = abs(float(axis @ normal)) if joint.kind == "prismatic" else float(np.linalg.norm(np.cross(axis, normal)))
    return part if part > ROUNDING else 0.0


class _Reach:
    """Lengths along the links, over all positions of sliding joints."""

    def __init__(self, robot: Robot) -> None:
        self._robot, self._travel = robot, travel(robot)

    def of(self, body: int, points: Array) -> dict[int, float]:
        """Return for each link up to the base how fast its joint can move points (k, 3) of a body, in m/rad or 1."""
        found: dict[int, float] = {}
        places, beyond = points, 0.0  # points beyond the frame of `body` are within `beyond` of `places`
        while 0 <= body < len(self._robot.links):
            joint = self._robot.joints[body]
            if joint.kind == "prismatic":
                found[body] = 1.0
            elif not np.isfinite(beyond) or not np.all(np.isfinite(places)):
                found[body] = np.inf
            else:
                across = places - np.outer(places @ joint.axis, joint.axis)
                found[body] = float(np.linalg.norm(across, axis=1).max()) + beyond
            beyond += float(np.linalg.norm(places, axis=1).max()) if np.isfinite(beyond) else 0.0
            places = self._places(body)
            body = joint.parent
        return found

    def _places(self, link: int) -> Array:
        """Return the ends of the way of a link's origin in its parent, shape (1 or 2, 3); infinite without limits."""
        joint = self._robot.joints[link]
        if joint.kind != "prismatic":
            return joint.translation[None, :]
        lowest, highest = self._travel[link]
        if not np.isfinite(lowest) or not np.isfinite(highest):
            return np.full((1, 3), np.inf)
        return joint.translation + np.outer([lowest, highest], joint.rotation @ joint.axis)
