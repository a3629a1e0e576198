"""What a robot was read from, for the provenance of what was identified: files, and whether they are as they were.

A robot model changes with its includes too: those of a xacro (YAML files as well), an MJCF, an SDF and a stage of USD.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dynident.errors import DynidentError
from dynident.files import sha256_of
from dynident.robot_files.reading import format_of, robot_text
from dynident.robot_files.xacro import split_arguments


def robot_facts(robot_path: str) -> dict[str, Any]:
    """Return path, hash, arguments and the hashes of the includes of a robot model; empty for one that is no file.

    Includes are named from the folder of the robot model.

    Raises:
        DynidentError: It cannot be read.
    """
    file, arguments = split_arguments(robot_path)
    if not os.path.isfile(file):
        return {}
    facts: dict[str, Any] = {"path": file, "sha256": sha256_of(file)}
    if arguments:
        facts["arguments"] = arguments
    folder = os.path.abspath(Path(file).parent)
    includes = {Path(os.path.relpath(one, folder)).as_posix(): sha256_of(one) for one in included_files(robot_path)}
    return facts | ({"includes": includes} if includes else {})


def included_files(robot_path: str) -> tuple[str, ...]:
    """Return the files that a robot model includes, in the order in which they are read.

    Raises:
        DynidentError: It cannot be read.
    """
    text = robot_text(robot_path)
    if text.is_expanded:
        return tuple(text.files)
    return format_of(text.path, text.data).included(text.path, text.data)


def is_unchanged(facts: Mapping[str, Any], path: str) -> bool:
    """Return whether a file has the content that facts state, and its includes theirs."""
    includes = facts.get("includes", {})
    folder = Path(path).absolute().parent
    stated = {path: facts.get("sha256"), **{str(folder / name): known for name, known in includes.items()}}
    try:
        return all(os.path.isfile(one) and sha256_of(one) == known for one, known in stated.items())
    except DynidentError:
        return False
