"""DH tables against homogeneous matrices written out factor by factor."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynident.arrays import Array
from dynident.model.documents.numbers import Place, expression
from dynident.model.inertia import Inertia
from dynident.model.kernels import batched
from dynident.model.robot import Robot
from dynident.robot_files.formats.dh import modified_pose, read_dh, standard_pose

TABLE = """\
name: arm
convention: {convention}
gravity: [0, 1, -9.7]
joints:
  - name: one
    a: 0.3
    alpha: -pi/2
    d: 0.4
    theta: 0.2
    offset: 0.1
    limits: {{lower: -pi, upper: 3*pi/4, velocity: 2, acceleration: 3, jerk: 4, effort: 5, effort_rate: 6}}
    drive: {{gear_ratio: -80, rotor_inertia: 1e-4, gain: 7}}
    damping: 0.5
    friction: 0.25
    link:
      name: arm_one
      inertia:
        mass: 2
        centre_of_mass: [0.1, -0.2, 0.3]
        about_centre: [0.5, 0.01, -0.02, 0.6, 0.03, 0.7]
  - kind: prismatic
    a: -0.2
    alpha: 0.7
    d: 0.6
    theta: pi/6
    offset: 0.05
    link: {{inertia: {{parameters: [1, 2, 3, 4, 5, 6, 7, 8, 9, -10]}}}}
  - name: three
    a: 0.1
    alpha: pi
    d: 0
tool: {{name: gripper, translation: [0, 0, 0.1], rpy: [0.1, 0.2, 0.3]}}
coupling: [[1, 0, 0], [0, 1, 0.5], [0, 0, 1]]
note: |
  An arm
  of tests.
"""
#: a, alpha, d, theta of TABLE at q = 0.
ROWS = [(0.3, -math.pi / 2, 0.4, 0.3), (-0.2, 0.7, 0.65, math.pi / 6), (0.1, math.pi, 0.0, 0.0)]
small = st.floats(-2.0, 2.0)


def read(convention: str, text: str = TABLE) -> Robot:
    return read_dh("arm.yaml", text.format(convention=convention).encode())


def turn(axis: str, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    if axis == "x":
        return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def shift(axis: str, length: float) -> Array:
    matrix = np.eye(4)
    matrix["xyz".index(axis), 3] = length
    return matrix


def distal(a: float, alpha: float, d: float, theta: float) -> Array:
    return turn("z", theta) @ shift("z", d) @ shift("x", a) @ turn("x", alpha)


def proximal(a: float, alpha: float, d: float, theta: float) -> Array:
    return turn("x", alpha) @ shift("x", a) @ turn("z", theta) @ shift("z", d)


def homogeneous(rotation: Array, translation: Array) -> Array:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def link_poses(robot: Robot, q: Array) -> list[Array]:
    (turns,), (places,) = batched.link_poses(robot.chain, q[None])
    return [homogeneous(*pose) for pose in zip(turns, places, strict=True)]


def frame_pose(robot: Robot, name: str, q: Array) -> Array:
    frame = robot.frames[name]
    return link_poses(robot, q)[frame.link] @ homogeneous(frame.rotation, frame.translation)


def table_poses(convention: str, q: Array) -> list[Array]:
    """Return the poses of the DH frames of TABLE; the second joint is prismatic."""
    product, found = np.eye(4), []
    for i, (a, alpha, d, theta) in enumerate(ROWS):
        moved = (a, alpha, d + q[i], theta) if i == 1 else (a, alpha, d, theta + q[i])
        product = product @ (distal if convention == "standard" else proximal)(*moved)
        found.append(product)
    return found


@given(a=small, alpha=small, d=small, theta=small)
@settings(max_examples=50, deadline=None)
def test_one_row_of_each_convention(a: float, alpha: float, d: float, theta: float) -> None:
    np.testing.assert_allclose(
        homogeneous(*standard_pose(a, alpha, d, theta)), distal(a, alpha, d, theta), rtol=0.0, atol=1e-14
    )
    np.testing.assert_allclose(
        homogeneous(*modified_pose(a, alpha, d, theta)), proximal(a, alpha, d, theta), atol=1e-14
    )


@given(q=st.tuples(small, small, small))
@settings(max_examples=30, deadline=None)
def test_modified_link_frames_are_the_dh_frames(q: tuple[float, float, float]) -> None:
    robot = read("modified")
    for ours, theirs in zip(link_poses(robot, np.array(q)), table_poses("modified", np.array(q)), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-14)


@given(q=st.tuples(small, small, small))
@settings(max_examples=30, deadline=None)
def test_standard_dh_frames_are_kept_on_their_links(q: tuple[float, float, float]) -> None:
    robot = read("standard")
    names = ("arm_one_dh", "link2_dh", "link3_dh")
    for name, theirs in zip(names, table_poses("standard", np.array(q)), strict=True):
        np.testing.assert_allclose(frame_pose(robot, name, np.array(q)), theirs, rtol=0.0, atol=1e-14)


def test_standard_link_frames_stand_on_their_joint_axes() -> None:
    robot = read("standard")
    still = [np.eye(4), *table_poses("standard", np.zeros(3))[:2]]
    for pose, before, joint in zip(link_poses(robot, np.zeros(3)), still, robot.joints, strict=True):
        np.testing.assert_allclose(pose, before, rtol=0.0, atol=1e-15)
        assert joint.axis.tolist() == [0, 0, 1]


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_tool_stands_in_the_last_dh_frame(convention: str) -> None:
    robot, q = read(convention), np.array([0.3, -0.4, 0.5])
    assert robot.tool == "gripper"
    end = table_poses(convention, q)[-1]
    yaw, pitch, roll = turn("z", 0.3), np.eye(4), turn("x", 0.1)
    pitch[:3, :3] = [[math.cos(0.2), 0, math.sin(0.2)], [0, 1, 0], [-math.sin(0.2), 0, math.cos(0.2)]]
    np.testing.assert_allclose(
        frame_pose(robot, "gripper", q), end @ shift("z", 0.1) @ yaw @ pitch @ roll, rtol=0.0, atol=1e-14
    )


def test_tool_without_one() -> None:
    bare = "\n".join(line for line in TABLE.splitlines() if not line.startswith("tool"))
    assert read("modified", bare).tool == ""
    assert read("standard", bare).tool == "link3_dh"


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_inertia_is_carried_from_the_dh_frame_to_the_link_frame(convention: str) -> None:
    robot = read(convention)
    first, second = robot.links[0].inertia, robot.links[1].inertia
    assert first is not None and second is not None and robot.links[2].inertia is None
    here = [np.eye(4), np.eye(4)] if convention == "modified" else [distal(*ROWS[0]), distal(*ROWS[1])]
    centre = here[0] @ np.array([0.1, -0.2, 0.3, 1.0])
    turned = here[0][:3, :3]
    about = np.array([[0.5, 0.01, -0.02], [0.01, 0.6, 0.03], [-0.02, 0.03, 0.7]])
    np.testing.assert_allclose(first.mass, 2.0, rtol=1e-15)
    np.testing.assert_allclose(first.centre_of_mass, centre[:3], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(first.about_centre, turned @ about @ turned.T, rtol=0.0, atol=1e-14)
    ten = Inertia.from_vector([1, 2, 3, 4, 5, 6, 7, 8, 9, -10]).pseudo
    np.testing.assert_allclose(second.pseudo, here[1] @ ten @ here[1].T, rtol=0.0, atol=1e-12)


def test_every_key_arrives() -> None:
    robot = read("modified")
    first, second, third = robot.joints
    limits = first.limits
    assert robot.name == "arm" and robot.note == "An arm\nof tests." and robot.base == "base"
    assert robot.gravity.tolist() == [0, 1, -9.7]
    assert (limits.lower, limits.upper, limits.velocity) == (-math.pi, 3 * math.pi / 4, 2)
    assert (limits.acceleration, limits.jerk, limits.effort, limits.effort_rate) == (3, 4, 5, 6)
    assert (first.drive.gear_ratio, first.drive.rotor_inertia, first.drive.gain) == (-80, 1e-4, 7)
    assert (first.damping, first.friction) == (0.5, 0.25)
    assert (second.damping, second.friction, second.drive.gain) == (None, None, None)
    assert robot.joint_names == ("one", "joint2", "three")
    assert [joint.kind for joint in robot.joints] == ["revolute", "prismatic", "revolute"]
    assert [link.name for link in robot.links] == ["arm_one", "link2", "link3"]
    assert third.limits.lower == -math.inf
    assert robot.coupling is not None
    assert robot.coupling.tolist() == [[1, 0, 0], [0, 1, 0.5], [0, 0, 1]]


def test_one_arm_in_both_conventions_moves_alike() -> None:
    """The same arm: modified row i has the a and alpha of standard row i - 1."""
    row = "  - {{a: {a}, alpha: {alpha}, d: {d}, theta: {theta}}}\n"
    head = "name: arm\nconvention: {convention}\njoints:\n"
    a, alpha = [0.4, 0.3, 0.0], [1.1, -0.6, 0.4]
    d, theta = [0.2, -0.1, 0.5], [0.3, -0.2, 0.1]
    standard = head.format(convention="standard") + "".join(
        row.format(a=a[i], alpha=alpha[i], d=d[i], theta=theta[i]) for i in range(3)
    )
    modified = head.format(convention="modified") + "".join(
        row.format(a=([0.0, *a])[i], alpha=([0.0, *alpha])[i], d=d[i], theta=theta[i]) for i in range(3)
    )
    one, other = (
        read_dh("arm.yaml", text.replace("{{", "{").replace("}}", "}").encode()) for text in (standard, modified)
    )
    q = np.array([0.7, -0.9, 1.2])
    end = frame_pose(one, "link3_dh", q)
    np.testing.assert_allclose(
        end, link_poses(other, q)[-1] @ shift("x", a[2]) @ turn("x", alpha[2]), rtol=0.0, atol=1e-14
    )


EXPRESSIONS: Mapping[str, float] = {
    "1": 1.0,
    "-1.5e-3": -1.5e-3,
    "1e-3": 1e-3,
    "+.5": 0.5,
    "5.": 5.0,
    "010": 10.0,
    "pi": math.pi,
    "-pi": -math.pi,
    "pi/2": math.pi / 2,
    "-pi / 2": -math.pi / 2,
    "2*pi": 2 * math.pi,
    "3*pi/4": 3 * math.pi / 4,
    "90*pi/180": 90 * math.pi / 180,
    "1/-4": -0.25,
}


@pytest.mark.parametrize("text", EXPRESSIONS)
def test_expression(text: str) -> None:
    assert expression(Place("arm.yaml"), text) == EXPRESSIONS[text]


@given(st.floats(-1e49, 1e49))
@settings(max_examples=100, deadline=None)
def test_written_numbers_are_read_exactly(value: float) -> None:
    assert expression(Place("arm.yaml"), repr(value)) == value


def test_yaml_guesses_no_types() -> None:
    text = "name: no\nconvention: standard\njoints:\n- {a: 010, alpha: 0, d: 0, limits: {upper: .inf, lower: null}}\n"
    robot = read_dh("arm.yaml", text.encode())
    assert robot.name == "no"
    assert robot.frames["link1_dh"].translation.tolist() == [10, 0, 0]
    assert (robot.joints[0].limits.lower, robot.joints[0].limits.upper) == (-math.inf, math.inf)
