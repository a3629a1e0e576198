"""What holds for the elements of a part of an MJCF: model, classes, names; and the models that are attached to it.

Frames, replicas and attached models are expanded into what they contain.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np

from dynident.errors import nearest
from dynident.model.documents.numbers import Place, shown
from dynident.robot_files.mjcf.document import MjcfDocument, read_document
from dynident.robot_files.mjcf.geoms import Geoms
from dynident.robot_files.mjcf.poses import IDENTITY, Pose, placed, pose_of
from dynident.robot_files.mjcf.schema import Defaults
from dynident.robot_files.rotations import rotation_from_euler
from dynident.robot_files.tree import some
from dynident.robot_files.xml_elements import MAX_LINKS, Element, Values

_MAX_ATTACHED: Final = 8


class Replica(NamedTuple):
    """A copy that a ``<replicate>`` makes.

    Attributes:
        source: File and number of the ``<replicate>``.
        ending: What names in it end with, after all copies of copies.
    """

    source: tuple[str, int]
    ending: str


#: The replicas that a name is copied by, from outside in.
Copy = tuple[Replica, ...]


@dataclass(frozen=True)
class Names:
    """What the elements of a model call bodies, joints, sites and tendons, and where its frames are.

    Attributes:
        copies: The copies that a kind and name stand for; a copy has a name of its own too, of fewer copies.
        makers: The ``<replicate>``s that made a copy, by its kind and name.
        frames: The frames by their names in the whole model, with what holds where they stand.
    """

    copies: dict[tuple[str, str], list[Copy]] = field(default_factory=dict)
    makers: dict[tuple[str, str], set[tuple[str, int]]] = field(default_factory=dict)
    frames: dict[str, tuple[Element, MjcfScope]] = field(default_factory=dict)

    def of(self, kind: str) -> list[str]:
        """Return the names of one kind."""
        return [name for one, name in self.copies if one == kind]


@dataclass(frozen=True)
class MjcfScope:
    """What holds for the elements of a part of the tree.

    Attributes:
        document: Their model.
        defaults: Its classes, and those of the models attached to it.
        own: Its classes: what elements outside of bodies have.
        geoms: Its geoms.
        models: The models attached to it, by the name that it gives them, as they are on their own.
        childclass: The class that elements have by default.
        prefix: What comes before names.
        replicas: The replicas of its own that the part stands in, from outside in.
        outer: The part of another model that it is attached to.
        names: What it calls bodies, joints, sites and tendons.
    """

    document: MjcfDocument
    defaults: Defaults
    own: Defaults
    geoms: Geoms
    models: Mapping[str, MjcfScope] = field(default_factory=dict)
    childclass: str = ""
    prefix: str = ""
    replicas: Copy = ()
    outer: MjcfScope | None = None
    names: Names = field(default_factory=Names)

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

    def within(self, copy: Copy) -> MjcfScope:
        """Return what holds in other replicas."""
        return replace(self, replicas=copy)

    def attached(self, values: Values) -> MjcfScope:
        """Return what holds at the top of the model that an ``<attach>`` in this part names."""
        prefix = self.prefix + values.text("prefix")
        return replace(self.models[values.text("model")], prefix=prefix, outer=self, names=Names())

    @property
    def suffix(self) -> str:
        """What names in the part end with."""
        return self.ending(len(self.replicas))

    def ending(self, depth: int) -> str:
        """Return what names end with in so many of the replicas, counted from outside."""
        if depth:
            return self.replicas[depth - 1].ending
        return "" if self.outer is None else self.outer.suffix

    def named(self, name: str) -> str:
        """Return a name as the whole model has it."""
        return f"{self.prefix}{name}{self.suffix}"

    def keep(self, kind: str, name: str) -> None:
        """Note a name of the whole model, of a body, joint, site or tendon, here and where the model is attached.

        What names it without what replicas add stands for one in each of them; with what the inner ones add, for one
        in each of the outer ones.
        """
        for depth in range(len(self.replicas) + 1):
            known = kind, name[len(self.prefix) : len(name) - len(self.ending(depth))]
            self.names.copies.setdefault(known, []).append(self.replicas[:depth])
            self.names.makers.setdefault(known, set()).update(one.source for one in self.replicas[depth:])
        if self.outer is not None:
            self.outer.keep(kind, name)

    def keep_frame(self, element: Element) -> None:
        """Note a frame, here and where the model is attached."""
        name, scope = element.attributes.get("name", ""), self
        while name and scope is not None:
            scope.names.frames.setdefault(self.named(name), (element, self))
            scope = scope.outer

    def copies(self, kind: str, name: str) -> list[Copy]:
        """Return the copies of a body, joint, site or tendon that the model calls so; none of one that is not there."""
        return self.names.copies.get((kind, name), [])


def _top(document: MjcfDocument, read: dict[str, MjcfScope], depth: int) -> MjcfScope:
    """Return what holds at the top of a model; ``read`` has the attached models by path, each of which is read once."""
    own, models = Defaults(document.sections.get("default", [])), dict[str, MjcfScope]()
    defaults = own
    for element in (one for world in document.sections["worldbody"] for one in world.below() if one.tag == "attach"):
        values = Values(element.place, element.attributes)
        name, prefix = values.text("model"), values.text("prefix")
        if depth >= _MAX_ATTACHED:
            raise values.place.error("models attached to models without end", "attach each model to another one once")
        if name not in models:
            models[name] = _model(values.place, document, name, read, depth)
            _check_options(values.place, document, models[name].document)
        defaults = defaults.with_attached(prefix, models[name].defaults)
    return MjcfScope(document, defaults, own, Geoms(document, defaults), models)


def _model(place: Place, document: MjcfDocument, name: str, read: dict[str, MjcfScope], depth: int) -> MjcfScope:
    """Return the first model of a name; one that ``<asset>`` gives no name has the one that its own file states."""
    names: list[str] = []
    for element in (one for one in document.each("asset") if one.tag == "model"):
        own = element.attributes.get("name")
        names.append(own or "")
        if own is None or own == name:
            file = Values(element.place, element.attributes).name("file")
            path = document.folder / file
            if path.suffix.lower() == ".urdf":
                saved = f"mujoco.mj_saveLastXML('{path.stem}.xml', mujoco.MjModel.from_xml_path('{path.name}'))"
                step = f"write it as an MJCF beside it, in Python by {saved}, and name that file"
                raise place.error(f"the attached model {shown(file)} is a URDF", step)
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


#: An element, where it stands in its body, and what holds for it.
Placed = tuple[Element, Pose, MjcfScope]

#: A body or frame, with its name in the whole model and what holds where it stands.
_Named = tuple[str, Element, MjcfScope]

_WORLD: Final = "world"


class Expansion:
    """Yields what stands in bodies, with models attached as MuJoCo does it."""

    def __init__(self, document: MjcfDocument) -> None:
        self._top = MjcfScope.of(document)
        self._attached: dict[tuple[str, str, str], MjcfScope] = {}
        self._count = 0

    @property
    def scopes(self) -> list[MjcfScope]:
        """Of the model and of those attached to it."""
        return [self._top, *self._attached.values()]

    def world(self) -> list[Placed]:
        """Return what stands in the world."""
        return list(self._in_world(self._top))

    def flat(self, element: Element, frame: Pose, scope: MjcfScope) -> Iterator[Placed]:
        """Yield the children of an element, those of frames, replicas and attached models in place of these."""
        for child in element.children:
            if child.tag == "frame":
                yield from self._framed(child, scope, frame)
            elif child.tag == "replicate":
                yield from self._replicas(child, frame, scope)
            elif child.tag == "attach":
                yield from self._in_attached(child, frame, scope)
            else:
                yield child, frame, scope

    def _in_world(self, scope: MjcfScope) -> Iterator[Placed]:
        for world in scope.document.sections["worldbody"]:
            yield from self.flat(world, IDENTITY, scope)

    def _framed(self, element: Element, scope: MjcfScope, frame: Pose) -> Iterator[Placed]:
        values = Values(element.place, element.attributes)
        if values.number("scale", 1.0) != 1.0:
            raise values.place.error("a frame with a scale is not read", "scale what is in it, and remove the scale")
        scope.keep_frame(element)
        yield from self.flat(element, placed(frame, pose_of(values, scope.document.compiler)), scope.inner(element))

    def _replicas(self, element: Element, frame: Pose, scope: MjcfScope) -> Iterator[Placed]:
        values = Values(element.place, element.attributes)
        copies = values.number("count")
        if not 0 <= copies <= MAX_LINKS or copies != int(copies):
            raise values.place.error(f"count {copies:g} is no number of replicas", f"write 0 to {MAX_LINKS}")
        compiler = scope.document.compiler
        angles = compiler.unit * (values.numbers("euler", 3) if "euler" in values else np.zeros(3))
        offset = values.numbers("offset", 3) if "offset" in values else np.zeros(3)
        digits = len(str(int(copies) - 1)) if copies > 1 else 1
        place = np.zeros(3)
        for number in range(int(copies)):
            ending = f"{values.text('sep', '')}{number:0{digits}d}{scope.suffix}"
            rotation = rotation_from_euler(number * angles, compiler.sequence)  # as MuJoCo: not one turn after another
            replica = Replica((str(element.path), element.number), ending)
            held = replace(scope, replicas=(*scope.replicas, replica)).inner(element)
            yield from self.flat(element, placed(frame, (rotation, place)), held)
            place = place + rotation @ offset

    def _in_attached(self, element: Element, frame: Pose, scope: MjcfScope) -> Iterator[Placed]:
        """Yield what an ``<attach>`` brings: the world of a model, one of its bodies, or what is in one of its frames.

        A body or frame may stand anywhere in the model. Its place there is that in the body or frame around it.
        """
        values = Values(element.place, element.attributes)
        own = scope.attached(values)
        own = self._attached.setdefault((str(own.document.path), own.prefix, own.suffix), own)
        self._count += 1
        if self._count > 10 * MAX_LINKS:
            raise values.place.error(f"more than {10 * MAX_LINKS} models are attached", "give the MJCF of one robot")
        if "body" in values and "frame" in values:
            raise values.place.error("it names a body and a frame", "keep one of the two")
        if values.text("body", "") == _WORLD:
            children = [child for world in own.document.sections["worldbody"] for child in world.children]
            yield Element("body", element.line, {"name": _WORLD}, children, element.path, element.number), frame, own
        elif "body" in values:
            child, held = self._found(values, "body", own, self._bodies(self._in_world(own)))
            yield child, frame, held
        elif "frame" in values:
            for _ in self._bodies(self._in_world(own)):  # passes all frames
                pass
            found = ((name, *one) for name, one in own.names.frames.items())
            yield from self._framed(*self._found(values, "frame", own, found), frame)
        else:
            yield from ((child, placed(frame, pose), held) for child, pose, held in self._in_world(own))

    def _bodies(self, children: Iterable[Placed]) -> Iterator[_Named]:
        """Yield the bodies among the children of one, and those in these, with their names in the whole model."""
        for child, _, scope in children:
            if child.tag == "body":
                yield scope.named(child.attributes.get("name", "")), child, scope
                yield from self._bodies(self.flat(child, IDENTITY, scope.inner(child)))

    def _found(self, values: Values, key: str, scope: MjcfScope, named: Iterable[_Named]) -> tuple[Element, MjcfScope]:
        """Return the body or frame of an attached model that an ``<attach>`` names."""
        name, known = values.name(key), list[str]()
        for whole, element, held in named:
            if whole == scope.named(name):
                return element, held
            known.append(whole.removeprefix(scope.prefix).removesuffix(scope.suffix))
        raise values.place.error(
            f"the attached model has no {key} {shown(name)}", f"correct the name{nearest(name, known)}"
        )
