"""What a profile is: the channels that a maker's log has, and what each of them means."""

from __future__ import annotations

import re
from abc import ABC
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from dynident.errors import BadOption

KINDS = ("measured", "commanded", "model")
SIDES = ("link", "motor")

#: What stands in a pattern for the joint: its number from 1, its number from 0, its name.
MARKS = ("{}", "{0}", "{joint}")

_EXPRESSIONS = {"{}": r"[1-9]\d*", "{0}": r"\d+", "{joint}": r".+"}


@dataclass(frozen=True)
class Channel:
    """A column per joint, and what it means.

    Attributes:
        pattern: Name of the columns, with ``{}``, ``{0}`` or ``{joint}`` for the joint.
        signal: Signal of a log that it is, such as ``q`` or ``torque``.
        kind: ``measured``, ``commanded`` or ``model`` (computed by the controller).
        side: ``link`` or ``motor``.
        unit: Its unit, a word of the case file; empty where only the user can know it.
        read: Whether it is read where the case file names no column for its signal.
        needed: Whether a log without it is refused; else it is left out.
        note: What one should know about it.
    """

    pattern: str
    signal: str
    kind: str = "measured"
    side: str = "link"
    unit: str = "SI"
    read: bool = True
    needed: bool = False
    note: str = ""

    def __post_init__(self) -> None:
        if self.kind not in KINDS or self.side not in SIDES or not any(mark in self.pattern for mark in MARKS):
            raise ValueError(f"no channel: {self}")

    def names(self, joints: Sequence[str]) -> tuple[str, ...]:
        """Return its columns, one per joint."""
        return pattern_names(self.pattern, joints)

    def matches(self, column: str) -> bool:
        """Return whether a column is one of its columns."""
        parts = re.split(r"(\{\}|\{0\}|\{joint\})", self.pattern)
        return re.fullmatch("".join(_EXPRESSIONS.get(part, re.escape(part)) for part in parts), column) is not None


class Profile(ABC):
    """A kind of log whose columns are documented.

    Attributes:
        time: Column of the time.
        time_unit: Its unit.
        channels: The channels; of those with one signal, the first that is ``read`` is read.
        source: Where the names and units are documented.
    """

    time: ClassVar[str]
    time_unit: ClassVar[str] = "s"
    channels: ClassVar[tuple[Channel, ...]]
    source: ClassVar[str]

    def read_channels(self) -> dict[str, Channel]:
        """Return the channel that is read for each signal."""
        found: dict[str, Channel] = {}
        for channel in self.channels:
            if channel.read:
                found.setdefault(channel.signal, channel)
        return found


def pattern_names(pattern: str, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the columns that a pattern stands for, one per joint.

    Args:
        pattern: Text with ``{}`` for the number of the joint counted from 1, ``{0}`` for that counted from 0, or
            ``{joint}`` for its name.
        joints: Names of the joints, in order.

    Raises:
        BadOption: The pattern has none of these marks.
    """
    if not any(mark in pattern for mark in MARKS):
        raise BadOption("columns", pattern, "write a list, or a pattern as q{}, q_{0} or {joint}.position")
    names = []
    for number, joint in enumerate(joints):
        values = {"{}": str(number + 1), "{0}": str(number), "{joint}": joint}
        names.append(re.sub(r"\{\}|\{0\}|\{joint\}", lambda match, values=values: values[match[0]], pattern))
    return tuple(names)
