"""Bounds of plausible bodies from the robot model: ellipsoids about each link, minimum thickness, mass, total mass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.model.body_constraints import BodyConstraints, Constraints, Ellipsoid, ValueRange
from dynident.model.inertia import Inertia
from dynident.model.robot import Robot
from dynident.model.shapes import Box, Capsule, Cylinder, Shape, Sphere

#: Radius of a link without shapes as a share of the length to its children, and the least radius, in m.
RADIUS_SHARE, LEAST_RADIUS = 0.15, 0.04

#: Minimum thickness as a share of the extent of the link.
THICKNESS_SHARE = 0.05

#: Bounds of a mass and of the total mass as factors about the nominal value.
MASS_FACTOR, TOTAL_FACTOR = 3.0, 1.5

_DIRECTIONS = np.array([[i, j, k] for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if i or j or k], float)
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)


def plausible_constraints(robot: Robot, stated: Constraints | None = None) -> Constraints:
    """Return bounds of plausible bodies; what ``stated`` says about a link or the total stands in their place.

    The ellipsoid holds the link's collision shapes; without shapes, or with meshes among them, balls about the frame of
    the link, those of its children, the named frames on it and the nominal centre of mass. An ellipsoid that the
    nominal inertia itself does not fit is scaled until it does, and a thickness above the nominal one is lowered to it.
    """
    known = stated or Constraints()
    masses = [link.inertia.mass if link.inertia is not None else 0.0 for link in robot.links]
    bodies: dict[str, BodyConstraints] = {}
    for i, link in enumerate(robot.links):
        body = known.links.get(link.name, BodyConstraints())
        points = link_points(robot, i)
        ellipsoid = bounding_ellipsoid(points)
        thickness = THICKNESS_SHARE * 2.0 * float(np.max(ellipsoid.semi_axes))
        if link.inertia is not None and link.inertia.is_consistent():
            pseudo = link.inertia.pseudo
            centre = pseudo[:3, 3] / masses[i]
            covariance = pseudo[:3, :3] / masses[i] - np.outer(centre, centre)
            thickness = min(thickness, 0.9 * float(np.sqrt(np.linalg.eigvalsh(covariance)[0])))
            used = 1.0 - float(np.sum(ellipsoid.quadric * pseudo)) / masses[i]  # E |A^-1 R' (x - centre)|^2, 1 at most
            ellipsoid = replace(ellipsoid, semi_axes=ellipsoid.semi_axes * np.sqrt(max(1.0, 1.1 * used)))
        if body.body_ellipsoid is None and body.body_box is None:
            body = replace(body, body_ellipsoid=ellipsoid)
        if body.mass == ValueRange() and masses[i] > 0:
            body = replace(body, mass=ValueRange(masses[i] / MASS_FACTOR, masses[i] * MASS_FACTOR))
        bodies[link.name] = replace(body, thickness=body.thickness or thickness)
    total = known.total_mass
    if total == ValueRange() and all(mass > 0 for mass in masses):
        total = ValueRange(sum(masses) / TOTAL_FACTOR, sum(masses) * TOTAL_FACTOR)
    return Constraints(bodies, total, known.fixed)


def link_points(robot: Robot, index: int) -> Array:
    """Return points whose convex hull is about the space of a link, shape (k, 3), in m, in the link frame."""
    link = robot.links[index]
    parts = [_shape_points(shape) for shape in link.shapes]
    if parts and all(len(part) for part in parts):
        return np.concatenate(parts)
    children = [joint.translation for joint in robot.joints if joint.parent == index]
    children += [frame.translation for frame in robot.frames.values() if frame.link == index]
    length = max((float(np.linalg.norm(child)) for child in children), default=0.0)
    places = [np.zeros(3), *children]
    if link.inertia is not None and link.inertia.mass > 0:
        places.append(link.inertia.first_moment / link.inertia.mass)
    return _balls(np.array(places), max(RADIUS_SHARE * length, LEAST_RADIUS))


def _balls(centres: Array, radius: float) -> Array:
    return (np.atleast_2d(centres)[:, None, :] + radius * _DIRECTIONS).reshape(-1, 3)


def _shape_points(shape: Shape) -> Array:
    """Return points of a shape's surface, shape (k, 3); none of a mesh, whose file is not read."""
    if isinstance(shape, Sphere):
        return _balls(shape.centre, shape.radius)
    if isinstance(shape, Capsule):
        return _balls(np.array([shape.start, shape.end]), shape.radius)
    if isinstance(shape, Box):
        return shape.corners
    if isinstance(shape, Cylinder):
        box = np.array([2 * shape.radius, 2 * shape.radius, shape.length])
        return (0.5 * _DIRECTIONS[np.all(_DIRECTIONS != 0, axis=1)] * np.sqrt(3) * box) @ shape.rotation.T + (
            shape.translation
        )
    return np.zeros((0, 3))


def bounding_ellipsoid(points: Array, steps: int = 200) -> Ellipsoid:
    """Return an ellipsoid of nearly the least volume that holds points (k, 3), which are not in a plane.

    Khachiyan's algorithm (Todd and Yildirim 2007, algorithm 3.1); the result is scaled so that it holds every point.
    """
    lifted = np.column_stack([points, np.ones(len(points))])
    weights = np.full(len(points), 1.0 / len(points))
    inverse = np.linalg.inv((lifted.T * weights) @ lifted)
    spread = np.einsum("ki,ij,kj->k", lifted, inverse, lifted)
    for _ in range(steps):
        far = int(np.argmax(spread))
        step = (spread[far] - 4.0) / (4.0 * (spread[far] - 1.0))
        turned = inverse @ lifted[far]
        update = step / (1.0 - step + step * spread[far])  # of the inverse by rank one (Sherman and Morrison 1950)
        inverse = (inverse - update * np.outer(turned, turned)) / (1.0 - step)
        spread = (spread - update * (lifted @ turned) ** 2) / (1.0 - step)
        weights *= 1.0 - step
        weights[far] += step
    centre = weights @ points
    covariance = (points.T * weights) @ points - np.outer(centre, centre)
    sizes, axes = np.linalg.eigh(covariance)
    furthest = float(np.max(np.sum(((points - centre) @ axes) ** 2 / sizes, axis=1)))
    return Ellipsoid(centre, np.sqrt(sizes * furthest), axes)


def uniform_body(known: BodyConstraints) -> Inertia:
    """Return the body of density 1 kg/m^3 that fills the ellipsoid of a link, or the ellipsoid inside its box."""
    space = known.body_ellipsoid
    if space is None:
        box = known.body_box
        assert box is not None  # plausible bounds have one of the two
        space = Ellipsoid((box.lower + box.upper) / 2, np.maximum((box.upper - box.lower) / 2, 1e-3))
    volume = 4.0 / 3.0 * np.pi * float(np.prod(space.semi_axes))
    covariance = (np.asarray(space.rotation) * space.semi_axes**2 / 5.0) @ np.asarray(space.rotation).T
    centre = np.append(space.centre, 1.0)
    pseudo = volume * np.outer(centre, centre)
    pseudo[:3, :3] += volume * covariance
    return Inertia.from_pseudo(pseudo)
