"""Where logs are: files, folders of logs, patterns, and addresses of a bucket; each as a file of this machine."""

from __future__ import annotations

import copy
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dynident.data.formats import FORMATS
from dynident.errors import DynidentError, FileError, MissingDependency

_MAGIC = "*?["


def is_address(name: str) -> bool:
    """Return whether a log is not on this machine's file system: ``s3://bucket/run.parquet``, ``https://...``."""
    return "://" in name


def logs_named(names: Sequence[str], find: Callable[[str], Path]) -> tuple[list[str], list[str]]:
    """Return the logs that names stand for, and the files of folders that are no logs.

    A folder stands for the logs in it, in the order of their names, unless a format takes it as one recording; a
    pattern with ``*``, ``?`` or ``[...]`` for the files that match it. A log that is named twice is there twice.

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


@contextmanager
def at_hand(name: str, root: str = "") -> Iterator[Path]:
    """Give a log as a file of this machine; what comes from an address goes when it is no longer needed.

    Args:
        name: File or address.
        root: Folder that the names of files start from.

    Raises:
        FileError: The address cannot be reached.
        MissingDependency: An address, and fsspec is not installed.
    """
    if not is_address(name):
        yield Path(root) / name
        return
    with tempfile.TemporaryDirectory(prefix="dynident-") as folder:
        file = Path(folder) / name.rstrip("/").rpartition("/")[2]
        _reached(name, lambda system, path: system.get(path, str(file)))
        yield file


@contextmanager
def as_named(path: Path, name: str) -> Iterator[None]:
    """Let errors name a log as the user does, not the copy of it."""
    try:
        yield
    except DynidentError as error:
        if str(path) == name:
            raise
        found = copy.copy(error)
        found.args = (str(error).replace(str(path), name),)
        for fact, value in vars(error).items():
            setattr(found, fact, value.replace(str(path), name) if isinstance(value, str) else value)
        raise found from error


def size_of(name: str) -> int:
    """Return the bytes of a log, for telling how far the work is; 0 where they cannot be known."""
    try:
        if is_address(name):
            return int(_reached(name, lambda system, path: system.size(path)) or 0)
        place = Path(name)
        files = [item for item in place.iterdir() if item.is_file()] if place.is_dir() else [place]
        return sum(file.stat().st_size for file in files)
    except (OSError, FileError):
        return 0


def _local(name: str, find: Callable[[str], Path]) -> list[str] | None:
    """Return the files that a folder or a pattern stands for; None for a single log."""
    place = find(name)
    if os.path.isdir(place):
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

    return _reached(name, listed)


def _reached(name: str, ask: Callable[[Any, str], Any]) -> Any:
    """Return what a file system says about an address."""
    try:
        from fsspec.core import url_to_fs  # type: ignore[import-untyped]
    except ImportError as error:
        raise MissingDependency(f"a log at an address ({name})", "fsspec", "dask") from error
    try:
        return ask(*url_to_fs(name))
    except Exception as error:  # each kind of bucket has its own errors
        evidence = f"cannot be reached ({type(error).__name__}: {' '.join(str(error).split())})"
        raise FileError(name, evidence, "check the address, its rights and the package for this kind") from error


def _is_log(name: str) -> bool:
    return any(FORMATS.get(form).takes(name) for form in FORMATS.names())
