"""Bounds of plausible bodies from the robot model: ellipsoids about each link, minimum thickness, mass, total mass."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.model.body_constraints import DIRECTIONS, NEAREST, BodyConstraints, Constraints, Ellipsoid, ValueRange
from dynident.model.inertia import PSEUDO_BASIS, Inertia
from dynident.model.robot import Link, Robot
from dynident.model.shapes import Box, Capsule, Cylinder, Shape, Sphere

#: Radius of a link without shapes as a share of the length to its children, and the least radius, in m; without mass
#: the size has a share of the longest of these lengths to spare: 95 % of the links of published robots stay within.
RADIUS_SHARE, LEAST_RADIUS, UNKNOWN_SHARE = 0.15, 0.04, 0.25

#: Least mean density of a link with its motors and hollow spaces, in kg/m^3: its nominal mass takes up that volume.
LEAST_DENSITY = 1000.0

#: Least mean density of the body of equal density with a nominal inertia: of a long tube, 500 kg/m^3, whose matter at
#: its surface and ends makes it look up to sqrt(5) times as large.
LOOK_DENSITY = 500.0 / np.sqrt(5.0)

#: Least radius of gyration about any axis through the centre of mass, as a share of the extent of the link.
GYRATION_SHARE = 0.05

#: The minimum thickness over that of the body that fills the shapes, else the ellipsoid, and of shapes that none fills.
UNIFORM_SHARE, SHAPE_SHARE = 0.8, 0.64

#: How far a body of equal density may reach, in half widths of the ellipsoid of its link; of shapes with quadrics.
REACH, ENDS_REACH = 1.5, 2.0

#: How far a body may reach over how far one does that fills the shapes of the link, whose matter may be at the ends.
SOLID_REACH = 1.1

#: Bounds of a mass and of the total mass as factors about the nominal value.
MASS_FACTOR, TOTAL_FACTOR = 3.0, 1.5

#: What bounds that a nominal body breaks have to spare once they hold it: lengths as factors.
SPARE = 1.5

#: Least semi-axis of an ellipsoid about points, as a share of the largest.
FLAT = 1e-6

_DIRECTIONS = np.vstack([DIRECTIONS, -DIRECTIONS])


def plausible_constraints(robot: Robot, stated: Constraints | None = None) -> Constraints:
    """Return bounds of plausible bodies; what ``stated`` says about a link or the total stands in their place.

    The ellipsoid holds the link's shapes and a possible nominal body that reaches beyond them (neither is proof against
    the other); without shapes, or with a mesh that is not read, balls about the frame of the link, those of its
    children, the named frames on it and the nominal centre of mass, and the nominal body as far as it can be a link.
    One far lighter than links are says nothing about a size. Without shapes and mass the size is all but unknown.
    Matter as far as the minimum thickness from every plane is further than sqrt(2) times that from every axis.
    """
    known = stated or Constraints()
    masses = [link.inertia.mass if link.inertia is not None else 0.0 for link in robot.links]
    bodies: dict[str, BodyConstraints] = {}
    clouds = [link_points(robot, i) for i in range(len(robot.links))]
    spare = UNKNOWN_SHARE * max(np.linalg.norm(joint.translation) * (joint.parent >= 0) for joint in robot.joints)
    for link, points, ellipsoid, mass in zip(robot.links, clouds, bounding_ellipsoids(clouds), masses, strict=True):
        body = known.links.get(link.name, BodyConstraints())
        full = [solid for solid in link.solids if np.sum(solid.pseudo * ellipsoid.quadric) > 0.0]
        share = SHAPE_SHARE if link.shapes or link.visuals else UNIFORM_SHARE
        thin = [UNIFORM_SHARE * _equal_density(solid)[0][0] for solid in full] or [share * min(ellipsoid.semi_axes)]
        thickness = float(min(GYRATION_SHARE * extent_of(points) / np.sqrt(2.0), min(thin) / np.sqrt(5.0)))
        if body.body_ellipsoid is None and body.body_box is None:
            wide, is_known = outgrown(link, ellipsoid), mass > 0 or len(shape_points(link)) > 0
            space = wide or (ellipsoid if is_known else replace(ellipsoid, semi_axes=ellipsoid.semi_axes + spare))
            quadrics, reach = (link.quadrics, ENDS_REACH) if link.quadrics and not wide else ((), REACH)
            reach = max([reach, *(SOLID_REACH * _reach_of(solid.pseudo / solid.mass, space) for solid in full)])
            body = replace(
                body, body_ellipsoid=space, reach=reach, quadrics=quadrics, filled=None if is_known else ellipsoid
            )
        if body.mass == ValueRange() and mass > 0:
            body = replace(body, mass=ValueRange(mass / MASS_FACTOR, mass * MASS_FACTOR))
        bodies[link.name] = replace(body, thickness=body.thickness or thickness)
    total = known.total_mass
    if total == ValueRange() and all(mass > 0 for mass in masses):
        ranges = [bodies[link.name].mass for link in robot.links]
        whole = sum(min(max(mass, own.low), own.high) for mass, own in zip(masses, ranges, strict=True))
        total = ValueRange(whole / TOTAL_FACTOR, whole * TOTAL_FACTOR)
    return Constraints(bodies, total, known.fixed)


def wider_bounds(
    robot: Robot, bounds: Constraints, stated: Constraints, prior: Array | None = None
) -> dict[str, BodyConstraints]:
    """Return bounds with room for the nominal body of each link that breaks those which its geometry gives.

    Args:
        robot: Nominal bodies, also those without thickness, such as a point mass.
        bounds: Of :func:`plausible_constraints`.
        stated: What they were made with; it stays.
        prior: Nominal bodies in place of the robot model's, shape (l, 10).
    """
    found: dict[str, BodyConstraints] = {}
    for i, link in enumerate(robot.links):
        known, own = bounds.links[link.name], stated.links.get(link.name, BodyConstraints())
        ten = prior[i] if prior is not None else np.zeros(10) if link.inertia is None else link.inertia.vector
        if not ten[9] > 0:
            continue
        second = np.einsum("k,kij->ij", ten / ten[9], PSEUDO_BASIS)
        least = np.linalg.eigvalsh(second[:3, :3] - np.outer(second[:3, 3], second[:3, 3]))[0]
        if not own.thickness and known.thickness**2 > least:
            found[link.name] = known = replace(known, thickness=float(np.sqrt(max(least, 0.0))) / SPARE)
        if known.body_ellipsoid is not None and known.reach:  # not a stated one
            if (size := _with_room(known.body_ellipsoid, second, known.reach)) is not None:
                found[link.name] = replace(known, body_ellipsoid=size)
    return found


def _with_room(space: Ellipsoid, second: Array, reach: float) -> Ellipsoid | None:
    """Return an ellipsoid scaled to hold a body of pseudo-inertia ``second`` per mass (4, 4); None where it does."""
    ratio = max(1.0 - np.sum(second * space.quadric), (_reach_of(second, space) / reach) ** 2)
    return replace(space, semi_axes=space.semi_axes * np.sqrt(ratio) * SPARE) if ratio > 1.0 else None


def _reach_of(second: Array, space: Ellipsoid) -> float:
    """Return the reach with which the slabs of an ellipsoid just hold a body of pseudo-inertia ``second`` per mass."""
    return float(np.sqrt(-6.0 / NEAREST * np.min(np.sum(second * space.slabs(0.0), axis=(1, 2)))))


def consistency_defects(links: Iterable[Link]) -> dict[str, str]:
    """Return why each link that is no possible body is none, by the link of the file where that is one of several."""
    found = {link.name: (link.inertia.defect(), link.impossible) for link in links if link.inertia is not None}
    return {name: part or why for name, (why, part) in found.items() if why}


def outgrown(link: Link, own: Ellipsoid | None = None) -> Ellipsoid | None:
    """Return the ellipsoid about shapes, ``own``, and body; None where they bound the body, or one cannot be a link."""
    points = shape_points(link)
    body = link.inertia.solid() if len(points) and link.inertia is not None else None
    if body is None or is_too_light(body):
        return None
    second, (semi_axes, axes) = body.pseudo / body.mass, _equal_density(body)
    if _with_room(own or bounding_ellipsoids([points])[0], second, REACH) is None:
        return None
    (size,) = bounding_ellipsoids([np.vstack([points, body.centre_of_mass + _DIRECTIONS * semi_axes @ axes.T])])
    return _with_room(size, second, REACH) or size


def extent_of(points: Array) -> float:
    """Return the largest distance between two of points (k, 3), in m."""
    gram = (points - points[0]) @ (points - points[0]).T
    return float(np.sqrt(np.max(np.diag(gram)[:, None] + np.diag(gram) - 2.0 * gram)))


def link_points(robot: Robot, index: int) -> Array:
    """Return points whose convex hull is about the space of a link, shape (k, 3), in m, in the link frame.

    The offset along a joint's own axis may be matter of the link on either side of it: it counts for both. A last link
    without frames reaches as far beyond its nominal centre of mass as its frame lies before it.
    """
    link, own = robot.links[index], robot.joints[index]
    if len(points := shape_points(link)):
        return points
    children = [joint.translation for joint in robot.joints if joint.parent == index]
    children += [frame.translation for frame in robot.frames.values() if frame.link == index]
    places = [np.zeros(3), *children, -own.axis * (own.axis @ own.rotation.T @ own.translation)]
    mass = 0.0 if link.inertia is None else link.inertia.mass
    if link.inertia is not None and mass > 0:
        centre = link.inertia.first_moment / mass
        places += [centre] if children else [centre, 2.0 * centre]
    length = max(float(np.linalg.norm(place)) for place in places)
    radius = max(RADIUS_SHARE * length, LEAST_RADIUS)
    volume = max(mass, 0.0) / LEAST_DENSITY / np.pi
    full = (0.75 * volume) ** (1.0 / 3.0)  # of a ball, then of a capsule as long by Newton, from above
    while (more := full**2 * (4.0 / 3.0 * full + length) - volume) > 1e-12 * volume:
        full -= more / (full * (4.0 * full + 2.0 * length))
    radius = max(radius, full)
    points, body = _balls(np.array(places), radius), link.inertia and link.inertia.solid()
    if body is None or (density := mean_density(body)) < LOOK_DENSITY / REACH**3:
        return points
    (semi_axes, axes), factor = _equal_density(body), min(1.0, (density / LOOK_DENSITY) ** (1.0 / 3.0))
    return np.vstack([points, body.centre_of_mass + _DIRECTIONS * factor * _thick(semi_axes) @ axes.T])


def shape_points(link: Link) -> Array:
    """Return points whose hull is about all shapes of a link, shape (k, 3), in m; none with an unread mesh."""
    return np.concatenate([np.zeros((0, 3)), *shape_clouds(link)])


def shape_clouds(link: Link) -> list[Array]:
    """Return points about each shape of a link, shape (k, 3) each; none with an unread mesh.

    Unread meshes that only show the link are left out where it has other shapes.
    """
    parts, shown = (list(map(_points_of, shapes)) for shapes in (link.shapes, link.visuals))
    needed = parts or shown
    return list(filter(len, [*parts, *shown])) if needed and all(map(len, needed)) else []


def is_too_light(body: Inertia) -> bool:
    """Return whether a body is lighter than links are, even if it reaches beyond them: the inertia is a placeholder."""
    return mean_density(body) < LOOK_DENSITY / REACH**3


def mean_density(body: Inertia) -> float:
    """Return the density of the ellipsoid of equal density of a body, as thick as links are, in kg/m^3."""
    return body.mass / max(4.0 / 3.0 * np.pi * float(np.prod(_thick(_equal_density(body)[0]))), 1e-300)


def _equal_density(body: Inertia) -> tuple[Array, Array]:
    """Return semi-axes (3,), in m, the shortest first, and directions (3, 3) of the ellipsoid of equal density."""
    centre = body.centre_of_mass
    sizes, axes = np.linalg.eigh(body.pseudo[:3, :3] / body.mass - np.outer(centre, centre))
    return np.sqrt(5.0 * np.maximum(sizes, 0.0)), axes


def _thick(semi_axes: Array) -> Array:
    """Return semi-axes with the longer ones cut to the least thickness that plausible bodies of their length have."""
    return np.minimum(semi_axes, semi_axes[0] / (GYRATION_SHARE * np.sqrt(10.0)))


def _balls(centres: Array, radius: float) -> Array:
    return (np.atleast_2d(centres)[:, None, :] + radius * _DIRECTIONS).reshape(-1, 3)


def _points_of(shape: Shape) -> Array:
    """Return points of a shape's surface, shape (k, 3); none of a mesh that nobody has read."""
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
    return np.zeros((0, 3)) if shape.points is None else shape.points @ shape.rotation.T + shape.translation


def bounding_ellipsoids(clouds: Sequence[Array], tolerance: float = 0.05) -> list[Ellipsoid]:
    """Return ellipsoids of nearly the least volume that hold points (k, 3) each, which are not in a plane.

    Khachiyan's algorithm (Todd and Yildirim 2007, algorithm 3.1) until the semi-axes are long by about half the
    tolerance at most; the results are scaled so that they hold every point. All clouds take their steps together.
    """
    each, most = np.arange(len(clouds)), max(map(len, clouds))
    points = np.array([np.pad(cloud, ((0, most - len(cloud)), (0, 0)), mode="edge") for cloud in clouds])
    weights = np.array([(np.arange(most) < len(cloud)) / len(cloud) for cloud in clouds])
    lifted = np.concatenate([points, np.ones((len(clouds), most, 1))], axis=2)
    inverse = np.linalg.inv((lifted * weights[:, :, None]).transpose(0, 2, 1) @ lifted)
    spread = np.sum((lifted @ inverse) * lifted, axis=2)
    while np.any((top := spread[each, far := spread.argmax(axis=1)]) > 4.0 * (1.0 + tolerance)):
        step = np.where(top > 4.0 * (1.0 + tolerance), (top - 4.0) / (4.0 * (top - 1.0)), 0.0)
        update, left = step / (1.0 - step + step * top), 1.0 - step  # of the inverse by rank one (Sherman and Morrison)
        turned = inverse @ lifted[each, far, :, None]
        inverse = (inverse - update[:, None, None] * turned * turned.transpose(0, 2, 1)) / left[:, None, None]
        spread = (spread - update[:, None] * (lifted @ turned)[:, :, 0] ** 2) / left[:, None]
        weights *= left[:, None]
        weights[each, far] += step
    found = []
    for cloud, own in zip(clouds, weights, strict=True):
        centre = own[: len(cloud)] @ cloud
        around = cloud - centre
        sizes, axes = np.linalg.eigh((around.T * own[: len(cloud)]) @ around)
        sizes = np.maximum(sizes, FLAT**2 * sizes[-1])  # rounding of a thin plate may leave less than none
        furthest = float(np.max(np.sum((around @ axes) ** 2 / sizes, axis=1)))
        found.append(Ellipsoid(centre, np.sqrt(sizes * furthest), axes))
    return found


def uniform_body(known: BodyConstraints) -> Inertia:
    """Return the body of density 1 kg/m^3 that fills the ellipsoid of a link, or the ellipsoid inside its box."""
    space = known.filled or known.body_ellipsoid
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
