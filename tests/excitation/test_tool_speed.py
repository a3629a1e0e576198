"""The speed of the tool point against finite differences of its place, on trees with slides and followers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.errors import UnknownChoice
from dynident.excitation.collision.tool_speed import ToolPoint, tool_point_of
from dynident.excitation.collision.workspace import Tool, Workspace
from dynident.model.joint import Joint, Mimic, rotation_about
from dynident.model.robot import Frame, Link, Robot

X, Y, Z = np.eye(3)


def random_point(seed: int) -> tuple[ToolPoint, Array, Array]:
    """Return a point on the last link of a chain of six with one follower, and states."""
    random = np.random.default_rng(seed)
    joints = []
    for i in range(6):
        kind = "prismatic" if random.uniform() < 0.3 else "revolute"
        axis = random.normal(size=3)
        turn = rotation_about(axis / np.linalg.norm(axis), float(random.uniform(-3, 3)))
        mimic = Mimic("joint1", -0.7, 0.2) if i == 4 else None
        joints.append(
            Joint(f"joint{i}", kind, i - 1, turn, random.uniform(-1, 1, 3), random.normal(size=3), mimic=mimic)
        )
    robot = Robot("chain", tuple(Link(f"link{i}") for i in range(6)), tuple(joints))
    point = tool_point_of(robot, Workspace(tool=Tool("", random.uniform(-1, 1, 3))))
    return point, random.uniform(-2, 2, (40, 5)), random.uniform(-2, 2, (40, 5))


@pytest.mark.parametrize("seed", range(5))
def test_the_speed_is_that_of_the_place(seed: int) -> None:
    point, q, dq = random_point(seed)
    ways = (point.position(q + 1e-6 * dq) - point.position(q - 1e-6 * dq)) / 2e-6
    assert point.speed(q, dq) == pytest.approx(np.linalg.norm(ways, axis=1), rel=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_its_derivatives_are_those_of_finite_differences(seed: int) -> None:
    point, q, dq = random_point(seed)
    by_q, by_dq = point.gradient(q, dq)
    for joint, shift in enumerate(1e-6 * np.eye(5)):
        slope = (point.speed(q + shift, dq) - point.speed(q - shift, dq)) / 2e-6
        assert by_q[:, joint] == pytest.approx(slope, abs=1e-7, rel=1e-6)
        slope = (point.speed(q, dq + shift) - point.speed(q, dq - shift)) / 2e-6
        assert by_dq[:, joint] == pytest.approx(slope, abs=1e-7, rel=1e-6)


def test_a_planar_arm_has_a_closed_form(planar_2r: Robot) -> None:
    """Stretched out: v = 0.5 dq1 + 0.4 (dq1 + dq2)."""
    robot = replace(planar_2r, frames={"flange": Frame(1, np.eye(3), 0.3 * X)})
    point = tool_point_of(robot, Workspace(tool=Tool("flange", 0.1 * X)))
    assert point.speed([[0.7, 0.0]], [[2.0, -1.0]]) == pytest.approx([1.4])
    by_q, by_dq = point.gradient([[0.7, 0.0]], [[2.0, -1.0]])
    assert by_q[0] == pytest.approx([0, 0], abs=1e-12) and by_dq[0] == pytest.approx([0.9, 0.4])


def test_at_rest_and_on_the_base(planar_2r: Robot) -> None:
    point = tool_point_of(planar_2r, Workspace())
    assert (point.link, point.offset.tolist()) == (1, [0, 0, 0])
    assert point.speed(np.zeros((2, 2)), np.zeros((2, 2))).tolist() == [0, 0]
    assert not np.any(point.gradient(np.ones((2, 2)), np.zeros((2, 2))))
    on_base = tool_point_of(planar_2r, Workspace(tool=Tool("base", Z)))
    assert on_base.position(np.ones((1, 2))).tolist() == [[0, 0, 1]]
    assert on_base.speed(np.ones((1, 2)), np.ones((1, 2))).tolist() == [0]
    with pytest.raises(UnknownChoice, match="'link7'"):
        tool_point_of(planar_2r, Workspace(tool=Tool("link7")))
