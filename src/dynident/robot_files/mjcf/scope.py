"""What holds for the elements of a part of an MJCF: model, classes, names; and models that are attached to another."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Final

from dynident.errors import nearest
from dynident.model.documents.numbers import Place, shown
from dynident.robot_files.mjcf.defaults import Defaults
from dynident.robot_files.mjcf.document import MjcfDocument, file_beside, read_document
from dynident.robot_files.mjcf.geoms import Geoms
from dynident.robot_files.xml_elements import Element
from dynident.robot_files.xml_values import Values

_MAX_ATTACHED: Final = 8


@dataclass(frozen=True)
class MjcfScope:
    """What holds for the elements of a part of the tree.

    Attributes:
        document: Their model.
        defaults: Its classes.
        geoms: Its geoms.
        childclass: The class that elements have by default.
        prefix: What comes before names.
        suffix: What comes behind names.
        depth: Of models attached to models.
    """

    document: MjcfDocument
    defaults: Defaults
    geoms: Geoms
    childclass: str = ""
    prefix: str = ""
    suffix: str = ""
    depth: int = 0

    @classmethod
    def of(cls, document: MjcfDocument, prefix: str = "", suffix: str = "", depth: int = 0) -> MjcfScope:
        """Return what holds at the top of a model."""
        defaults = Defaults(document.sections.get("default", []))
        return cls(document, defaults, Geoms(document, defaults), "", prefix, suffix, depth)

    @property
    def is_own(self) -> bool:
        """Whether elements are written once in the main model."""
        return not self.suffix and not self.depth

    def inner(self, element: Element) -> MjcfScope:
        """Return what holds in a body or frame."""
        name = element.attributes.get("childclass", "")
        if not name:
            return self
        self.defaults.check(element, name)
        return replace(self, childclass=name)

    def named(self, name: str) -> str:
        """Return a name as the whole model has it."""
        return f"{self.prefix}{name}{self.suffix}"


def submodel(values: Values, scope: MjcfScope) -> MjcfDocument:
    """Return the model that an ``<attach>`` names."""
    name = values.text("model")
    models: dict[str, Element] = {}
    for element in scope.document.each("asset"):
        if element.tag == "model":
            file = element.attributes.get("file", "")
            models[element.attributes.get("name") or PurePath(file).stem] = element
    if name not in models:
        step = f"add <model name={shown(name)} file=.../> to <asset>{nearest(name, models)}"
        raise values.place.error(f"there is no model {shown(name)} to attach", step)
    if scope.depth >= _MAX_ATTACHED:
        raise values.place.error("models attached to models without end", "attach each model to another one once")
    element = models[name]
    file = Values(element.place, element.attributes).name("file")
    found = read_document(scope.document.folder / file, file_beside(element, "file", file, scope.document.folder))
    scope.document.texts.update(found.texts)
    _check_attached(values.place, found)
    return found


def _check_attached(place: Place, document: MjcfDocument) -> None:
    """Refuse an attached model with something outside of its world that would be lost."""
    for section in ("tendon", "deformable"):
        if any(True for _ in document.each(section)):
            step = f"write its <{section}> in the main file, or put the bodies there"
            raise place.error(f"the attached model has <{section}>, which is not read", step)
