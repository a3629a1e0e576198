"""read_robot: from a file, or the name of a robot that ships, to a Robot."""

from __future__ import annotations

import os
from importlib import resources
from pathlib import Path
from typing import Final

from dynident.errors import DescriptionError, FileError, nearest
from dynident.model.robot import Robot
from dynident.robot_files.formats.base import DESCRIPTIONS, Description
from dynident.robot_files.robot_catalogue import ENDING, catalogued_file

MAX_BYTES: Final = 20_000_000

_SHIPPED: Final = "dynident.robot_files.robots"
_SPACE: Final = b"\xef\xbb\xbf \t\r\n"  # with the byte order mark of UTF-8


def read_robot(path: str | Path) -> Robot:
    """Read a robot model: a URDF, a DH table in YAML, the JSON of dynident, or a robot that ships, by name.

    The format follows from the first visible character (``<`` is XML) and then from the ending of the file name.

    Args:
        path: The file, or a name from :func:`shipped_robots` or of the package robot_descriptions (from its cache,
            such as ``panda_description``); a file of that name goes first.

    Raises:
        FileError: No such file or robot, no regular file, not readable, or larger than 20 MB.
        DescriptionError: A fault in the robot model.
    """
    file = Path(path)
    name = str(path)
    if not os.path.isfile(file) and name in shipped_robots():
        data = (resources.files(_SHIPPED) / f"{name}.yaml").read_bytes()
        return _format(f"{name}.yaml", ".yaml", data).read(f"{name}.yaml", data)
    if name.endswith(ENDING) and not os.path.exists(file):
        path = file = catalogued_file(name)
    data = _bytes(file)
    return _format(path, file.suffix.lower(), data).read(path, data)


def shipped_robots() -> tuple[str, ...]:
    """Return the names of the robots that ship with dynident, sorted; each is a choice for :func:`read_robot`."""
    files = (entry.name for entry in resources.files(_SHIPPED).iterdir())
    return tuple(sorted(name.removesuffix(".yaml") for name in files if name.endswith(".yaml")))


def _bytes(file: Path) -> bytes:
    """Return the bytes of a file of a sane size."""
    if os.path.isdir(file):  # a name too long for the system is none, where Path.is_dir raises before Python 3.12
        raise FileError(file, "it is a folder", "give the robot model file in it")
    if not os.path.exists(file):
        names = shipped_robots()
        step = f"give a file, or a built-in example robot: {', '.join(names)}{nearest(str(file), names)}"
        raise FileError(file, "no such file", step)
    if not os.path.isfile(file):
        raise FileError(file, "it is no regular file", "give a file")
    try:
        with file.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except OSError as problem:
        raise FileError(file, f"it cannot be read ({problem.strerror})", "check its permissions") from problem
    if len(data) > MAX_BYTES:
        raise FileError(file, f"it is larger than {MAX_BYTES // 1_000_000} MB", "give the model of one robot")
    return data


def _format(path: object, suffix: str, data: bytes) -> Description:
    """Return the format of a file, by its first visible bytes and then by its suffix."""
    head = data[:4096].lstrip(_SPACE)
    if not head:
        raise DescriptionError(path, "", "the file is empty", "give a URDF, or a DH table in YAML")
    kinds = [DESCRIPTIONS.get(name) for name in DESCRIPTIONS.names()]
    for kind in kinds:
        if kind.opening and head.startswith(kind.opening):
            return kind()
    for kind in kinds:
        if suffix in kind.suffixes:
            return kind()
    endings = ", ".join(ending for kind in kinds for ending in kind.suffixes)
    step = f"give a file that ends with one of: {endings}"
    raise DescriptionError(path, "", f"a file that ends with '{suffix}' is not known", step)
