"""What the names of a C source begin with: the prefix that was asked for, or one made of the file's name."""

from __future__ import annotations

import re
from pathlib import Path

from dynident.errors import BadOption

_PREFIX = re.compile(r"[a-z][a-z0-9]*(?:_[a-z0-9]+)*")

#: Longest prefix: with it every name stays within the 63 signs that C99 compilers tell apart.
LONGEST = 30


def check_names(prefix: str, velocity_scale: float) -> None:
    """Refuse options that no C source can have.

    Raises:
        BadOption: A prefix that is no name, or a speed that is none.
    """
    if prefix and (not _PREFIX.fullmatch(prefix) or len(prefix) > LONGEST):
        step = f"give small letters, digits and single '_', a letter first, {LONGEST} signs at most"
        raise BadOption("prefix", prefix, step)
    if not 1e-6 <= velocity_scale <= 1e3:
        raise BadOption("velocity_scale", velocity_scale, "give a speed in rad/s from 1e-6 to 1000")


def prefix_of(asked: str, path: Path) -> str:
    """Return the prefix that was asked for, or one made of the name of a file."""
    if asked:
        return asked
    word = "_".join(re.findall(r"[a-z0-9]+", path.stem.lower()))[:LONGEST].rstrip("_")
    return word if word[:1].isalpha() else f"arm_{word}".rstrip("_")[:LONGEST]
