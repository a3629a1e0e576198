"""The process that expands a xacro file with the package xacro; it answers with one JSON object, the XML or a fault.

Run as ``python xacro_child.py FILE ARGUMENTS PACKAGES``, the last two JSON objects of texts; it imports nothing of
dynident but the file ``ros_packages.py`` beside it, which finds packages that ``$(find NAME)`` names without ROS. A
mistyped argument, which the package xacro passes over, is a fault, and so is one without default that is not given.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import io
import json
import os
import sys
from pathlib import Path
from typing import Any
from xml.parsers.expat import ExpatError

#: Memory that an expansion may take, in bytes.
_MEMORY = 4 << 30


class PackageNotFound(Exception):
    """A package that ``$(find NAME)`` names."""


class Arguments(dict[str, str]):
    """Arguments by name that notes which of those that were given the file declares."""

    def __init__(self, given: dict[str, str]) -> None:
        super().__init__(given)
        self.given, self.declared = frozenset(given), list[str]()

    def __contains__(self, name: object) -> bool:  # asked for each <xacro:arg>
        self.declared.append(str(name))
        return super().__contains__(name)


def expanded(file: str, given: dict[str, str], packages: dict[str, str]) -> dict[str, Any]:
    """Return the expanded XML under ``xml``, or ``fault`` with its ``kind``, ``name``, ``file`` and ``line``."""
    import xacro  # pyright: ignore[reportMissingImports]
    import xacro.substitution_args  # pyright: ignore[reportMissingImports]

    engine: Any = xacro
    substitution: Any = xacro.substitution_args
    arguments, packages_of_ros = Arguments(given), _beside("ros_packages")

    def find(name: str) -> str:
        folder = packages.get(name) or packages_of_ros.package_folder(name, engine.filestack[-1] or file)
        if folder is None:
            raise PackageNotFound(name)
        return str(folder)

    def check(tag: Any, required: list[str], optional: list[str]) -> Any:
        if tag.tagName == "xacro:arg" and not tag.hasAttribute("default"):
            name = tag.getAttribute("name")
            if name not in arguments:
                raise substitution.ArgException(name)
            return [name, arguments[name]]
        return own_check(tag, required, optional)

    own_check, engine.check_attrs = engine.check_attrs, check
    substitution._eval_find = find
    substitution._eval_dict["find"] = find
    engine.all_includes.clear()
    warnings = io.StringIO()
    try:
        with contextlib.redirect_stderr(warnings), contextlib.redirect_stdout(io.StringIO()):
            xml = engine.process_file(file, mappings=arguments).documentElement.toxml()
    except Exception as problem:  # what files hold is evaluated, and may fail in any way
        return {"fault": _fault(problem, list(engine.filestack or [file]))}
    finally:
        engine.check_attrs = own_check
    unknown = sorted(arguments.given - set(arguments.declared))
    if unknown:
        names = sorted(set(arguments.declared))
        return {"fault": {"kind": "unknown", "name": unknown[0], "file": file, "line": 0, "choices": names}}
    notes = [line.removeprefix("warning: ") for line in warnings.getvalue().splitlines() if line.strip()]
    return {"xml": xml, "notes": notes, "files": sorted(set(engine.all_includes))}


@functools.cache
def _beside(name: str) -> Any:
    """Return a module by the file beside this one; by its dotted name it would load the whole package, and NumPy."""
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _fault(problem: Exception, files: list[str]) -> dict[str, Any]:
    """Return kind, name, file and line of a fault, from the causes that xacro wraps."""
    causes: list[BaseException] = [problem]
    while getattr(causes[-1], "exc", None) is not None:
        causes.append(causes[-1].exc)  # type: ignore[attr-defined]
    last, file = causes[-1], files[-1]
    if isinstance(last, ExpatError):
        return {"kind": "xml", "name": str(last), "file": file, "line": last.lineno}
    if isinstance(last, OSError):
        missing = str(last.filename or last)
        includer = files[-2] if len(files) > 1 and os.path.abspath(files[-1]) == os.path.abspath(missing) else file
        return {
            "kind": "include",
            "name": missing,
            "file": includer,
            "line": _line(includer, os.path.basename(missing)),
        }
    if type(last).__name__ == "ArgException":
        name = str(last)
        line = _line(file, f"$(arg {name})") or _line(file, f'<xacro:arg name="{name}"')
        return {"kind": "argument", "name": name, "file": file, "line": line}
    if isinstance(last, PackageNotFound):
        return {"kind": "package", "name": str(last), "file": file, "line": _line(file, f"$(find {last})")}
    return {"kind": "other", "name": str(problem) or type(problem).__name__, "file": file, "line": 0}


def _line(file: str, text: str) -> int:
    """Return the first line of a file that has a text, from 1; 0 where none has."""
    try:
        with open(file, encoding="utf-8", errors="replace") as stream:
            return next((number for number, line in enumerate(stream, start=1) if text in line), 0)
    except OSError:
        return 0


if __name__ == "__main__":
    try:
        import resource
    except ImportError:  # Windows has no such limit
        pass
    else:
        with contextlib.suppress(ValueError, OSError):  # not allowed
            resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    json.dump(expanded(sys.argv[1], json.loads(sys.argv[2]), json.loads(sys.argv[3])), sys.stdout)
