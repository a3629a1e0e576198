"""Figures of the structure of src/dynident: lines, statements, small files, parameters, circles of imports.

    python scripts/sizes.py
    python scripts/sizes.py --list
    python scripts/sizes.py --core model experiment estimation --without identification/simulated
    python scripts/sizes.py --json

A wing is a folder of the package, a room a folder or file directly below a wing. Names are read from the source.
Imports inside functions count; those for type checking only do not, unless --typing is given.
"""

from __future__ import annotations

import argparse
import ast
import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

SOURCE = Path(__file__).resolve().parent.parent / "src" / "dynident"
#: Most parameters and lines of a function, fewest lines of a file, most branches of a function.
PARAMETERS, LONG, SMALL, BRANCHES = 8, 60, 60, 10
Function = ast.FunctionDef | ast.AsyncFunctionDef
_BRANCH = (ast.If, ast.For, ast.AsyncFor, ast.While, ast.IfExp, ast.ExceptHandler, ast.comprehension, ast.match_case)


@dataclass(frozen=True)
class File:
    """A file of the package.

    Attributes:
        path: Below the package.
        text: Its source.
    """

    path: Path
    text: str

    @cached_property
    def tree(self) -> ast.Module:
        """The parsed source."""
        return ast.parse(self.text)

    @cached_property
    def nodes(self) -> list[ast.AST]:
        """All nodes of the parsed source: walking them takes longer than parsing."""
        return list(ast.walk(self.tree))

    @property
    def lines(self) -> int:
        """Number of lines."""
        return len(self.text.splitlines())

    @property
    def room(self) -> tuple[str, ...]:
        """Wing and room; the wing alone for its ``__init__.py``, nothing for files outside the wings."""
        parts = self.path.with_suffix("").parts
        return () if len(parts) == 1 else tuple(part for part in parts[:2] if part != "__init__")

    def functions(self) -> Iterator[Function]:
        """Yield all functions and methods."""
        yield from (node for node in self.nodes if isinstance(node, Function))


def parameters(function: Function) -> int:
    """Return how many parameters a function has, beside self and cls."""
    names = [one.arg for one in (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)]
    return len(names) - (names[:1] in (["self"], ["cls"]))


def branches(function: Function) -> int:
    """Return McCabe's number of a function, functions inside it included."""
    nodes = list(ast.walk(function))
    chains = sum(len(node.values) - 1 for node in nodes if isinstance(node, ast.BoolOp))
    return 1 + chains + sum(isinstance(node, _BRANCH) for node in nodes)


def families(files: Sequence[File]) -> set[Path]:
    """Return the folders of parts: those that a ``Family("package", ...)`` names."""
    folders = set()
    for node in (node for file in files for node in file.nodes if isinstance(node, ast.Call)):
        named = node.func.value if isinstance(node.func, ast.Subscript) else node.func
        first = node.args[0] if node.args else None
        if isinstance(named, ast.Name) and named.id == "Family" and isinstance(first, ast.Constant):
            folders.add(Path(*str(first.value).split(".")[1:]))
    return folders


def imported(file: File, package: str, typing: bool) -> Iterator[tuple[str, ...]]:
    """Yield the dotted names, without the package's, that a file imports from the package, anywhere in it."""
    skipped: set[ast.AST] = set()
    if not typing:
        for node in file.nodes:
            if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
                skipped.update(inner for one in node.body for inner in ast.walk(one))
    here = (package, *file.path.with_suffix("").parts)
    for node in file.nodes:
        if node in skipped:
            continue
        if isinstance(node, ast.Import):
            names = [tuple(alias.name.split(".")) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = (*here[: -node.level],) if node.level else ()
            base += tuple(node.module.split(".")) if node.module else ()
            names = [(*base, alias.name) for alias in node.names]
        else:
            continue
        yield from (name[1:] for name in names if name[0] == package)


def arrows(files: Sequence[File], package: str, typing: bool) -> dict[tuple[str, ...], set[tuple[str, ...]]]:
    """Return which rooms each room imports, of the same wing or another."""
    rooms = {file.room for file in files if len(file.room) == 2}
    graph: dict[tuple[str, ...], set[tuple[str, ...]]] = {room: set() for room in rooms}
    for file in files:
        if file.room in rooms:
            graph[file.room] |= {name[:2] for name in imported(file, package, typing)} & rooms - {file.room}
    return graph


def circles(graph: Mapping[Any, set[Any]]) -> list[list[Any]]:
    """Return the groups of nodes that reach each other, the largest first."""
    reach: dict[Any, set[Any]] = {}
    for start in graph:
        seen, todo = set(), list(graph[start])
        while todo:
            node = todo.pop()
            if node not in seen:
                seen.add(node)
                todo += graph[node]
        reach[start] = seen
    groups = {frozenset(b for b in reach[a] if a in reach[b]) for a in graph if a in reach[a]}
    return sorted((sorted(group) for group in groups), key=lambda group: (-len(group), group))


def _beyond(file: File, folders: set[Path]) -> Iterator[tuple[str, str]]:
    """Yield what of a file is beyond a bound: which bound, and the place."""
    name = file.path.stem
    part = file.path.parent in folders and name != "base" and not name.startswith("_")
    if file.lines < SMALL and name != "__init__" and not part:
        yield "small", f"{file.path.as_posix()} {file.lines}"
    for function in file.functions():
        place = f"{file.path.as_posix()}:{function.lineno} {function.name}"
        length = (function.end_lineno or function.lineno) - function.lineno + 1
        for bound, number, most in (
            ("wide", parameters(function), PARAMETERS),
            ("long", length, LONG),
            ("branched", branches(function), BRANCHES),
        ):
            if number > most:
                yield bound, f"{place} {number}"
        if function.args.kwarg is not None:
            yield "open", place


def figures(source: Path, typing: bool = False) -> dict[str, Any]:
    """Return all figures of a package; what has names is a list of them."""
    files = [File(path.relative_to(source), path.read_text("utf-8")) for path in sorted(source.rglob("*.py"))]
    folders = families(files)
    wings, rooms = defaultdict(int), defaultdict(int)
    classes, names = defaultdict(list), defaultdict(list)
    for file in files:
        wings[file.room[0] if file.room else "(outside)"] += file.lines
        if len(file.room) == 2:
            rooms["/".join(file.room)] += file.lines
        for bound, place in _beyond(file, folders):
            names[bound].append(place)
        for node in file.nodes:
            if isinstance(node, ast.ClassDef):
                classes[node.name].append(f"{file.path.as_posix()}:{node.lineno}")
    graph = arrows(files, source.name, typing)
    within = {room: {other for other in others if other[0] == room[0]} for room, others in graph.items()}
    widths = [len(line) for file in files for line in file.text.splitlines()]
    return {
        "lines": sum(file.lines for file in files),
        "statements": sum(isinstance(node, ast.stmt) for file in files for node in file.nodes),
        "files": len(files),
        "mean line length": round(sum(widths) / max(1, len(widths)), 2),
        f"files under {SMALL} lines": sum(file.lines < SMALL for file in files),
        f"files under {SMALL} lines, no parts and no __init__": names["small"],
        f"functions with more than {PARAMETERS} parameters": names["wide"],
        "functions with **kwargs": names["open"],
        f"functions over {LONG} lines": names["long"],
        f"functions with more than {BRANCHES} branches": names["branched"],
        "class names that are defined twice": [
            f"{k}: {', '.join(v)}" for k, v in sorted(classes.items()) if len(v) > 1
        ],
        "circles of rooms": [" ".join("/".join(room) for room in group) for group in circles(within)],
        "rooms in circles": sum(map(len, circles(within))),
        "lines by wing": dict(sorted(wings.items())),
        "lines by room": dict(sorted(rooms.items())),
    }


def core(numbers: Mapping[str, Any], named: Sequence[str], without: Sequence[str]) -> dict[str, int]:
    """Return the lines of wings or rooms, by name; those of the rooms of ``without`` are taken off.

    Raises:
        ValueError: There is no such wing or room.
    """
    sizes = numbers["lines by wing"] | numbers["lines by room"]
    for name in (*named, *without):
        if name not in sizes:
            raise ValueError(f"no wing or room is called '{name}'")
    lines = {name: sizes[name] for name in named}
    for name in without:
        lines[name.split("/")[0] if name.split("/")[0] in lines else name] -= sizes[name]
    return lines


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--source", type=Path, default=SOURCE, help="folder of the package")
    parser.add_argument("--core", nargs="+", default=[], metavar="WING[/ROOM]", help="what the core is: its lines")
    parser.add_argument("--without", nargs="+", default=[], metavar="WING/ROOM", help="rooms that do not belong to it")
    parser.add_argument("--typing", action="store_true", help="count imports for type checking as well")
    parser.add_argument("--list", action="store_true", help="name what is counted, and the lines of every room")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    numbers = figures(options.source.resolve(), options.typing)
    if options.core:
        numbers["core"] = core(numbers, options.core, options.without)
        numbers["lines of the core"] = sum(numbers["core"].values())
    if options.json:
        print(json.dumps(numbers, indent=1))
        return
    for key, value in numbers.items():
        if isinstance(value, dict):
            if key != "lines by room" or options.list:
                print(f"{key}:")
                print(*(f"  {name:30} {number:6}" for name, number in value.items()), sep="\n")
            continue
        print(f"{key}: {len(value) if isinstance(value, list) else value}")
        if isinstance(value, list) and (options.list or key.startswith("circles")):
            print(*(f"  {one}" for one in value), sep="\n")


if __name__ == "__main__":
    main()
