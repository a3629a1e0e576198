"""Shapes of published robots as bounds: no body of one density that fills the shapes of a link is refused.

Needs the package example-robot-data (400 MB: ``pip install --no-deps example-robot-data``), whose 69 robot models have
boxes, cylinders, balls and meshes, in metres and millimetres, closed and open. Moments are those of trimesh.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident import read_robot
from dynident.arrays import Array
from dynident.case.mesh_bounds import with_mesh_points
from dynident.errors import DescriptionError
from dynident.model.plausible import plausible_constraints, shape_points
from dynident.model.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from dynident.robot_files.meshes import mesh_places, mesh_triangles

#: Robot models that are refused: no joint moves, a joint that follows one it may not, or a robot without a name.
UNREAD = {"alex_psyonic_hands.urdf", "quadrotor_base.urdf", "iris_simple.urdf", "ur3.urdf"}


def robots() -> tuple[Path, list[Path]]:
    """Return the folder of the robot models, and those."""
    try:
        place = distribution("example-robot-data").locate_file("cmeel.prefix/share/example-robot-data/robots")
    except PackageNotFoundError:
        pytest.skip("example-robot-data is not installed: pip install --no-deps example-robot-data (400 MB)")
    return Path(str(place)), sorted(Path(str(place)).rglob("*.urdf"))


def filled(shape: Shape, places: Sequence[Path | str]) -> tuple[Array, str]:
    """Return the pseudo-inertia of the body of density 1 that fills a shape, of an open mesh its hull, and its kind."""
    trimesh: Any = pytest.importorskip("trimesh")
    pose, kind = np.eye(4), type(shape).__name__
    if isinstance(shape, Sphere):
        solid, pose[:3, 3] = trimesh.creation.icosphere(4, shape.radius), shape.centre
    elif isinstance(shape, Capsule):
        solid = trimesh.creation.capsule(shape.length, shape.radius)
        solid.apply_translation(-solid.center_mass)
        pose[:3, 3] = (shape.start + shape.end) / 2.0
        pose[:3, :3] = trimesh.geometry.align_vectors([0, 0, 1], shape.end - shape.start)[:3, :3]
    else:
        pose[:3, :3], pose[:3, 3] = shape.rotation, shape.translation
        if isinstance(shape, Mesh):
            corners = mesh_triangles(shape, places).reshape(-1, 3)
            solid = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3))
            solid.merge_vertices()
            is_closed = solid.is_watertight and solid.volume > 0.0
            solid = solid if is_closed else solid.convex_hull
            kind = f"{'closed' if is_closed else 'open'}, {'m' if np.all(shape.scale == 1.0) else 'scaled'}"
        elif isinstance(shape, Box):
            solid = trimesh.creation.box(shape.size)
        else:
            assert isinstance(shape, Cylinder)
            solid = trimesh.creation.cylinder(shape.radius, shape.length, sections=64)
    solid.apply_transform(pose)
    volume, centre, moments = solid.volume, solid.center_mass, solid.moment_inertia
    pseudo = volume * np.outer(np.append(centre, 1.0), np.append(centre, 1.0))
    pseudo[:3, :3] += 0.5 * np.trace(moments) * np.eye(3) - moments
    return pseudo, kind


@pytest.mark.battery
def test_a_body_that_fills_the_shapes_of_its_link_is_never_refused() -> None:
    folder, files = robots()
    kinds, links, unread, refused = Counter[str](), 0, set[str](), []
    for file in files:
        try:
            robot, _ = with_mesh_points(read_robot(file), str(file), [str(folder)])
        except DescriptionError:
            unread.add(file.name)
            continue
        places, bounds = [*mesh_places(robot, str(file)), folder], plausible_constraints(robot)
        for link in robot.links:
            parts = [filled(shape, places) for shape in link.shapes or link.visuals] if len(shape_points(link)) else []
            if not parts:
                continue
            body, known = np.sum([part for part, _ in parts], axis=0), bounds.links[link.name]
            body /= body[3, 3]
            assert known.body_ellipsoid is not None
            rows = [known.body_ellipsoid.quadric, *known.body_ellipsoid.slabs(known.reach), *known.quadrics]
            spread = np.linalg.eigvalsh(body[:3, :3] - np.outer(body[:3, 3], body[:3, 3]))[0]
            if min(np.sum(body * row) for row in rows) < 0.0 or spread < known.thickness**2:
                refused.append((file.name, link.name))
            links += 1
            kinds.update(kind for _, kind in parts)
    assert refused == [] and unread <= UNREAD
    assert links > 900 and len(kinds) >= 7, kinds
