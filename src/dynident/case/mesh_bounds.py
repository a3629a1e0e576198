"""Meshes and shapes of links as bounds of their bodies: found beside the robot model, read, and checked for their size.

Quadrics about the shapes of a link hold where one ellipsoid is too coarse: an L of two boxes is half empty in it.
Matter in the union of ellipsoids E_k = {x: q_k(x) >= 0}, one about each shape, has the pseudo-inertia P = sum_k J_k of
bodies J_k >= 0 with tr(J_k Q_k) >= 0 (Wensing, Kim and Slotine 2018, (15), for each). By duality P is such a sum where
tr(P Y) >= 0 for every Y with Y - l_k Q_k >= 0, l_k >= 0: then (x, 1)' Y (x, 1) >= 0 in every E_k (S-lemma: Boyd and
Vandenberghe 2004, B.2). A few such Y exclude what is not in the shapes: bodies stay linear conditions of ten numbers.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.errors import FileError, MissingDependency
from dynident.identification.consistency.conditions import Conditions, stack_vectors, unstack_vectors
from dynident.identification.consistency.conic import cone_rows, run_clarabel, split_duals
from dynident.model.body_constraints import BodyConstraints
from dynident.model.inertia import PSEUDO_BASIS, Inertia
from dynident.model.plausible import bounding_ellipsoids, extent_of, link_points, shape_clouds, uniform_body
from dynident.model.robot import Link, Robot
from dynident.model.shapes import Capsule, Mesh, Shape, Sphere
from dynident.robot_files.meshes import mesh_places, mesh_triangles, outermost
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


#: One ellipsoid is too coarse where those about each shape have this share of its volume or less.
COARSE = 0.5

#: Ellipsoids about 26 points of a ball, or of each end of a capsule, hold all of it where they are longer by this.
ROUND = 1.05

#: Most quadrics of a link, and points along each axis of the grid in which they are sought.
MOST, GRID = 8, 15

_GRID = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, GRID)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)

_SPREADS = np.multiply.outer([0.0, 0.05, 0.15], np.diag([1.0, 1.0, 1.0, 0.0]))


def with_quadrics(link: Link) -> Link:
    """Return a link with quadrics where an ellipsoid about its shapes is too coarse and its nominal body meets them."""
    is_round = any(isinstance(shape, Sphere | Capsule) for shape in (*link.shapes, *link.visuals))
    found = shape_quadrics(shape_clouds(link), ROUND if is_round else 1.0)
    body = link.inertia and link.inertia.solid()
    meets = body is None or all(np.sum(body.pseudo * quadric) >= 0.0 for quadric in found)
    return replace(link, quadrics=found if meets else ())


def shape_quadrics(clouds: Sequence[Array], spare: float = 1.0) -> tuple[Array, ...]:
    """Return Q (4, 4), in 1 / m^2, 1 / m and 1, with (x, 1)' Q (x, 1) >= 0 in ellipsoids about each of clouds (k, 3).

    Each excludes the body deepest in what is empty so far: a point, or one of some size. There is none where one
    ellipsoid about all is not too coarse. Semi-axes are longer by ``spare`` than clouds ask for.
    """
    if len(clouds) < 2:
        return ()
    whole, *parts = bounding_ellipsoids([np.concatenate(clouds), *clouds])
    parts = [replace(part, semi_axes=spare * part.semi_axes) for part in parts]
    if sum(np.prod(part.semi_axes) for part in parts) > COARSE * np.prod(whole.semi_axes):
        return ()
    place = np.eye(4)  # from the unit ball to the ellipsoid about all
    place[:3, :3], place[:3, 3] = np.asarray(whole.rotation) * whole.semi_axes, whole.centre
    inverse, forms = np.linalg.inv(place), np.array([place.T @ part.quadric @ place for part in parts])
    points = np.column_stack([_GRID, np.ones(len(_GRID))])[np.sum(_GRID**2, axis=1) < 1.0]
    bodies = (points[:, :, None] * points[:, None] + _SPREADS[:, None]).reshape(-1, 4, 4)
    depth = -np.max(np.tensordot(bodies, forms, ((1, 2), (1, 2))), axis=1)
    full = np.sum([uniform_body(BodyConstraints(body_ellipsoid=part)).pseudo for part in parts], axis=0)
    found: list[Array] = []
    while len(found) < MOST and np.max(depth) > 0.0:
        deepest = int(np.argmax(depth))
        form = separating(forms, bodies[deepest], inverse @ full @ inverse.T)
        depth[np.tensordot(bodies, form) < 0.0] = depth[deepest] = 0.0
        found.append(inverse.T @ form @ inverse)
    return tuple(found)


def separating(forms: Array, body: Array, inside: Array) -> Array:
    """Return Y, >= 0 in ellipsoids of forms (k, 4, 4), with the least tr(body Y) of those with tr(inside Y) = 1.

    Args:
        forms: Q_k of ellipsoids in or about the unit ball.
        body: A pseudo-inertia, shape (4, 4).
        inside: One of matter in the ellipsoids.
    """
    count = len(forms)
    vectors = stack_vectors(PSEUDO_BASIS).T  # of ten parameters
    zero = np.column_stack([*[vectors] * count, -stack_vectors(inside)])  # sum_k J_k = body + t inside, least t
    sign = np.zeros((count, 10 * count + 1))
    for k, form in enumerate(forms):
        sign[k, 10 * k : 10 * k + 10] = np.einsum("kij,ij->k", PSEUDO_BASIS, form)
    names = ("",) * count
    rules = Conditions(zero, -stack_vectors(body), ("",) * 10, sign, np.zeros(count), names, names, 0.0)
    found = run_clarabel(np.zeros((10 * count + 1,) * 2), np.eye(10 * count + 1)[-1], *cone_rows(rules))
    prices = split_duals(rules, np.array(found.z))
    form = unstack_vectors(-prices.zero[None])[0]
    form /= np.sum(form * inside)
    left = [np.linalg.eigvalsh(form - price * each)[0] for price, each in zip(prices.sign, forms, strict=True)]
    return form - min(*left, 0.0) * np.eye(4)  # proven, whatever the solver says
