"""What every exporter is, of motions and of models: a target that says what it writes and how that is proved."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Generic, TypeVar

from dynident.errors import FileError
from dynident.files import check_place, write_atomically

#: What is exported, and its files with what is known about them.
Subject = TypeVar("Subject")
Files = TypeVar("Files")


@dataclass(frozen=True)
class Proof:
    """What one engine made of the files.

    Attributes:
        engine: Its name with its version.
        what: What was compared.
        states: Number of states or samples; 0 where the engine was not asked.
        difference: Largest difference, of a torque in N m or N, or of a position in rad or m; None where the engine
            was not asked.
        relative: Largest difference over the largest value of its joint; None where the engine was not asked.
        why_not: Why the engine was not asked; empty where it was.
        allowed: Largest relative difference with which files are written.
    """

    engine: str
    what: str
    states: int
    difference: float | None
    relative: float | None
    why_not: str
    allowed: float


class Exporter(ABC, Generic[Subject, Files]):
    """A frozen dataclass whose fields are its options; its methods write nothing and keep nothing.

    Attributes:
        takes: What it exports: ``plan`` or ``estimate``.
        suffix: Ending of the name of its first file, with the dot; empty where any name will do, and for a folder.
        writes_folder: Whether it writes a folder in place of files.
        extra: Extra of dynident without which it writes nothing, as in ``pip install 'dynident[EXTRA]'``; empty for
            none.
        proof: What is compared when its files are loaded again, and by which engines.
    """

    takes: ClassVar[str]
    suffix: ClassVar[str]
    writes_folder: ClassVar[bool] = False
    extra: ClassVar[str] = ""
    proof: ClassVar[str]

    @abstractmethod
    def content(self, subject: Subject, path: Path) -> Files:
        """Return the files for a subject, the first of them at ``path``.

        Raises:
            DynidentError: The subject does not fit the target.
        """

    @abstractmethod
    def prove(self, subject: Subject, content: Files, path: Path) -> tuple[Proof, ...]:
        """Load files that are not written yet again, and compare what they hold with the subject.

        Args:
            subject: What was exported.
            content: What :meth:`content` gave.
            path: The file that the user named.

        Raises:
            FileError: They cannot be loaded, or hold something else.
        """


def write_files(files: Mapping[Path, bytes], target: Path) -> None:
    """Write all files of an export, all or none that could be refused beforehand, each of them whole.

    Args:
        files: Bytes by place.
        target: What the user named: the first file, or the folder of all, which is made and holds nothing else.

    Raises:
        FileError: A place where no file can be, or a folder with something else in it.
    """
    inside = [file for file in files if target in file.parents]
    if inside:
        known = {file.name for file in inside}
        if target.exists() and (not target.is_dir() or {entry.name for entry in target.iterdir()} - known):
            raise FileError(target, "there is something else already", "choose a new folder")
        if not target.parent.is_dir():
            raise FileError(target, f"there is no folder '{target.parent}'", "create it or choose another place")
        try:
            target.mkdir(exist_ok=True)
        except OSError as error:
            raise FileError(target, f"cannot be made ({error.strerror})", "choose another place") from error
    for file in files:
        check_place(file)
    for file, data in files.items():
        write_atomically(file, data)
