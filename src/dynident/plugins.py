"""How parts are found: one part per file, chosen by file name, imported when chosen.

A family has the parts of its folder and those that installed packages add, as entry points of the group that is called
as the folder is: ``[project.entry-points."dynident.model.friction"]`` with ``spring = "my_package.spring"``.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import math
import pkgutil
import sys
from collections.abc import Collection, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import cache
from types import MappingProxyType, ModuleType
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from dynident.errors import BadOption, BrokenPart, UnknownChoice, nearest

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

Part = TypeVar("Part")


@dataclass(frozen=True)
class Option:
    """A field of a part, as the command line and the documentation show it; with its limits."""

    name: str
    kind: str
    default: Any
    help: str
    least: float = -math.inf
    most: float = math.inf


def bounded(default: float | None, *, least: float = -math.inf, most: float = math.inf) -> Any:
    """Return a field of a part whose value has limits where the part is made by its name, as from a case file.

    They stand far beyond all use: a count takes no more time or memory than a machine has, and a number none that
    arithmetic cannot follow.
    """
    return field(default=default, metadata={"least": least, "most": most})


def part_names(package: str, *rooms: str) -> tuple[str, ...]:
    """Return the names of the parts in a folder and in installed packages, sorted; no part is imported.

    Args:
        package: Dotted name of the folder, and of the group of entry points.
        rooms: Further folders of the family; one may be absent.

    Raises:
        ModuleNotFoundError: There is no such folder.
    """
    return _sorted(_in_folder(package), tuple(added(package)), *(_in_room(room) for room in rooms))


@cache
def _sorted(*names: Collection[str]) -> tuple[str, ...]:
    return tuple(sorted(set().union(*names)))


@cache
def added(package: str) -> Mapping[str, tuple[EntryPoint, ...]]:
    """Return the parts that installed packages add to a folder, by name; nothing is imported.

    Args:
        package: Dotted name of the folder, and of the group of entry points.
    """
    found: dict[str, tuple[EntryPoint, ...]] = {}
    for point in installed_entry_points().select(group=package):
        found[point.name] = (*found.get(point.name, ()), point)
    return found


@cache
def installed_entry_points() -> Any:
    """Return the entry points of all groups, with ``select``: to look for one group takes as long."""
    from importlib.metadata import entry_points

    return entry_points()


def _in_folder(package: str) -> frozenset[str]:
    folder = sys.modules.get(package)
    spec = importlib.util.find_spec(package) if folder is None else None
    places = getattr(folder, "__path__", None) if spec is None else spec.submodule_search_locations
    if places is None:
        raise ModuleNotFoundError(f"there is no folder of parts '{package}'", name=package)
    return _modules(tuple(places))


def _in_room(package: str) -> frozenset[str]:
    """Return the parts of a further folder of a family; none where the folder, or the room above it, is absent."""
    try:
        return _in_folder(package)
    except ModuleNotFoundError:
        return frozenset()


@cache
def _modules(places: tuple[str, ...]) -> frozenset[str]:
    found = (module.name for module in pkgutil.iter_modules(places) if not module.ispkg)
    return frozenset(name for name in found if name != "base" and not name.startswith("_"))


class Family(Generic[Part]):
    """The parts of one folder and of installed packages: file name = name in scripts, case files and commands.

    Attributes:
        package: Dotted name of the folder, and of the group of entry points.
        kind: The abstract base that every part of the family implements.
        noun: What one part is called in messages, such as ``"estimator"``.
        rooms: Further folders of parts, in rooms that stand above the family's own; one may be absent.
        aliases: Other names by which parts are asked for, with the name of the part; a part of that name goes first.
    """

    def __init__(
        self,
        package: str,
        kind: type[Part],
        noun: str,
        rooms: tuple[str, ...] = (),
        aliases: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self.package, self.kind, self.noun, self.rooms, self.aliases = package, kind, noun, rooms, aliases

    def names(self) -> tuple[str, ...]:
        """Return the names of the parts, sorted; nothing is imported."""
        return part_names(self.package, *self.rooms)

    def resolve(self, name: str) -> str:
        """Return the name of the part that a name or an alias asks for; any other name as it is."""
        return name if name in self.names() else self.aliases.get(name, name)

    def place(self, name: str) -> str:
        """Return the dotted name of the folder that has a part of the family's own."""
        return next((room for room in self.rooms if name in _in_room(room)), self.package)

    def get(self, name: str) -> type[Part]:
        """Import the part called ``name`` and return its class.

        Raises:
            UnknownChoice: The family has no such part.
            BrokenPart: An installed package adds a part that cannot be loaded, or whose name is taken.
        """
        names, name = self.names(), self.resolve(name)
        if name not in names:
            raise UnknownChoice(self.noun, name, names, self.aliases)
        points = added(self.package).get(name, ())
        if points:
            return self._added(points)
        return _only_class(importlib.import_module(f"{self.place(name)}.{name}"), self.kind)

    def make(self, choice: str | Part, options: Mapping[str, Any] = MappingProxyType({})) -> Part:
        """Return a part from its name and options by name, or the part itself when one is given.

        Raises:
            UnknownChoice: No such part.
            BadOption: The part has no such option, or its value is beyond the limits.
            TypeError: Options beside a part that is made already.
        """
        if not isinstance(choice, str):
            if options:
                raise TypeError(f"{choice!r} has its options already; {', '.join(options)} would be lost")
            if isinstance(choice, tuple | list | Mapping):
                step = "write a name, or a part made with its options: FRICTION.make('coulomb', {'width': 0.02})"
                raise BadOption(self.noun, choice, step)
            return choice
        part = self.get(choice)
        known = {option.name: option for option in self.options(choice)}
        for key, value in options.items():
            if key not in known:
                step = f"the {self.noun} '{choice}' has the options: {', '.join(known) or 'none'}{nearest(key, known)}"
                raise BadOption(key, value, step)
        made = part(**options)
        for key, value in options.items():
            _check_limits(known[key], value)
        return made

    def make_from_text(self, choice: str, options: Mapping[str, str | None]) -> Part:
        """Return a part whose options are written as text, as in a case file or on the command line.

        Raises:
            UnknownChoice: No such part.
            BadOption: No such option, or a text that is no value for it.
        """
        kinds = {option.name: option.kind for option in self.options(choice)}
        return self.make(choice, {k: _from_text(k, kinds.get(k, "str"), text) for k, text in options.items()})

    def has_option(self, name: str, option: str) -> bool:
        """Return whether a part has an option of this name; errors as of :meth:`get`."""
        return any(known.name == option for known in self.options(name))

    def name_of(self, part: Part) -> str:
        """Return the name (the file) of a part."""
        return type(part).__module__.rsplit(".", 1)[-1]

    def options(self, name: str) -> tuple[Option, ...]:
        """Return the options of a part: the fields of its dataclass, with the line that describes each."""
        return _options(self.get(name))

    def summary(self, name: str) -> str:
        """Return the first line of the part's docstring."""
        return (inspect.getdoc(self.get(name)) or "").split("\n", 1)[0]

    def _added(self, points: tuple[EntryPoint, ...]) -> type[Part]:
        """Return the class of a part that an installed package adds."""
        name, module = points[0].name, points[0].value
        origin = f"the package '{points[0].dist.name}'" if points[0].dist else f"'{module}'"
        if len(points) > 1 or any(name in _in_room(room) for room in (self.package, *self.rooms)):
            modules = ", ".join(point.value for point in points)
            raise BrokenPart(self.noun, name, f"{modules} would take a name that is taken", "uninstall what adds it")
        if module.rsplit(".", 1)[-1] != name:
            step = f'{origin} must add a module called as the part is: {name} = "....{name}"'
            raise BrokenPart(self.noun, name, f"its entry point is '{module}'", step)
        try:
            return _only_class(importlib.import_module(module), self.kind)
        except Exception as error:
            evidence = f"loading {module} ends with {type(error).__name__}: {error}"
            raise BrokenPart(self.noun, name, evidence, f"fix or uninstall {origin}") from error


@cache
def _only_class(module: ModuleType, kind: type[Any]) -> type[Any]:
    mine = [
        value
        for value in vars(module).values()
        if inspect.isclass(value) and value.__module__ == module.__name__ and issubclass(value, kind)
    ]
    if len(mine) != 1:
        raise TypeError(f"{module.__name__} must define exactly one {kind.__name__}, found {len(mine)}")
    return mine[0]


@cache
def _options(part: type[Any]) -> tuple[Option, ...]:
    if not is_dataclass(part):
        return ()
    texts: dict[str, str] = {}
    for kind in reversed(part.__mro__):  # options that parts share are described where they come from
        texts |= attribute_lines(inspect.getdoc(kind) or "")
    return tuple(
        Option(
            f.name,
            str(f.type),
            None if f.default is MISSING else f.default,
            texts.get(f.name, ""),
            f.metadata.get("least", -math.inf),
            f.metadata.get("most", math.inf),
        )
        for f in fields(part)
        if f.init
    )


def _check_limits(option: Option, value: Any) -> None:
    if isinstance(value, int | float) and not option.least <= value <= option.most:
        step = f"give {option.most:.10g} or less" if value > option.most else f"give {option.least:.10g} or more"
        raise BadOption(option.name, value, step)


def attribute_lines(doc: str) -> dict[str, str]:
    """Return the texts of the ``Attributes:`` block of a Google-style docstring."""
    texts: dict[str, str] = {}
    name = ""
    _, _, block = doc.partition("Attributes:\n")
    for line in block.splitlines():
        if not line.startswith("    "):
            break
        if not line.startswith("        ") and ":" in line:
            name, _, text = line.strip().partition(":")
            texts[name] = text.strip()
        elif name:
            texts[name] += " " + line.strip()
    return texts


def _from_text(name: str, kind: str, text: str | None) -> Any:
    """Return the value that ``text`` writes for a field annotated ``kind``."""
    told = "none" if text is None else text.strip().lower()
    empty = text is None or (told in ("none", "null") and f"'{told}'" not in kind)
    if empty or (told == "auto" and "None" in kind):
        if "None" in kind:
            return None
        raise BadOption(name, text, f"give a value of the kind {kind}")
    word = (text or "").strip()
    if kind.startswith("bool"):
        if word.lower() not in ("true", "false"):
            raise BadOption(name, text, "write true or false")
        return word.lower() == "true"
    try:
        if kind.startswith("int"):
            return int(word)
        if kind.startswith("float"):
            return float(word)
        if kind.startswith("tuple"):
            items = [item.strip() for item in word.strip("[]()").split(",")]
            return tuple(filter(None, items)) if kind.startswith("tuple[str") else tuple(map(float, items))
    except ValueError:
        point = "; write decimals with a point" if "," in word and kind.startswith("float") else ""
        raise BadOption(name, text, f"write a value of the kind {kind}{point}") from None
    return word
