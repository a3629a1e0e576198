"""Bounds of plausible bodies: the ellipsoid against closed forms, and what follows from a robot model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynident import read_robot
from dynident.model.body_constraints import BodyConstraints, Constraints, ValueRange
from dynident.model.inertia import Inertia
from dynident.model.plausible import bounding_ellipsoid, link_points, nominal_misfits, plausible_constraints
from dynident.model.shapes import Box


def test_the_least_ellipsoid_about_a_box() -> None:
    found = bounding_ellipsoid(Box(np.array([0.2, 0.4, 0.6]), translation=np.array([1.0, 2.0, 3.0])).corners)
    np.testing.assert_allclose(found.centre, [1, 2, 3], atol=1e-9)
    np.testing.assert_allclose(np.sort(found.semi_axes), np.sqrt(3) * np.array([0.1, 0.2, 0.3]), rtol=1e-9)


def test_bounds_of_a_robot_hold_its_points_and_its_nominal_bodies() -> None:
    robot = read_robot("generic-6r")
    known = plausible_constraints(robot)
    for i, link in enumerate(robot.links):
        body = known.links[link.name]
        assert body.body_ellipsoid is not None and link.inertia is not None
        quadric = body.body_ellipsoid.quadric
        lifted = np.column_stack([link_points(robot, i), np.ones(len(link_points(robot, i)))])
        assert np.min(np.einsum("ki,ij,kj->k", lifted, quadric, lifted)) > -1e-9
        assert np.sum(quadric * link.inertia.pseudo) > 0
        thin = link.inertia.pseudo - body.thickness**2 * link.inertia.mass * np.diag([1.0, 1, 1, 0])
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
    assert body.thickness == pytest.approx(0.05 * 3 * np.sqrt(3))


def test_a_nominal_inertia_beyond_the_size_of_its_link_is_named() -> None:
    robot = read_robot("generic-6r")
    before, body = nominal_misfits(robot), robot.links[1].inertia
    assert robot.links[1].name not in before and body is not None
    pseudo = np.array(body.pseudo)
    centre = body.centre_of_mass
    covariance = pseudo[:3, :3] / body.mass - np.outer(centre, centre)
    values, axes = np.linalg.eigh(covariance)
    plate = axes @ np.diag([1e-6 * values[0], *values[1:]]) @ axes.T
    for wrong in (36.0 * covariance, plate):  # six times the size; no thickness
        pseudo[:3, :3] = body.mass * (wrong + np.outer(centre, centre))
        links = [
            replace(link, inertia=Inertia.from_pseudo(pseudo)) if k == 1 else link for k, link in enumerate(robot.links)
        ]
        found = nominal_misfits(replace(robot, links=tuple(links)))
        assert set(found) == {*before, robot.links[1].name}
