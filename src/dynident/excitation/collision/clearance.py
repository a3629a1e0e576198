"""Clearance: how far the links of a robot are from each other and from their surroundings, with exact derivatives.

Links are capsules (see robot_capsules.py), surroundings are boxes and half-spaces. Distances are signed: below zero is
how deep two bodies are in each other. Shapes: N samples, n joints, l links, c pairs of names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, BoolArray, IntArray, frozen
from dynident.errors import BadOption
from dynident.excitation.collision.clearance_pairs import Pair, levers, pairs_of, surroundings
from dynident.excitation.collision.covering import robot_capsules
from dynident.excitation.collision.workspace import Workspace, link_names
from dynident.model.chain import Chain
from dynident.model.kernels.inputs import samples
from dynident.model.robot import Robot
from dynident.model.shapes import Capsule

#: Postures that are drawn to find pairs that can never be kept apart.
POSTURES = 2000

#: Links with one link between them whose shapes leave less than this much beyond what is required, in m, are not told
#: apart by shapes so coarse.
ROOM = 5e-3


@dataclass(frozen=True)
class Geometry:
    """The tables of the compiled kernels; see clearance_kernel.py.

    Attributes:
        ends: Ends of the m capsules in the frames of their links, shape (m, 6), in m.
        radii: Their radii, shape (m,), in m.
        bodies: The link that carries each, l for the base, shape (m,).
        boxes: Rotation, centre and half edges of each box in the base frame, shape (k, 15).
        planes: Unit normal and offset of each half-space, shape (h, 4).
    """

    ends: Array
    radii: Array
    bodies: IntArray
    boxes: Array
    planes: Array


@dataclass(frozen=True)
class Clearance:
    """The distances that a robot must keep, pair by pair.

    A pair is two links, a link and an obstacle, or the tool and its region. Of several shapes of a link the nearest
    counts; so a distance is continuous in q, and differentiable but where two shapes are equally near.

    Attributes:
        names: The c pairs, such as ``"link3 | floor"``.
        required: Distance that each must keep, shape (c,), in m.
        ignored: Pairs that are not checked, and why.
        unchecked: Links without any shape.
        capsules: The capsules of each link that has some, in its frame.
        chain: The kinematics.
        geometry: What the kernels work on.
        tests: Kind, capsule and other shape of each test, shape (t, 3).
        starts: The first test of each pair, shape (c + 1,).
        lever: See :meth:`speed_bound`, shape (c, n).
    """

    names: tuple[str, ...]
    required: Array
    ignored: Mapping[str, str]
    unchecked: tuple[str, ...]
    capsules: Mapping[str, tuple[Capsule, ...]]
    chain: Chain
    geometry: Geometry
    tests: IntArray
    starts: IntArray
    lever: Array

    def distances(self, q: npt.ArrayLike) -> Array:
        """Return the signed distances of all pairs, shape (N, n) -> (N, c), in m.

        Raises:
            ValueError: A wrong shape.
        """
        from dynident.excitation.collision import clearance_kernel  # numba loads with the first call

        (q,) = samples(self.chain, {"q": q})
        out = np.empty((len(q), len(self.names)))
        clearance_kernel.distances(self._scene(), q, out)
        return out

    def gradient(self, q: npt.ArrayLike, pair: npt.ArrayLike) -> Array:
        """Return the derivative by q of the distance of pair[s] at sample s, in m/rad or m/m.

        Exact: the two nearest points move with their links, and the distance changes by what they come nearer.

        Args:
            q: Positions, shape (S, n).
            pair: Indices into ``names``, shape (S,).

        Returns:
            Shape (S, n).

        Raises:
            ValueError: A wrong shape, or an index that is none.
        """
        from dynident.excitation.collision import clearance_kernel

        (q,) = samples(self.chain, {"q": q})
        chosen = np.ascontiguousarray(pair, dtype=np.int64)
        if chosen.shape != (len(q),):
            raise ValueError(f"pair has shape {chosen.shape}, expected ({len(q)},)")
        if chosen.size and not (0 <= chosen.min() and chosen.max() < len(self.names)):
            raise ValueError(f"pair reaches from {chosen.min()} to {chosen.max()}, expected 0 to {len(self.names) - 1}")
        out = np.empty((len(q), self.chain.joints))
        clearance_kernel.gradient(self._scene(), q, _read_only(chosen), out)
        return out

    def speed_bound(self) -> Array:
        """Return how fast each distance changes at most per unit of joint speed, shape (c, n), in m/rad or 1.

        At every posture within the position limits of the robot model |d distance / dq_i| <= bound, so between two
        postures the distance differs by at most sum_i bound_i |q_i' - q_i| along a straight line, and along any way by
        bound_i times the length of the way of joint i. Infinite beyond a sliding joint without limits.
        """
        return self.lever

    def summary(self) -> tuple[str, ...]:
        """Return lines that say what is checked, what is not, and why."""
        count = sum(len(capsules) for capsules in self.capsules.values())
        lines = [f"{len(self.names)} pairs are checked, {count} capsules on {len(self.capsules)} links"]
        for distance in dict.fromkeys(self.required.tolist()):
            pairs = [name for name, own in zip(self.names, self.required, strict=True) if own == distance]
            lines.append(f"at least {distance:g} m: {', '.join(pairs)}")
        for why in dict.fromkeys(self.ignored.values()):
            pairs = [name for name, own in self.ignored.items() if own == why]
            lines.append(f"not checked, {why}: {', '.join(pairs)}")
        if self.unchecked:
            lines.append(f"not checked, they have no shape: {', '.join(self.unchecked)}")
        return tuple(lines)

    def _scene(self) -> tuple[Any, ...]:
        """Return the tables of the kernels; they are read-only, which after unpickling they are not."""
        from dynident.model.kernels.generic import pack

        links, reals, _ = pack(self.chain)
        own = self.geometry
        tables = (own.ends, own.radii, own.bodies, own.boxes, own.planes, self.tests, self.starts)
        return (links, reals, *map(_read_only, tables))


def clearance_of(robot: Robot, workspace: Workspace) -> Clearance:
    """Return what a robot must keep clear of in its workspace.

    Left out and listed in ``ignored``: links that a joint connects; the base and what stands around it; pairs of
    ``workspace.ignore``; pairs whose distance no joint changes; and, over :data:`POSTURES` postures drawn within the
    position limits (a full turn, or 1 m, where there are none), links that overlap in all of them or never come within
    reach of the required distance without ever touching, and whatever is nearer than required in all of them to a link
    that hangs on the base (the mounting).

    Raises:
        UnknownChoice: The workspace names a link, frame or obstacle that is not there.
        BadOption: No shapes and no joint radius, or pairs that are too near in every posture without a reason above.
        FileError: A mesh that cannot be read.
        MissingDependency: A mesh in a format that needs the pin extra.
    """
    capsules = robot_capsules(robot, workspace)
    candidates, ignored, tool_point = pairs_of(robot, workspace, capsules)
    listed = [(body, capsule) for body, own in enumerate(capsules) for capsule in own]
    listed += [] if tool_point is None else [tool_point]
    boxes, planes = surroundings(workspace)
    geometry = Geometry(
        frozen(np.array([np.r_[c.start, c.end] for _, c in listed]).reshape(-1, 6)),
        frozen([c.radius for _, c in listed]),
        _read_only(np.array([(body - 1) % (len(robot.links) + 1) for body, _ in listed], dtype=np.int64)),
        frozen(boxes),
        frozen(planes),
    )
    whole = _assembled(robot, capsules, geometry, candidates, ignored)
    kept, more = _reachable(candidates, whole.distances(_postures(robot)), np.any(whole.lever > 0.0, axis=1))
    return _assembled(robot, capsules, geometry, kept, {**ignored, **more})


def _assembled(
    robot: Robot,
    capsules: Sequence[tuple[Capsule, ...]],
    geometry: Geometry,
    pairs: Sequence[Pair],
    ignored: Mapping[str, str],
) -> Clearance:
    """Return the clearance of some pairs."""
    owners = list(zip(link_names(robot), capsules, strict=True))
    return Clearance(
        tuple(pair.name for pair in pairs),
        frozen([pair.required for pair in pairs]),
        dict(ignored),
        tuple(name for name, own in owners if not own),
        {name: own for name, own in owners if own},
        robot.chain,
        geometry,
        _read_only(np.array([test for pair in pairs for test in pair.tests], dtype=np.int64).reshape(-1, 3)),
        _read_only(np.cumsum([0, *(len(pair.tests) for pair in pairs)], dtype=np.int64)),
        frozen(levers(robot, pairs, geometry.ends, geometry.bodies, geometry.planes[:, :3])),
    )


def _postures(robot: Robot) -> Array:
    """Return random postures within the limits and the middle of these, shape (1 + POSTURES, n)."""
    limits = [joint.limits for joint in robot.active]
    reach = np.array([np.pi if joint.kind == "revolute" else 1.0 for joint in robot.active])
    lower, upper = (np.array([getattr(limit, end) for limit in limits]) for end in ("lower", "upper"))
    lower, upper = np.where(np.isfinite(lower), lower, -reach), np.where(np.isfinite(upper), upper, reach)
    lower, upper = np.minimum(lower, upper), np.maximum(lower, upper)
    drawn = np.random.default_rng(0).uniform(lower, upper, (POSTURES, robot.dof))
    return np.vstack([0.5 * (lower + upper), drawn])


def _reachable(pairs: list[Pair], distances: Array, moves: BoolArray) -> tuple[list[Pair], dict[str, str]]:
    """Return the pairs that some posture keeps apart and some joint moves, and why the others are left out.

    Raises:
        BadOption: Pairs that no posture keeps apart, and for no reason in the build of the robot.
    """
    kept, ignored, stuck = [], {}, []
    for pair, column, can_move in zip(pairs, distances.T, moves, strict=True):
        nearest, farthest = float(column.min()), float(column.max())
        if nearest >= pair.required and not can_move:
            ignored[pair.name] = "kept in every posture: no joint changes the distance"
        elif pair.near and farthest < pair.required + ROOM:
            most = max(round(farthest, 4), 0.0)
            ignored[pair.name] = f"one link apart and never farther than {most:.3g} m: too coarse to check"
        elif farthest >= pair.required:
            kept.append(pair)
        elif pair.mounting:
            ignored[pair.name] = "nearer than required in every posture, as mounted"
        elif pair.links and farthest < 0.0:
            ignored[pair.name] = "they overlap in every posture"
        elif pair.links and nearest > 0.0:
            ignored[pair.name] = "they never touch, and are never as far apart as required"
        else:
            stuck.append(f"{pair.name} ({farthest:.3g} of {pair.required:g} m)")
    if stuck:
        step = (
            f"no posture keeps this far apart, of {len(distances)} tried; "
            "correct the shapes or obstacles, require less, or list these pairs under ignore"
        )
        raise BadOption("workspace", ", ".join(stuck), step)
    return kept, ignored


def _read_only(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    view = np.ascontiguousarray(array).view()
    view.setflags(write=False)
    return view
