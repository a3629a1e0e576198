"""The logs that names stand for: files, folders of logs, patterns, and addresses of a bucket."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from dynident.data.formats import FORMATS
from dynident.data.log_places import is_address, reached
from dynident.errors import FileError

_MAGIC = "*?["


def logs_named(names: Sequence[str], find: Callable[[str], Path]) -> tuple[list[str], list[str]]:
    """Return the logs that names stand for, and the files of folders that are no logs.

    A folder stands for the logs in it, in the order of their names, a data set of LeRobot for those under ``data``,
    unless a format takes it as one recording; a pattern with ``*``, ``?`` or ``[...]`` for the files that match it. A
    log that is named twice is there twice.

    Args:
        names: Files, folders, patterns, addresses.
        find: Where a file is that a case names.

    Raises:
        FileError: A pattern or a folder without logs, or an address that cannot be reached.
        MissingDependency: An address, and fsspec is not installed.
    """
    logs, others = list[str](), list[str]()
    for name in names:
        found = _remote(name) if is_address(name) else _local(name, find)
        if found is None:
            logs.append(name)
            continue
        taken = [one for one in found if _is_log(one)]
        if not taken:
            evidence = f"{len(found)} files, none of which is a log" if found else "there is no log"
            raise FileError(name, evidence, "check the name; 'dynident list formats' shows the suffixes of logs")
        logs += taken
        others += [one for one in found if one not in taken]
    return logs, others


def _local(name: str, find: Callable[[str], Path]) -> list[str] | None:
    """Return the files that a folder or a pattern stands for; None for a single log."""
    place = find(name)
    if os.path.isdir(place):
        if (place / "meta" / "info.json").exists():  # a data set of LeRobot
            return sorted(str(item) for item in place.glob("data/*/*.parquet"))
        return None if _is_log(str(place)) else sorted(str(item) for item in place.iterdir() if item.is_file())
    if os.path.exists(place) or not any(sign in name for sign in _MAGIC):
        return None
    parts = Path(name).parts
    fixed = next(k for k, part in enumerate(parts) if any(sign in part for sign in _MAGIC))
    root = find(str(Path(*parts[:fixed]))) if fixed else find(".")
    return sorted(str(item) for item in root.glob(str(Path(*parts[fixed:]))))


def _remote(name: str) -> list[str] | None:
    """Return the addresses that a folder or a pattern of a bucket stands for; None for a single log."""

    def listed(system: Any, path: str) -> list[str] | None:
        if any(sign in path for sign in _MAGIC):
            return sorted(system.unstrip_protocol(one) for one in system.glob(path))
        if not system.isdir(path):
            return None
        return sorted(system.unstrip_protocol(one["name"]) for one in system.ls(path) if one["type"] == "file")

    return reached(name, listed)


def _is_log(name: str) -> bool:
    return any(FORMATS.get(form).takes(name) for form in FORMATS.names())
