"""Friction parts of a case file that no log can tell: fields that cannot be looked for, elements that are the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from dynident.errors import BadOption
from dynident.identification.selection.friction.variable_projection import spans_of
from dynident.model.friction import Friction


def check_part(part: Friction, earlier: Sequence[Friction]) -> None:
    """Refuse a part that leaves to the logs what is no field to look for, or that has the torque of an earlier one.

    Args:
        part: The part.
        earlier: Those before it.

    Raises:
        BadOption: It does.
    """
    for asked in ("vary", "choose"):
        spans_of(part, asked, fastest=1.0)
    if part.vary or part.choose or "element" not in part.options:
        return
    same: dict[str, Any] = {"element": 1, "joints": None}
    for other in earlier:
        on = part.joints is None or other.joints is None or set(part.joints) & set(other.joints)
        if on and type(other) is type(part) and replace(other, **same) == replace(part, **same):
            step = "elements with the same options have the same torque; give each a length of its own"
            raise BadOption("element", part.options["element"], step)
