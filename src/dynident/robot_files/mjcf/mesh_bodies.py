"""Mass, centre and inertia of a mesh of unit density, as MuJoCo's four kinds of mesh inertia define them."""

from __future__ import annotations

from typing import Literal

import numpy as np

from dynident.arrays import Array
from dynident.model.inertia import Inertia

MeshKind = Literal["convex", "exact", "legacy", "shell"]


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
