"""The tool's path and its picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawings import check_labels, lines, parsed, points
from synthetic import arm

from dynident.arrays import Array
from dynident.errors import UnknownChoice
from dynident.model.joint import joint_pose
from dynident.model.robot import Frame, Robot
from dynident.results.figures import ToolPath, path_chart, tool_path

GENERATOR = np.random.default_rng(3)


def tool_by_hand(robot: Robot, q: Array) -> Array:
    """Return the tool's place at one position by multiplying poses along the chain."""
    rotation, place = np.eye(3), np.zeros(3)
    for joint, position in zip(robot.joints, q, strict=True):
        turn, shift = joint_pose(joint, float(position))
        rotation, place = rotation @ turn, place + rotation @ shift
    return place + rotation @ np.asarray(robot.frames[robot.tool].translation)


@pytest.mark.parametrize("sliding", [False, True])
def test_the_path_is_that_of_the_poses_along_the_chain(sliding: bool) -> None:
    robot = arm(["a", "b", "c", "d", "e"], sliding=sliding)
    q = GENERATOR.uniform(-1, 1, (20, 5))
    path = tool_path(robot, q)
    assert path.points == pytest.approx(np.array([tool_by_hand(robot, row) for row in q]), abs=1e-12)
    assert path.bones.shape == (6, 2, 3)
    assert path.bones[0, 0] == pytest.approx(np.zeros(3))
    assert path.bones[1:, 0] == pytest.approx(path.bones[:-1, 1])  # a chain hangs together
    assert path.bones[-1, 1] == pytest.approx(path.points[0])


def test_long_logs_are_thinned_from_end_to_end() -> None:
    robot = arm()
    q = GENERATOR.uniform(-1, 1, (5000, 3))
    path = tool_path(robot, q, most=100)
    assert len(path.points) == 100
    assert path.points[[0, -1]] == pytest.approx(tool_path(robot, q[[0, -1]]).points)


def test_tools_elsewhere() -> None:
    robot = replace(arm(), tool="")
    last = tool_path(robot, np.zeros((1, 3)))
    assert last.points[0] == pytest.approx(last.bones[2, 1])
    on_the_base = replace(arm(), frames={"lamp": Frame(-1, np.eye(3), np.array([1.0, 2, 3]))}, tool="lamp")
    assert tool_path(on_the_base, np.zeros((2, 3))).points.tolist() == [[1, 2, 3], [1, 2, 3]]
    with pytest.raises(UnknownChoice, match="no frame called 'tol'; choose one of: tool; did you mean 'tool'"):
        tool_path(replace(arm(), tool="tol"), np.zeros((1, 3)))


@pytest.mark.parametrize("scale", [1e-3, 0.1, 1.0, 37.0])
@pytest.mark.parametrize("seed", range(12))
def test_labels_of_the_view_do_not_touch(seed: int, scale: float) -> None:
    generator = np.random.default_rng(seed)
    walk = scale * (generator.normal(size=3) + 0.1 * np.cumsum(generator.normal(size=(200, 3)), axis=0))
    bones = scale * generator.normal(size=(4, 2, 3))
    check_labels(path_chart("Path of the tool", ToolPath(walk, bones)))


def test_flat_and_still_paths_can_be_drawn() -> None:
    still = ToolPath(np.zeros((3, 3)), np.zeros((1, 2, 3)))
    check_labels(path_chart("still", still))
    flat = ToolPath(
        np.column_stack([np.cos(np.arange(50) / 8), np.sin(np.arange(50) / 8), np.zeros(50)]), np.zeros((1, 2, 3))
    )
    check_labels(path_chart("flat", flat))


def test_the_view_is_a_parallel_projection_with_z_upright() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1], [0, 0, 0.0]])
    root = parsed(path_chart("square", ToolPath(square, np.zeros((1, 2, 3)))))
    drawn = points(lines(root, "c1")[0])[0]
    assert drawn[1] - drawn[0] == pytest.approx(drawn[2] - drawn[3], abs=0.21)
    assert drawn[3, 0] == pytest.approx(drawn[0, 0], abs=0.11)
    assert drawn[3, 1] < drawn[0, 1]
    assert drawn[1, 0] > drawn[0, 0]
