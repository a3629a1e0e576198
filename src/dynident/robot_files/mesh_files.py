"""Where the mesh files of a robot model are: folders of the ROS packages that it names, and which files are missing."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Final

from dynident.errors import FileError
from dynident.model.robot import Robot
from dynident.model.shapes import Mesh
from dynident.robot_files.meshes import mesh_file
from dynident.robot_files.ros_packages import package_folder, places_searched
from dynident.robot_files.xacro import split_arguments

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
