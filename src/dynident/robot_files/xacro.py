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
from collections.abc import Callable, Mapping
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
    try:
        words = shlex.split(match[2])
    except ValueError:
        step = "close the quote, or write \\' for an apostrophe: NAME:=it\\'s"
        raise BadOption("robot", name, step) from None
    for word in words:
        key, _, value = word.partition(":=")
        if key in found:
            raise BadOption("robot", name, f"state the argument {key} once")
        found[key] = value
    return match[1], found


def with_arguments(file: str, arguments: Mapping[str, str]) -> str:
    """Return the name of a robot with arguments; the inverse of :func:`split_arguments`."""
    return " ".join([file, *(f"{key}:={shlex.quote(value) if value else ''}" for key, value in arguments.items())])


def is_xacro(path: str | Path, data: bytes) -> bool:
    """Return whether a file is to be expanded: it has macros, or ends with .xacro and has expressions.

    What stands in comments does not count: an expanded file may have macros there.
    """
    if not any(mark in data for mark in _MACROS):
        return False
    first, *rest = data.split(b"<!--")
    read = first + b"".join(part.partition(b"-->")[2] for part in rest)
    return _MACROS[0] in read or (str(path).endswith(".xacro") and any(mark in read for mark in _MACROS))


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
    line, element = fault["line"], fault.get("element", "")
    where = ", ".join([*([f"line {line}"] if line else []), *([element] if element else [])])
    evidence, step = _EXPLAINED.get(fault["kind"], _of_expression)(fault)
    given = ", ".join(f"{key}:={value}" for key, value in arguments.items())
    if given and fault["kind"] in ("other", "condition"):
        step += f", or the arguments (given: {given})"
    if given and fault["kind"] == "undefined":
        evidence += f", with {given}"
    if call := fault.get("call"):
        evidence += f" (in the call {call[0]}, {f'{call[1]}, ' if call[1] != fault['file'] else ''}line {call[2]})"
    return DescriptionError(str(fault["file"]), where, evidence, step)


def _of_expression(fault: Mapping[str, Any]) -> tuple[str, str]:
    expression = fault.get("expression", "")
    return f"xacro: {fault['name']}{f' in ${{{expression}}}' if expression else ''}", "correct it"


def _of_argument(fault: Mapping[str, Any]) -> tuple[str, str]:
    name, file = fault["name"], fault["file"]
    step = f"give it: '{file} {name}:=VALUE', in a case file robot: {{file: ..., arguments: {{{name}: VALUE}}}}"
    return f"the argument {name} has no value and no default", step


def _of_early_argument(fault: Mapping[str, Any]) -> tuple[str, str]:
    name, (file, line) = fault["name"], fault["stated"]
    place = f"line {line}" if file == fault["file"] else f"{file}, line {line}"
    evidence = f"the argument {name} is used before it is declared ({place})"
    return evidence, f'move <xacro:arg name="{name}" .../> above its use, or give {name}:=VALUE'


def _of_unknown_argument(fault: Mapping[str, Any]) -> tuple[str, str]:
    name, names = str(fault["name"]), list(fault["choices"])
    return f"the file has no argument {name}", f"it has {', '.join(names) or 'no arguments'}{nearest(name, names)}"


def _of_package(fault: Mapping[str, Any]) -> tuple[str, str]:
    evidence = f"$(find {fault['name']}): no package {fault['name']} {places_searched()}"
    return evidence, (
        "source its workspace, or name the folder that holds it (a package is a folder with package.xml): "
        "ROS_PACKAGE_PATH=FOLDER"
    )


def _of_parameters(fault: Mapping[str, Any]) -> tuple[str, str]:
    names = [name.strip() for name in str(fault["name"]).split(",")]
    texts = " ".join(f'{name}="..."' for name in names)
    return f"the macro needs {', '.join(names)}, which has no value and no default", f"write {texts}"


def _of_name(fault: Mapping[str, Any]) -> tuple[str, str]:
    name, expression, near = fault["name"], fault["expression"], nearest(str(fault["name"]), fault["choices"])
    evidence = f"{name} is not defined{f' in ${{{expression}}}' if expression else ''}"
    if fault["is_argument"]:
        return evidence, f"write $(arg {name}): it is an argument, not a property"
    return evidence, f'define it above with <xacro:property name="{name}" .../>, or correct it{near}'


#: Evidence and remedy of each kind of fault.
_EXPLAINED: Final[Mapping[str, Callable[[Mapping[str, Any]], tuple[str, str]]]] = {
    "argument": _of_argument,
    "early": _of_early_argument,
    "unknown": _of_unknown_argument,
    "package": _of_package,
    "parameters": _of_parameters,
    "undefined": _of_name,
    "include": lambda f: (f"there is no file {f['name']}", "check the path, which is relative to the file it is in"),
    "yaml": lambda f: (
        f"load_yaml: there is no file {f['name']}", "check the path, which is relative to the file it is in"
    ),
    "xml": lambda f: (f"not XML ({f['name']})", "correct the line"),
    "recursion": lambda f: (
        "recursion without end, or elements nested too deep", "does a macro call itself? end it with <xacro:if>"
    ),
    "macro": lambda f: (
        f"unknown macro {f['name']}",
        f"define or include it above, or correct the name{nearest(str(f['name']), f['choices'])}",
    ),
    "parameter": lambda f: (
        f"the macro has no parameter {f['name']}",
        f"it has {', '.join(f['choices']) or 'none'}{nearest(str(f['name']), f['choices'])}",
    ),
    "environment": lambda f: (
        f"the environment has no variable {f['name']}", f"set it, or write $(optenv {f['name']} DEFAULT)"
    ),
    "condition": lambda f: (f["reason"].rstrip(".").removeprefix("Xacro "), "write true, false, 1 or 0"),
    "attribute": lambda f: (f"no attribute '{f['name']}'", f'write {f["name"]}="..."'),
}  # fmt: skip
