"""The folder of a session: its files by name, uploads within limits, and nothing written outside it."""

from __future__ import annotations

import os
import re
import secrets
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from dynident.errors import FileError
from dynident.files import write_atomically
from dynident.studio.kinds import kind_of

#: Files that a session holds at most.
MAX_FILES = 500

#: Longest name that is kept.
MAX_NAME = 100

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


def _made_by(outputs: tuple[str, ...]) -> re.Pattern[str]:
    """Return what matches the names of files that a command with these outputs may write, hidden parts of them too."""
    stems = "|".join(re.escape(name.split(".", 1)[0]) for name in outputs)
    return re.compile(rf"(?i)\.?({stems})([.-]|$)")


@dataclass(frozen=True)
class Folder:
    """The files of a session.

    Attributes:
        path: The folder; commands run in it.
        max_bytes: Largest upload, and a quarter of what uploads may take together, in bytes.
    """

    path: Path
    max_bytes: int = 1 << 30
    _mine: set[str] = field(default_factory=set, repr=False)

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

    def fresh(self, stem: str, suffix: str) -> str:
        """Return a name that nothing in the folder has yet: the stem, a number and the suffix.

        Links, folders and hidden files count too, and names that go on after the number, such as ``plan_1-old.json``:
        a command writes through a link, and what it leaves is known by this name.
        """
        taken = (*os.listdir(self.path), *self._mine)
        number = next(k for k in range(1, 10_000) if not any(map(_made_by((f"{stem}_{k}",)).match, taken)))
        self._mine.add(f"{stem}_{number}{suffix}")
        return f"{stem}_{number}{suffix}"

    def receive(self, name: str, stream: BinaryIO, size: int) -> str:
        """Write an upload and return the name it is kept under; a file with that name stays, the new one is numbered.

        Args:
            name: As the browser gives it.
            stream: Where its bytes come from.
            size: How many there are.

        Raises:
            FileError: Too large, too many, or not all of it came.
        """
        used = sum((self.path / mine).stat().st_size for mine in self.names() if mine in self._mine)
        if size > self.max_bytes or used + size > 4 * self.max_bytes:
            evidence = f"{size / 1e6:.1f} MB are too many beside the {used / 1e6:.1f} MB that are here"
            raise FileError(safe_name(name), evidence, "start 'dynident studio' with a larger --max-upload, or --work")
        if len(self.names()) >= MAX_FILES:
            raise FileError(safe_name(name), f"the session has {MAX_FILES} files", "remove some")
        kept = self._free(safe_name(name))
        partial = self.path / f".{secrets.token_hex(8)}.part"
        try:
            with open(partial, "xb") as out:
                left = size
                while left and (chunk := stream.read(min(left, _CHUNK))):
                    out.write(chunk)
                    left -= len(chunk)
            if left:
                raise FileError(kept, f"only {size - left} of {size} bytes came", "upload it again")
            os.replace(partial, self.path / kept)
        finally:
            partial.unlink(missing_ok=True)
        self._mine.add(kept)
        return kept

    def write(self, name: str, text: str) -> None:
        """Write over a text file of the session.

        Raises:
            FileError: No such file, or it cannot be written.
        """
        write_atomically(self.find(name), text)

    def remove(self, name: str) -> None:
        """Remove a file that the session has made or received; those that were there before stay.

        Raises:
            FileError: No such file, or one that was there before.
        """
        if name not in self._mine:
            raise FileError(name[:MAX_NAME], "it was there before the session", "remove it by hand if it is to go")
        self.find(name).unlink()
        self._mine.discard(name)

    def made_by(self, outputs: tuple[str, ...]) -> tuple[str, ...]:
        """Return the files that a command has made: its outputs and what it wrote beside them, whole or in part."""
        mine = _made_by(outputs)
        with os.scandir(self.path) as entries:
            return tuple(e.name for e in entries if e.is_file(follow_symlinks=False) and outputs and mine.match(e.name))

    def keep(self, outputs: tuple[str, ...]) -> None:
        """Count what a command has made among the files of the session."""
        self._mine.update(self.made_by(outputs))

    def discard(self, outputs: tuple[str, ...]) -> None:
        """Remove what a command that was broken off has left; its outputs had names that no other file has."""
        for name in self.made_by(outputs):
            (self.path / name).unlink(missing_ok=True)
            self._mine.discard(name)

    def _free(self, name: str) -> str:
        taken = {known.lower() for known in os.listdir(self.path)}  # links and folders too
        if name.lower() not in taken:
            return name
        stem, dot, suffix = name.rpartition(".")
        if not dot:
            stem, suffix = name, ""
        numbers = (f"{stem}_{k}{dot}{suffix}" for k in range(2, 10_000))
        return next(one for one in numbers if one.lower() not in taken)
