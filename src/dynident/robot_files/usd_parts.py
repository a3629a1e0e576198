"""What a USD stage holds of a robot, as plain records, and how a stage is opened.

Shapes are cubes, spheres, cylinders, capsules and meshes, in the frame of the prim of their body.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from dynident.arrays import Array
from dynident.errors import DescriptionError, MissingDependency
from dynident.model.documents.numbers import Place
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive
from dynident.model.shapes import Box, Capsule, Cylinder, Shape, Sphere
from dynident.robot_files.tree import Connection

#: Name of what does not move.
WORLD: Final = "world"

#: Endings of files that a stage is composed of; textures and materials may be missing.
_LAYERS: Final = (".usd", ".usda", ".usdc", ".usdz")

#: Inertia of NewtonMassAPI: xx, yy, zz, xy, xz, yz about the centre of mass in the axes of the prim, in double
#: precision.
WHOLE_INERTIA: Final = "newton:inertia"

#: What OpenUSD says first, behind the place in its own source; the file and line that it begins with; its name spaces.
_ITS_PLACE: Final = re.compile(r"Error in .*? in file \S+ : '(.*?)\s*'\s*(?:Error in|$)", re.DOTALL)
_FILE_AND_LINE: Final = re.compile(r"^.*?\.usda?:(\d+):\d+: ")
_ITS_NAMES: Final = re.compile(r"\bpxrInternal_\w+::(?:\w+::)*")


@dataclass(frozen=True)
class StageUnits:
    """Units of a stage.

    Attributes:
        length: m in its unit of length.
        mass: kg in its unit of mass.
    """

    length: float
    mass: float

    @property
    def inertia(self) -> float:
        """Kg m^2 in its unit of moments of inertia, and N m in its unit of torque."""
        return self.mass * self.length**2


@dataclass(frozen=True)
class StageBody:
    """A rigid body of a stage.

    Attributes:
        prim: Path of its prim.
        inertia: About the origin and in the axes of its link frame; None where the stage does not state all of it.
        shift: Origin of its link frame in the frame of the prim, shape (3,), in m: where its joint turns.
        shapes: Its shapes that touch, in its link frame.
        visuals: Those that touch nothing.
    """

    prim: str
    inertia: Inertia | None
    shift: Array
    shapes: tuple[Shape, ...] = ()
    visuals: tuple[Shape, ...] = ()


@dataclass(frozen=True)
class StageParts:
    """What a stage holds of a robot.

    Attributes:
        name: Name of the robot.
        bodies: The bodies by name, with their link frames; what does not move is not among them.
        connections: The joints, each towards the body that is farther from the world.
        drives: Known rotor inertias by joint.
        gravity: Gravity in the frame of the world, shape (3,), in m/s^2.
        units: Its units.
        notes: What is not read.
        unknown: Bodies whose inertia the stage does not state in full; those without mass and shapes are frames.
    """

    name: str
    bodies: Mapping[str, StageBody]
    connections: tuple[Connection, ...]
    drives: Mapping[str, Drive]
    gravity: Array
    units: StageUnits
    notes: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()

    @property
    def inertias(self) -> dict[str, Inertia | None]:
        """Inertia of each body about its link frame, the world first."""
        return {WORLD: None, **{name: body.inertia for name, body in self.bodies.items()}}


def pxr_module(name: str) -> Any:
    """Return a module of OpenUSD.

    Raises:
        MissingDependency: It is not installed.
    """
    import importlib

    try:
        return importlib.import_module(f"pxr.{name}")
    except ImportError as problem:
        raise MissingDependency("a robot model in USD", "usd-core", "usd") from problem


def open_stage(path: str | Path) -> Any:
    """Return the ``Usd.Stage`` of a file with all layers that it names.

    Raises:
        MissingDependency: OpenUSD (usd-core) is not installed.
        DescriptionError: It cannot be opened, or a layer is missing.
    """
    engine, utilities = pxr_module("Usd"), pxr_module("UsdUtils")
    trap = pxr_module("Tf")
    held = utilities.CoalescingDiagnosticDelegate()  # of a missing layer OpenUSD warns itself, in lines of its own
    try:
        stage = engine.Stage.Open(str(path))
        _, _, unresolved = utilities.ComputeAllDependencies(str(path))
        warnings = [str(warning.commentary) for warning in held.TakeUncoalescedDiagnostics()]
    except trap.ErrorException as problem:
        raise DescriptionError(path, "", f"not USD ({said(problem)})", "export the stage again") from problem
    finally:
        del held  # with it, warnings are printed again
    missing = [str(name) for name in unresolved if str(name).lower().endswith(_LAYERS)]
    if missing:
        count = "a layer is" if len(missing) == 1 else f"{len(missing)} layers are"
        evidence = f"{count} missing: {', '.join(missing)}"
        raise DescriptionError(path, "", evidence, "put them where the stage names them, or flatten it (usdcat -f)")
    for warning in warnings:
        trap.Warn(warning)
    return stage


def said(problem: Exception) -> str:
    """Return what OpenUSD says of a fault, in one line without its own places; it may quote bytes that are no text."""
    try:
        text = str(problem)
    except UnicodeDecodeError:
        return "it holds bytes that are no text"
    first = _ITS_PLACE.search(text)
    told = " ".join((first[1] if first else text.rsplit("--", maxsplit=1)[-1]).split())
    return _ITS_NAMES.sub("", _FILE_AND_LINE.sub(r"line \1: ", told))[:200]


def check_values(prim: Any, place: Place) -> None:
    """Refuse values of the schemas that are no numbers, or not of the kind that the schema has.

    Raises:
        DescriptionError: Such a value.
    """
    schema = prim.GetPrimDefinition()
    for attribute in prim.GetAuthoredAttributes():
        name, value = attribute.GetName(), attribute.Get()
        known = schema.GetAttributeDefinition(name)
        if not known and type(value).__name__ != "UnregisteredValue":
            continue
        wanted = known.GetTypeName() if known else attribute.GetTypeName()
        if not known or _kind(value) != _kind(wanted.defaultValue):
            raise place.error(f"{name} has no value of the type {wanted}", "write one, or leave the attribute out")
        if _kind(value) in ("float", "Vec3", "Quat") and np.isnan(numbers(value)).any():
            raise place.error(f"{name} is no number", "write numbers")


def _kind(value: Any) -> str:
    """Return what a value is, whatever the digits of its numbers."""
    name = type(value).__name__
    return "float" if name == "int" else name[:4] if name.startswith(("Vec", "Quat")) else name


def numbers(value: Any) -> Array:
    """Return the numbers of a value of OpenUSD; of a quaternion (w, x, y, z)."""
    if _kind(value) == "Quat":
        return np.array([value.GetReal(), *value.GetImaginary()], dtype=float)
    return np.array(value, dtype=float)


def whole_inertia(prim: Any) -> Array | None:
    """Return the inertia about the centre of mass of the schema NewtonMassAPI, (3, 3); it goes before the diagonal."""
    values = prim.GetAttribute(WHOLE_INERTIA).Get() if prim.HasAttribute(WHOLE_INERTIA) else None
    if values is None or len(values) != 6:
        return None
    xx, yy, zz, xy, xz, yz = map(float, values)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


#: Sizes that a shape has, by the type of its prim.
_SIZES: Final = {
    "Cube": ("size",),
    "Sphere": ("radius",),
    "Cylinder": ("radius", "height"),
    "Capsule": ("radius", "height"),
    "Cone": ("radius", "height"),
}

#: Largest difference of scales that are one, and of directions that are at right angles.
_SAME: Final = 1e-5


def shape_of(prim: Any, matrix: Array, length: float, place: Place) -> Shape | None:
    """Return the shape of a prim, the box around it where it is stretched or of another kind; None where it has none.

    Args:
        prim: The prim.
        matrix: Its transform to the frame of its body, a row of coordinates times the matrix, shape (4, 4).
        length: m in the unit of the stage.
        place: Where it stands, for messages.

    Raises:
        DescriptionError: A size that is no length, or points that are no numbers.
    """
    found, scales = _half_sizes(prim, place), np.linalg.norm(matrix[:3, :3], axis=1)
    if found is None or not (np.all(np.isfinite(matrix)) and np.all(scales > 0.0)):
        return None
    middle, half, along = found
    directions = (matrix[:3, :3] / scales[:, None]).T
    centre = (middle @ matrix[:3, :3] + matrix[3, :3]) * length
    if np.abs(directions.T @ directions - np.eye(3)).max() > _SAME:  # sheared: the box about its corners
        return Box(2.0 * length * half @ np.abs(matrix[:3, :3]), np.eye(3), centre)
    if np.linalg.det(directions) < 0.0:
        directions = directions * [1.0, 1.0, -1.0]  # mirrored: each shape is symmetric
    size = half * scales * length
    round_one = _round(str(prim.GetTypeName()), size, along, (directions, centre))
    return round_one or Box(2.0 * size, directions, centre)


def _round(kind: str, size: Array, along: int, pose: tuple[Array, Array]) -> Shape | None:
    """Return the sphere, cylinder or capsule of half lengths ``size`` (3,); None where it is none or stretched."""
    (directions, centre), across = pose, np.delete(size, along)
    if np.ptp(across) > _SAME * across.max() or (kind == "Sphere" and np.ptp(size) > _SAME * size.max()):
        return None
    turn, radius = np.roll(directions, 2 - along, axis=1), float(across.mean())
    if kind == "Sphere":
        return Sphere(radius, centre)
    if kind == "Cylinder":
        return Cylinder(radius, 2.0 * float(size[along]), turn, centre)
    reach = max(float(size[along]) - radius, 0.0) * turn[:, 2]
    return Capsule(centre - reach, centre + reach, radius) if kind == "Capsule" else None


def _half_sizes(prim: Any, place: Place) -> tuple[Array, Array, int] | None:
    """Return middle and half lengths (3,) of the box around a prim in its own frame, and the number of its axis."""
    kind = str(prim.GetTypeName())
    if kind in ("Mesh", "Points"):
        points = np.array(prim.GetAttribute("points").Get() or np.zeros((0, 3)), dtype=float)
        if not len(points):
            return None
        if not np.all(np.isfinite(points)):
            raise place.error("points that are no numbers", "export the mesh again")
        low, high = points.min(axis=0), points.max(axis=0)
        half = (high - low) / 2.0
        return ((low + high) / 2.0, np.maximum(half, _SAME * half.max()), 2) if half.any() else None
    if kind not in _SIZES:
        return None
    sizes = [float(prim.GetAttribute(name).Get()) for name in _SIZES[kind]]
    if not all(0.0 < size < np.inf for size in sizes):
        told = ", ".join(f"{name} {size:g}" for name, size in zip(_SIZES[kind], sizes, strict=True))
        raise place.error(f"its {told} is no length", "write lengths above 0")
    if kind == "Cube":
        return np.zeros(3), np.full(3, sizes[0] / 2.0), 2
    if kind == "Sphere":
        return np.zeros(3), np.full(3, sizes[0]), 2
    letter = str(prim.GetAttribute("axis").Get())
    if letter not in ("X", "Y", "Z"):
        raise place.error(f"its axis is '{letter}'", "write X, Y or Z")
    along = "XYZ".index(letter)
    half = np.full(3, sizes[0])
    half[along] = sizes[1] / 2.0 + (sizes[0] if kind == "Capsule" else 0.0)
    return np.zeros(3), half, along
