"""Figure of the tool's path in space, with the robot, the floor and the axes (Figure 5 of the article).

Around the robot stand floor and walls, boxes, the region of the tool, marks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dynident.arrays import Array
from dynident.errors import UnknownChoice
from dynident.excitation.collision.tool_speed import ToolPoint
from dynident.excitation.collision.workspace import HalfSpace, Workspace
from dynident.model.kernels import batched
from dynident.model.robot import Robot
from dynident.model.shapes import Box
from dynident.results.figures import svg
from dynident.results.figures.chart import WIDTH
from dynident.results.figures.scales import LabelPlace, Tick, View, put_label, round_step, write_tick
from dynident.results.text import format_number, label, shorten

#: Height of the view at most.
_HIGHEST = 340.0


@dataclass(frozen=True)
class ToolPath:
    """Where the tool was, and how the robot stood at the start.

    Attributes:
        points: Origin of the tool frame in the base frame, shape (N, 3), in m.
        bones: From each link's parent to the link, and on to the tool, at the first sample, shape (s, 2, 3), in m.
    """

    points: Array
    bones: Array


def tool_path(robot: Robot, q: Array, most: int = 1500, point: ToolPoint | None = None) -> ToolPath:
    """Return the path of the robot's tool, or of its last link where it names none.

    Args:
        robot: The robot.
        q: Positions, shape (N, n), in rad or m.
        most: So many samples at most, evenly taken.
        point: Another tool point, such as that of a workspace; None for the robot's own.

    Raises:
        UnknownChoice: The robot's tool is none of its frames.
    """
    if point is None and robot.tool and robot.tool not in robot.frames:
        raise UnknownChoice("frame", robot.tool, tuple(robot.frames))
    rows = np.unique(np.linspace(0, len(q) - 1, min(len(q), most)).astype(int))
    rotations, places = batched.link_poses(robot.chain, q[rows])
    link, shift = len(robot.links) - 1, np.zeros(3)
    if point is not None:
        link, shift = point.link, point.offset
    elif robot.tool:
        link, shift = robot.frames[robot.tool].link, np.asarray(robot.frames[robot.tool].translation)
    fixed = np.broadcast_to(shift, (len(rows), 3))
    points = fixed if link < 0 else places[:, link] + rotations[:, link] @ shift
    bones = [
        (places[0, joint.parent] if joint.parent >= 0 else np.zeros(3), places[0, k])
        for k, joint in enumerate(robot.joints)
    ]
    if link >= 0:
        bones.append((places[0, link], points[0]))
    return ToolPath(np.array(points), np.array(bones))


def path_chart(title: str, path: ToolPath, scenery: Scenery | None = None) -> str:
    """Return the path in an axonometric view: floor grid, axes in metres, the robot at the start.

    Args:
        title: What it shows.
        path: Points and bones.
        scenery: What stands around, and marks on the path.
    """
    around = scenery or Scenery()
    cloud = np.concatenate([path.points, path.bones.reshape(-1, 3), np.zeros((1, 3))])
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    ground = around.floor(cloud)
    cloud = np.concatenate([cloud, around.near(cloud)])
    step = round_step(max(float(np.ptp(cloud, axis=0).max()), 1e-3) / 5)
    low, high = np.floor(cloud.min(axis=0) / step) * step, np.ceil(cloud.max(axis=0) / step) * step
    high = np.maximum(high, low + step)
    low[2] = min(low[2], 0.0) if ground is None or cloud[:, 2].min() < ground - 1e-9 else ground
    floor = [[x, y, low[2]] for x in (low[0], high[0]) for y in (low[1], high[1])]
    walls = [plane_outline(plane, low, high) for plane in around.half_spaces.values()]
    view = View.around(np.concatenate([cloud, floor, [[low[0], low[1], high[2]]], *walls]), WIDTH, _HIGHEST)
    taken: list[LabelPlace] = []
    body = [
        svg.element("g", svg.words(title, 0, 15, "ink"), {"font-weight": "600"}),
        _box(view, low, high, step, taken),
        draw_behind(view, around, low, high),
        svg.stroke(view.line(path.points * [1, 1, 0] + [0, 0, low[2]]), 0, 1.0, opacity=0.22),
        *[svg.stroke(view.line(bone), 0, 7.0, opacity=0.35) for bone in path.bones if np.ptp(bone, axis=0).any()],
        *[
            svg.stroke(view.line(bone), 4, 3.5, opacity=0.55)
            for posture in around.postures
            for bone in posture
            if np.ptp(bone, axis=0).any()
        ],
        svg.stroke(view.line(path.points), 1, 1.6),
        *[view.dot(point, 0, 3.5) for point in path.bones[:, 0]],
        view.dot(path.points[0], 2, 5.0),
        draw_marks(view, around, low, high, taken),
    ]
    spans = ", ".join(
        f"{axis} from {format_number(float(a), 3)} to {format_number(float(b), 3)} m"
        for axis, a, b in zip("xyz", path.points.min(axis=0), path.points.max(axis=0), strict=True)
    )
    said = f"Path of the tool in the base frame, {spans}; its shadow on the floor and the robot at the start."
    said += around.said()
    return svg.drawing(WIDTH, view.height, "".join(body), title, said)


def _box(view: View, low: Array, high: Array, step: float, taken: list[LabelPlace]) -> str:
    """Draw the floor with its grid, the labels along its two near edges, and the height at the left."""

    def labels(entries: list[tuple[list[float], str]], anchor: str, away: tuple[float, float]) -> list[str]:
        return _labels(view, entries, anchor, away, taken)

    ticks = [_axis_ticks(a, b, step) for a, b in zip(low, high, strict=True)]
    tall = [t for t in ticks[2] if t.value > low[2] + 0.3 * step]
    body = [_segment(view, [t.value, low[1], low[2]], [t.value, high[1], low[2]]) for t in ticks[0]]
    body += [_segment(view, [low[0], t.value, low[2]], [high[0], t.value, low[2]]) for t in ticks[1]]
    body.append(_segment(view, [low[0], low[1], low[2]], [low[0], low[1], high[2]], strong=True))
    body += labels([([t.value, low[1], low[2]], t.text) for t in ticks[0]], "middle", (0.0, 19.0))
    body += labels([([high[0], t.value, low[2]], t.text) for t in ticks[1][1:]], "start", (9.0, 11.0))
    body += labels([([low[0], low[1], t.value], t.text) for t in tall], "end", (-9.0, 4.5))
    middle = (low + high) / 2
    wide = max(svg.breadth(t.text) for t in ticks[1])
    body += labels([([middle[0], low[1], low[2]], "x [m]")], "middle", (-22.0, 40.0))
    body += labels([([high[0], middle[1], low[2]], "y [m]")], "start", (14.0 + wide, 24.0))
    body += labels([([low[0], low[1], high[2]], "z [m]")], "end", (-4.0, -14.0))
    return "".join(body)


def _axis_ticks(low: float, high: float, step: float) -> list[Tick]:
    first, last = int(np.ceil(low / step - 1e-6)), round(high / step)
    return [Tick(k * step, write_tick(k * step, step)) for k in range(first, last + 1)]


def _segment(view: View, start: list[float], end: list[float], strong: bool = False) -> str:
    (x1, y1), (x2, y2) = view.at(np.array([start, end]))
    return svg.rule(x1, y1, x2, y2, strong)


def _labels(
    view: View, entries: list[tuple[list[float], str]], anchor: str, away: tuple[float, float], taken: list[LabelPlace]
) -> list[str]:
    """Write labels beside points, and note where they stand; one that would touch the label before is left out."""
    body: list[str] = []
    last = np.array([-np.inf, -np.inf])
    for point, text in entries:
        place = view.at(np.array(point))[0]
        if abs(place[0] - last[0]) > svg.breadth(text) + 6 or abs(place[1] - last[1]) > svg.SIZE + 2:
            x, y = float(place[0] + away[0]), float(place[1] + away[1])
            body.append(svg.words(text, x, y, anchor=anchor))
            taken.append(LabelPlace.of(text, x, y, anchor))
            last = place
    return body


#: Surroundings are shown so far from the motion, as a share of its size.
NEAR = 0.35

#: Marks nearer to each other than this, in units of the drawing, share their label.
APART = 16.0

#: Edges of a box between its corners, which differ in one of the three bits of their number.
EDGES = tuple((i, i | bit) for bit in (4, 2, 1) for i in range(8) if not i & bit)


@dataclass(frozen=True)
class Spot:
    """A point of a path that is worth a mark.

    Attributes:
        text: What stands beside it, such as ``1``.
        point: Where it is, shape (3,), in m.
    """

    text: str
    point: Array


@dataclass(frozen=True)
class Scenery:
    """What is drawn beside a path, in the base frame.

    Attributes:
        half_spaces: Floor and walls by name; their boundary is drawn where it crosses the view.
        boxes: Boxes by name.
        region: Box that the tool stays in; None for none.
        spots: Marks on the path.
        postures: Other postures of the robot, lines (s, 2, 3) each, in m.
    """

    half_spaces: Mapping[str, HalfSpace] = field(default_factory=dict)
    boxes: Mapping[str, Box] = field(default_factory=dict)
    region: Box | None = None
    spots: Sequence[Spot] = ()
    postures: Sequence[Array] = ()

    @classmethod
    def of(cls, workspace: Workspace | None, spots: Sequence[Spot] = (), postures: Sequence[Array] = ()) -> Scenery:
        """Return the scenery of a workspace with marks on the path."""
        if workspace is None:
            return cls(spots=spots, postures=postures)
        return cls(workspace.half_spaces, workspace.boxes, workspace.region, spots, postures)

    def floor(self, cloud: Array) -> float | None:
        """Return the height of the highest level floor below points (N, 3) and near them; None where there is none."""
        low = float(cloud[:, 2].min())
        reach = NEAR * max(float(np.ptp(cloud, axis=0).max()), 1e-3)
        heights = [p.offset for p in self.half_spaces.values() if p.normal[2] > 1 - 1e-9]
        return max((h for h in heights if low - reach <= h <= low), default=None)

    def near(self, cloud: Array) -> Array:
        """Return the points (k, 3) that the view should take in beside those of the motion (N, 3)."""
        low, high = cloud.min(axis=0), cloud.max(axis=0)
        reach = NEAR * max(float(np.ptp(cloud, axis=0).max()), 1e-3)
        boxes = [*self.boxes.values(), *([] if self.region is None else [self.region])]
        found = [posture.reshape(-1, 3) for posture in self.postures]
        found += [np.clip(box.corners, low - reach, high + reach) for box in boxes]
        middle = 0.5 * (low + high)
        for plane in self.half_spaces.values():
            foot = middle - (plane.normal @ middle - plane.offset) * plane.normal
            found.append(np.clip(foot, low - reach, high + reach)[None, :])
        return np.concatenate([*found, np.empty((0, 3))])

    def said(self) -> str:
        """Return what is shown, in words for those who do not see it."""
        names = [label(name) for name in (*self.half_spaces, *self.boxes)] + ["the tool's region"] * bool(self.region)
        shown = f" Around it: {', '.join(names)}." if names else ""
        return shown + f" Marked on it: {', '.join(spot.text for spot in self.spots)}." * bool(self.spots)


def draw_behind(view: View, scenery: Scenery, low: Array, high: Array) -> str:
    """Return floor, walls, boxes and region as far as they are inside the box from ``low`` to ``high``."""
    body = []
    for plane in scenery.half_spaces.values():
        outline = plane_outline(plane, low, high)
        if len(outline):
            data = view.line(outline)
            body += [svg.filled(f"{data}z", 0, 0.05), svg.stroke(f"{data}z", 0, 1.0, opacity=0.4)]
    for box in scenery.boxes.values():
        inside = np.all((box.corners >= low - 1e-9) & (box.corners <= high + 1e-9))
        if inside:
            body.append(svg.filled(f"{_hull(view.at(box.corners))}z", 5, 0.16))
        body.append(svg.stroke(_wires(view, box, low, high), 5, 1.2))
    if scenery.region is not None:
        body.append(svg.stroke(_wires(view, scenery.region, low, high), 3, 1.2, dashed=True))
    return "".join(body)


def draw_marks(view: View, scenery: Scenery, low: Array, high: Array, taken: list[LabelPlace]) -> str:
    """Return the marks on the path and the names of what stands around, where they have room."""
    body = [view.dot(spot.point, 4, 4.5) for spot in scenery.spots]
    for text, place in _gathered(view, scenery.spots):
        body.append(put_label(view, text, _around(*place, 8.0), taken, "ink"))
    named: list[tuple[str, Array]] = []
    for name, box in scenery.boxes.items():
        named.append((name, np.clip(box.corners, low, high)))
    if scenery.region is not None:
        named.append(("tool region", np.clip(scenery.region.corners, low, high)))
    for name, plane in scenery.half_spaces.items():
        outline = plane_outline(plane, low, high)
        if len(outline):
            named.append((name, outline))
    for name, corners in named:
        places = view.at(corners)
        top = places[np.argsort(-places[:, 0] if name in scenery.half_spaces else places[:, 1])]
        anchors = [anchor for x, y in top for anchor in _around(float(x), float(y), 5.0)]
        body.append(put_label(view, shorten(label(name), 22), anchors, taken))
    return "".join(body)


def plane_outline(plane: HalfSpace, low: Array, high: Array) -> Array:
    """Return where a plane cuts the box from ``low`` to ``high``, corners in order, shape (k, 3); none where it misses.

    Args:
        plane: The plane.
        low: Lower corner, shape (3,).
        high: Upper corner, shape (3,).
    """
    corners = Box.between(low, high).corners
    height = corners @ plane.normal - plane.offset
    height = np.where(np.abs(height) < 1e-9 * float(np.max(high - low)), 0.0, height)
    found = [corners[k] for k in np.flatnonzero(height == 0.0)]
    for a, b in EDGES:
        if height[a] * height[b] < 0:
            found.append(corners[a] + height[a] / (height[a] - height[b]) * (corners[b] - corners[a]))
    if len(found) < 3:
        return np.empty((0, 3))
    points = np.array(found)
    first = np.eye(3)[int(np.argmin(np.abs(plane.normal)))]
    across = np.cross(plane.normal, first)
    away = points - points.mean(axis=0)
    return points[np.argsort(np.arctan2(away @ np.cross(plane.normal, across), away @ across))]


def clipped(start: Array, end: Array, low: Array, high: Array) -> Array:
    """Return the part of a segment inside a box, shape (2, 3), empty (0, 3) where it misses (Liang and Barsky 1984)."""
    along, first, last = end - start, 0.0, 1.0
    for k in range(3):
        if along[k] == 0.0:
            if not low[k] - 1e-9 <= start[k] <= high[k] + 1e-9:
                return np.empty((0, 3))
            continue
        enters, leaves = sorted(((low[k] - start[k]) / along[k], (high[k] - start[k]) / along[k]))
        first, last = max(first, enters), min(last, leaves)
    return np.array([start + first * along, start + last * along]) if first < last else np.empty((0, 3))


def _wires(view: View, box: Box, low: Array, high: Array) -> str:
    corners = box.corners
    parts = [clipped(corners[a], corners[b], low, high) for a, b in EDGES]
    return "".join(view.line(part) for part in parts if len(part))


def _hull(places: Array) -> str:
    """Return path data around places (N, 2), anticlockwise (Andrew 1979)."""
    ordered = sorted(map(tuple, places.tolist()))

    def half(run: Sequence[tuple[float, ...]]) -> list[tuple[float, ...]]:
        chain: list[tuple[float, ...]] = []
        for p in run:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 0:
                chain.pop()
            chain.append(p)
        return chain[:-1]

    outline = np.array([*half(ordered), *half(ordered[::-1])])
    return svg.track(outline[:, 0], outline[:, 1])


def _turn(a: tuple[float, ...], b: tuple[float, ...], c: tuple[float, ...]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _gathered(view: View, spots: Sequence[Spot]) -> list[tuple[str, tuple[float, float]]]:
    """Return the labels of marks with their places; marks that lie together share one."""
    found: list[tuple[list[str], Array]] = []
    for spot in spots:
        place = view.at(spot.point)[0]
        near = next((texts for texts, other in found if np.linalg.norm(place - other) < APART), None)
        if near is None:
            found.append(([spot.text], place))
        else:
            near.append(spot.text)
    return [(", ".join(texts), (float(place[0]), float(place[1]))) for texts, place in found]


def _around(x: float, y: float, away: float) -> list[tuple[float, float, str]]:
    """Return anchors of a label beside a place: right, left, above, below, then the corners."""
    return [
        (x + away, y + 4.5, "start"),
        (x - away, y + 4.5, "end"),
        (x, y - away, "middle"),
        (x, y + away + 10.0, "middle"),
        (x + away, y - away, "start"),
        (x - away, y + away + 10.0, "end"),
    ]
