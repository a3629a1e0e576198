"""Figure of the tool's path in space, with the robot, the floor and the axes (Figure 5 of the article)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.errors import UnknownChoice
from dynident.excitation.collision.tool_speed import ToolPoint
from dynident.model.kernels import batched
from dynident.model.robot import Robot
from dynident.results.figures import svg
from dynident.results.figures.chart import WIDTH
from dynident.results.figures.scales import Tick, round_step, write_tick
from dynident.results.figures.scenery import Scenery, draw_behind, draw_marks, plane_outline
from dynident.results.figures.view import LabelPlace, View
from dynident.results.text import format_number

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
