"""Read the XML of a URDF into a small tree, or refuse it: no entities, no outside files, bounded size and depth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final
from xml.sax import SAXParseException
from xml.sax.handler import ContentHandler
from xml.sax.xmlreader import AttributesImpl, Locator

from dynident.errors import DescriptionError
from dynident.model.documents.numbers import Place, shown

MAX_DEPTH: Final = 64
MAX_LINKS: Final = 1000
MAX_ELEMENTS: Final = 20 * MAX_LINKS

#: What is read of each element. Everything else (visual, gazebo, transmission, ...) is passed over.
_CHILDREN: Final[Mapping[str, frozenset[str]]] = {
    "robot": frozenset({"link", "joint"}),
    "link": frozenset({"inertial", "collision"}),
    "collision": frozenset({"origin", "geometry"}),
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


@dataclass(frozen=True)
class Element:
    """An element of the file.

    Attributes:
        tag: Its name.
        line: Its line in the file, from 1.
        attributes: Its attributes.
        children: The elements in it that are read.
    """

    tag: str
    line: int
    attributes: Mapping[str, str]
    children: list[Element] = field(default_factory=list)

    def all(self, tag: str) -> list[Element]:
        """Return the children of one name."""
        return [child for child in self.children if child.tag == tag]


def parse_urdf(path: object, data: bytes) -> Element:
    """Return the ``<robot>`` element of a URDF with the elements that are read.

    Raises:
        DescriptionError: No XML, a document type or entity, a xacro file, another root element, too deep, too many
            links.
    """
    import defusedxml.sax  # loads slowly, and other descriptions do without it

    builder = _Builder(path)
    try:
        defusedxml.sax.parseString(data, builder, forbid_dtd=True, forbid_entities=True, forbid_external=True)
    except defusedxml.DefusedXmlException as problem:
        step = "remove the <!DOCTYPE ...> part: it can hide entities and outside files"
        raise builder.place().error("it has a document type (DTD) or an entity", step) from problem
    except SAXParseException as problem:
        place = Place(path, f"line {problem.getLineNumber()}")
        step = "correct the line, or write the file again with the tool that made it"
        raise place.error(f"not XML ({problem.getMessage()})", step) from problem
    except (LookupError, ValueError) as problem:  # an encoding that Python does not know or cannot decode
        raise builder.place().error(f"not XML ({problem})", "save the file as UTF-8") from problem
    if builder.root is None:
        raise DescriptionError(path, "", "not XML (no element)", "give a URDF")
    return builder.root


class _Builder(ContentHandler):
    """Builds the tree; elements that are not read are counted only for their depth."""

    def __init__(self, path: object) -> None:
        super().__init__()
        self._path = path
        self._locator: Locator | None = None
        self._open: list[Element | None] = []  # None: passed over, with all that is in it
        self._kept = 0
        self._links = 0
        self.root: Element | None = None

    def setDocumentLocator(self, locator: Locator) -> None:
        self._locator = locator

    def place(self) -> Place:
        """Return the line that is being read."""
        return Place(self._path, f"line {self._line()}" if self._line() else "")

    def startElement(self, name: str, attrs: AttributesImpl) -> None:
        if len(self._open) >= MAX_DEPTH:
            raise self.place().error(f"elements more than {MAX_DEPTH} levels deep", "give the URDF of one robot")
        if name.startswith("xacro:"):
            raise self.place().error(f"<{name}> makes this a xacro file, not a URDF", _STEP_XACRO)
        parent = self._open[-1] if self._open else None
        if not self._open and name != "robot":
            raise self.place().error(f"the file begins with <{name}>, not with <robot>", "give a URDF")
        if self._open and (parent is None or name not in _CHILDREN.get(parent.tag, ())):
            self._open.append(None)
            return
        element = Element(name, self._line(), dict(attrs.items()))
        self._check(element, parent)
        if parent is None:
            self.root = element
        else:
            parent.children.append(element)
        self._open.append(element)

    def endElement(self, name: str) -> None:
        self._open.pop()

    def _line(self) -> int:
        return (self._locator.getLineNumber() or 0) if self._locator is not None else 0

    def _check(self, element: Element, parent: Element | None) -> None:
        self._kept += 1
        self._links += element.tag == "link"
        if self._links > MAX_LINKS:
            raise self.place().error(f"more than {MAX_LINKS} links", "give the URDF of one robot")
        if self._kept > MAX_ELEMENTS:
            raise self.place().error(f"more than {MAX_ELEMENTS} elements", "give the URDF of one robot")
        for name, text in element.attributes.items():
            if "${" in text or "$(" in text:
                raise self.place().error(f"{name}={shown(text)} makes this a xacro file, not a URDF", _STEP_XACRO)
        if parent is not None and parent.tag in ("mass", "axis", "limit", "dynamics", "mimic"):
            step = f'write an attribute: <{parent.tag} {element.tag}="...">'
            raise self.place().error(f"<{element.tag}> is an element of <{parent.tag}>, which no reader sees", step)
