"""Bodies of unit density that fill shapes; those of meshes as MuJoCo's four kinds of mesh inertia define them."""

from __future__ import annotations

from typing import Literal

import numpy as np

from dynident.arrays import Array
from dynident.model.inertia import Inertia
from dynident.model.shapes import Box, Capsule, Mesh, Shape, Sphere
from dynident.robot_files.rotations import rotation_to_axis

MeshKind = Literal["convex", "exact", "legacy", "shell"]


def solid_of(shape: Shape, triangles: Array | None = None) -> Inertia:
    """Return the body of unit density that fills a shape.

    Args:
        shape: The shape.
        triangles: Of a mesh, shape (k, 3, 3), in m, in its own frame, wound either way. Where they enclose no body, as
            those of an open mesh may, it is the one of the tetrahedra from the centre of the surface.

    Raises:
        ValueError: The surface of a mesh has no area.
    """
    if isinstance(shape, Sphere):
        return solid_body("sphere", np.full(3, shape.radius)).moved(np.eye(3), shape.centre)
    if isinstance(shape, Capsule):
        turn = rotation_to_axis(shape.end - shape.start) if shape.length else np.eye(3)
        body = solid_body("capsule", np.array([shape.radius, shape.length / 2.0]))
        return body.moved(turn, (shape.start + shape.end) / 2.0)
    if isinstance(shape, Box):
        body = solid_body("box", shape.size / 2.0)
    elif isinstance(shape, Mesh):
        assert triangles is not None  # whoever has a mesh has read it
        body = _enclosed(triangles) or _enclosed(triangles[:, ::-1]) or mesh_body(triangles, "legacy")
    else:
        body = solid_body("cylinder", np.array([shape.radius, shape.length / 2.0]))
    return body.moved(shape.rotation, shape.translation)


def _enclosed(triangles: Array) -> Inertia | None:
    """Return the body that a surface encloses; None where that is none."""
    try:
        body = mesh_body(triangles, "exact")
    except ValueError:
        return None
    return body if body.is_consistent() else None


def solid_body(kind: str, size: Array) -> Inertia:
    """Return a solid of unit density about its centre.

    Args:
        kind: ``sphere``, ``ellipsoid``, ``box``, ``cylinder`` or ``capsule``.
        size: Radii or half lengths, shape (3,), in m; of the last two the radius and half the length, along z.
    """
    if kind in ("sphere", "ellipsoid", "box"):
        half = np.full(3, size[0]) if kind == "sphere" else size
        mass = float(8.0 * np.prod(half)) if kind == "box" else float(4.0 / 3.0 * np.pi * np.prod(half))
        squares = half**2 / (3.0 if kind == "box" else 5.0)
        return Inertia(mass, np.zeros(3), mass * np.diag(squares.sum() - squares))
    radius, half = size[0], size[1]
    tube = float(2.0 * np.pi * radius**2 * half)
    across, along = tube * (radius**2 / 4.0 + half**2 / 3.0), tube * radius**2 / 2.0
    ball = float(4.0 / 3.0 * np.pi * radius**3) if kind == "capsule" else 0.0
    # Two half balls, whose centres of mass are 3/8 of the radius beyond the ends.
    along += 0.4 * ball * radius**2
    across += ball * (0.4 * radius**2 + half**2 + 0.75 * half * radius)
    return Inertia(tube + ball, np.zeros(3), np.diag([across, across, along]))


def mesh_body(triangles: Array, kind: MeshKind) -> Inertia:
    """Return the body of unit density of a mesh, in the frame of its points.

    Args:
        triangles: Corners, shape (k, 3, 3), in m.
        kind: ``exact``: the volume that the surface encloses; ``convex``: that of the convex hull; ``legacy``: sum
            of the tetrahedra from the centre of the surface, all counted positive; ``shell``: the surface alone.

    Raises:
        ValueError: No volume, or a surface that encloses none.
    """
    if kind == "convex":
        triangles = hull_of(triangles.reshape(-1, 3))
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = 0.5 * np.linalg.norm(normals, axis=1)
    if not areas.sum() > 0.0:
        raise ValueError("its surface has no area")
    middle = areas @ triangles.mean(axis=1) / areas.sum()
    mass, first, _ = _moments(triangles - middle, areas, kind)
    if not mass > 1e-15:
        raise ValueError("it encloses no volume, or its faces are turned inside out")
    centre = middle + first / mass
    # As MuJoCo does: volume and moments anew from the centre, which for overlapping tetrahedra are others.
    mass, _, moment = _moments(triangles - centre, areas, kind)
    return Inertia.from_centre_of_mass(mass, centre, np.trace(moment) * np.eye(3) - moment)


def _moments(corners: Array, areas: Array, kind: MeshKind) -> tuple[float, Array, Array]:
    """Return volume (area of a shell), first and second moments about the origin."""
    sums = corners.sum(axis=1)
    squares = np.einsum("kni,knj->kij", corners, corners) + np.einsum("ki,kj->kij", sums, sums)
    if kind == "shell":
        return float(areas.sum()), areas @ sums / 3.0, np.einsum("k,kij->ij", areas, squares) / 12.0
    parts = np.einsum("ki,ki->k", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    parts = np.abs(parts) if kind == "legacy" else parts
    return float(parts.sum()), parts @ sums / 4.0, np.einsum("k,kij->ij", parts, squares) / 20.0


def hull_of(points: Array) -> Array:
    """Return the triangles of the convex hull of points, shape (n, 3) -> (k, 3, 3), normals outwards.

    Raises:
        ValueError: The points are in one plane.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError) as problem:
        raise ValueError("its points are in one plane") from problem
    found = points[hull.simplices]
    normals = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
    flipped = np.einsum("ki,ki->k", normals, hull.equations[:, :3]) < 0
    found[flipped] = found[flipped][:, ::-1]
    return found
