"""What a file of a session is: a robot, a case, a log, a plan, an estimate, a report."""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path

from dynident.errors import DynidentError

_KIND = re.compile(rb'"kind"\s*:\s*"dynident (estimate|plan|[a-z ]+)"')
_BY_SUFFIX = {".html": "report", ".tri": "triangles", ".stl": "mesh", ".obj": "mesh", ".dae": "mesh"}
_HEAD = 4096


@lru_cache(maxsize=2048)
def kind_of(path: Path, changed: int, size: int) -> str:
    """Return what a file is: robot, case, log, plan, estimate, report, triangles, mesh or other.

    Args:
        path: The file.
        changed: When it was changed, in ns; with the size it tells whether the answer still holds.
        size: Its size in bytes.
    """
    del changed
    suffix = path.suffix.lower()
    if suffix in _BY_SUFFIX:
        return _BY_SUFFIX[suffix]
    if suffix in (".yaml", ".yml"):
        return _of_yaml(path, size)
    with open(path, "rb") as stream:
        head = stream.read(_HEAD)
    if suffix == ".json":
        found = _KIND.search(head)
        word = found.group(1).decode() if found else ""
        return word if word in ("estimate", "plan") else "other"
    if suffix in (".usd", ".usda", ".usdc", ".usdz"):
        return "robot"
    if suffix in (".urdf", ".xacro", ".xml", ".mjcf", ".sdf"):
        return "robot" if any(mark in head for mark in (b"<robot", b"<mujoco", b"<sdf")) else "other"
    return "log" if _is_log(path) else "other"


def _of_yaml(path: Path, size: int) -> str:
    from dynident.robot_files.strict_yaml import MAX_BYTES, load_yaml

    if size > MAX_BYTES:
        return "other"
    try:
        value, _ = load_yaml(path, path.read_bytes())
    except DynidentError:
        return "case" if re.search(rb"(?m)^case\s*:", path.read_bytes()) else "other"
    keys = value.keys() if isinstance(value, dict) else set()
    if "case" in keys:
        return "case"
    return "robot" if {"joints", "links", "format", "convention"} & set(keys) else "other"


def _is_log(path: Path) -> bool:
    from dynident.data.formats import FORMATS

    return any(FORMATS.get(name).takes(path) for name in FORMATS.names())
