"""Folders of ROS packages: beside a file, in the places of ROS 2 (ament) and of ROS 1.

Sources: the package path of ROS 1 (``ROS_PACKAGE_PATH``: each entry is a package or is searched for some) and the
install prefixes of ROS 2 (``AMENT_PREFIX_PATH``: a package NAME is PREFIX/share/NAME). A package is a folder with
``package.xml``, which states its name.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

#: What states the name of a package, and files by which a folder is passed over.
MANIFEST: Final = "package.xml"
_IGNORED: Final = ("CATKIN_IGNORE", "COLCON_IGNORE", "AMENT_IGNORE", "rospack_nosubdirs")

#: Levels below an entry of the package path, and folders in all, that are searched.
_DEPTH, _FOLDERS = 6, 20_000

#: In the folder of installed packages: files that are called as they are, whatever their manifests state.
_INDEX: Final = "ament_index/resource_index/packages"

#: Folders above a file that may be its package by their name alone, without a manifest.
_BARE_LEVELS: Final = 3

_NAME: Final = re.compile(r"<name>\s*([^<\s]+)\s*</name>")
_VALID: Final = re.compile(r"[A-Za-z][A-Za-z0-9_.-]*")


def package_folder(name: str, near: str | Path | None = None) -> Path | None:
    """Return the folder of a ROS package, or None.

    Looked for, in this order: the folders that hold the file ``near``, and the packages beside these; the prefixes of
    ``AMENT_PREFIX_PATH``; the entries of ``ROS_PACKAGE_PATH``.

    Args:
        name: Name of the package.
        near: A file, such as the robot model that names the package.
    """
    if not _VALID.fullmatch(name):
        return None
    places = (*_around(name, near), *_installed(name), *_on_package_path(name))
    return next(iter(places), None)


def places_searched() -> str:
    """Return where packages are looked for, in words for a message."""
    stated = [
        f"{variable} ({os.environ.get(variable) or 'not set'})"
        for variable in ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH")
    ]
    return f"beside the file or in {' or '.join(stated)}"


def _around(name: str, near: str | Path | None) -> Iterator[Path]:
    """Yield the package among the folders that hold a file, then those beside them."""
    if near is None:
        return
    holders = Path(os.path.abspath(near)).parents
    for level, folder in enumerate(holders):
        is_called = folder.name == name and (level < _BARE_LEVELS or os.path.isfile(folder.parent / _INDEX / name))
        if is_called or _is_package(folder, name):
            yield folder
    for folder in holders:
        if _is_package(folder / name, name):
            yield folder / name


def _installed(name: str) -> Iterator[Path]:
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        folder = Path(prefix) / "share" / name
        if os.path.isfile(folder / MANIFEST) or (
            os.path.isdir(folder) and os.path.isfile(folder.parent / _INDEX / name)
        ):
            yield folder


def _on_package_path(name: str) -> Iterator[Path]:
    entries = list(filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)))
    for entry in entries:
        for folder in (Path(entry), Path(entry) / name):
            if _is_package(folder, name):
                yield folder
    for entry in entries:  # packages that are not called as their folder, or stand deeper
        yield from (folder for folder in _packages_below(entry) if _is_package(folder, name))


def _packages_below(entry: str) -> Iterator[Path]:
    """Yield the packages below a folder; none of them holds another."""
    count = 0
    depth = len(Path(entry).parts)
    for place, folders, files in os.walk(entry):
        count += 1
        is_package = MANIFEST in files
        if is_package:
            yield Path(place)
        if is_package or set(_IGNORED) & set(files) or len(Path(place).parts) - depth >= _DEPTH or count > _FOLDERS:
            folders.clear()
        else:
            folders[:] = sorted(folder for folder in folders if not folder.startswith("."))


def _is_package(folder: Path, name: str) -> bool:
    """Return whether a folder is the package of a name, by its manifest."""
    try:
        with (folder / MANIFEST).open(encoding="utf-8", errors="replace") as stream:
            stated = _NAME.search(stream.read(100_000))
    except OSError:
        return False
    return stated is not None and stated[1] == name
