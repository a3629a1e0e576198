"""Which elements and attributes MJCF has, and what an element has that it does not write itself.

MuJoCo's own schema as data, with the check of a file against it; the defaults classes of a file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Final

from dynident.errors import nearest
from dynident.model.documents.numbers import shown
from dynident.robot_files.xml_elements import Element, Values

_FILE: Final = "schema.txt"
#: What MuJoCo's printed schema leaves out: groups of elements in bodies, with any attribute there; and includes.
_GROUPS: Final = {
    "frame": "axisangle childclass euler name pos quat scale xyaxes zaxis",
    "replicate": "childclass count euler offset sep",
}
#: Start of the attributes that every XML file may have, beside those with a prefix.
_OF_XML: Final = "xml"


@dataclass(frozen=True)
class MjcfRule:
    """An element of MJCF.

    Attributes:
        attributes: Names of its attributes.
        children: The elements that may stand in it.
    """

    attributes: frozenset[str]
    children: dict[str, MjcfRule] = field(default_factory=dict)


@cache
def mjcf_rules() -> MjcfRule:
    """Return the rules of the first element of an MJCF, of versions 2.3.7 to 4.0 of MuJoCo together."""
    root = MjcfRule(frozenset())
    above = [root]
    for line in resources.files("dynident.robot_files.mjcf").joinpath(_FILE).read_text("utf-8").splitlines():
        if line.startswith("#"):
            continue
        tag, *attributes = line.split()
        depth = len(line) - len(line.lstrip())
        rule = MjcfRule(frozenset(attributes))
        above[depth + 1 :] = [rule]
        above[depth].children[tag] = rule
    top = root.children["mujoco"]
    default, body = top.children["default"], top.children["body"]
    default.children["default"] = default
    inside = body.children
    inside["body"] = body
    grouped = {tag: rule for tag, rule in inside.items() if tag != "inertial"}
    for tag, attributes in _GROUPS.items():
        inside[tag] = grouped[tag] = MjcfRule(frozenset(attributes.split()), inside)
    del top.children["body"]
    top.children["worldbody"] = MjcfRule(frozenset(), inside)
    return top


def check_schema(root: Element) -> None:
    """Refuse an element or attribute that MJCF has not, anywhere in a file whose includes are in place.

    Raises:
        DescriptionError: There is one; the message has the nearest known name.
    """
    for element, rule in _ruled(root, mjcf_rules()):
        for name in element.attributes:
            if name not in rule.attributes and not name.startswith(_OF_XML) and ":" not in name:
                step = f"remove or correct it{nearest(name, sorted(rule.attributes))}"
                raise element.place.error(f"unknown attribute {shown(name)}", step)


def _ruled(element: Element, rule: MjcfRule) -> Iterator[tuple[Element, MjcfRule]]:
    """Yield an element and all in it with their rules."""
    yield element, rule
    for child in element.children:
        if child.tag not in rule.children:
            known = sorted(rule.children)
            what = "section of MJCF" if element.tag in ("mujoco", "mujocoinclude") else f"element in <{element.tag}>"
            step = f"remove or correct it{nearest(child.tag, known)}"
            raise child.place.error(f"no {what} has this name", step)
        yield from _ruled(child, rule.children[child.tag])


#: All shortcuts of actuators set the same defaults.
ACTUATORS: Final = frozenset(
    "general motor position velocity intvelocity damper cylinder muscle adhesion dcmotor plugin pid orientation".split()
)
_TURNS: Final = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
#: Lists of numbers of which an element may write the first ones; the others are those of its class.
_PARTLY_WRITTEN: Final = ("damping", "gear", "size", "stiffness")
_MAIN: Final = "main"

_Class = dict[str, dict[str, str]]


class Defaults:
    """The classes of one model."""

    def __init__(self, elements: Iterable[Element]) -> None:
        self._classes: dict[str, _Class] = {_MAIN: {}}
        for element in elements:
            name = element.attributes.get("class", _MAIN)
            if name != _MAIN:
                step = f"put it into <default>, or write class={shown(_MAIN)}"
                raise element.place.error(f"the class {shown(name)} stands outside of the main one", step)
            self._read(element, name)

    def _read(self, element: Element, name: str) -> None:
        own = self._classes[name]
        for child in element.children:
            if child.tag != "default":
                key = _key(child.tag)
                own[key] = merged(own.get(key, {}), child.attributes)
        for child in element.all("default"):
            inner = Values(child.place, child.attributes).name("class")
            if inner in self._classes:
                step = "give each class a name of its own"
                raise child.place.error(f"a second class is called {shown(inner)}", step)
            self._classes[inner] = {tag: dict(values) for tag, values in own.items()}
            self._read(child, inner)

    def values(self, element: Element, childclass: str, kind: str = "") -> Values:
        """Return the attributes of an element with those of its class, or of the class that its bodies give it.

        Args:
            element: The element.
            childclass: The class that its bodies give it.
            kind: What it is called in ``<default>``; empty for its own name.

        Raises:
            DescriptionError: An unknown class.
        """
        given = {key: text for key, text in element.attributes.items() if key != "class"}
        name = element.attributes.get("class") or childclass or _MAIN
        if name not in self._classes:
            step = f"add it to <default>, or correct the name{nearest(name, self._classes)}"
            raise element.place.error(f"there is no defaults class {shown(name)}", step)
        return Values(element.place, merged(self._classes[name].get(kind or _key(element.tag), {}), given))

    def with_attached(self, prefix: str, inner: Defaults) -> Defaults:
        """Return these and those of an attached model, whose names begin with a prefix; a name that is taken stays."""
        both = Defaults(())
        both._classes = {prefix + name: one for name, one in inner._classes.items()} | self._classes
        return both

    def check(self, element: Element, name: str) -> None:
        """Refuse a ``childclass`` that is none, as :meth:`values` does."""
        self.values(Element(element.tag, element.line, {"class": name}, path=element.path), "")


def _key(tag: str) -> str:
    return "actuator" if tag in ACTUATORS else tag


def merged(inherited: Mapping[str, str], own: Mapping[str, str]) -> dict[str, str]:
    """Return the attributes of a class and of an element in it; of orientations only the last one written counts."""
    is_turned = any(name in own for name in _TURNS)
    kept = {name: text for name, text in inherited.items() if not (is_turned and name in _TURNS)}
    found = {**kept, **own}
    for name in _PARTLY_WRITTEN:
        if name in own and name in kept:
            words = own[name].split()
            found[name] = " ".join([*words, *kept[name].split()[len(words) :]])
    return found
