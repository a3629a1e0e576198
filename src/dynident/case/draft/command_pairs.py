"""Commanded and measured positions that only words such as action and state, goal and present tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.case.draft.column_groups import Group, joint_forms, joint_in
from dynident.case.draft.column_words import (
    ENABLED,
    KIND,
    NEUTRAL,
    OTHER,
    SHARE_WORDS,
    SIGNAL,
    Meaning,
    split_unit,
    tokens_of,
)
from dynident.case.draft.command_topics import by_places
from dynident.case.draft.joint_choice import choose_joints
from dynident.case.draft.recognition import Recognised, SignalSource
from dynident.case.draft.structure import TableStructure

#: Words for what a servo is told, beside those that commands have in every log.
_TOLD = frozenset("action actions leader".split())

#: Words for what it did, beside those of measurements.
_DID = frozenset("follower state observation".split())


def command_pair(header: Sequence[str], joints: Sequence[str]) -> dict[str, Group]:
    """Return measured and commanded positions, ``q`` and ``q_ref``, whose names differ in a word for the command alone.

    The columns of both have the same words and numbers beside it, one for each motor: ``action.elbow.pos`` and
    ``observation.state.elbow.pos``, ``cmd1`` and ``pos1``. They are those of the joints where their words are, else in
    the order of the header; at least as many as the robot has joints.

    Args:
        header: Names of the columns.
        joints: Names of the joints of the robot, in order.

    Returns:
        Both groups; empty where the names tell no such pair, or more columns than these may be torques.
    """
    told: dict[tuple[str, ...], str] = {}
    did: dict[tuple[str, ...], str] = {}
    rest = 0
    for name in header:
        words = tokens_of(split_unit(name)[0])
        signals = {SIGNAL[word] for word in words if word in SIGNAL}
        if (
            ENABLED.fullmatch(name)
            or signals == {"time"}
            or OTHER.intersection(words)
            or (not signals and SHARE_WORDS.intersection(words))
        ):
            continue
        is_told = any(word in _TOLD or KIND.get(word) == "commanded" for word in words)
        known = is_told or bool(signals) or any(word in _DID or KIND.get(word) == "measured" for word in words)
        key = tuple(w for w in words if w not in NEUTRAL | SIGNAL.keys() | KIND.keys() | _TOLD | _DID)
        if signals & {"torque", "current"}:
            return {}
        if signals - {"q"} or not known or key in (told if is_told else did):
            rest += not signals
            continue
        (told if is_told else did)[key] = name
    both = [key for key in did if key in told]
    if len(both) < len(joints) or rest + len(told) + len(did) - 2 * len(both) >= len(joints):
        return {}
    forms = joint_forms(joints)
    places = {key: place[0] for key in both if (place := joint_in(key, forms)) is not None}
    by_name = sorted(places.values()) == list(range(len(joints)))
    order = sorted(places, key=places.__getitem__) if by_name else both
    meanings = {"q": (did, "measured"), "q_ref": (told, "commanded")}
    return {
        signal: Group(Meaning("q", kind), {k: names[key] for k, key in enumerate(order)}, by_name)
        for signal, (names, kind) in meanings.items()
    }


def by_commands(found: Recognised) -> Recognised:
    """Return measured and commanded positions that a word for the command, or a topic, alone tells apart, if any."""
    groups = command_pair(found.header, found.robot.joint_names)
    if not groups or not found.time:
        return by_places(found)
    how = {"q": "measured, by their names", "q_ref": "commanded, by their names"}
    sources = {signal: SignalSource(group.names, "", "link", how[signal]) for signal, group in groups.items()}
    joints = choose_joints(found.robot, groups["q"], np.zeros((1, groups["q"].count)))
    structure = TableStructure(groups=groups, evidence=how)
    return replace(found, sources=sources, rivals={}, joints=joints, structure=structure)
