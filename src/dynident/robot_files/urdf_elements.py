"""The elements of a URDF that are read, and what makes a file a xacro."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from dynident.model.documents.numbers import Place, shown
from dynident.robot_files.xml_elements import Element, XmlLanguage, parse_xml

#: What is read of each element. Everything else (gazebo, transmission, ...) is passed over.
_CHILDREN: Final[Mapping[str, frozenset[str]]] = {
    "robot": frozenset({"link", "joint"}),
    "link": frozenset({"inertial", "collision", "visual"}),
    "collision": frozenset({"origin", "geometry"}),
    "visual": frozenset({"origin", "geometry"}),
    "geometry": frozenset({"box", "sphere", "cylinder", "capsule", "mesh"}),
    "inertial": frozenset({"origin", "mass", "inertia"}),
    "joint": frozenset({"origin", "parent", "child", "axis", "limit", "dynamics", "mimic"}),
    # Values that some writers put into elements of their own, where no reader sees them.
    "mass": frozenset({"value"}),
    "axis": frozenset({"xyz"}),
    "limit": frozenset({"lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk"}),
    "dynamics": frozenset({"damping", "friction"}),
    "mimic": frozenset({"multiplier", "offset"}),
}
_STEP_XACRO: Final = "expand it first: xacro file.xacro > file.urdf"


def parse_urdf(path: object, data: bytes) -> Element:
    """Return the ``<robot>`` element of a URDF with the elements that are read.

    Raises:
        DescriptionError: No XML, a document type or entity, a xacro file, another root element, too deep, too many
            links.
    """
    return parse_xml(path, data, _URDF)


def _check_name(place: Place, name: str) -> None:
    if name.startswith("xacro:"):
        raise place.error(f"<{name}> makes this a xacro file, not a URDF", _STEP_XACRO)


def _check_element(place: Place, element: Element, parent: Element | None) -> None:
    for name, text in element.attributes.items():
        if "${" in text or "$(" in text:
            raise place.error(f"{name}={shown(text)} makes this a xacro file, not a URDF", _STEP_XACRO)
    if parent is not None and parent.tag in ("mass", "axis", "limit", "dynamics", "mimic"):
        step = f'write an attribute: <{parent.tag} {element.tag}="...">'
        raise place.error(f"<{element.tag}> is an element of <{parent.tag}>, which no reader sees", step)


_URDF: Final = XmlLanguage("URDF", ("robot",), "link", _CHILDREN, _check_name, _check_element)
