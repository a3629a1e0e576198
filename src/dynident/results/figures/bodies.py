"""Figure of masses in space: the robot at one posture, its centres of mass, and ellipsoids of the same inertia."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.excitation.collision.covering import covering_capsules
from dynident.model.inertia import Inertia
from dynident.model.kernels import batched
from dynident.model.robot import Robot
from dynident.model.shapes import Capsule, Mesh
from dynident.results.figures import svg
from dynident.results.figures.chart import WIDTH, Line, heading
from dynident.results.figures.path import tool_path
from dynident.results.figures.scales import AZIMUTH, ELEVATION, LabelPlace, View, put_label, round_step
from dynident.results.text import format_number, label, shorten

#: Of the robot's own reach, so far may an ellipsoid widen the picture.
FAR = 1.15

_SIDES = np.eye(3)
_CORNERS = 48  # of the outline of an ellipsoid


@dataclass(frozen=True)
class Body:
    """A link as what its inertia says of it.

    Attributes:
        name: Of the link.
        mass: In kg.
        centre: Centre of mass in the base frame, shape (3,), in m.
        spread: Squared half axes of the solid ellipsoid of even density with the same mass and inertia, as a matrix in
            the base frame, shape (3, 3), in m^2.
        kind: Which of the kinds of a scene it belongs to.
        vast: Whether the ellipsoid is larger than the whole robot: what the data do not pin down, drawn as a line only.
    """

    name: str
    mass: float
    centre: Array
    spread: Array
    kind: int
    vast: bool = False


@dataclass(frozen=True)
class Scene:
    """A robot at a posture with the bodies of one or more sets of inertias.

    Attributes:
        kinds: What each set is called, such as ``identified``.
        bones: From each link's parent to the link, and on to the tool, shape (s, 2, 3), in m.
        bodies: Those of all sets.
        left_out: Links of a set that no body with a positive mass can have, in words.
        capsules: What covers the shapes of the links, in the base frame; empty where the robot model states none.
    """

    kinds: tuple[str, ...]
    bones: Array
    bodies: tuple[Body, ...]
    left_out: tuple[str, ...]
    capsules: tuple[Capsule, ...] = ()

    @property
    def points(self) -> Array:
        """Points that a picture of it must hold, shape (N, 3), in m: bones, centres, and how far the ellipsoids reach.

        An ellipsoid that the data do not pin down may be metres long: it counts no further than FAR times the robot.
        """
        hulls = [np.stack([c.start, c.end])[:, None] + c.radius * np.vstack([_SIDES, -_SIDES]) for c in self.capsules]
        known = [*(hull.reshape(-1, 3) for hull in hulls), *(b.centre[None, :] for b in self.bodies)]
        core = np.concatenate([self.bones.reshape(-1, 3), np.zeros((1, 3)), *known])
        middle = 0.5 * (core.min(axis=0) + core.max(axis=0))
        most = FAR * float(np.linalg.norm(core - middle, axis=1).max())
        found = [core]
        for body in self.bodies:
            sizes, axes = np.linalg.eigh(body.spread)
            reach = (axes * np.sqrt(np.maximum(sizes, 0.0))).T
            away = np.concatenate([body.centre + reach, body.centre - reach]) - middle
            size = np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
            found.append(middle + away * np.minimum(1.0, most / size))
        return np.concatenate(found)


def mass_scene(robot: Robot, q: Array, sets: Sequence[tuple[str, Sequence[Inertia | None]]]) -> Scene:
    """Return a robot at positions q (n,) with the bodies of sets of inertias, each with a name.

    The ellipsoid of a body with mass m and inertia I about its centre of mass has the squared half axes
    (5 / m) (tr(I) / 2 - I), which are not negative where a body with this inertia can exist.

    Args:
        robot: The robot.
        q: Positions, shape (n,), in rad or m.
        sets: Name of a set and its inertias in link frames, one a link; None for one that is not known.
    """
    rotations, places = batched.link_poses(robot.chain, np.asarray(q, dtype=float)[None, :])
    bodies, left_out = [], []
    for kind, (called, inertias) in enumerate(sets):
        for k, (link, inertia) in enumerate(zip(robot.links, inertias, strict=True)):
            if inertia is None:
                continue
            if inertia.defect():
                left_out.append(f"{label(link.name)} ({label(called)})")
                continue
            turn, about = rotations[0, k], np.asarray((inertia.solid() or inertia).about_centre)
            spread = 5.0 / inertia.mass * (0.5 * np.trace(about) * np.eye(3) - about)
            centre = places[0, k] + turn @ inertia.centre_of_mass
            bodies.append(Body(label(link.name), float(inertia.mass), centre, turn @ spread @ turn.T, kind))
    bones = tool_path(robot, np.asarray(q, dtype=float)[None, :]).bones
    reach = float(np.ptp(bones.reshape(-1, 3), axis=0).max())
    bodies = [replace(each, vast=bool(2.0 * np.sqrt(np.linalg.norm(each.spread, 2)) > reach)) for each in bodies]
    return Scene(
        tuple(name for name, _ in sets),
        bones,
        tuple(bodies),
        tuple(left_out),
        _capsules(robot, rotations[0], places[0]),
    )


def _capsules(robot: Robot, rotations: Array, places: Array) -> tuple[Capsule, ...]:
    """Return what covers the shapes of the base and the links but meshes, whose files are not at hand."""
    own = [(shape, np.eye(3), np.zeros(3)) for shape in robot.base_shapes]
    own += [(shape, rotations[k], places[k]) for k, link in enumerate(robot.links) for shape in link.shapes]
    shapes = [each for each in own if not isinstance(each[0], Mesh)]
    return tuple(one.moved(turn, place) for shape, turn, place in shapes for one in covering_capsules(shape))


def scene_chart(
    title: str, scene: Scene, azimuth: float = AZIMUTH, elevation: float = ELEVATION, width: float = WIDTH
) -> str:
    """Return a parallel projection of a scene.

    Args:
        title: What it shows.
        scene: Robot and bodies.
        azimuth: Direction of the eye about the vertical, in rad; 0 looks along -x, -pi/2 along y.
        elevation: How far it is raised, in rad.
        width: Of the figure.
    """
    nothing = np.zeros(0)
    legend = [Line(name, nothing, nothing, _colour(kind), dashed=kind > 0) for kind, name in enumerate(scene.kinds)]
    head, top = heading(title, legend, width)
    view = View.around(scene.points, width, 300.0, azimuth, elevation, top + 26.0)
    depth = -np.cross(view.matrix[0], view.matrix[1])  # towards the eye
    behind = sorted(scene.bodies, key=lambda body: float(depth @ body.centre))
    taken: list[LabelPlace] = []
    size = float(np.linalg.norm(view.matrix[0]))
    inside = [
        *[
            svg.stroke(view.line(np.stack([c.start, c.end])), 0, 2 * size * c.radius, opacity=0.1, round_ends=True)
            for c in scene.capsules
        ],
        *[svg.stroke(view.line(bone), 0, 7.0, opacity=0.3) for bone in scene.bones if np.ptp(bone, axis=0).any()],
        *[view.dot(bone[0], 0, 3.0) for bone in scene.bones],
        *[_ellipsoid(view, each) for each in behind],
        *[view.dot(each.centre, _colour(each.kind), 3.5) for each in behind],
    ]
    body = [
        head,
        _cut(view, top, "".join(inside)),
        _axes(view, taken),
        *[_name(view, each, taken) for each in scene.bodies if each.kind == 0],
        _ruler(view, taken),
    ]
    masses = "; ".join(
        f"{each.name} {format_number(each.mass, 3)} kg, {scene.kinds[each.kind]}" for each in scene.bodies
    )
    said = f"Centres of mass and ellipsoids of inertia at one posture: {masses}."
    return svg.drawing(width, view.height, "".join(body), title, said)


def scene_text(scene: Scene) -> str:
    """Return a scene as JSON for a page that can turn it: kinds, bones and bodies, lengths in m."""
    bodies = [
        {
            "name": shorten(body.name, 22),
            "kind": body.kind,
            "centre": _short(body.centre),
            "spread": [_short(row) for row in body.spread],
            "vast": body.vast,
        }
        for body in scene.bodies
    ]
    bones = [[_short(end) for end in bone] for bone in scene.bones]
    points = scene.points
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    radius = float(np.linalg.norm(points - middle, axis=1).max())
    data: dict[str, object] = {"kinds": scene.kinds, "bones": bones, "bodies": bodies}
    data["capsules"] = [[_short(c.start), _short(c.end), c.radius] for c in scene.capsules]
    data |= {"middle": _short(middle), "radius": radius}
    return json.dumps(data, separators=(",", ":"), allow_nan=False)


def _short(values: Array) -> list[float]:
    return [float(f"{value:.6g}") for value in values]


def _colour(kind: int) -> int:
    """Return the colour of a set: blue for the first, orange for the second."""
    return 1 + kind


def _ellipsoid(view: View, body: Body) -> str:
    """Return the outline of an ellipsoid: that of a projection is given by the projected spread."""
    sizes, axes = np.linalg.eigh(view.matrix @ body.spread @ view.matrix.T)
    turn = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)
    outline = (axes * np.sqrt(np.maximum(sizes, 0.0))) @ np.stack([np.cos(turn), np.sin(turn)])
    ((x, y),) = view.at(body.centre)
    data = svg.track(x + outline[0], y + outline[1]) + "z"
    colour = _colour(body.kind)
    edge = svg.stroke(data, colour, 1.4, dashed=body.kind > 0)
    return (svg.filled(data, colour, 0.14) if body.kind == 0 and not body.vast else "") + edge


def _cut(view: View, top: float, body: str) -> str:
    """Return what is drawn below the heading, without what leaves the drawing: an inner one shows only its inside."""
    height = view.height - top
    box = f"0 {svg.number(top)} {svg.number(view.width)} {svg.number(height)}"
    return svg.element("svg", body, {"x": 0, "y": top, "width": view.width, "height": height, "viewBox": box})


def _axes(view: View, taken: list[LabelPlace]) -> str:
    """Draw the axes of the base frame, a sixth of the picture long."""
    length = view.width / 6.0 / float(np.linalg.norm(view.matrix, axis=1).max())
    step = round_step(length / 2.5)
    found = []
    for axis, end in zip("xyz", step * np.eye(3), strict=True):
        (x, y), (x0, y0) = view.at(end)[0], view.at(np.zeros(3))[0]
        if np.hypot(x - x0, y - y0) < 6.0:  # points at the eye
            continue
        found.append(svg.rule(x0, y0, x, y, strong=True))
        found.append(put_label(view, axis, [(x + 4, y + 4, "start"), (x - 4, y + 4, "end")], taken))
    return "".join(found)


def _name(view: View, body: Body, taken: list[LabelPlace]) -> str:
    ((x, y),) = view.at(body.centre)
    text = shorten(body.name, 22)
    anchors = [(x + 9, y + 4.5, "start"), (x - 9, y + 4.5, "end"), (x, y - 10, "middle"), (x, y + 20, "middle")]
    return put_label(view, text, [(float(a), float(b), side) for a, b, side in anchors], taken, "ink")


def _ruler(view: View, taken: list[LabelPlace]) -> str:
    """Draw a bar of a round length at the lower right."""
    scale = float(np.linalg.norm(view.matrix[0]))
    length = round_step(view.width / 10.0 / scale)
    x, y = view.width - 14.0, view.height - 10.0
    text = f"{length:g} m"
    body = svg.rule(x - scale * length, y, x, y, strong=True)
    return body + put_label(view, text, [(x - scale * length - 6, y + 4.5, "end")], taken)
