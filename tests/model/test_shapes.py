"""Shapes as values: what they refuse, how they move, and the closed forms of a capsule."""

from __future__ import annotations

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.model.joint import rotation_about
from dynident.model.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere

X, Y, Z = np.eye(3)
TURN, SHIFT = rotation_about(np.array([2.0, -1.0, 2.0]) / 3.0, 0.8), np.array([0.1, -0.2, 0.3])
SHAPES: tuple[Shape, ...] = (
    Sphere(0.1, X),
    Capsule(X, Y, 0.2),
    Box(np.array([0.1, 0.2, 0.3]), TURN, Y),
    Cylinder(0.1, 0.4, TURN, Z),
    Mesh("a.stl", np.array([0.001, 0.001, -0.001]), TURN, X, points=np.array([X, Y])),
)


def numbers(shape: Shape) -> Array:
    return np.concatenate([np.ravel(value) for value in vars(shape).values() if not isinstance(value, str)])


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_there_and_back_is_the_same_shape(shape: Shape) -> None:
    moved = shape.moved(TURN, SHIFT)
    assert type(moved) is type(shape)
    assert np.abs(numbers(moved) - numbers(shape)).max() > 0.05
    assert numbers(moved.moved(TURN.T, -TURN.T @ SHIFT)) == pytest.approx(numbers(shape), abs=1e-14)


def test_the_pose_of_a_shape_moves_with_its_frame() -> None:
    assert Sphere(0.1, X).moved(TURN, SHIFT).centre == pytest.approx(TURN @ X + SHIFT)
    assert Capsule(X, Y, 0.1).moved(TURN, SHIFT).end == pytest.approx(TURN @ Y + SHIFT)
    box = Box(np.array([0.1, 0.2, 0.3]), rotation_about(Z, 0.3), Y)
    assert box.moved(TURN, SHIFT).corners == pytest.approx(box.corners @ TURN.T + SHIFT)


def test_the_corners_of_a_box_between_two_of_them() -> None:
    corners = Box.between([0.0, -1.0, 2.0], [1.0, 1.0, 5.0]).corners
    assert {tuple(row) for row in corners} == {(x, y, z) for x in (0.0, 1.0) for y in (-1.0, 1.0) for z in (2.0, 5.0)}


def test_distances_and_volume_of_a_capsule() -> None:
    capsule = Capsule(np.zeros(3), 2 * X, 0.5)
    points = [[1, 2, 0], [3, 0, 0], [-1, 0, 0], [1, 0, 0], [3, 0, 1]]
    assert capsule.distances(points) == pytest.approx([1.5, 0.5, 0.5, -0.5, np.sqrt(2) - 0.5])
    assert capsule.volume == pytest.approx(np.pi * 0.25 * 2 + 4 / 3 * np.pi * 0.125)
    assert Capsule(X, X, 1.0).distances([[1, 0, 3]]) == pytest.approx([2.0])


@pytest.mark.parametrize("bad", [0.0, -0.1, np.nan, np.inf])
def test_sizes_are_above_zero(bad: float) -> None:
    for make in (
        lambda: Sphere(bad),
        lambda: Cylinder(bad, 1.0),
        lambda: Cylinder(1.0, bad),
        lambda: Box(np.array([1.0, bad, 1.0])),
    ):
        with pytest.raises(ValueError, match=r"the (radius|length|size) of a"):
            make()


def test_other_values_that_no_shape_has() -> None:
    assert Capsule(X, Y, 0.0).radius == 0.0  # a bare segment
    with pytest.raises(ValueError, match="the radius of a capsule is -1"):
        Capsule(X, Y, -1.0)
    with pytest.raises(ValueError, match="the scale of a mesh"):
        Mesh("a.stl", np.array([1.0, 0.0, 1.0]))
    with pytest.raises(ValueError, match="rotation has shape"):
        Box(np.ones(3), np.eye(2))


def test_arrays_are_read_only_copies() -> None:
    size = np.ones(3)
    box = Box(size)
    size[0] = 9.0
    assert box.size.tolist() == [1.0, 1.0, 1.0]
    with pytest.raises(ValueError, match="read-only"):
        box.size[0] = 2.0  # type: ignore[index]
