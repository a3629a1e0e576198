"""Which elements and attributes MJCF has: MuJoCo's own schema as data, and the check of a file against it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Final

from dynident.errors import nearest
from dynident.model.documents.numbers import shown
from dynident.robot_files.xml_elements import Element

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
