"""Mesh files of a robot model: where they are, which are missing, and their points.

They are found beneath stated folders only, those of ROS packages too; STL and MSH are read here, others by the loader
of coal.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath, PurePosixPath
from typing import Final

import numpy as np

from dynident.arrays import Array
from dynident.errors import FileError, MissingDependency
from dynident.files import read_at_most, resolved
from dynident.model.robot import Robot
from dynident.model.shapes import Mesh
from dynident.robot_files.ros_packages import package_folder, places_searched
from dynident.robot_files.xacro import split_arguments

#: Largest mesh file that is read, in bytes.
MAX_BYTES: Final = 100_000_000

#: Number of directions in which the outermost points of a mesh are taken: neighbours are about 5 degrees apart.
DIRECTIONS: Final = 1000

_SCHEME: Final = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+)://(.*)", re.DOTALL)
_BINARY_HEAD, _BINARY_FACE = 84, 50


def mesh_points(mesh: Mesh, folders: Sequence[str | Path]) -> Array:
    """Return the points of a mesh, each once, scaled, in the mesh's own frame, shape (k, 3), in m.

    Raises:
        FileError: Not beneath a folder, not readable, too large, or no sound mesh.
        MissingDependency: Neither STL, nor coal (which comes with pin) installed.
    """
    return np.unique(mesh_triangles(mesh, folders).reshape(-1, 3), axis=0)


def outermost(points: Array) -> Array:
    """Return those of points (k, 3) that are furthest in one of many directions, shape (m, 3).

    Directions of a Fibonacci lattice (Gonzalez 2010): their hull is that of all points but for 0.2 % of its extent.
    """
    turn = np.arange(DIRECTIONS) + 0.5
    height, angle = 1.0 - 2.0 * turn / DIRECTIONS, np.pi * (1.0 + np.sqrt(5.0)) * turn
    across = np.sqrt(1.0 - height**2)
    directions = np.stack([across * np.cos(angle), across * np.sin(angle), height])
    furthest = [np.argmax(points @ part, axis=0) for part in np.array_split(directions, 20, axis=1)]
    return points[np.unique(np.concatenate(furthest))]


def mesh_triangles(mesh: Mesh, folders: Sequence[str | Path]) -> Array:
    """Return the corners of the triangles of a mesh, shape (k, 3, 3); else as :func:`mesh_points`."""
    file = mesh_file(mesh.file, folders)
    data = read_at_most(file, MAX_BYTES, "simplify the mesh")
    own = {".stl": _stl, ".msh": _msh}.get(file.suffix.lower())
    corners = own(file, data) if own else _by_coal(file)
    if not len(corners) or not np.all(np.isfinite(corners)):
        raise FileError(file, "it has no points, or points that are no numbers", "export the mesh again")
    return corners[: len(corners) // 3 * 3].reshape(-1, 3, 3) * mesh.scale


def mesh_file(name: str, folders: Sequence[str | Path]) -> Path:
    """Return where a mesh file is: beneath one of the folders, links followed, and nowhere else.

    ``package://NAME/REST`` is REST in a folder called NAME, NAME/REST in any folder, or REST in any, as the folder of a
    package may have another name. A relative name is looked for in each folder. An absolute name and ``file://`` count
    only where they point beneath a folder.

    Raises:
        FileError: No such file there, or a name that leads out of all folders.
    """
    roots = [resolved(folder) for folder in folders]
    for candidate in _candidates(name, roots):
        real = resolved(candidate)
        if any(real.is_relative_to(root) for root in roots) and real.is_file():
            return real
    where = ", ".join(str(folder) for folder in folders) or "no folder at all"
    step = "name the folder that holds it (the package's, for package://) under workspace.mesh_folders"
    raise FileError(name, f"no such mesh file beneath {where}", step)


def _candidates(name: str, roots: Sequence[Path]) -> list[Path]:
    """Return the places that a name may stand for."""
    if "\0" in name:
        return []
    scheme = _SCHEME.fullmatch(name)
    if scheme is None:
        return [root / name for root in roots]
    kind, rest = scheme[1].lower(), scheme[2]
    if kind == "file":
        return [Path(rest)]
    if kind not in ("package", "model"):
        return []
    parts = PurePosixPath(rest).parts
    inner = [(root / Path(*parts[1:]), root.name == parts[0]) for root in roots if parts]
    named = [path for path, is_named in inner if is_named]
    return [*named, *(root / rest.lstrip("/") for root in roots), *(path for path, _ in inner)]


def _stl(file: Path, data: bytes) -> Array:
    """Return the corners of the triangles of an STL file, binary or text, shape (3 k, 3)."""
    faces = int.from_bytes(data[80:_BINARY_HEAD], "little") if len(data) >= _BINARY_HEAD else -1
    if len(data) == _BINARY_HEAD + _BINARY_FACE * faces:
        table = np.frombuffer(data, dtype=np.uint8, offset=_BINARY_HEAD).reshape(faces, _BINARY_FACE)
        corners = np.ascontiguousarray(table[:, 12:48]).view("<f4").reshape(-1, 3).astype(float)
    elif data.lstrip()[:5].lower() == b"solid":
        words = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", data)
        try:
            corners = np.array(words, dtype=float).reshape(-1, 3)
        except ValueError as problem:
            raise FileError(file, f"a vertex is no three numbers ({problem})", "export the mesh again") from problem
    else:
        evidence = f"its {len(data)} bytes are no STL of {faces} facets" if faces >= 0 else "it is no STL"
        raise FileError(file, evidence, "export the mesh again, as binary STL")
    return corners


def _msh(file: Path, data: bytes) -> Array:
    """Return the corners of MuJoCo's binary format, (3 k, 3): counts of points, normals, textures, faces; then them."""
    counts = np.frombuffer(data[:16], "<i4").tolist() if len(data) >= 16 else [-1]
    if min(counts) < 0 or len(data) != 16 + 4 * np.dot(counts, (3, 3, 2, 3)):
        raise FileError(file, f"its {len(data)} bytes are no MSH of MuJoCo", "export the mesh again, as binary STL")
    corners = np.frombuffer(data, "<i4", offset=len(data) - 12 * counts[3])
    if not np.all((corners >= 0) & (corners < counts[0])):
        raise FileError(file, "a face has a corner that is no vertex", "export the mesh again, as binary STL")
    return np.frombuffer(data, "<f4", 3 * counts[0], 16).reshape(-1, 3)[corners].astype(float)


def _by_coal(file: Path) -> Array:
    try:
        import coal  # pyright: ignore[reportMissingImports]
    except ImportError as problem:
        raise MissingDependency(f"reading the mesh '{file.name}'", "pin", "pin") from problem
    try:
        found = coal.MeshLoader().load(str(file))
        rows = [[found.tri_indices(k)[j] for j in range(3)] for k in range(found.num_tris)]
        points = np.asarray(found.vertices())[rows]
    except Exception as problem:  # assimp's errors come as they like
        reason = str(problem).strip().splitlines() or [type(problem).__name__]
        raise FileError(file, f"it cannot be read as a mesh ({reason[0]})", "export it as STL") from problem
    return np.array(points, dtype=float).reshape(-1, 3)


_PACKAGE: Final = re.compile(r"(?:package|model)://([^/]+)/", re.IGNORECASE)
_LEVELS_UP: Final = 3


@dataclass(frozen=True)
class MissingMesh:
    """A mesh file that is not where the robot model says.

    Attributes:
        link: The link that it belongs to.
        file: Its name in the robot model.
        reason: Why it was not found.
        is_visual: Whether it only shows the link.
    """

    link: str
    file: str
    reason: str
    is_visual: bool = False


def package_folders(robot: Robot, robot_file: str | Path) -> tuple[Path, ...]:
    """Return the folders of the ROS packages that mesh files are named by, where they are found.

    Args:
        robot: The robot.
        robot_file: Its robot model, beside which packages are looked for first.
    """
    near = robot_file if os.path.isfile(robot_file) else None
    names = {match[1] for _, mesh, _ in _meshes(robot) if (match := _PACKAGE.match(mesh.file))}
    found = (package_folder(name, near) for name in sorted(names))
    return tuple(folder for folder in found if folder is not None)


def mesh_places(robot: Robot, robot_path: str) -> tuple[Path, ...]:
    """Return where mesh files are looked for: the folder of the robot model, and the ROS packages that it names.

    Args:
        robot: The robot.
        robot_path: Its robot model, with the arguments of a xacro.
    """
    file, _ = split_arguments(robot_path)
    if not os.path.isfile(file):
        return package_folders(robot, file)
    folder = Path(file).parent
    above = folders_above(folder, [mesh.file for _, mesh, _ in _meshes(robot)])
    return (folder, *above, *package_folders(robot, file))


def folders_above(folder: Path, files: Iterable[str]) -> tuple[Path, ...]:
    """Return the folders of mesh files that are named by a way up from the folder of the robot model (``../meshes/``).

    Up to three levels; absolute names, and ways further up, lead elsewhere. So does ``package://NAME/REST`` to the
    nearest of these folders with REST in it, whatever its name.
    """
    found: dict[Path, None] = {}
    levels = [folder.absolute(), *folder.absolute().parents][: _LEVELS_UP + 1]
    for name in files:
        if (match := _PACKAGE.match(name)) and "\0" not in name and ".." not in name:
            rest = name[match.end() :].lstrip("/")
            found |= dict.fromkeys([each for each in levels if (each / rest).is_file()][:1])
        parts = PurePath(name).parts
        if 0 < parts.count("..") <= _LEVELS_UP and not PurePath(name).is_absolute() and "\0" not in name:
            found[Path(os.path.normpath((folder / name).absolute())).parent] = None
    return tuple(found)


def missing_meshes(robot: Robot, robot_file: str | Path, folders: Sequence[str | Path] = ()) -> list[MissingMesh]:
    """Return the mesh files of a robot that are not there, one by one.

    Args:
        robot: The robot.
        robot_file: Its robot model.
        folders: Further folders that hold meshes.
    """
    roots = [*mesh_places(robot, str(robot_file)), *map(Path, folders)]
    found: dict[tuple[str, str], MissingMesh] = {}
    for link, mesh, is_visual in _meshes(robot):
        if (link, mesh.file) not in found and not _is_there(mesh, roots):
            package = _PACKAGE.match(mesh.file)
            is_known = package is None or package_folder(package[1], robot_file) is not None
            reason = "no such file" if is_known else f"no package {package[1] if package else ''} {places_searched()}"
            found[link, mesh.file] = MissingMesh(link, mesh.file, reason, is_visual)
    return list(found.values())


def mesh_count(robot: Robot) -> int:
    """Return how many mesh files a robot model names."""
    return len({mesh.file for _, mesh, _ in _meshes(robot)})


def _meshes(robot: Robot) -> Iterator[tuple[str, Mesh, bool]]:
    """Yield link and mesh, and whether it only shows the link; those that touch come first."""
    touching = [(robot.base, robot.base_shapes), *((link.name, link.shapes) for link in robot.links)]
    for is_visual, each in ((False, touching), (True, [(link.name, link.visuals) for link in robot.links])):
        for name, shapes in each:
            yield from ((name, shape, is_visual) for shape in shapes if isinstance(shape, Mesh))


def _is_there(mesh: Mesh, roots: Sequence[Path]) -> bool:
    try:
        mesh_file(mesh.file, roots)
    except FileError:
        return False
    return True
