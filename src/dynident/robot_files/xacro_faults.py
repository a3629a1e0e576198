"""Where and why the expansion of a xacro file failed: file, line and element, and what the package xacro says.

The package keeps no lines. Here each element that is parsed notes its file and line, also where it is copied into a
call of a macro; the element of a fault is the innermost one that the package was working on when it failed. The
process :mod:`xacro_child` loads this by its file: it imports nothing of dynident.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from types import TracebackType
from typing import Any, cast
from xml.dom import expatbuilder, minidom
from xml.parsers.expat import ExpatError

#: The reasons that the package gives, and the kind of fault that each is.
_REASONS = (
    (re.compile(r"name '(?P<name>\w+)' is not defined"), "undefined"),
    (re.compile(r"unknown macro name: (?:xacro:)?(?P<name>.+)"), "macro"),
    (re.compile(r"Undefined parameters \[(?P<name>.*)\]"), "parameters"),
    (re.compile(r"Invalid parameter \"(?P<name>.*)\""), "parameter"),
    (re.compile(r"environment variable '(?P<name>.*)' is not set"), "environment"),
    (re.compile(r"Xacro conditional \"(?P<name>.*)\" evaluated to .*"), "condition"),
    (re.compile(r".*: missing attribute '(?P<name>.*)'"), "attribute"),
)

#: Names in the package's functions under which they have the element that they work on.
_ELEMENTS = ("node", "elt", "tag")

#: How the use of an argument is written.
_USED = re.compile(r"\$\(arg\s+([^\s)]+)\s*\)")


class PackageNotFound(Exception):
    """A package that ``$(find NAME)`` names."""


class Places:
    """Where elements stand, and what the files that were parsed say about arguments.

    Attributes:
        declared: Arguments with a ``<xacro:arg>``: file and line of the first one.
        used: Arguments that some text uses.
    """

    def __init__(self) -> None:
        self.declared: dict[str, tuple[str, int]] = {}
        self.used: set[str] = set()

    @contextlib.contextmanager
    def noted(self, engine: Any) -> Iterator[None]:
        """Have the elements that the package xacro parses and copies note their place."""
        places, module, dom = self, cast(Any, expatbuilder), cast(Any, minidom)
        builder, clone = module.ExpatBuilderNS, dom._clone_node

        class Builder(builder):
            def parseFile(self, file: Any) -> Any:
                text = file.read()
                places.used.update(_USED.findall(text))
                return self.parseString(text)

            def start_element_handler(self, tag: str, attributes: Any) -> None:
                super().start_element_handler(tag, attributes)
                node: Any = self.curNode
                name = node.getAttribute("name")
                node.place = str((engine.filestack or [""])[-1]), self.getParser().CurrentLineNumber, name
                if node.nodeName == "xacro:arg":
                    places.declared.setdefault(name, node.place[:2])

        def copied(node: Any, deep: Any, document: Any) -> Any:
            found = clone(node, deep, document)
            if found is not None and hasattr(node, "place"):
                found.place = node.place
            return found

        module.ExpatBuilderNS, dom._clone_node = Builder, copied
        try:
            yield
        finally:
            module.ExpatBuilderNS, dom._clone_node = builder, clone


def fault_of(problem: Exception, engine: Any, places: Places) -> dict[str, Any]:
    """Return a fault: ``kind``, ``name``, ``file``, ``line`` and ``element``, and what its kind has beside these.

    Args:
        problem: What the package xacro raised.
        engine: The package.
        places: What the files that were parsed say.
    """
    causes: list[Any] = [problem]
    while getattr(causes[-1], "exc", None) is not None:
        causes.append(causes[-1].exc)
    last, file, line = causes[-1], str((engine.filestack or [""])[-1]), 0
    if isinstance(last, ExpatError):
        return {"kind": "xml", "name": str(last), "file": file, "line": last.lineno}
    elements, tables, _ = _worked_on(problem.__traceback__)
    if elements:
        file, line, _ = elements[-1].place
    fault = {"file": file, "line": line, "element": _shown(elements[-1]) if elements else "", "call": _call(elements)}
    if isinstance(last, OSError):
        is_yaml = "load_yaml" in _worked_on(last.__traceback__)[2]
        return {**fault, "kind": "yaml" if is_yaml else "include", "name": str(last.filename or last)}
    if type(last).__name__ == "ArgException":
        stated = places.declared.get(str(last))
        is_early = stated is not None and (stated[0] != file or stated[1] > line)
        return {**fault, "kind": "early" if is_early else "argument", "name": str(last), "stated": stated}
    kinds = {PackageNotFound: "package", RecursionError: "recursion"}
    if type(last) in kinds:
        return {**fault, "kind": kinds[type(last)], "name": str(last)}
    texts = [cause.suffix for cause in causes[:-1] if getattr(cause, "suffix", None)]
    fault["expression"] = texts[-1].strip().removeprefix("when evaluating expression ")[1:-1] if texts else ""
    return {**fault, **_reason(last, problem, tables, places)}


def _reason(last: Any, problem: Any, tables: dict[str, Any], places: Places) -> dict[str, Any]:
    """Return kind and name of a fault by what the package says, with the names that there are."""
    text = " ".join((last.msg if isinstance(last, SyntaxError) else str(last)).split()) or type(last).__name__
    for pattern, kind in _REASONS:
        if match := pattern.fullmatch(text):
            choices = _names(tables.get({"undefined": "symbols", "macro": "macros"}.get(kind, "")))
            if kind == "parameter":
                choices = [name.lstrip("*") for macro in problem.macros for name in macro.params]
            name = match["name"]
            is_argument = name in places.declared or name in places.used
            return {"kind": kind, "name": name, "reason": text, "choices": choices, "is_argument": is_argument}
    return {"kind": "other", "name": text}


def _worked_on(trace: TracebackType | None) -> tuple[list[Any], dict[str, Any], set[str]]:
    """Return the elements that the package was working on, outermost first, its innermost tables, and its functions."""
    elements, tables, called = list[Any](), dict[str, Any](), set[str]()
    while trace is not None:
        frame = trace.tb_frame
        called.add(frame.f_code.co_name)
        if frame.f_globals.get("__name__", "").partition(".")[0] == "xacro":
            node = next((frame.f_locals[name] for name in _ELEMENTS if name in frame.f_locals), None)
            while node is not None and getattr(node, "nodeType", None) != minidom.Node.ELEMENT_NODE:
                node = getattr(node, "parentNode", None)
            if node is not None and hasattr(node, "place") and (not elements or elements[-1] is not node):
                elements.append(node)
            tables |= {name: frame.f_locals[name] for name in ("symbols", "macros") if name in frame.f_locals}
        trace = trace.tb_next
    return elements, tables, called


def _shown(element: Any) -> str:
    name = element.place[2]  # as it is written: the package empties attributes that it has read
    return f"<{element.nodeName} name='{name}'>" if name else f"<{element.nodeName}>"


def _call(elements: list[Any]) -> list[Any] | None:
    """Return the outermost call of a macro: element, file and line; None where the fault is in none."""
    known = ("if", "unless", "include", "property", "arg", "element", "attribute", "insert_block", "macro")
    calls = [one for one in elements[:-1] if one.nodeName.startswith("xacro:") and one.nodeName[6:] not in known]
    return [_shown(calls[0]), *calls[0].place[:2]] if calls else None


def _names(table: Any) -> list[str]:
    """Return the names in a table of the package and in those around it."""
    found: list[str] = []
    while isinstance(table, dict) and type(table).__name__ in ("Table", "NameSpace"):
        found += [str(name).lstrip("*") for name in table]
        table = getattr(table, "parent", None)
    return found
