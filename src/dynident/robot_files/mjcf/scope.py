"""What holds for the elements of a part of an MJCF: model, classes, names; and the models that are attached to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from dynident.errors import nearest
from dynident.model.documents.numbers import Place, shown
from dynident.robot_files.mjcf.defaults import Defaults
from dynident.robot_files.mjcf.document import MjcfDocument, read_document
from dynident.robot_files.mjcf.geoms import Geoms
from dynident.robot_files.tree import some
from dynident.robot_files.xml_elements import Element
from dynident.robot_files.xml_values import Values

_MAX_ATTACHED: Final = 8


@dataclass(frozen=True)
class MjcfScope:
    """What holds for the elements of a part of the tree.

    Attributes:
        document: Their model.
        defaults: Its classes, and those of the models attached to it.
        geoms: Its geoms.
        models: The models attached to it, by the name that it gives them, as they are on their own.
        childclass: The class that elements have by default.
        prefix: What comes before names.
        suffix: What comes behind names.
        is_attached: Whether the model is attached to another.
    """

    document: MjcfDocument
    defaults: Defaults
    geoms: Geoms
    models: Mapping[str, MjcfScope] = field(default_factory=dict)
    childclass: str = ""
    prefix: str = ""
    suffix: str = ""
    is_attached: bool = False

    @classmethod
    def of(cls, document: MjcfDocument) -> MjcfScope:
        """Return what holds at the top of a model.

        Raises:
            DescriptionError: A faulty class, or an ``<attach>`` of a model that is missing or faulty.
        """
        return _top(document, {}, 0)

    def inner(self, element: Element) -> MjcfScope:
        """Return what holds in a body or frame."""
        name = element.attributes.get("childclass", "")
        if not name:
            return self
        self.defaults.check(element, name)
        return replace(self, childclass=name)

    def attached(self, values: Values) -> MjcfScope:
        """Return what holds at the top of the model that an ``<attach>`` in this part names."""
        prefix = self.prefix + values.text("prefix")
        return replace(self.models[values.text("model")], prefix=prefix, suffix=self.suffix, is_attached=True)

    def named(self, name: str) -> str:
        """Return a name as the whole model has it."""
        return f"{self.prefix}{name}{self.suffix}"


def _top(document: MjcfDocument, read: dict[str, MjcfScope], depth: int) -> MjcfScope:
    """Return what holds at the top of a model; ``read`` has the attached models by path, each of which is read once."""
    defaults, models = Defaults(document.sections.get("default", [])), dict[str, MjcfScope]()
    for element in (one for world in document.sections["worldbody"] for one in world.below() if one.tag == "attach"):
        values = Values(element.place, element.attributes)
        name, prefix = values.text("model"), values.text("prefix")
        if depth >= _MAX_ATTACHED:
            raise values.place.error("models attached to models without end", "attach each model to another one once")
        if name not in models:
            models[name] = _model(values.place, document, name, read, depth)
            _check_options(values.place, document, models[name].document)
        defaults.attach(prefix, models[name].defaults)
    return MjcfScope(document, defaults, Geoms(document, defaults), models)


def _model(place: Place, document: MjcfDocument, name: str, read: dict[str, MjcfScope], depth: int) -> MjcfScope:
    """Return the first model of a name; one that ``<asset>`` gives no name has the one that its own file states."""
    names: list[str] = []
    for element in (one for one in document.each("asset") if one.tag == "model"):
        own = element.attributes.get("name")
        names.append(own or "")
        if own is None or own == name:
            file = Values(element.place, element.attributes).name("file")
            path = document.folder / file
            if str(path) not in read:
                inner = read_document(path, document.beside(element, "file", file), document.known)
                read[str(path)] = _top(inner, read, depth + 1)
            found = read[str(path)]
            names[-1] = found.document.model if own is None else own
            if names[-1] == name:
                document.take(found.document, element)
                return found
    step = f"add <model name={shown(name)} file=.../> to it, or correct the name{nearest(name, names)}"
    others = f", but {some(names)}" if names else ""
    raise place.error(f"<asset> names no model {shown(name)}{others}", step)


def _check_options(place: Place, document: MjcfDocument, inner: MjcfDocument) -> None:
    """Refuse options of an attached model that MuJoCo takes over, which are not read."""
    same = np.array_equal(inner.gravity, document.gravity) and inner.disabled.keys() <= document.disabled.keys()
    if document.compiler.merges and not (same and inner.has_fluid <= document.has_fluid):
        step = "write the <option> into the main file, and remove conflict"
        raise place.error('conflict="merge" takes over the options of the attached model, which is not read', step)
