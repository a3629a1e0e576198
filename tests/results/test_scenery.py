"""What stands around a robot in a picture: planes and edges cut to the view, labels that do not touch."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from drawings import check_labels, lines, named, parsed, points
from hypothesis import given
from hypothesis import strategies as st
from synthetic import HOSTILE, arm

from dynident.arrays import Array
from dynident.excitation.collision.tool_speed import ToolPoint
from dynident.excitation.collision.workspace import HalfSpace, Workspace
from dynident.model.shapes import Box
from dynident.results.figures import Bounded, Scenery, Spot, ToolPath, limit_chart, path_chart, tool_path
from dynident.results.figures.path import EDGES, clipped, plane_outline

LOW, HIGH = np.array([-1.0, -0.5, 0.0]), np.array([1.0, 1.5, 2.0])
numbers = st.floats(-3, 3, allow_nan=False).map(lambda value: round(value, 3))
triples = st.tuples(numbers, numbers, numbers).map(np.array)


@given(triples.filter(lambda n: np.linalg.norm(n) > 0.1), numbers)
def test_the_outline_of_a_plane_is_a_convex_polygon_on_the_faces_of_the_box(normal: Array, offset: float) -> None:
    plane = HalfSpace(normal, offset)
    corners = Box.between(LOW, HIGH).corners
    height = corners @ plane.normal - plane.offset
    found = plane_outline(plane, LOW, HIGH)
    if not len(found):
        assert np.all(height > -1e-6) or np.all(height < 1e-6)
        return
    assert found @ plane.normal == pytest.approx(plane.offset, abs=1e-9)
    assert np.all((found >= LOW - 1e-9) & (found <= HIGH + 1e-9))
    assert np.all(np.isclose(found, LOW) | np.isclose(found, HIGH), axis=1).any() or len(found) <= 6
    ring = np.vstack([found, found[:2]])
    turns = [float(np.cross(b - a, c - b) @ plane.normal) for a, b, c in zip(ring, ring[1:], ring[2:], strict=False)]
    assert min(turns) > -1e-9 or max(turns) < 1e-9


def test_a_floor_is_the_rectangle_of_the_view() -> None:
    found = plane_outline(HalfSpace(np.array([0, 0, 2.0]), 0.5), LOW, HIGH)
    assert sorted(map(tuple, found.tolist())) == [(-1, -0.5, 0.5), (-1, 1.5, 0.5), (1, -0.5, 0.5), (1, 1.5, 0.5)]
    assert all(np.count_nonzero(a != b) == 1 for a, b in pairwise(found))  # corner to corner along an edge
    assert not len(plane_outline(HalfSpace(np.array([0, 0, 1.0]), -0.1), LOW, HIGH))


@given(triples, triples)
def test_a_segment_is_cut_to_what_lies_inside(start: Array, end: Array) -> None:
    share = np.linspace(0, 1, 2001)[:, None]
    along = start + share * (end - start)
    inside = along[np.all((along >= LOW) & (along <= HIGH), axis=1)]
    found = clipped(start, end, LOW, HIGH)
    if len(inside) > 1:
        step = np.linalg.norm(end - start) / 2000 + 1e-9
        assert np.linalg.norm(found[0] - inside[0]) < 2 * step and np.linalg.norm(found[1] - inside[-1]) < 2 * step
    else:
        assert len(found) == 0 or np.linalg.norm(found[1] - found[0]) < 1e-2


def test_edges_of_a_box_are_its_twelve() -> None:
    corners = Box.between(LOW, HIGH).corners
    assert len(set(EDGES)) == 12
    assert all(np.count_nonzero(corners[a] != corners[b]) == 1 for a, b in EDGES)


def scenery_of(seed: int) -> tuple[ToolPath, Scenery]:
    """Return a path with a room, boxes near and far, a region and ten marks."""
    random = np.random.default_rng(seed)
    walk = random.normal(size=3) * 0.3 + 0.05 * np.cumsum(random.normal(size=(300, 3)), axis=0)
    around = Workspace(
        {"floor": HalfSpace(np.array([0, 0, 1.0]), float(walk[:, 2].min()) - random.uniform(0, 0.5)),
         "wall": HalfSpace(random.normal(size=3), -1.0)},
        {name: Box(random.uniform(0.1, 0.5, 3), np.eye(3), random.uniform(-1, 1, 3)) for name in ("bin", "a" * 60)}
        | {"far away": Box(np.ones(3), np.eye(3), np.array([50.0, 0, 0]))},
        region=Box(np.array([3.0, 3.0, 3.0]), np.eye(3), walk.mean(axis=0)),
    )  # fmt: skip
    spots = [Spot(str(k), walk[row]) for k, row in enumerate(random.integers(0, 300, 10), start=1)]
    return ToolPath(walk, random.normal(size=(4, 2, 3)) * 0.3), Scenery.of(
        around, spots, [random.normal(size=(3, 2, 3))]
    )


@pytest.mark.parametrize("seed", range(15))
def test_labels_of_a_furnished_view_do_not_touch(seed: int) -> None:
    path, scenery = scenery_of(seed)
    figure = path_chart("Path of the tool", path, scenery=scenery)
    check_labels(figure)
    texts = [text.text or "" for text in named(parsed(figure), "text")]
    marks = [number for text in texts for number in text.split(", ") if number.isdigit() and text[0] != "0"]
    assert set(marks) <= {str(k) for k in range(11)}
    said = parsed(figure)[1].text or ""
    assert "Around it: floor, wall, bin, " in said and "far away" in said and "Marked on it: 1, 2, 3" in said


def test_names_are_only_text() -> None:
    boxes = {name: Box(np.ones(3) * 0.1, np.eye(3), np.array([0.1 * k, 0, 0])) for k, name in enumerate(HOSTILE)}
    path = ToolPath(np.random.default_rng(0).normal(size=(9, 3)), np.zeros((1, 2, 3)))
    figure = path_chart("path", path, scenery=Scenery(boxes=boxes, spots=[Spot("1", path.points[3])]))
    check_labels(figure)
    assert {element.tag.split("}")[1] for element in parsed(figure).iter()} <= {
        "svg", "title", "desc", "g", "text", "line", "path",
    }  # fmt: skip


def test_the_grid_stands_on_the_floor_and_marks_stand_on_the_path() -> None:
    square = np.array([[0, 0, 0.3], [1, 0, 0.3], [1, 1, 0.8], [0, 0, 0.3]])
    scenery = Scenery(half_spaces={"floor": HalfSpace(np.array([0, 0, 1.0]), -0.15)}, spots=[Spot("7", square[2])])
    root = parsed(path_chart("square", ToolPath(square, np.zeros((1, 2, 3))), scenery=scenery))
    drawn = points(lines(root, "c1")[0])[0]
    (mark,) = [path for path in named(root, "path") if path.get("class") == "d4"]
    left = points(mark.attrib["d"].split("a")[0])[0][0]  # of the disc
    assert left + np.array([4.5, 0]) == pytest.approx(drawn[2], abs=0.2)
    (below,) = [path for path in named(root, "path") if path.get("stroke-opacity") == "0.22"]
    shadow = points(below.attrib["d"])[0]
    assert shadow[:, 0] == pytest.approx(drawn[:, 0], abs=0.2)
    drop = shadow[:, 1] - drawn[:, 1]
    assert drop[2] / drop[0] == pytest.approx((0.8 + 0.15) / (0.3 + 0.15), rel=0.01)
    assert "7" in [text.text for text in named(root, "text")]


def test_the_path_of_another_tool_point() -> None:
    robot = arm()
    q = np.random.default_rng(1).uniform(-1, 1, (5, 3))
    point = ToolPoint(robot.chain, 1, np.array([0.0, 0.2, 0.1]))
    found = tool_path(robot, q, point=point)
    assert found.points == pytest.approx(point.position(q), abs=1e-12)
    assert found.bones[-1, 1] == pytest.approx(found.points[0])


def test_limits_are_drawn_where_the_motion_is_near_and_stated_where_it_is_not() -> None:
    time = np.linspace(0, 3, 200)
    wave = np.sin(time)
    signals = [
        Bounded("position", "rad", wave, -1.5, 1.25),
        Bounded("speed", "rad/s", wave, -9.0, 9.0),
        Bounded("acceleration", "rad/s^2", wave, -np.inf, np.inf),
    ]
    assert [signal.used for signal in signals] == pytest.approx([(1 + 0.125) / 1.375, 1 / 9, 0.0], rel=1e-3)
    figure = limit_chart("a" * 90, time, signals)
    check_labels(figure)
    root = parsed(figure)
    texts = [text.text for text in named(root, "text")]
    assert "position [rad], limit -1.5 to 1.25" in texts
    assert "speed [rad/s], limit ±9 is off the plot" in texts
    assert "acceleration [rad/s²], no limit stated" in texts
    dashed = [path for path in named(root, "path") if path.get("stroke-dasharray")]
    heights = sorted(points(path.attrib["d"])[0][0, 1] for path in dashed)
    curve = points(lines(root, "c1")[0])[0][:, 1]
    assert len(heights) == 2 and heights[0] < curve.min() < curve.max() < heights[1]
