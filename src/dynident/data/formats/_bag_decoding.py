"""Messages as numbers; states of joints that differ in stamp and numbers alone are read from their bytes.

A publisher repeats the names of its joints in every message. Where the bytes of a message are those of one that was
decoded before, save for its stamp and its numbers, these stand where they stood there. Layout of the bytes: OMG,
Common Data Representation (CORBA 3.4, chapter 9.3), with the four bytes in front that DDS adds.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.arrays import IntArray
from dynident.data.formats._bag_messages import STATE, Layout, Numbers, is_joint_state, numbers_of

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
