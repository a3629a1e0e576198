"""Covering capsules contain their shapes, whatever these are, and are not much larger."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.excitation.collision.covering import MAX_STRIPS, covering_capsules, fitted_capsule, snug
from dynident.model.joint import rotation_about
from dynident.model.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere

length = st.floats(0.005, 2.0)
place = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)
seeds = st.integers(0, 2**32 - 1)


@st.composite
def poses(draw: st.DrawFn) -> tuple[Array, Array]:
    axis = np.array([1.0, 0.3, -0.2]) + 0.5 * draw(place)
    return rotation_about(axis / np.linalg.norm(axis), draw(st.floats(-4, 4))), draw(place)


def inside(shape: Box | Cylinder, random: np.random.Generator) -> Array:
    """Return points in and on a shape, its rims and corners among them."""
    cube = np.vstack([random.uniform(-1, 1, (200, 3)), Box(np.full(3, 2.0)).corners])
    if isinstance(shape, Box):
        local = 0.5 * cube * shape.size
    else:
        angle = np.pi * cube[:, 0]
        flat = shape.radius * np.where(np.arange(len(cube)) % 2, 1.0, np.sqrt(np.abs(cube[:, 1])))
        height = 0.5 * shape.length * np.where(np.arange(len(cube)) % 3, cube[:, 2], np.sign(cube[:, 2]))
        local = np.stack([flat * np.cos(angle), flat * np.sin(angle), height], axis=1)
    return local @ shape.rotation.T + shape.translation


def beyond(points: Array, capsules: tuple[Capsule, ...]) -> float:
    """Return how far the worst point is outside of the union."""
    return float(np.min([capsule.distances(points) for capsule in capsules], axis=0).max())


@given(length, length, length, poses(), seeds)
@settings(max_examples=80)
def test_a_box_is_covered(a: float, b: float, c: float, pose: tuple[Array, Array], seed: int) -> None:
    box = Box(np.array([a, b, c]), *pose)
    capsules = covering_capsules(box)
    assert 1 <= len(capsules) <= MAX_STRIPS
    assert beyond(inside(box, np.random.default_rng(seed)), capsules) <= 1e-12


@given(length, length, poses(), seeds)
@settings(max_examples=80)
def test_a_cylinder_is_covered(radius: float, height: float, pose: tuple[Array, Array], seed: int) -> None:
    cylinder = Cylinder(radius, height, *pose)
    assert beyond(inside(cylinder, np.random.default_rng(seed)), covering_capsules(cylinder)) <= 1e-12


@given(st.integers(1, 60), poses(), place, seeds)
@settings(max_examples=40)
def test_points_are_covered(count: int, pose: tuple[Array, Array], stretch: Array, seed: int) -> None:
    """Also few, flat and equal ones."""
    points = np.random.default_rng(seed).normal(size=(count, 3)) * np.where(np.abs(stretch) < 0.2, 0.0, stretch)
    cloud = points @ pose[0].T + pose[1]
    assert beyond(cloud, (fitted_capsule(cloud),)) <= 0.0


def test_shapes_that_are_their_own_cover() -> None:
    capsule = Capsule(np.zeros(3), np.ones(3), 0.1)
    assert covering_capsules(capsule) == (capsule,)
    (ball,) = covering_capsules(Sphere(0.2, np.ones(3)))
    assert (ball.start.tolist(), ball.end.tolist(), ball.radius) == ([1, 1, 1], [1, 1, 1], 0.2)


def test_a_long_cylinder_keeps_its_radius_and_a_flat_one_becomes_a_ball() -> None:
    half, radius = snug(1.0, 0.05)
    assert radius < 1.02 * 0.05 and 0.98 < half <= 1.0
    half, radius = snug(0.001, 0.1)
    assert half == 0.0 and radius == pytest.approx(np.hypot(0.001, 0.1))


def test_a_flat_box_gets_capsules_side_by_side() -> None:
    sheet, beam = Box(np.array([0.5, 0.3, 0.1])), Box(np.array([0.1, 0.1, 0.5]))
    capsules = covering_capsules(sheet)
    assert len(capsules) == 3 and len(covering_capsules(beam)) == 1
    assert sum(capsule.volume for capsule in capsules) < 2.6 * 0.015
    assert max(capsule.radius for capsule in capsules) < 0.5 * 0.15  # one alone would need 0.158


@pytest.mark.parametrize("seed", range(4))
def test_the_points_of_a_capsule_give_it_back(seed: int) -> None:
    random = np.random.default_rng(seed)
    true = Capsule(random.uniform(-1, 1, 3), random.uniform(-1, 1, 3), 0.12)
    rays = random.normal(size=(4000, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    cloud = true.start + random.integers(0, 2, (4000, 1)) * (true.end - true.start) + true.radius * rays
    found = fitted_capsule(cloud)
    assert beyond(cloud, (found,)) <= 0.0
    assert found.volume < 1.03 * true.volume


def test_a_skewed_cloud_is_covered_more_tightly_than_by_its_principal_axes_alone() -> None:
    """The corners of a box with a heavy end: principal axes are pulled to the crowd, the fit is not."""
    random = np.random.default_rng(0)
    box = Box(np.array([0.6, 0.1, 0.1]))
    crowd = np.array([0.3, 0.05, 0.05]) - 0.04 * random.uniform(size=(3000, 3))
    cloud = np.vstack([box.corners, crowd])
    assert fitted_capsule(cloud).volume < 1.1 * covering_capsules(box)[0].volume


def test_a_mesh_needs_its_points_and_is_placed() -> None:
    mesh = Mesh("a.stl", rotation=rotation_about(np.array([0.0, 0.0, 1.0]), np.pi / 2), translation=np.ones(3))
    points = Box(np.array([0.4, 0.1, 0.1])).corners
    (capsule,) = covering_capsules(mesh, lambda asked: points if asked is mesh else points[:0])
    assert beyond(points @ mesh.rotation.T + 1.0, (capsule,)) <= 1e-12
    assert abs(capsule.end - capsule.start)[1] == pytest.approx(capsule.length, rel=0.01)
    with pytest.raises(BadOption, match=r"mesh = 'a.stl' is not possible; state the folder of"):
        covering_capsules(mesh)


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.zeros((3, 2)), np.full((4, 3), np.nan)])
def test_points_that_are_none(points: Array) -> None:
    with pytest.raises(ValueError, match=r"expected \(k, 3\) with finite values"):
        fitted_capsule(points)


def test_every_kind_of_shape_has_a_cover() -> None:
    shapes: list[Shape] = [Sphere(0.1), Capsule(np.zeros(3), np.ones(3), 0.1), Box(np.ones(3)), Cylinder(0.1, 0.3)]
    assert all(covering_capsules(shape) for shape in shapes)
