"""What frames, replicas and attached models of an MJCF contain, in place of these."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from dynident.errors import nearest
from dynident.model.documents.numbers import shown
from dynident.robot_files.mjcf.document import MjcfDocument
from dynident.robot_files.mjcf.poses import IDENTITY, Pose, placed, pose_of
from dynident.robot_files.mjcf.scope import MjcfScope, Replica
from dynident.robot_files.rotations import rotation_from_euler
from dynident.robot_files.xml_elements import MAX_LINKS, Element, Values

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
