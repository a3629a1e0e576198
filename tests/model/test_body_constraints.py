"""Constraints on bodies: hulls against a linear program, quadrics against point masses, values that cannot be."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy.optimize

from dynident.arrays import Array
from dynident.errors import BadOption, UnknownChoice
from dynident.model.body_constraints import (
    BodyConstraints,
    BoundingBox,
    Constraints,
    Ellipsoid,
    ValueRange,
    box_quadrics,
    halfspaces,
)
from dynident.model.joint import rotation_about
from dynident.model.robot import Robot


def in_hull(points: Array, place: Array) -> bool:
    """Say by a linear program whether a place is a convex combination of points."""
    rows = np.vstack([points.T, np.ones(len(points))])
    found = scipy.optimize.linprog(np.zeros(len(points)), A_eq=rows, b_eq=np.append(place, 1.0))
    return found.status == 0


@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_half_spaces_are_the_hull(rank: int) -> None:
    generator = np.random.default_rng(rank)
    points = generator.normal(size=(8, rank)) @ generator.normal(size=(rank, 3)) + [0.3, -0.2, 0.1]
    normals, limits, equations, values = halfspaces(points)
    assert len(equations) == 3 - rank
    np.testing.assert_allclose(np.linalg.norm(np.vstack([normals, equations]), axis=1), 1.0)
    for _ in range(40):
        mixed = generator.dirichlet(np.full(8, 0.3)) @ points
        place = points.mean(axis=0) + generator.uniform(0.5, 2.5) * (mixed - points.mean(axis=0))
        inside = bool(np.all(normals @ place <= limits + 1e-9) and np.allclose(equations @ place, values))
        assert inside == in_hull(points, place) or rank == 0


def pseudo_of(points: Array, masses: Array) -> Array:
    return np.einsum("k,ki,kj->ij", masses, np.c_[points, np.ones(len(points))], np.c_[points, np.ones(len(points))])


def test_a_density_in_an_ellipsoid_or_a_box_has_non_negative_traces() -> None:
    generator = np.random.default_rng(0)
    turn = rotation_about(np.array([0.6, 0.0, 0.8]), 0.7)
    shape = Ellipsoid(np.array([0.1, 0.2, -0.1]), np.array([0.3, 0.2, 0.1]), turn)
    directions = generator.normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    surface = shape.centre + directions * shape.semi_axes @ turn.T
    quadric = shape.quadric
    values = np.einsum("ki,ij,kj->k", np.c_[surface, np.ones(50)], quadric, np.c_[surface, np.ones(50)])
    np.testing.assert_allclose(values, 0.0, atol=1e-12)  # zero on the surface
    inner = shape.centre + generator.uniform(0, 1, (50, 1)) * (surface - shape.centre)
    assert np.trace(pseudo_of(inner, generator.uniform(0, 1, 50)) @ quadric) > 0
    box = BoundingBox(np.array([-0.1, 0.0, 0.2]), np.array([0.3, 0.1, 0.5]))
    filled = generator.uniform(box.lower, box.upper, (50, 3))
    assert all(np.trace(pseudo_of(filled, np.ones(50)) @ q) > 0 for q in box_quadrics(box))
    ends = np.array([box.lower, box.upper])  # all matter on the two ends of every axis: the limit
    np.testing.assert_allclose([np.trace(pseudo_of(ends, np.ones(2)) @ q) for q in box_quadrics(box)], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    "make",
    [
        lambda: ValueRange(2.0, 1.0),
        lambda: ValueRange(np.nan, 1.0),
        lambda: BoundingBox(np.zeros(3), np.array([1.0, -1.0, 1.0])),
        lambda: Ellipsoid(np.zeros(3), np.array([1.0, 0.0, 1.0])),
        lambda: BodyConstraints(mass=ValueRange(-2.0, -1.0)),
        lambda: BodyConstraints(centre_hull=np.zeros((0, 3))),
    ],
)
def test_values_that_cannot_be(make: Callable[[], object]) -> None:
    with pytest.raises(BadOption):
        make()


def test_names_that_are_not_there(planar_2r: Robot) -> None:
    with pytest.raises(UnknownChoice, match=r"no moving link called 'link3'.*did you mean"):
        Constraints(links={"link3": BodyConstraints()}).check(planar_2r)
    with pytest.raises(UnknownChoice, match="no axis called 'w'"):
        BodyConstraints(symmetry={"w": 0.0})
    assert Constraints().is_empty and not Constraints(total_mass=ValueRange(1.0)).is_empty
