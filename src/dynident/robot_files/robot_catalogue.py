"""Robots by the names of the package robot_descriptions, from its cache on this machine: nothing is fetched."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

from dynident.errors import FileError, nearest
from dynident.robot_files.formats.base import DESCRIPTIONS

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
