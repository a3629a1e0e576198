"""The defaults classes of an MJCF: what an element has that it does not write itself."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from dynident.errors import nearest
from dynident.model.documents.numbers import shown
from dynident.robot_files.xml_elements import Element, Values

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
