"""The geoms of a body: the inertia that they give it, and the space that they take up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Final

import numpy as np

from dynident.arrays import Array
from dynident.errors import DescriptionError, DynidentError, FileError, nearest
from dynident.model.documents.numbers import shown
from dynident.model.inertia import Inertia
from dynident.model.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from dynident.robot_files.meshes import folders_above, mesh_triangles
from dynident.robot_files.mjcf.document import MjcfDocument
from dynident.robot_files.mjcf.poses import Pose, placed, pose_of
from dynident.robot_files.mjcf.schema import Defaults
from dynident.robot_files.rotations import rotation_from_quaternion, rotation_to_axis
from dynident.robot_files.solids import MeshKind, hull_of, mesh_body, solid_body
from dynident.robot_files.xml_elements import Element, Values

_TYPES: Final = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "sdf")
_SIZES: Final = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}
_STRETCHED: Final = ("capsule", "cylinder", "ellipsoid", "box")
_WRITE: Final = "write the <inertial> of the body"


@dataclass(frozen=True)
class MeshAsset:
    """A mesh of the assets.

    Attributes:
        values: Its attributes.
        file: Its file relative to the folder of the model; empty where its points are written.
    """

    values: Values
    file: str

    @property
    def kind(self) -> str:
        """How it gives inertia; empty where it does not say."""
        return self.values.choice("inertia", ("convex", "exact", "legacy", "shell"), "legacy")


@dataclass(frozen=True)
class Meshes:
    """The meshes of a model, each read when its inertia is wanted.

    Attributes:
        document: The model.
        assets: The meshes by name.
        bodies: Those of unit density that were asked for, by name and kind.
    """

    document: MjcfDocument
    assets: Mapping[str, MeshAsset]
    bodies: dict[tuple[str, str], Inertia] = field(default_factory=dict)

    @classmethod
    def of(cls, document: MjcfDocument, defaults: Defaults) -> Meshes:
        """Return the meshes of a model by name."""
        assets: dict[str, MeshAsset] = {}
        for element in document.each("asset"):
            if element.tag == "mesh":
                values = defaults.values(element, "")
                file = values.text("file", "")
                name = values.text("name", PurePath(file).stem)
                file = PurePath(file).name if document.compiler.strips else file
                assets[name] = MeshAsset(values, str(PurePath(document.compiler.mesh_folder, file)) if file else "")
        return cls(document, assets)

    def asset(self, values: Values) -> MeshAsset:
        """Return the mesh that a geom names.

        Raises:
            DescriptionError: There is none of this name.
        """
        name = values.text("mesh")
        if name not in self.assets:
            step = f"add it to <asset>, or correct the name{nearest(name, self.assets)}"
            raise values.place.error(f"there is no mesh {shown(name)}", step)
        return self.assets[name]

    def body(self, values: Values) -> Inertia:
        """Return the body of unit density of the mesh of a geom, in the frame of the geom.

        Raises:
            DescriptionError: The file is missing or no mesh, or the mesh has no volume.
        """
        asset, name = self.asset(values), values.text("mesh")
        kind = asset.kind
        if "inertia" not in asset.values and self.document.compiler.exact_meshes:
            kind = "exact"
        if (name, kind) not in self.bodies:
            kinds: dict[str, MeshKind] = {"convex": "convex", "exact": "exact", "legacy": "legacy", "shell": "shell"}
            try:
                self.bodies[name, kind] = mesh_body(self._triangles(asset), kinds[kind])
            except DescriptionError:
                raise
            except (ValueError, DynidentError) as problem:
                reason, step = str(problem), f"correct the file, or {_WRITE}"
                if isinstance(problem, FileError):
                    reason = f"{problem.path}: {problem.evidence}"
                    is_missing = problem.evidence.startswith("no such")
                    step = "put it there, with a name relative to that folder" if is_missing else problem.step
                    step = f"{step}, or {_WRITE}"
                raise asset.values.place.error(f"the mesh {shown(name)} gives no inertia: {reason}", step) from problem
        return self.bodies[name, kind]

    def shape(self, values: Values, pose: Pose) -> Mesh | Box | None:
        """Return the mesh of a geom at its place, the box about written points; None where no file has it as it is."""
        asset = self.asset(values)
        if not asset.file and "vertex" in asset.values:
            points = self._triangles(asset).reshape(-1, 3)
            return Box.between(points.min(axis=0), points.max(axis=0)).moved(*pose)
        scale = asset.values.numbers("scale", 3) if "scale" in asset.values else np.ones(3)
        is_moved = "refpos" in asset.values or "refquat" in asset.values
        return None if not asset.file or is_moved or np.any(scale == 0.0) else Mesh(asset.file, scale, *pose)

    def _triangles(self, asset: MeshAsset) -> Array:
        values = asset.values
        scale = values.numbers("scale", 3) if "scale" in values else np.ones(3)
        if asset.file:
            folder = self.document.folder
            found = mesh_triangles(Mesh(asset.file), [folder.absolute(), *folders_above(folder, [asset.file])])
        elif "vertex" in values:
            found = _written(values)
        else:
            raise values.place.error("its points are not in the file and not in a mesh file", _WRITE)
        if "refpos" in values:
            found = found - values.numbers("refpos", 3)
        if "refquat" in values:
            quaternion = values.numbers("refquat", 4)
            found = found @ rotation_from_quaternion(quaternion / np.linalg.norm(quaternion))
        found = found * scale
        return found[:, ::-1] if np.prod(np.sign(scale)) < 0 else found


def _written(values: Values) -> Array:
    """Return the triangles of a mesh whose points are written; without faces those of the convex hull."""
    points = values.numbers("vertex", 12, 3_000_000).astype(np.float32).astype(float)  # as MuJoCo has them
    if len(points) % 3:
        raise values.place.error(f"vertex has {len(points)} numbers", "write three a point")
    if "face" not in values:
        return hull_of(points.reshape(-1, 3))
    faces = values.numbers("face", 3, 3_000_000)
    rows = faces.astype(int)
    if len(faces) % 3 or np.any(rows != faces) or rows.min() < 0 or rows.max() >= len(points) // 3:
        raise values.place.error("face has an index of no vertex", "write three whole numbers a face, from 0")
    return points.reshape(-1, 3)[rows.reshape(-1, 3)]


class Geoms:
    """The geoms of a model."""

    def __init__(self, document: MjcfDocument, defaults: Defaults) -> None:
        self._document, self._defaults = document, defaults
        self._meshes = Meshes.of(document, defaults)

    def body(self, element: Element, childclass: str, frame: Pose, groups: tuple[float, float]) -> Inertia | None:
        """Return the inertia of a geom about the origin of its body, in its axes; None where it does not count.

        Args:
            element: The geom.
            childclass: The class that bodies and frames around it give it.
            frame: Where the frame that it stands in is in its body.
            groups: First and last group of the geoms that count for its body.

        Raises:
            DescriptionError: A fault of the geom, or a mesh that is not there.
        """
        values, kind = self._values(element, childclass)
        if not groups[0] <= values.number("group", 0.0) <= groups[1] or kind in ("plane", "hfield"):
            return None
        mass = values.at_least_zero("mass") if "mass" in values else None
        density = values.at_least_zero("density", 1000.0)
        if not (density if mass is None else mass):
            return None
        if kind == "sdf" or ("mesh" in values and kind != "mesh"):
            raise values.place.error(f"the inertia of a {kind} fitted to a mesh is not read", _WRITE)
        if kind == "mesh":
            unit = self._meshes.body(values)
        else:
            size = self._size(values, kind)
            unit = _shell(values, kind, size) if values.flag("shellinertia", False) else solid_body(kind, size)
        if mass is not None and not (unit.mass and np.isfinite(mass / unit.mass)):
            evidence = f"size {shown(values.text('size'))} is too small for its mass of {mass:g} kg"
            raise values.place.error(evidence, f"write lengths in m, or {_WRITE}")
        scale = density if mass is None else mass / unit.mass
        return Inertia.from_vector(scale * unit.vector).moved(*self._pose(values, kind, frame))

    def shape(self, element: Element, childclass: str, frame: Pose) -> tuple[Shape | None, bool]:
        """Return the space that a geom takes up in the frame of its body, if any, and whether it touches."""
        values, kind = self._values(element, childclass)
        touches = bool(values.number("contype", 1.0) or values.number("conaffinity", 1.0))
        return self._shape(values, kind, frame), touches

    def _shape(self, values: Values, kind: str, frame: Pose) -> Shape | None:
        if kind in ("plane", "hfield", "sdf"):
            return None
        rotation, translation = self._pose(values, kind, frame)
        if "mesh" in values:
            return self._meshes.shape(values, (rotation, translation))
        size = self._size(values, kind)
        if kind == "sphere":
            return Sphere(size[0], translation)
        if kind == "capsule":
            return Capsule(translation - size[1] * rotation[:, 2], translation + size[1] * rotation[:, 2], size[0])
        if kind == "cylinder":
            return Cylinder(size[0], 2.0 * size[1], rotation, translation)
        return Box(2.0 * size, rotation, translation)  # an ellipsoid lies in it

    def _values(self, element: Element, childclass: str) -> tuple[Values, str]:
        values = self._defaults.values(element, childclass)
        return values, values.choice("type", _TYPES, "sphere")

    def _ends(self, values: Values, kind: str) -> tuple[Array, Array] | None:
        if "fromto" not in values or kind not in _STRETCHED:
            return None
        ends = values.numbers("fromto", 6)
        if np.linalg.norm(ends[3:] - ends[:3]) < 1e-10:
            raise values.place.error("both ends of fromto are one point", "write two points")
        return ends[:3], ends[3:]

    def _size(self, values: Values, kind: str) -> Array:
        """Return radii and half lengths as MuJoCo has them."""
        ends = self._ends(values, kind)
        count = _SIZES[kind]
        needed = 1 if ends is not None else count
        given = values.numbers("size", needed, 3)
        if ends is not None:
            half = 0.5 * float(np.linalg.norm(ends[1] - ends[0]))
            given = np.array([given[0], half] if count == 2 else [given[0], given[0], half])
        if np.any(given[:count] <= 0.0):
            raise values.place.error(
                f"size {shown(values.text('size'))} is not above 0", f"write {needed} lengths in m"
            )
        return given[:count]

    def _pose(self, values: Values, kind: str, frame: Pose) -> Pose:
        ends = self._ends(values, kind)
        if ends is None:
            return placed(frame, pose_of(values, self._document.compiler))
        return placed(frame, (rotation_to_axis(ends[1] - ends[0]), 0.5 * (ends[0] + ends[1])))


def _shell(values: Values, kind: str, size: Array) -> Inertia:
    """Return a surface of unit density about its centre."""
    if kind == "ellipsoid":
        raise values.place.error("the inertia of the shell of an ellipsoid is not read", _WRITE)
    if kind == "box":
        areas = 8.0 * np.array([size[1] * size[2], size[0] * size[2], size[0] * size[1]])
        squares = np.array(
            [sum(a * size[i] ** 2 / (1.0 if i == j else 3.0) for j, a in enumerate(areas)) for i in range(3)]
        )
        return Inertia(float(areas.sum()), np.zeros(3), np.diag(squares.sum() - squares))
    radius = size[0]
    sphere = float(4.0 * np.pi * radius**2)
    if kind == "sphere":
        return Inertia(sphere, np.zeros(3), sphere * radius**2 * 2.0 / 3.0 * np.eye(3))
    half = size[1]
    tube = float(4.0 * np.pi * radius * half)
    across, along = tube * (radius**2 / 2.0 + half**2 / 3.0), tube * radius**2
    if kind == "cylinder":
        lids = float(2.0 * np.pi * radius**2)
        across, along = across + lids * (radius**2 / 4.0 + half**2), along + lids * radius**2 / 2.0
        return Inertia(tube + lids, np.zeros(3), np.diag([across, across, along]))
    # Two half spheres, whose centres of mass are half of the radius beyond the ends.
    across += sphere * (2.0 / 3.0 * radius**2 + half**2 + half * radius)
    along += sphere * 2.0 / 3.0 * radius**2
    return Inertia(tube + sphere, np.zeros(3), np.diag([across, across, along]))
