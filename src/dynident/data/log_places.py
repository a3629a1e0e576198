"""Where logs are: files, and addresses of a bucket; each as a file of this machine."""

from __future__ import annotations

import copy
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dynident.errors import DynidentError, FileError, MissingDependency


def is_address(name: str) -> bool:
    """Return whether a log is not on this machine's file system: ``s3://bucket/run.parquet``, ``https://...``."""
    return "://" in name


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
        reached(name, lambda system, path: system.get(path, str(file)))
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
            return int(reached(name, lambda system, path: system.size(path)) or 0)
        place = Path(name)
        files = [item for item in place.iterdir() if item.is_file()] if place.is_dir() else [place]
        return sum(file.stat().st_size for file in files)
    except (OSError, FileError):
        return 0


def reached(name: str, ask: Callable[[Any, str], Any]) -> Any:
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
