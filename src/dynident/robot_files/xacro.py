"""Xacro files: expanded to a URDF by the package xacro, in a process of its own, and robots named with arguments.

A robot with arguments is written as for the program xacro: ``arm.urdf.xacro ur_type:=ur5e prefix:=a_``.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from dynident.errors import BadOption, DescriptionError, MissingDependency, nearest
from dynident.robot_files.ros_packages import places_searched

#: Seconds that an expansion may take.
_SECONDS: Final = 60.0

#: Arguments behind the name of a file.
_ARGUMENTS: Final = re.compile(r"(.*?)((?:\s+[A-Za-z_]\w*:=(?:'[^']*'|\"[^\"]*\"|\S*))+)\s*", re.DOTALL)

#: What makes an XML file one for xacro, whatever its ending.
_MACROS: Final = (b"<xacro:", b"${", b"$(")


@dataclass(frozen=True)
class Expanded:
    """A URDF that xacro made.

    Attributes:
        data: Its bytes.
        files: The files that were included.
        notes: Warnings of xacro.
    """

    data: bytes
    files: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def split_arguments(name: str) -> tuple[str, dict[str, str]]:
    """Return file and arguments of a robot named as ``FILE NAME:=VALUE ...``; a plain name has no arguments.

    Raises:
        BadOption: An argument is there twice, or a quote is left open.
    """
    match = None if os.path.exists(name) else _ARGUMENTS.fullmatch(name)
    if match is None:
        return name, {}
    found: dict[str, str] = {}
    for word in shlex.split(match[2]):
        key, _, value = word.partition(":=")
        if key in found:
            raise BadOption("robot", name, f"state the argument {key} once")
        found[key] = value
    return match[1], found


def with_arguments(file: str, arguments: Mapping[str, str]) -> str:
    """Return the name of a robot with arguments; the inverse of :func:`split_arguments`."""
    return " ".join([file, *(f"{key}:={shlex.quote(value) if value else ''}" for key, value in arguments.items())])


def is_xacro(path: str | Path, data: bytes) -> bool:
    """Return whether a file is to be expanded: it has macros, or ends with .xacro and has expressions."""
    return _MACROS[0] in data or (str(path).endswith(".xacro") and any(mark in data for mark in _MACROS))


def expand(file: Path, arguments: Mapping[str, str], packages: Mapping[str, str] = MappingProxyType({})) -> Expanded:
    """Return the URDF of a xacro file.

    Args:
        file: The file.
        arguments: Values of its arguments (``<xacro:arg>``), as text.
        packages: Folders of ROS packages that are known, by name; others are looked for (:mod:`ros_packages`).

    Raises:
        MissingDependency: The package xacro is not installed (extra ``xacro``).
        DescriptionError: An argument, an include or a package is missing, an argument is not known, or another fault.
    """
    if find_spec("xacro") is None:
        raise MissingDependency(f"the xacro file '{file}'", "xacro", "xacro")
    facts = [json.dumps(dict(arguments)), json.dumps(dict(packages))]
    command = [sys.executable, "-P", str(Path(__file__).with_name("xacro_child.py")), str(file), *facts]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=_SECONDS)
    except subprocess.TimeoutExpired:
        evidence = f"its expansion takes more than {_SECONDS:.0f} s"
        raise DescriptionError(file, "", evidence, "does a macro call itself? try the program xacro") from None
    if done.returncode or not done.stdout:
        told = done.stderr.strip().splitlines()
        evidence = f"xacro ended before it was done ({told[-1] if told else f'code {done.returncode}'})"
        raise DescriptionError(file, "", evidence, "try the program xacro on it")
    return answered(json.loads(done.stdout), arguments)


def answered(answer: Mapping[str, Any], arguments: Mapping[str, str]) -> Expanded:
    """Return the URDF that the process answers with.

    Raises:
        DescriptionError: It answers with a fault.
    """
    if "fault" in answer:
        raise _error(answer["fault"], arguments)
    data = answer["xml"].encode("utf-8", errors="surrogatepass")  # the reader of XML refuses by name what is no text
    return Expanded(data, tuple(answer["files"]), tuple(answer["notes"]))


def _error(fault: Mapping[str, Any], arguments: Mapping[str, str]) -> DescriptionError:
    """Return the error of a fault that the expansion met."""
    name, file = str(fault["name"]), str(fault["file"])
    where = f"line {fault['line']}" if fault["line"] else ""
    if fault["kind"] == "argument":
        step = f"give it: '{file} {name}:=VALUE', in a case file robot: {{file: ..., arguments: {{{name}: VALUE}}}}"
        return DescriptionError(file, where, f"the argument {name} has no value and no default", step)
    if fault["kind"] == "unknown":
        names = list(fault["choices"])
        step = f"it has {', '.join(names) or 'no arguments'}{nearest(name, names)}"
        return DescriptionError(file, where, f"the file has no argument {name}", step)
    if fault["kind"] == "include":
        step = "check the path, which is relative to the file that includes it"
        return DescriptionError(file, where, f"<xacro:include>: there is no file {name}", step)
    if fault["kind"] == "package":
        evidence = f"$(find {name}): no package {name} {places_searched()}"
        step = "source its workspace, or name the folder that holds it: ROS_PACKAGE_PATH=FOLDER"
        return DescriptionError(file, where, evidence, step)
    if fault["kind"] == "xml":
        return DescriptionError(file, where, f"not XML ({name})", "correct the line")
    given = ", ".join(f"{key}:={value}" for key, value in arguments.items()) or "none"
    reason = " ".join(name.split())
    return DescriptionError(file, where, f"xacro: {reason}", f"correct it, or the arguments (given: {given})")
