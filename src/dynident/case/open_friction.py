"""Friction parts of a case file that no log can tell: fields that cannot be looked for, elements that are the same."""

from __future__ import annotations

from collections.abc import Sequence
from math import isclose

from dynident.errors import BadOption
from dynident.identification.selection.friction.variable_projection import spans_of
from dynident.model.friction import WHOLE_PART, Friction

#: Share by which a field of one of two elements has to differ from that of the other.
APART = 1e-3


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
    own = part.options
    for other in earlier if "element" in own and "length" in part.ranges else ():
        on = part.joints is None or other.joints is None or set(part.joints) & set(other.joints)
        is_open = {*(part.vary or ()), *(part.choose or ()), *(other.vary or ()), *(other.choose or ())} - {WHOLE_PART}
        if not on or is_open or type(other) is not type(part) or other.options["element"] == own["element"]:
            continue
        if all(isclose(other.options[name], own[name], rel_tol=APART) for name in part.ranges):
            both = f"that of element {other.options['element']} is {other.options['length']:g}"
            step = f"{both}, so that both have the same torque; give each a length of its own"
            raise BadOption("length", own["length"], step)
