"""Messages as numbers; states of joints that differ in stamp and numbers alone are read from their bytes.

A publisher repeats the names of its joints in every message. Where the bytes of a message are those of one that was
decoded before, save for its stamp and its numbers, these stand where they stood there. Layout of the bytes: OMG,
Common Data Representation (CORBA 3.4, chapter 9.3), with the four bytes in front that DDS adds.

Definitions of messages are looked at before ``rosbags`` reads them and makes code of them.
Its reader of IDL tries every level of operators twice, so that its time grows with 64 to the power of the depth of
parentheses, and with 2 to that of nested sequences; it works out shifts of any size; and its code has lines for every
element of an array of texts or messages. A few hundred bytes could so take hours or all memory.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.arrays import IntArray
from dynident.data.formats._bag_messages import STATE, Layout, Numbers, is_joint_state, numbers_of
from dynident.errors import LogFormatError

_LITTLE_ENDIAN, _FIRST, _STAMP_END = b"\x00\x01", 4, 12
_STAMP = struct.Struct("<iI")

#: Kinds of messages of a topic that are known by their bytes at most.
_MOST_KNOWN = 256


@dataclass(frozen=True)
class _Known:
    """A state of joints whose like is read from its bytes.

    Attributes:
        layout: Its layout.
        fixed: Parts of the bytes that must be the same, with what they are.
        first: Byte of the first number.
        count: Numbers of eight bytes from there to the last.
        places: Which of them are the values, shape (k,).
    """

    layout: Layout
    fixed: tuple[tuple[slice, bytes], ...]
    first: int
    count: int
    places: IntArray

    def read(self, data: bytes) -> Numbers | None:
        """Return the numbers of a message of as many bytes; None where it is of another kind."""
        for part, known in self.fixed:
            if data[part] != known:
                return None
        seconds, nanoseconds = _STAMP.unpack_from(data, _FIRST)
        values = np.frombuffer(data, "<f8", self.count, self.first)[self.places]
        return Numbers(self.layout, values, seconds * 1_000_000_000 + nanoseconds)


class Decoder:
    """Decodes messages, each kind of states of joints in full only once."""

    def __init__(self, decode: Callable[[Any, str], Any]) -> None:
        """Begin; ``decode`` makes a message of its bytes and type."""
        self._decode = decode
        self._known: dict[tuple[str, int], _Known | None] = {}

    def __call__(self, data: Any, topic: str, kind: str) -> Numbers:
        """Return what is read of a message of a topic."""
        key = topic, len(data)
        known = self._known.get(key)
        found = None if known is None else known.read(data)
        if found is not None:
            return found
        message = self._decode(data, kind)
        found = numbers_of(message)
        if key not in self._known and len(self._known) < _MOST_KNOWN:
            self._known[key] = _known(bytes(data), message, found) if is_joint_state(message) else None
        return found


def _known(data: bytes, message: Any, found: Numbers) -> _Known | None:
    """Return how messages like one are read; None where its bytes are not as expected."""
    if data[:2] != _LITTLE_ENDIAN:
        return None
    place = _behind_text(_STAMP_END, message.header.frame_id)
    place = _aligned(place, 4) + 4
    for name in message.name:
        place = _behind_text(place, name)
    free, places = [(_FIRST, _STAMP_END)], list[int]()
    for signal in STATE:
        values = getattr(message, signal)
        place = _aligned(place, 4) + 4
        if len(values):
            place = _aligned(place, 8)
            free.append((place, place + 8 * len(values)))
            if len(values) == len(message.name):
                places += range(place, free[-1][1], 8)
            place = free[-1][1]
    if place != len(data) or not places or any((at - places[0]) % 8 for at in places):
        return None
    edges = [0, *(edge for part in free for edge in part), len(data)]
    fixed = [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b > a]
    first, last = places[0], places[-1]
    order = (np.array(places) - first) // 8
    known = _Known(found.layout, tuple((part, data[part]) for part in fixed), first, (last - first) // 8 + 1, order)
    again = known.read(data)
    same = again is not None and again.stamp == found.stamp and again.values.tobytes() == found.values.tobytes()
    return known if same else None


def _behind_text(place: int, text: str) -> int:
    """Return the place behind a text: its length in bytes, the bytes and a zero."""
    return _aligned(place, 4) + 4 + len(text.encode()) + 1


def _aligned(place: int, size: int) -> int:
    """Return the next place that is a multiple of ``size`` from the first on."""
    return place + (_FIRST - place) % size


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
