"""The frames of an SDF: links, joints, frames and nested models, where each is and what link it is fixed to."""

from __future__ import annotations

from typing import Final

import numpy as np

from dynident.errors import nearest
from dynident.model.documents.numbers import shown
from dynident.robot_files.sdf_elements import Pose, model_pose, name_of, placed, pose_of_element
from dynident.robot_files.xml_elements import Element

WORLD: Final = "world"
_OWN: Final = "__model__"
_DEPTH: Final = 100


def inverse(pose: Pose) -> Pose:
    """Return where the frame is in which a pose is stated, seen from that pose."""
    return pose[0].T, -pose[0].T @ pose[1]


class SdfFrames:
    """The frames of one model and those nested in it, by their full names (``MODEL::NAME``).

    Attributes:
        elements: Element of each frame, and the scope in which it stands (empty, or ends with ``::``).
    """

    def __init__(self, model: Element) -> None:
        self._model = model
        self._poses: dict[str, Pose] = {}
        self._open: list[str] = []
        self.elements: dict[str, tuple[Element, str]] = {}
        self._collect(model, "")

    def _collect(self, model: Element, scope: str) -> None:
        for element in model.children:
            if element.tag in ("link", "joint", "frame", "model"):
                name = scope + name_of(element)
                if name in self.elements or name == WORLD:
                    step = "give each link, joint, frame and nested model a name of its own"
                    raise element.place.error(f"the name {shown(name)} is taken", step)
                self.elements[name] = element, scope
                if element.tag == "model":
                    self._collect(element, f"{name}::")

    def all(self, tag: str) -> dict[str, Element]:
        """Return the elements of a kind by name."""
        return {name: element for name, (element, _) in self.elements.items() if element.tag == tag}

    def pose(self, name: str) -> Pose:
        """Return where a frame is in the frame of the model.

        Raises:
            DescriptionError: Frames that are placed by each other in a ring.
        """
        if name in self._poses:
            return self._poses[name]
        if name in self._open or len(self._open) > 200:
            ring = " -> ".join(shown(each) for each in [*self._open[:6], name])
            evidence = f"poses refer to each other in a ring: {ring}"
            raise self.elements[name][0].place.error(evidence, "correct relative_to")
        self._open.append(name)
        found = self._placed_element(name)
        self._open.pop()
        self._poses[name] = found
        return found

    def _placed_element(self, name: str) -> Pose:
        element, scope = self.elements[name]
        poses = element.all("pose")
        given = poses[0].attributes.get("relative_to", "") if poses else ""
        own = pose_of_element(poses[0]) if poses else (np.eye(3), np.zeros(3))
        if given:
            found = placed(self.frame(given, scope, poses[0]), own)
        elif element.tag == "joint":
            found = placed(self.frame(self._stated_end(element, "child"), scope, element), own)
        else:
            attached = element.attributes.get("attached_to") if element.tag == "frame" else ""
            found = placed(self.frame(attached or _OWN, scope, element), own)
        placement = element.attributes.get("placement_frame") if element.tag == "model" else ""
        return placed(found, inverse(self._within(name, placement))) if placement else found

    def _within(self, model: str, name: str) -> Pose:
        """Return where a frame of a nested model is in the frame of that model, wherever this one stands."""
        kept = self._poses, self._open
        self._poses, self._open = {model: (np.eye(3), np.zeros(3))}, []
        found = self.frame(name, f"{model}::", self.elements[model][0])
        self._poses, self._open = kept
        return found

    def in_world(self) -> Pose:
        """Return the frame of the model in the world; its pose is that of its ``placement_frame``."""
        given, name = model_pose(self._model), self._model.attributes.get("placement_frame", "")
        if name == WORLD:
            raise self._model.place.error("its placement_frame is the world", "write a frame of the model")
        return placed(given, inverse(self.frame(name, "", self._model))) if name else given

    def frame(self, name: str, scope: str, element: Element) -> Pose:
        """Return where the frame is that a name means in a scope; errors are at ``element``.

        Raises:
            DescriptionError: There is no frame of this name.
        """
        if name == WORLD:
            return inverse(self.in_world())
        full = scope + name
        is_model = full == _OWN or full.endswith(f"::{_OWN}")
        if is_model:
            full = full.removesuffix(_OWN).removesuffix("::")
            if not full:
                return np.eye(3), np.zeros(3)
        if full not in self.elements or (is_model and self.elements[full][0].tag != "model"):
            step = f"correct the name{nearest(name, self.elements)}"
            raise element.place.error(f"there is no frame {shown(full)}", step)
        return self.pose(full)

    def end(self, joint: Element, scope: str, tag: str) -> str:
        """Return the link, or the world, that a joint has as its parent or child: what the frame it names is fixed to.

        Raises:
            DescriptionError: It names none, or what is fixed to no link.
        """
        text = self._stated_end(joint, tag)
        name = self.link_behind(WORLD if text == WORLD else scope + text)
        if name is None:
            raise joint.place.error(f"its {tag} {shown(text)} is fixed to itself", "correct attached_to")
        if name != WORLD and name not in self.elements:
            step = f"write the name of a link or frame{nearest(text, self.elements)}"
            raise joint.place.error(f"its {tag} {shown(text)} is no link and no frame", step)
        return name

    @staticmethod
    def _stated_end(joint: Element, tag: str) -> str:
        found = joint.all(tag)
        if not found or not found[0].text:
            raise joint.place.error(f"<joint> has no <{tag}>", f"write <{tag}>LINK</{tag}>")
        return found[0].text

    def link_behind(self, name: str) -> str | None:
        """Return what a frame is fixed to: a link, the world, or an unknown name as it is; None in a ring.

        A joint is fixed to its child, a model to its canonical link.
        """
        for _ in range(_DEPTH):
            if name == _OWN or name.endswith(f"::{_OWN}"):
                scope = name.removesuffix(_OWN)
                model, _ = self.elements.get(scope.removesuffix("::"), (None, "")) if scope else (self._model, "")
                if model is None or model.tag != "model":
                    return name
                name = self._canonical(model, scope)
                continue
            if name == WORLD or name not in self.elements:
                return name
            element, scope = self.elements[name]
            if element.tag == "link":
                return name
            if element.tag == "model":
                name = f"{name}::{_OWN}"
            else:
                is_joint = element.tag == "joint"
                text = self._stated_end(element, "child") if is_joint else element.attributes.get("attached_to") or _OWN
                name = WORLD if text == WORLD else scope + text
        return None

    def _canonical(self, model: Element, scope: str) -> str:
        """Return the link that the frame of a model is fixed to: the stated one, else the first, own ones before.

        Raises:
            DescriptionError: It has none, or the stated one is none.
        """
        if stated := model.attributes.get("canonical_link"):
            links = self.all("link")
            if scope + stated not in links:
                step = f"write the name of a link in it{nearest(scope + stated, links)}"
                raise model.place.error(f"its canonical_link {shown(stated)} is no link", step)
            return scope + stated
        for tag, end in (("link", ""), ("model", f"::{_OWN}")):
            for child in model.all(tag)[:1]:
                return f"{scope}{name_of(child)}{end}"
        raise model.place.error("a model without links", "write a <link> into it, or remove it")
