"""The folder of a session: its files by name, uploads within limits, and nothing written outside it.

A file is a robot, a case, a log, a plan, an estimate or a report.
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import count
from pathlib import Path
from typing import BinaryIO

from dynident.errors import DynidentError, FileError
from dynident.files import move_to_new_name, sha256_of, write_atomically

#: Files that a session holds at most.
MAX_FILES = 500

#: Longest name that is kept.
MAX_NAME = 100

#: How often a file that another studio writes is tried again, and the age in s from which it writes no more.
TRIES, LEFT_BEHIND = 100, 30.0

_CHUNK = 1 << 20
#: Signs of a name that is kept.
SAFE = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._+-"

_UNSAFE = re.compile(r"[^A-Za-z0-9._+-]+")
_RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\.|$)")


def safe_name(name: str) -> str:
    """Return the name under which an upload is kept: letters, digits and ``._+-``, no folder, not hidden.

    A name of which nothing is left becomes ``file`` with its suffix.
    """
    last = name.replace("\\", "/").rsplit("/", 1)[-1]
    stem, dot, suffix = last.rpartition(".")
    if not dot:
        stem, suffix = last, ""
    stem = _UNSAFE.sub("_", stem).strip("._-+") or "file"
    suffix = _UNSAFE.sub("", suffix)[:12]
    kept = stem[: MAX_NAME - 13] + (f".{suffix}" if suffix else "")
    return f"file_{kept}" if _RESERVED.match(kept) else kept


def store_of(name: str) -> str:
    """Return the hidden folder that reserves a name, and in which a command writes it until the command is done."""
    return f".{name.split('.', 1)[0]}.reserved"


@dataclass(frozen=True)
class Folder:
    """The files of a session; other sessions and commands may write into the same folder at any time.

    Attributes:
        path: The folder; commands run in it.
        max_bytes: Largest upload, and a quarter of what uploads may take together, in bytes.
    """

    path: Path
    max_bytes: int = 1 << 30
    _mine: set[str] = field(default_factory=set, repr=False)
    _coming: dict[str, int] = field(default_factory=dict, repr=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def names(self) -> tuple[str, ...]:
        """Return the names of the files: ordinary ones, neither hidden nor looking like an option, sorted."""
        with os.scandir(self.path) as entries:
            found = [e.name for e in entries if e.is_file(follow_symlinks=False) and e.name[0] not in ".-"]
        return tuple(sorted(name for name in found if name.isprintable()))

    def listing(self) -> list[dict[str, object]]:
        """Return name, kind, size in bytes and age of every file, the newest first."""
        found = []
        for name in self.names():
            with suppress(FileNotFoundError):  # a command may have taken it away
                facts = (self.path / name).stat()
                kind = kind_of(self.path / name, facts.st_mtime_ns, facts.st_size)
                mine = name in self._mine
                found.append({"name": name, "kind": kind, "size": facts.st_size, "time": facts.st_mtime, "own": mine})
        return sorted(found, key=lambda file: -float(file["time"]))  # type: ignore[arg-type]

    def find(self, name: str) -> Path:
        """Return the place of a file of the session, by its name only.

        Raises:
            FileError: The session has no such file.
        """
        if name not in self.names():
            raise FileError(name[:MAX_NAME], "the session has no such file", "upload it, or choose one of the list")
        return self.path / name

    def reserve(self, stem: str, suffix: str) -> str:
        """Reserve a name that nothing in the folder has yet: the stem, a number and the suffix.

        Links, folders and hidden files count too, and names that go on after the number, such as ``plan_1-old.json``. A
        folder is made for it, which only one session can do; :meth:`release` removes it.

        Raises:
            FileError: Nothing can be written here.
        """
        taken = os.listdir(self.path)
        numbers = count(1)
        while True:
            start = f"{stem}_{next(numbers)}"
            if any(re.match(rf"(?i)\.?{re.escape(start)}([.-]|$)", known) for known in taken):
                continue
            try:
                (self.path / store_of(start)).mkdir()
            except FileExistsError:  # another session was faster
                continue
            except OSError as error:
                evidence = f"cannot be written in ({error.strerror})"
                raise FileError(self.path, evidence, "check its rights and the space left") from error
            return start + suffix

    def receive(self, name: str, stream: BinaryIO, size: int) -> str:
        """Write an upload and return the name it is kept under; a file with that name stays, the new one is numbered.

        Args:
            name: As the browser gives it.
            stream: Where its bytes come from.
            size: How many there are.

        Raises:
            FileError: Too large, too many, or not all of it came.
        """
        partial = self.path / f".{secrets.token_hex(8)}.part"
        with self._lock:
            self._check_room(safe_name(name), size)
            self._coming[partial.name] = size
        try:
            with open(partial, "xb") as out:
                left = size
                while left and (chunk := stream.read(min(left, _CHUNK))):
                    out.write(chunk)
                    left -= len(chunk)
            if left:
                raise FileError(safe_name(name), f"only {size - left} of {size} bytes came", "upload it again")
            names = (one for one in _numbered(safe_name(name)) if not (self.path / store_of(one)).exists())
            with self._lock:
                kept = self._moved(partial, names)
                del self._coming[partial.name]
            return kept
        finally:
            partial.unlink(missing_ok=True)
            self._coming.pop(partial.name, None)

    def write(self, name: str, text: str, before: str) -> None:
        """Write over a text file of the session, where nobody else has written over it meanwhile.

        Args:
            name: The file.
            text: What it says from now on.
            before: SHA-256 of the file that was changed, as hexadecimal digits.

        Raises:
            FileError: No such file, another one by now, or it cannot be written.
        """
        path = self.find(name)
        with self._lock, self._alone(name):
            if sha256_of(path) != before:
                evidence = "it was changed meanwhile, in another tab or by another program"
                raise FileError(name, evidence, "copy your changes, load the page again and make them there")
            write_atomically(path, text)

    @contextmanager
    def _alone(self, name: str) -> Iterator[None]:
        """Keep other studios from writing a file: a hidden folder that only one of them can make."""
        place = self.path / f".{name}.writing"
        for _ in range(TRIES):
            try:
                place.mkdir()
                break
            except FileExistsError:
                with suppress(OSError):
                    if abs(time.time() - place.stat().st_mtime) > LEFT_BEHIND:
                        place.rmdir()  # of a studio that was killed, perhaps before the clock was set back
                time.sleep(0.05)
        else:
            raise FileError(name, "another studio is writing it", "try again")
        try:
            yield
        finally:
            with suppress(OSError):
                place.rmdir()

    def remove(self, name: str) -> None:
        """Remove a file that the session has made or received; those that were there before stay.

        Raises:
            FileError: No such file, or one that was there before.
        """
        if name not in self._mine:
            raise FileError(name[:MAX_NAME], "it was there before the session", "remove it by hand if it is to go")
        self.find(name).unlink(missing_ok=True)
        self._mine.discard(name)

    def keep(self, outputs: tuple[str, ...]) -> dict[str, str]:
        """Give what a command has written its names in the folder, and count it among the files of the session.

        Returns:
            The names by those that the command wrote; another one where the first was taken meanwhile.
        """
        stores = [self.path / store_of(name) for name in outputs]
        written = [file for store in stores for file in sorted(store.iterdir()) if file.name[0] != "."]
        with self._lock:
            return {file.name: self._moved(file, _numbered(file.name)) for file in written}

    def release(self, outputs: Iterable[str]) -> None:
        """Give up the names that were reserved for a command, with all that it has written and that was not kept."""
        for name in outputs:
            shutil.rmtree(self.path / store_of(name), ignore_errors=True)

    def _check_room(self, name: str, size: int) -> None:
        """Refuse an upload that is too much beside those that are here and those that are coming."""
        used = sum(self._coming.values())
        for mine in self._mine & {*self.names()}:
            with suppress(FileNotFoundError):  # a command may have taken it away
                used += (self.path / mine).stat().st_size
        if size > self.max_bytes or used + size > 4 * self.max_bytes:
            evidence = f"{size / 1e6:.1f} MB are too many beside the {used / 1e6:.1f} MB that are here or on the way"
            raise FileError(name, evidence, "start 'dynident studio' with a larger --max-upload, or --work")
        if len(self.names()) + len(self._coming) >= MAX_FILES:
            raise FileError(name, f"the session has {MAX_FILES} files", "remove some")

    def _moved(self, source: Path, names: Iterator[str]) -> str:
        """Move a finished file to the first of some names that nothing has, and return it."""
        taken = {known.lower() for known in os.listdir(self.path)}  # links and folders too
        while True:
            name = next(names)
            if name.lower() in taken:
                continue
            with suppress(FileExistsError):  # written at this moment by another process
                move_to_new_name(source, self.path / name)
                self._mine.add(name)
                return name


def _numbered(name: str) -> Iterator[str]:
    """Return a name, and then the same with numbers before its suffix."""
    stem, dot, suffix = name.rpartition(".")
    if not dot:
        stem, suffix = name, ""
    yield name
    yield from (f"{stem}_{k}{dot}{suffix}" for k in count(2))


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
