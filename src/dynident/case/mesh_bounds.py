"""Meshes of the links as bounds of their bodies: found beside the robot model, read, and checked for their size."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.case.shape_quadrics import with_quadrics
from dynident.errors import FileError, MissingDependency
from dynident.model.inertia import Inertia
from dynident.model.plausible import extent_of, link_points
from dynident.model.robot import Robot
from dynident.model.shapes import Mesh, Shape
from dynident.robot_files.mesh_files import mesh_places
from dynident.robot_files.meshes import mesh_triangles, outermost
from dynident.robot_files.solids import solid_of

#: Extent of a mesh over that of the frames of its link from which its unit is another: half way to 1000 in logarithms.
WRONG_UNIT = float(np.sqrt(1000.0))


@dataclass(frozen=True)
class MeshFault:
    """A mesh that says nothing about the size of its link.

    Attributes:
        link: The link.
        evidence: What is wrong with which file.
        remedy: What to do.
    """

    link: str
    evidence: str
    remedy: str

    def figures(self) -> dict[str, Any]:
        """Return the fault as plain data."""
        return asdict(self)


def with_mesh_points(robot: Robot, robot_path: str, folders: Sequence[str] = ()) -> tuple[Robot, tuple[MeshFault, ...]]:
    """Return the robot with points of its meshes, bodies that fill its shapes, quadrics about them, and faulty meshes.

    A link with a faulty mesh keeps the size that its frames give. Meshes that only show a link are read where it has no
    mesh that touches, which is the simpler one of the same link.

    Args:
        robot: The robot.
        robot_path: Its file: meshes are looked for beneath its folder, and in the ROS packages that they name.
        folders: Other folders.
    """
    places = [*mesh_places(robot, robot_path), *folders]
    links, faults = [], []
    for i, link in enumerate(robot.links):
        try:
            parts = [_read(robot, i, shape, places) for shape in link.shapes]
            is_shown = any(isinstance(shape, Mesh) for shape, _ in parts)
            shown = [(one, None) if is_shown else _visual(robot, i, one, places) for one in link.visuals]
            shapes, visuals = (tuple(shape for shape, _ in group) for group in (parts, shown))
            solids = tuple(whole for group in (parts, shown) if (whole := _joined(body for _, body in group)))
            links.append(with_quadrics(replace(link, shapes=shapes, visuals=visuals, solids=solids)))
        except (FileError, MissingDependency) as error:
            evidence, _, remedy = str(error).rpartition("; ")
            faults.append(MeshFault(link.name, evidence, remedy))
            links.append(link)
    return replace(robot, links=tuple(links)), tuple(faults)


def _visual(robot: Robot, index: int, shape: Shape, places: Sequence[str | Path]) -> tuple[Shape, Inertia | None]:
    """Return what shows a link and its solid, a mesh with its points if it is a sound one.

    Raises:
        FileError, MissingDependency: It is not, and the link has no shapes but this.
    """
    try:
        return _read(robot, index, shape, places)
    except (FileError, MissingDependency):
        if robot.links[index].shapes:
            return shape, None
        raise


def _read(robot: Robot, index: int, shape: Shape, folders: Sequence[str | Path]) -> tuple[Shape, Inertia | None]:
    """Return a shape of a link, a mesh with its outermost points, and the body of density 1 kg/m^3 that fills it.

    Raises:
        FileError: Not beneath a folder, not readable, or in another unit than m.
        MissingDependency: Neither STL, nor coal installed.
    """
    if not isinstance(shape, Mesh):
        return shape, solid_of(shape)
    triangles = mesh_triangles(shape, folders)
    points = outermost(np.unique(triangles.reshape(-1, 3), axis=0))
    check_unit(robot, index, shape, points)
    with suppress(ValueError):  # a surface without an area
        return replace(shape, points=points), solid_of(shape, triangles)
    return replace(shape, points=points), None


def _joined(bodies: Iterable[Inertia | None]) -> Inertia | None:
    """Return bodies as one; None of none, and where one of them is not known."""
    found = list(bodies)
    known = [body.vector for body in found if body is not None]
    return Inertia.from_vector(np.sum(known, axis=0)) if known and len(known) == len(found) else None


def check_unit(robot: Robot, index: int, mesh: Mesh, points: Array) -> None:
    """Refuse a mesh of a link whose points (k, 3) lie as in another unit than m.

    Raises:
        FileError: Its extent is that of the frames of the link in another unit.
    """
    bare = replace(robot.links[index], shapes=(), visuals=())
    frames = replace(robot, links=(*robot.links[:index], bare, *robot.links[index + 1 :]))
    size, usual = extent_of(points), extent_of(link_points(frames, index))
    if not usual / WRONG_UNIT < size < usual * WRONG_UNIT:
        scale, unit = (0.001, "millimetres") if size > usual else (1000.0, "metres, with a scale for millimetres")
        evidence = f"it is {size:.3g} m large where the frames of {bare.name} are {usual:.2g} m apart: in {unit}?"
        raise FileError(mesh.file, evidence, f'write scale="{scale:g} {scale:g} {scale:g}" at the mesh')
