"""Versions of the files that dynident writes: an older one is migrated as it is read, a newer one is refused."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from dynident.errors import DynidentError

#: The parsed document of a file.
Document = Mapping[str, Any]


@dataclass(frozen=True)
class FileVersions:
    """The versions of one kind of file.

    Attributes:
        name: What the file is called in messages.
        migrations: The first turns the document of version 1 into that of version 2, and so on.
        key: Where the document states its version; one without it is the oldest.
    """

    name: str
    migrations: tuple[Callable[[Document], Document], ...] = ()
    key: str = "format"

    @property
    def current(self) -> int:
        """The version that is written."""
        return len(self.migrations) + 1

    def migrated(self, data: Document, refuse: Callable[[str, str], DynidentError]) -> dict[str, Any]:
        """Return the document as the current version has it.

        Args:
            data: The document, as its file has it.
            refuse: The error to raise, of evidence and next step.

        Raises:
            DynidentError: Of ``refuse``: the file is of a newer version, or states none that can be.
        """
        stated = data.get(self.key)
        version = 1 if stated is None else stated
        if isinstance(stated, str) and stated.isascii() and stated.isdigit() and len(stated) < 10:
            version = int(stated)
        if type(version) is not int or version < 1:
            raise refuse(f"{self.key} {str(stated)[:40]!r} is no version", f"write {self.current}, the current one")
        if version > self.current:
            evidence = f"{self.name} of version {version}; this dynident reads versions up to {self.current}"
            raise refuse(evidence, "update dynident")
        for migration in self.migrations[version - 1 :]:
            data = migration(data)
        return {**data, self.key: self.current}


def renamed(data: Document, names: Mapping[str, str]) -> Document:
    """Return a document with keys renamed; what is not there, or has its new name already, stays as it is.

    Args:
        data: The document; it is not changed.
        names: New name of the last key of each place, such as ``train.joints[].rows``: ``[]`` stands for each item of
            a list, ``*`` for each key.
    """
    for place, name in names.items():
        data = _renamed(data, place.split("."), name)
    return data


def _renamed(value: Any, place: list[str], name: str) -> Any:
    if not isinstance(value, Mapping):
        return value
    first, *rest = place
    key = first.removesuffix("[]")
    if not rest:
        return value if name in value else {name if k == key else k: v for k, v in value.items()}
    found = dict(value)
    for own in found if key == "*" else [key] if key in found else []:
        inner = found[own]
        if key == first:
            found[own] = _renamed(inner, rest, name)
        elif isinstance(inner, list):
            found[own] = [_renamed(item, rest, name) for item in inner]
    return found
