"""What elements of an MJCF outside of its bodies name: in which replicas and attached models they stand for one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from dynident.errors import nearest
from dynident.model.documents.numbers import shown
from dynident.robot_files.mjcf.scope import Copy, MjcfScope
from dynident.robot_files.xml_elements import Element
from dynident.robot_files.xml_values import Values

#: The attributes that name something, by its kind.
_NAMING: Final = {
    "joint": ("joint", "jointinparent", "joint1", "joint2"),
    "body": ("body", "body1", "body2"),
    "site": ("site", "site1", "site2", "cranksite", "slidersite", "refsite"),
    "tendon": ("tendon", "tendon1", "tendon2"),
}


@dataclass(frozen=True)
class Tendon:
    """A tendon, as one of the replicas that it stands in has it.

    Attributes:
        element: Its element.
        parts: Coefficient of each joint, by its name in the whole model; None of one that is not ``<fixed>``.
    """

    element: Element
    parts: dict[str, float] | None


def copies_named(values: Values, kind: str, key: str, scope: MjcfScope) -> list[Copy]:
    """Return the copies of what an attribute names; none where an attached model has it and it is not attached.

    Raises:
        DescriptionError: The main model has none of this name.
    """
    name = values.text(key)
    found = scope.copies(kind, name)
    if not found and scope.outer is None:
        step = f"correct the name{nearest(name, scope.names.of(kind))}"
        raise values.place.error(f"{key} {shown(name)} is no {kind}", step)
    return found


def parts_with(values: Values, kind: str, keys: Sequence[str], scope: MjcfScope) -> list[MjcfScope]:
    """Return the parts of the model in which an element stands for one, as it names joints or tendons that are copied.

    Raises:
        DescriptionError: It names none, one that the main model has not, or two that not the same replicas copy.
    """
    values.text(keys[0])
    keys = [key for key in keys if key in values]
    copies = [copies_named(values, kind, key, scope) for key in keys]
    if not all(copies):
        return []
    first = [one[0] for one in copies]
    if any([replica.source for replica in one] != [replica.source for replica in first[0]] for one in first):
        evidence = f"no <replicate> copies both of its {kind}s"
        pairs = zip(keys, first, strict=True)
        names = " and ".join(scope.within(one).named(values.text(key)).removeprefix(scope.prefix) for key, one in pairs)
        raise values.place.error(evidence, f"name those of copies, such as {names}")
    return [scope.within(one) for one in copies[0] if all(one in others for others in copies)]


def is_left(values: Values, scope: MjcfScope) -> bool:
    """Return whether an element of an attached model stays behind, as what it names is not attached."""
    named = ((kind, values.text(key)) for kind, keys in _NAMING.items() for key in keys if key in values)
    return scope.outer is not None and not all(scope.copies(*one) for one in named)


def tendons_in(scope: MjcfScope) -> Iterator[tuple[str, Tendon]]:
    """Yield the tendons of a model by their names in the whole one, and note the names.

    Each replica with a part of a tendon has one of its own; the parts outside of the replica are in all of these.

    Raises:
        DescriptionError: A tendon of the main model has a joint that is not there, or two in different replicas.
    """
    for element in scope.document.each("tendon"):
        parts = [Values(one.place, one.attributes) for one in element.children]
        for held in _with_tendon(element, parts, scope):
            name = held.named(element.attributes.get("name", ""))
            held.keep("tendon", name)
            coefficients = dict[str, float]()
            for part in (part for part in parts if "joint" in part):
                depth = len(scope.copies("joint", part.text("joint"))[0])
                joint = held.within(held.replicas[:depth]).named(part.text("joint"))
                if joint in coefficients:
                    evidence = f"the tendon has joint {shown(joint)} twice"
                    raise part.place.error(evidence, "write the sum of both coef once")
                coefficients[joint] = part.number("coef")
            yield name, Tendon(element, coefficients if element.tag == "fixed" else None)


def _with_tendon(element: Element, parts: Sequence[Values], scope: MjcfScope) -> list[MjcfScope]:
    """Return the parts of a model in which a tendon stands for one."""
    named = [(kind, part) for kind in ("joint", "site") for part in parts if kind in part]
    copies = [copies_named(part, kind, kind, scope) for kind, part in named]
    if not all(copies):
        return []
    deepest = max(copies, key=lambda one: len(one[0]), default=[()])
    around = {replica.source for replica in deepest[0]}
    for kind, part in named:
        if around & scope.names.makers[kind, part.text(kind)]:
            evidence = (
                f"{kind} {shown(part.text(kind))} is a copy, made with the copies of another one that it runs over"
            )
            raise element.place.error(evidence, "name a copy of each, or what is copied of each")
    found = [one for one in deepest if all(one[: len(other[0])] in other for other in copies)]
    if not found and scope.outer is None:
        step = "couple those of one <replicate>, and write the rest as bodies of their own"
        raise element.place.error("no <replicate> copies all that it runs over", step)
    return [scope.within(one) for one in found]
