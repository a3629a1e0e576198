"""Names in exported files: what robot descriptions and XML can hold, and no two alike."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from dynident.errors import BadOption


def checked_names(what: str, names: Sequence[str]) -> list[str]:
    """Return names that can stand in XML, each once.

    Raises:
        BadOption: An empty name, characters that cannot be printed, or two alike.
    """
    check_printable(what, names)
    for name in names:
        if names.count(name) > 1:
            raise BadOption(what, name, f"two have this name; give each {what} a name of its own")
    return list(names)


def check_printable(what: str, names: Sequence[str]) -> None:
    """Refuse names that no reader of a robot description takes.

    Raises:
        BadOption: An empty name, or characters that cannot be printed.
    """
    for name in names:
        if not name.strip() or not name.isprintable():
            raise BadOption(what, name, "rename it in the robot description: it must be plain text of one line")


def unused_name(name: str, taken: Collection[str]) -> str:
    """Return the name, with a number behind it where it is taken."""
    found, number = name, 2
    while found in taken:
        found, number = f"{name}_{number}", number + 1
    return found
