"""Definitions of messages in a recording, looked at before ``rosbags`` reads them and makes code of them.

Its reader of IDL tries every level of operators twice, so that its time grows with 64 to the power of the depth of
parentheses, and with 2 to that of nested sequences; it works out shifts of any size; and its code has lines for every
element of an array of texts or messages. A few hundred bytes could so take hours or all memory.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from dynident.errors import LogFormatError

#: Characters of all definitions of a recording, and elements of the arrays of texts and messages of one, at most.
MOST_TEXT, MOST_ELEMENTS = 1 << 22, 2000

_TEXT_OR_COMMENT = re.compile(r'"(?:\\"|[^"])*"|/\*.*?\*/|//[^\n]*', re.DOTALL)
_ANNOTATION = re.compile(r"@[\w:\s]+\([^()]*\)")
_NESTED = re.compile(r"(?:sequence\s*<\s*){3}")
_STEP = "record it with the message definitions of ROS itself"


def check_texts(path: str, texts: Iterable[tuple[str, bool]]) -> None:
    """Check definitions before they are read.

    Args:
        path: The recording, for messages.
        texts: Each with whether it is IDL.

    Raises:
        LogFormatError: They are too long, or hold what would take ``rosbags`` too long.
    """
    left = MOST_TEXT
    for text, idl in texts:
        left -= len(text)
        if left < 0:
            raise LogFormatError(path, None, f"more than {MOST_TEXT} characters of message definitions", _STEP)
        bare = _TEXT_OR_COMMENT.sub(" ", text) if idl else ""
        if "<<" in bare or _NESTED.search(bare) or "(" in _ANNOTATION.sub(" ", bare):
            evidence = "a message definition computes its constants or nests its sequences"
            raise LogFormatError(path, None, evidence, _STEP)


def common_types(releases: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the message types that are the same in all of some releases, with all types that they hold.

    Args:
        releases: Constants and fields of every type of each release, as a type store of ``rosbags`` has them.
    """
    first, *others = releases
    found = {kind: fields for kind, fields in first.items() if all(other.get(kind) == fields for other in others)}
    while True:
        whole = {kind: fields for kind, fields in found.items() if _held(fields) <= found.keys()}
        if len(whole) == len(found):
            return found
        found = whole


def _held(fields: Any) -> set[str]:
    """Return the types of the messages that a message holds."""
    from rosbags.interfaces import Nodetype

    inner = (what[0] if node in (Nodetype.ARRAY, Nodetype.SEQUENCE) else (node, what) for _, (node, what) in fields[1])
    return {what for node, what in inner if node == Nodetype.NAME}


def check_arrays(path: str, fields: Mapping[str, Any], kinds: Iterable[str]) -> None:
    """Check the arrays of texts and messages in the messages of some types and in those that they hold.

    Args:
        path: The recording, for messages.
        fields: Constants and fields of every type, as a type store of ``rosbags`` has them.
        kinds: The types.

    Raises:
        LogFormatError: Their arrays have too many elements.
    """
    from rosbags.interfaces import Nodetype

    elements, open_, seen = 0, list(kinds), set[str]()
    while open_:
        kind = open_.pop()
        if kind in seen or kind not in fields:
            continue
        seen.add(kind)
        for _, (node, what) in fields[kind][1]:
            inner, count = what if node in (Nodetype.ARRAY, Nodetype.SEQUENCE) else ((node, what), 0)
            if inner[0] == Nodetype.NAME:
                open_.append(inner[1])
            if node == Nodetype.ARRAY and (inner[0] == Nodetype.NAME or inner[1][0] in ("string", "wstring")):
                elements += count
        if elements > MOST_ELEMENTS:
            evidence = f"the definition of '{kind}' has arrays of {elements} texts or messages"
            raise LogFormatError(path, None, evidence, f"at most {MOST_ELEMENTS} are read; {_STEP}")
