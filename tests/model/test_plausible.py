"""Bounds of plausible bodies: the ellipsoid against closed forms, and what follows from a robot model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynident import read_robot
from dynident.model.body_constraints import DIRECTIONS, NEAREST, BodyConstraints, Constraints, Ellipsoid, ValueRange
from dynident.model.documents.robot_data import robot_from_dict, robot_to_dict
from dynident.model.inertia import Inertia
from dynident.model.joint import rotation_about
from dynident.model.plausible import (
    LEAST_DENSITY,
    REACH,
    bounding_ellipsoids,
    link_points,
    outgrown,
    plausible_constraints,
    shape_points,
    uniform_body,
    wider_bounds,
)
from dynident.model.robot import Robot
from dynident.model.shapes import Box, Mesh, Sphere


def test_a_thin_plate_far_from_its_frame_has_an_ellipsoid() -> None:
    """Of which rounding had made lengths that are no numbers."""
    generator = np.random.default_rng(0)
    for thickness in 10.0 ** np.arange(-9.0, -6.0):
        plate = 3.0 + generator.uniform(-0.1, 0.1, (200, 3)) * [1.0, 1.0, thickness]
        (found,) = bounding_ellipsoids([plate])
        lengths = ((plate - found.centre) @ np.asarray(found.rotation)) / found.semi_axes
        assert np.all(np.linalg.norm(lengths, axis=1) < 1.01) and np.all(found.semi_axes > 0.0)


def test_the_least_ellipsoid_about_a_box() -> None:
    (found,) = bounding_ellipsoids([Box(np.array([0.2, 0.4, 0.6]), translation=np.array([1.0, 2.0, 3.0])).corners])
    np.testing.assert_allclose(found.centre, [1, 2, 3], atol=1e-9)
    np.testing.assert_allclose(np.sort(found.semi_axes), np.sqrt(3) * np.array([0.1, 0.2, 0.3]), rtol=1e-9)


def test_no_body_between_the_slabs_reaches_further_at_equal_density() -> None:
    """Random second moments, as large as the 13 directions allow, against the extent in 500 others."""
    generator = np.random.default_rng(3)
    space = Ellipsoid(
        np.array([0.1, 0.2, -0.1]), np.array([0.1, 0.2, 0.5]), rotation_about(np.array([0.6, 0.0, 0.8]), 0.7)
    )
    others = generator.normal(size=(500, 3))
    others /= np.linalg.norm(others, axis=1, keepdims=True)
    largest = 0.0
    for _ in range(200):
        spread, centre = generator.normal(size=(3, int(generator.integers(1, 4)))), generator.normal(size=3)
        second = spread @ spread.T + np.outer(centre, centre) * generator.uniform(0, 8)
        held = np.einsum("ki,ij,kj->k", DIRECTIONS, second, DIRECTIONS).max() / (NEAREST * 1.5**2 / 6)
        second, centre = second / held, 0.7 * centre / np.sqrt(held)  # what the slabs hold, and a centre that it allows
        if np.linalg.eigvalsh(second - np.outer(centre, centre))[0] < 0:
            continue
        scaling = space.rotation * space.semi_axes
        pseudo = np.eye(4)
        pseudo[:3, 3] = pseudo[3, :3] = scaling @ centre + space.centre
        pseudo[:3, :3] = scaling @ (second - np.outer(centre, centre)) @ scaling.T + np.outer(
            pseudo[3, :3], pseudo[3, :3]
        )
        assert np.min(np.einsum("kij,ij->k", space.slabs(1.5), pseudo)) == pytest.approx(0.0, abs=1e-12)
        spreads = np.einsum("ki,ij,kj->k", others, second, others) - (others @ centre) ** 2
        largest = max(largest, np.max(np.abs(others @ centre) + np.sqrt(5 * np.maximum(spreads, 0.0))))
    assert 1.2 < largest <= 1.5


def test_bounds_that_a_nominal_body_breaks_are_widened_to_hold_it_with_room() -> None:
    """A rod 20 mm thin in a box, a ball too large for it, and one that fits; what is stated stays.

    The ball makes the size of its link larger at once; the rod is thinner than links of its box are.
    """
    robot, box = read_robot("generic-6r"), Box(np.full(3, 0.3))
    spreads = ([1e-4, 0.01, 0.01], [0.05, 0.05, 0.05], [0.006, 0.006, 0.006])
    bodies = [Inertia.from_pseudo(200.0 * np.diag([*spread, 1.0])) for spread in spreads]  # as dense as links are
    links = [
        replace(link, inertia=body, shapes=(box,)) for link, body in zip(robot.links, [*bodies, *bodies], strict=True)
    ]
    robot = replace(robot, links=tuple(links))
    names = [link.name for link in links]
    stated = Constraints({name: BodyConstraints(thickness=0.01) for name in names[3:]})
    bounds = plausible_constraints(robot, stated)
    found = wider_bounds(robot, bounds, stated)
    assert list(found) == [names[0]] and 0.5 * 0.01 < found[names[0]].thickness < 0.01
    assert bounds.links[names[1]].thickness == bounds.links[names[2]].thickness
    assert [outgrown(link) is not None for link in links] == [False, True, False] * 2
    for k in (1, 4):
        space = bounds.links[names[k]].body_ellipsoid
        assert space is not None
        rules = np.concatenate([space.quadric[None], space.slabs(bounds.links[names[k]].reach)])
        assert np.all(np.einsum("kij,ij->k", rules, bodies[1].pseudo) > 0.0)
    boxed = bounds.links[names[2]].body_ellipsoid
    assert boxed is not None
    np.testing.assert_allclose(boxed.semi_axes, np.sqrt(3) * 0.15, rtol=1e-9)
    given = Constraints({names[1]: BodyConstraints(body_ellipsoid=boxed)})
    assert plausible_constraints(robot, given).links[names[1]].body_ellipsoid is boxed
    point = Inertia(2.0, np.zeros(3), np.zeros((3, 3)))  # no body of positive density, but what the file states
    alone = replace(robot, links=(replace(links[0], inertia=point), *links[1:]))
    assert wider_bounds(alone, plausible_constraints(alone), Constraints())[names[0]].thickness == 0.0


def test_what_shows_a_link_bounds_it_beside_what_touches() -> None:
    robot = read_robot("generic-6r")
    ball, box = Sphere(0.03), Box(np.array([0.3, 0.2, 0.4]), translation=np.array([0.0, 0.0, 0.2]))
    link = replace(robot.links[0], shapes=(ball,), visuals=(box,))
    both, alone = len(shape_points(link)), len(shape_points(replace(link, visuals=())))
    assert both == alone + 8 == alone + len(shape_points(replace(link, shapes=())))
    unread = Mesh("look.dae")
    assert len(shape_points(replace(link, visuals=(box, unread)))) == both
    assert not len(shape_points(replace(link, shapes=(), visuals=(unread,))))
    assert not len(shape_points(replace(link, shapes=(unread,))))
    kept = robot_from_dict(robot_to_dict(replace(robot, links=(link, *robot.links[1:])))).links[0]
    np.testing.assert_array_equal(shape_points(kept), shape_points(link))


def test_a_small_body_far_from_its_shapes_is_within_the_size() -> None:
    """A ball of 20 mm half a metre away from a ball of 30 mm; one of an impossible inertia is not."""
    link = replace(read_robot("generic-6r").links[0], shapes=(Sphere(0.03),))
    far = Inertia.from_centre_of_mass(1.0, np.array([0.5, 0.0, 0.0]), 0.4 * 0.02**2 * np.eye(3))
    size = outgrown(replace(link, inertia=far))
    assert size is not None and np.all(np.einsum("kij,ij->k", size.slabs(REACH), far.pseudo) > 0.0)
    assert np.sum(size.quadric * far.pseudo) > 0.0
    flat = Inertia.from_centre_of_mass(1.0, np.array([0.5, 0.0, 0.0]), np.diag([0.1, 0.1, 0.3]))
    assert outgrown(replace(link, inertia=flat)) is None and outgrown(replace(link, inertia=None)) is None


def test_the_size_of_a_link_without_shapes() -> None:
    """A volume for its nominal mass, and the offset along its joint's own axis."""
    robot = read_robot("generic-6r")
    joint = replace(robot.joints[0], translation=np.array([0.0, 0.0, 0.4]))
    inertia = Inertia.from_centre_of_mass(300.0, np.zeros(3), 5.0 * np.eye(3))
    links = (replace(robot.links[0], inertia=inertia), *robot.links[1:])
    points = link_points(replace(robot, joints=(joint, *robot.joints[1:]), links=links), 0)
    assert points[:, 2].min() < -0.4
    radius = -0.4 - points[:, 2].min()
    length = max(0.4, np.linalg.norm(robot.joints[1].translation))
    assert np.pi * radius**2 * (length + 4 / 3 * radius) == pytest.approx(300.0 / LEAST_DENSITY)


def _held_by_its_bounds(robot: Robot, body: Inertia) -> bool:
    """Return whether the first link may have a body, and that of the robot model is this one."""
    robot = replace(robot, links=(replace(robot.links[0], inertia=body), *robot.links[1:]))
    known = plausible_constraints(robot).links[robot.links[0].name]
    assert known.body_ellipsoid is not None
    quadrics = [known.body_ellipsoid.quadric, *known.body_ellipsoid.slabs(known.reach)]
    thin = body.pseudo - known.thickness**2 * body.mass * np.diag([1.0, 1, 1, 0])
    return min(float(np.sum(q * body.pseudo)) for q in quadrics) > 0 and np.linalg.eigvalsh(thin)[0] > 0


def test_a_nominal_body_that_can_be_a_link_is_within_its_own_bounds() -> None:
    """Uniform ellipsoids far from the frames: as dense as links are, and as thick as their length asks for."""
    robot = read_robot("generic-6r")
    for semi_axes, density, can_be in (
        (np.array([0.3, 0.2, 0.25]), 300.0, True),
        (np.array([0.1, 0.6, 0.1]), 700.0, True),
        (np.array([0.9, 0.8, 0.9]), 10.0, False),
        (np.array([0.002, 0.5, 0.4]), 5000.0, False),
    ):
        mass = density * 4 / 3 * np.pi * np.prod(semi_axes)
        about = mass / 5 * np.diag(np.sum(semi_axes**2) - semi_axes**2)
        body = Inertia.from_centre_of_mass(float(mass), np.array([0.0, 0.4, 0.1]), about)
        assert _held_by_its_bounds(robot, body) == can_be


def test_bounds_of_a_robot_hold_its_points_and_bodies_as_large() -> None:
    robot = read_robot("generic-6r")
    known = plausible_constraints(robot)
    for i, link in enumerate(robot.links):
        body = known.links[link.name]
        assert body.body_ellipsoid is not None and link.inertia is not None
        quadric = body.body_ellipsoid.quadric
        lifted = np.column_stack([link_points(robot, i), np.ones(len(link_points(robot, i)))])
        assert np.min(np.einsum("ki,ij,kj->k", lifted, quadric, lifted)) > -1e-9
        uniform = uniform_body(body)
        assert np.sum(quadric * uniform.pseudo) > 0
        assert np.min(np.einsum("kij,ij->k", body.body_ellipsoid.slabs(body.reach), uniform.pseudo)) > 0
        thin = uniform.pseudo - body.thickness**2 * uniform.mass * np.diag([1.0, 1, 1, 0])
        assert body.thickness > 0 and np.linalg.eigvalsh(thin)[0] > 0
        assert body.mass == ValueRange(link.inertia.mass / 3, link.inertia.mass * 3)


def test_shapes_and_stated_bounds_stand_in_place_of_the_derived_ones() -> None:
    robot = read_robot("generic-6r")
    first = replace(robot.links[0], shapes=(Box(np.array([1.0, 2.0, 3.0])),), inertia=None)
    robot = replace(robot, links=(first, *robot.links[1:]))
    stated = Constraints({first.name: BodyConstraints(mass=ValueRange(1.0, 2.0))}, ValueRange(high=90.0))
    body = plausible_constraints(robot, stated).links[first.name]
    assert body.mass == ValueRange(1.0, 2.0) and plausible_constraints(robot, stated).total_mass == ValueRange(
        high=90.0
    )
    assert body.body_ellipsoid is not None
    np.testing.assert_allclose(np.sort(body.body_ellipsoid.semi_axes), np.sqrt(3) / 2 * np.array([1, 2, 3]), rtol=1e-9)
    assert body.thickness == pytest.approx(0.05 * np.sqrt(14) / np.sqrt(2))
    flat = replace(first, shapes=(Box(np.array([0.01, 1.0, 1.0])),))
    thin = plausible_constraints(replace(robot, links=(flat, *robot.links[1:]))).links[first.name]
    assert 0.0 < thin.thickness < 0.01 * np.sqrt(3) / 2 / np.sqrt(5)
