"""The process that expands a xacro file with the package xacro; it answers with one JSON object, the XML or a fault.

Run as ``python xacro_child.py FILE ARGUMENTS PACKAGES``, the last two JSON objects of texts; it imports nothing of
dynident but two files beside it: ``ros_packages.py``, which finds packages that ``$(find NAME)`` names without ROS, and
``xacro_faults.py``. An argument that no file declares or uses, which the package xacro passes over, is a fault, and so
is one without default that is not given.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import io
import json
import sys
from pathlib import Path
from typing import Any

#: Memory that an expansion may take, in bytes.
_MEMORY = 4 << 30


class Arguments(dict[str, str]):
    """Arguments by name that notes which the files declare and use."""

    def __init__(self, given: dict[str, str]) -> None:
        super().__init__(given)
        self.given, self.known = frozenset(given), set[str]()

    def __contains__(self, name: object) -> bool:  # asked for each <xacro:arg>
        self.known.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:  # asked for each $(arg NAME), also of one that no <xacro:arg> declares
        self.known.add(name)
        return super().__getitem__(name)


def expanded(file: str, given: dict[str, str], packages: dict[str, str]) -> dict[str, Any]:
    """Return the expanded XML under ``xml``, or ``fault`` with its kind and place (:func:`xacro_faults.fault_of`)."""
    import xacro  # pyright: ignore[reportMissingImports]
    import xacro.substitution_args  # pyright: ignore[reportMissingImports]

    engine: Any = xacro
    substitution: Any = xacro.substitution_args
    arguments, packages_of_ros, faults = Arguments(given), _beside("ros_packages"), _beside("xacro_faults")
    places = faults.Places()

    def find(name: str) -> str:
        folder = packages.get(name) or packages_of_ros.package_folder(name, engine.filestack[-1] or file)
        if folder is None:
            raise faults.PackageNotFound(name)
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
        with contextlib.redirect_stderr(warnings), contextlib.redirect_stdout(io.StringIO()), places.noted(engine):
            xml = engine.process_file(file, mappings=arguments).documentElement.toprettyxml(indent="  ")
    except Exception as problem:  # what files hold is evaluated, and may fail in any way
        return {"fault": faults.fault_of(problem, engine, places)}
    finally:
        engine.check_attrs = own_check
    known = arguments.known | set(places.declared) | places.used
    if unknown := sorted(arguments.given - known):
        names = sorted(known)
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


if __name__ == "__main__":
    try:
        import resource
    except ImportError:  # Windows has no such limit
        pass
    else:
        with contextlib.suppress(ValueError, OSError):  # not allowed
            resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    json.dump(expanded(sys.argv[1], json.loads(sys.argv[2]), json.loads(sys.argv[3])), sys.stdout)
