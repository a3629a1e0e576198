"""A robot model format: from the bytes of a file to a Robot."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Final

from dynident.model.robot import Robot
from dynident.plugins import Family


class Description(ABC):
    """A format of robot models.

    Attributes:
        suffixes: Endings of its file names, with the dot.
        opening: First visible bytes of every file of the format; empty where it has no mark.
        roots: Names of the first element of an XML file of the format; empty for those that are no XML.
    """

    suffixes: ClassVar[tuple[str, ...]]
    opening: ClassVar[bytes] = b""
    roots: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def read(self, path: object, data: bytes) -> Robot:
        """Return the robot that the bytes of a file describe; ``path`` is what messages call the file.

        Raises:
            DescriptionError: Any fault of the file.
        """

    def included(self, path: object, data: bytes) -> tuple[str, ...]:
        """Return the files that it includes; none, unless a format has includes."""
        return ()


DESCRIPTIONS: Final = Family("dynident.robot_files.formats", Description, "robot model format")
