"""read_robot: from a file, or the name of a robot, to a Robot.

A name is that of a robot that ships, or of the package robot_descriptions, read from its cache on this machine: nothing
is fetched.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, Final

from dynident.errors import BadOption, DescriptionError, FileError, nearest
from dynident.files import read_at_most
from dynident.model.robot import Robot
from dynident.robot_files.formats.base import DESCRIPTIONS, Description
from dynident.robot_files.tree import without_placeholders
from dynident.robot_files.xacro import expand, is_xacro, split_arguments

MAX_BYTES: Final = 20_000_000

_SHIPPED: Final = "dynident.robot_files.robots"
#: The first element, behind the declaration, comments and processing instructions.
_FIRST: Final = re.compile(
    rb"[\xef\xbb\xbf\xff\xfe\s]*(?:<\?.*?\?>\s*|<!--.*?-->\s*|<![^>]*>\s*)*<([A-Za-z_][^\s/>]*)", re.DOTALL
)
_SPACE: Final = b"\xef\xbb\xbf \t\r\n"  # with the byte order mark of UTF-8


def read_robot(path: str | Path) -> Robot:
    """Read a robot model: a URDF, MJCF, SDF or USD, a DH table, JSON, or a robot that ships, by name.

    The format follows from the first visible character (``<`` is XML) and then from the ending of the file name. Macros
    of xacro are expanded by the package xacro (extra ``xacro``).

    Args:
        path: The file, a xacro with its arguments as ``arm.urdf.xacro NAME:=VALUE ...``, or a name from
            :func:`shipped_robots` or of the package robot_descriptions (from its cache, such as
            ``panda_description``); a file of that name goes first.

    Raises:
        FileError: No such file or robot, no regular file, not readable, or larger than 20 MB.
        DescriptionError: A fault in the robot model.
        BadOption: Arguments of a file that is no xacro.
        MissingDependency: A xacro, and the package xacro is not installed.
    """
    name = str(path)
    if not os.path.isfile(name) and name in shipped_robots():
        data = (resources.files(_SHIPPED) / f"{name}.yaml").read_bytes()
        return _format(f"{name}.yaml", ".yaml", data).read(f"{name}.yaml", data)
    found = robot_text(path)
    robot = _format(found.called, found.path.suffix.lower(), found.data).read(found.called, found.data)
    robot = without_placeholders(robot)
    return replace(robot, note="; ".join([robot.note, *found.notes])) if found.notes else robot


@dataclass(frozen=True)
class RobotText:
    """The bytes of a robot model, macros expanded.

    Attributes:
        path: Its file.
        data: Its bytes; of a xacro those of the URDF that it stands for.
        called: What messages call it.
        is_expanded: Whether it is a xacro.
        files: What that includes.
        notes: Warnings of xacro.
    """

    path: Path
    data: bytes
    called: str
    is_expanded: bool = False
    files: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def robot_text(path: str | Path) -> RobotText:
    """Return the bytes of a robot model, named as for :func:`read_robot`, errors as there; no built-in robots."""
    name, arguments = split_arguments(str(path))
    entry = CataloguedFile(Path(name))
    if name.endswith(ENDING) and not os.path.exists(name):
        entry = catalogued_file(name)
    data = _bytes(entry.path)
    if is_xacro(entry.path, data):
        done = expand(entry.path, {**entry.arguments, **arguments}, entry.packages)
        return RobotText(entry.path, done.data, f"{entry.path} (expanded)", True, done.files, done.notes)
    if arguments:
        raise BadOption("robot", str(path), f"{name} is no xacro: it has no arguments")
    return RobotText(entry.path, data, str(entry.path))


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
    return read_at_most(file, MAX_BYTES, "give the model of one robot")


def format_name(path: object, data: bytes) -> str:
    """Return the name of the format of a file, such as ``urdf`` or ``mjcf``.

    Raises:
        DescriptionError: It is empty or of no format that is known.
    """
    return DESCRIPTIONS.name_of(format_of(path, data))


def format_of(path: object, data: bytes) -> Description:
    """Return the format of a file; errors as of :func:`format_name`."""
    return _format(path, Path(str(path)).suffix.lower(), data)


def _format(path: object, suffix: str, data: bytes) -> Description:
    """Return the format of a file, by its first visible bytes and then by its suffix."""
    head = data[:4096].lstrip(_SPACE)
    if not head:
        raise DescriptionError(path, "", "the file is empty", "give a URDF, MJCF, SDF or xacro, or a DH table in YAML")
    kinds = [DESCRIPTIONS.get(name) for name in DESCRIPTIONS.names()]
    if head.startswith(b"<"):
        return _xml_format(kinds, suffix, data)()
    for kind in kinds:
        if kind.opening and head.startswith(kind.opening):
            return kind()
    for kind in kinds:
        if suffix in kind.suffixes:
            return kind()
    endings = ", ".join(ending for kind in kinds for ending in kind.suffixes)
    step = f"give a file that ends with one of: {endings}"
    raise DescriptionError(path, "", f"a file that ends with '{suffix}' is not known", step)


def _xml_format(kinds: Sequence[type[Description]], suffix: str, data: bytes) -> type[Description]:
    """Return the format of an XML file by its first element, else by its suffix, else URDF."""
    found = _FIRST.match(data.replace(b"\0", b"") if data[:2] in (b"\xff\xfe", b"\xfe\xff") else data)
    root = found.group(1).decode("utf-8", "replace") if found else ""
    xml = [kind for kind in kinds if kind.roots]
    named = [kind for kind in xml if root in kind.roots] or [kind for kind in xml if suffix in kind.suffixes]
    return next(iter(named or [kind for kind in xml if "robot" in kind.roots]))


#: How the names of the package end.
ENDING = "_description"

#: Imports a module of the package, which would clone its repository where the cache has none; prints the files.
_LOOK = """
import json, os, shutil, sys
import git
def refuse(*_, **__): raise FileNotFoundError("not in the cache")
git.Repo.init = git.Repo.clone_from = os.makedirs = shutil.rmtree = refuse  # the cache stays as it is
module = __import__("robot_descriptions." + sys.argv[1], fromlist=["REPOSITORY_PATH"])
names = ("URDF_PATH", "XACRO_PATH", "XACRO_ARGS", "XACRO_PACKAGE_PATHS", "MJCF_PATH")
print("\\n" + json.dumps({name: getattr(module, name, "") for name in names}))
"""


@dataclass(frozen=True)
class CataloguedFile:
    """A file in the cache of robot_descriptions.

    Attributes:
        path: The file.
        arguments: Arguments of a xacro file.
        packages: Folders of the ROS packages that it names.
    """

    path: Path
    arguments: Mapping[str, str] = field(default_factory=dict)
    packages: Mapping[str, str] = field(default_factory=dict)


def catalogued_file(name: str) -> CataloguedFile:
    """Return the URDF, xacro or MJCF that the package robot_descriptions has of a robot in its cache.

    The cache is the folder ``ROBOT_DESCRIPTIONS_CACHE``, else ``~/.cache/robot_descriptions``.

    Args:
        name: Name of the module, such as ``panda_description``.

    Raises:
        FileError: The package is not installed, has no such robot or no file of it, or its cache does not have it.
    """
    spec = find_spec("robot_descriptions")
    if spec is None:
        evidence = "there is no such file, and the package robot_descriptions, which has names like this, is missing"
        raise FileError(name, evidence, f"give a file, or: pip install robot_descriptions; {_pull(name)}")
    known = [entry.name for entry in iter_modules(spec.submodule_search_locations) if entry.name.endswith(ENDING)]
    if name not in known:
        evidence = f"neither a file nor one of the {len(known)} robots of robot_descriptions"
        raise FileError(name, evidence, f"list them with: robot_descriptions list{nearest(name, known)}")
    offline = {**os.environ, "GIT_ALLOW_PROTOCOL": "none"}  # a clone of another commit would be fetched anew
    command = [sys.executable, "-c", _LOOK, name]
    import subprocess  # loads slowly, and few robots are named

    done = subprocess.run(command, capture_output=True, text=True, env=offline, check=False)
    if done.returncode:
        evidence = "the cache of robot_descriptions does not have this robot at its commit"
        raise FileError(name, evidence, f"fetch it with: {_pull(name)}")
    files: dict[str, Any] = json.loads(done.stdout.rsplit("\n", 2)[-2])
    if files["URDF_PATH"]:
        return CataloguedFile(Path(files["URDF_PATH"]))
    if files["XACRO_PATH"]:
        arguments = {key: str(value) for key, value in (files["XACRO_ARGS"] or {}).items()}
        return CataloguedFile(Path(files["XACRO_PATH"]), arguments, files["XACRO_PACKAGE_PATHS"] or {})
    if files["MJCF_PATH"] and "mjcf" in DESCRIPTIONS.names():
        return CataloguedFile(Path(files["MJCF_PATH"]))
    step = f'in Python, with MuJoCo: di.robot_of(mujoco.MjModel.from_xml_path("{files["MJCF_PATH"]}"))'
    raise FileError(name, "robot_descriptions has it as MJCF, not as URDF", step)


def _pull(name: str) -> str:
    return f"robot_descriptions pull {name}"
