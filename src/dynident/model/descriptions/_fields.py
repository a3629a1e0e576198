"""Values of a description, checked one by one: each error names the file, the place, the evidence and the next step."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from dynident.arrays import Array
from dynident.errors import DescriptionError, nearest
from dynident.model.robot import Drive, JointLimits

#: Beyond this a length, mass or moment is a slip, and its products would overflow; limits may be larger.
LARGEST: Final = 1e50

LIMITS: Final = ("lower", "upper", "velocity", "acceleration", "jerk", "effort", "effort_rate")

_DECIMAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_INFINITE = re.compile(r"[+-]?\.?inf(inity)?", re.IGNORECASE)
_NOT_A_NUMBER = re.compile(r"[+-]?\.?nan", re.IGNORECASE)
_SHOWN = 40


def shown(value: object) -> str:
    """Return a value from a file as a message shows it: quoted, on one line, cut when long."""
    if isinstance(value, str):
        return repr(value) if len(value) <= _SHOWN else f"{value[:_SHOWN]!r}..."
    if isinstance(value, int) and value.bit_length() > 1024:
        return "a whole number of hundreds of digits"  # Python refuses to write out the longest
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


@dataclass(frozen=True)
class Place:
    """Where in a description a value stands.

    Attributes:
        path: The file.
        where: The link, the joint, or the line and the key path.
    """

    path: object
    where: str = ""

    def error(self, evidence: str, step: str) -> DescriptionError:
        """Return the error that names this place."""
        return DescriptionError(self.path, self.where, evidence, step)


def decimal(place: Place, what: str, text: str, *, unbounded: bool = False) -> float:
    """Return the number written in ``text``.

    Args:
        place: Where it stands.
        what: What the number is, such as ``"mass value"``; may be empty.
        text: The text.
        unbounded: Whether ``inf`` is an answer, as it is for limits.

    Raises:
        DescriptionError: No plain finite number.
    """
    written = text.strip()
    label = f"{what} {shown(written)}".strip()
    if not written:
        raise place.error(f"{what or 'the value'} is empty", "write a number")
    if unbounded and _INFINITE.fullmatch(written):
        return float(written.replace(".", ""))
    if _INFINITE.fullmatch(written) or _NOT_A_NUMBER.fullmatch(written):
        raise place.error(f"{label} is not a finite number", "write a finite number")
    if not _DECIMAL.fullmatch(written):
        raise place.error(f"{label} is not a number", _advice(written))
    return in_range(place, label, float(written), unbounded=unbounded)


def in_range(place: Place, label: str, value: float, *, unbounded: bool = False) -> float:
    """Return ``value`` after a look at its size.

    Raises:
        DescriptionError: Larger than any real robot has and arithmetic stands.
    """
    largest = sys.float_info.max if unbounded else LARGEST
    if not abs(value) <= largest:
        step = "write 'inf' where there is no limit" if unbounded else "write a number in SI units"
        raise place.error(f"{label} is too large", step)
    return value


def expression(place: Place, text: str, *, unbounded: bool = False) -> float:
    """Return the value of a number or a product of numbers and ``pi``, such as ``-pi/2`` or ``90*pi/180``.

    Raises:
        DescriptionError: Something else, or a division by zero.
    """
    factors = re.split(r"([*/])", text)
    if len(factors) == 1 and "pi" not in text:
        return decimal(place, "", text, unbounded=unbounded)
    value = _factor(place, factors[0])
    for sign, factor in zip(factors[1::2], factors[2::2], strict=True):
        operand = _factor(place, factor)
        if sign == "*":
            value *= operand
        elif operand == 0.0:
            raise place.error(f"{shown(text)} divides by zero", "write a number, or a product such as pi/2")
        else:
            value /= operand
    return in_range(place, shown(text), value)


def _factor(place: Place, text: str) -> float:
    written = text.strip()
    if written in ("pi", "+pi", "-pi"):
        return -math.pi if written[0] == "-" else math.pi
    if not _DECIMAL.fullmatch(written):
        raise place.error(f"{shown(written)} is not a number", "write a number, or a product such as pi/2")
    return in_range(place, shown(written), float(written))


def _advice(written: str) -> str:
    if re.fullmatch(r"[+-]?\d*,\d+", written):
        return f"write a decimal point: {written.replace(',', '.')}"
    return "write one plain number, without a unit"


def check_name(place: Place, what: str, text: str) -> str:
    """Return a name as it is.

    Raises:
        DescriptionError: Empty, or with characters that cannot be printed.
    """
    if not text.strip():
        raise place.error(f"{what} is empty", "give it a name")
    if not text.isprintable():
        raise place.error(f"{what} {shown(text)} has characters that cannot be printed", "use plain letters")
    return text


@dataclass(frozen=True)
class Section:
    """A mapping of a YAML or JSON description, read key by key.

    Attributes:
        path: The file.
        values: The mapping.
        key: Key path of the mapping, ``""`` at the top; items of a list are counted from 1 (``joints.2.alpha``).
        lines: Line of each key path, where the file has lines.
        written: Whether numbers come as text (YAML, may be products with pi) or as numbers (JSON).
    """

    path: object
    values: Mapping[str, object]
    key: str = ""
    lines: Mapping[str, int] = field(default_factory=dict)
    written: bool = False

    @classmethod
    def top(cls, path: object, value: object, keys: Sequence[str], lines: Mapping[str, int] | None = None) -> Section:
        """Return the whole description as a section with the given known keys.

        Raises:
            DescriptionError: Not a mapping, or an unknown key.
        """
        where = Place(path)
        section = cls(path, _mapping(where, value), "", lines or {}, lines is not None)
        return section.known(keys)

    def place(self, key: str = "") -> Place:
        """Return the place of a key, or of the section itself."""
        full = ".".join(part for part in (self.key, key) if part)
        line = self.lines.get(full) or self.lines.get(self.key)
        return Place(self.path, ", ".join(part for part in (f"line {line}" if line else "", full) if part))

    def known(self, keys: Sequence[str]) -> Section:
        """Return the section itself after a check that it has no other keys.

        Raises:
            DescriptionError: An unknown key; the message has the nearest known one.
        """
        for key in self.values:
            if key not in keys:
                step = f"known keys: {', '.join(keys)}{nearest(key, keys)}"
                raise self.place().error(f"unknown key {shown(key)}", step)
        return self

    def has(self, key: str) -> bool:
        """Say whether a key is there and not null."""
        return self.values.get(key) is not None

    def value(self, key: str, step: str = "add it") -> object:
        """Return the value of a key that must be there.

        Raises:
            DescriptionError: Missing or null.
        """
        if not self.has(key):
            raise self.place(key).error("is missing", step)
        return self.values[key]

    def text(self, key: str, default: str | None = None) -> str:
        """Return a text; ``default`` where the key is missing.

        Raises:
            DescriptionError: Missing without a default, or no text.
        """
        if default is not None and not self.has(key):
            return default
        value = self.value(key)
        if not isinstance(value, str):
            raise self.place(key).error(f"a text is needed, not {_kind(value)}", "write a text")
        return value

    def name(self, key: str, default: str | None = None) -> str:
        """Return a name: a text that is not empty and can be printed."""
        return check_name(self.place(key), "the name", self.text(key, default))

    def choice(self, key: str, choices: Sequence[str], default: str | None = None, step: str = "") -> str:
        """Return one of some words.

        Raises:
            DescriptionError: Missing without a default, or another word.
        """
        if default is None:
            self.value(key, step or f"write one of: {', '.join(choices)}")
        word = self.text(key, default)
        if word not in choices:
            advice = step or f"choose one of: {', '.join(choices)}{nearest(word, choices)}"
            raise self.place(key).error(f"{shown(word)} is not known here", advice)
        return word

    def number(self, key: str, default: float | None = None, *, unbounded: bool = False) -> float:
        """Return a number; ``default`` where the key is missing.

        Raises:
            DescriptionError: Missing without a default, no number, or not finite (``unbounded``: inf is fine).
        """
        if default is not None and not self.has(key):
            return default
        return self._number(self.place(key), self.value(key), unbounded=unbounded)

    def at_least_zero(self, key: str, default: float | None = None, *, unbounded: bool = False) -> float:
        """Return a number that is not negative; see :meth:`number`."""
        value = self.number(key, default, unbounded=unbounded)
        if value < 0:
            raise self.place(key).error(f"{value:g} is negative", "write 0 or more")
        return value

    def numbers(self, key: str, count: int, default: Sequence[float] | None = None) -> Array:
        """Return a list of numbers, shape (count,)."""
        if default is not None and not self.has(key):
            return np.array(default, dtype=float)
        return self._numbers(key, self.value(key), count)

    def matrix(self, key: str, rows: int, columns: int) -> Array:
        """Return a list of rows, shape (rows, columns)."""
        place, value = self.place(key), self.value(key)
        if not isinstance(value, list) or len(value) != rows:
            raise place.error(f"{rows} rows are needed, not {_kind(value)}", f"write {rows} lists of {columns} numbers")
        table = [self._numbers(f"{key}.{i}", row, columns) for i, row in enumerate(value, start=1)]
        return np.array(table, dtype=float).reshape(rows, columns)

    def section(self, key: str, keys: Sequence[str]) -> Section:
        """Return the mapping under a key as a section with the given known keys; empty where the key is missing."""
        value = self.values.get(key)
        inner = _mapping(self.place(key), {} if value is None else value)
        return Section(self.path, inner, self._full(key), self.lines, self.written).known(keys)

    def sections(self, key: str, keys: Sequence[str]) -> list[Section]:
        """Return the list of mappings under a key as sections with the given known keys."""
        value = self.value(key)
        if not isinstance(value, list):
            raise self.place(key).error(f"a list is needed, not {_kind(value)}", "write a list")
        found = []
        for i, item in enumerate(value, start=1):
            inner = _mapping(self.place(f"{key}.{i}"), item)
            found.append(Section(self.path, inner, f"{self._full(key)}.{i}", self.lines, self.written).known(keys))
        return found

    def _full(self, key: str) -> str:
        return f"{self.key}.{key}" if self.key else key

    def _numbers(self, key: str, value: object, count: int) -> Array:
        place = self.place(key)
        if not isinstance(value, list) or len(value) != count:
            raise place.error(f"{count} numbers are needed, not {_kind(value)}", f"write a list of {count} numbers")
        found = [self._number(self.place(f"{key}.{i}"), item) for i, item in enumerate(value, start=1)]
        return np.array(found, dtype=float)

    def _number(self, place: Place, value: object, *, unbounded: bool = False) -> float:
        if self.written and isinstance(value, str):
            return expression(place, value, unbounded=unbounded)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise place.error(f"a number is needed, not {_kind(value)}", "write a number")
        if isinstance(value, float) and not math.isfinite(value):
            raise place.error(
                f"{value} is not a finite number", "write a number, or null for a limit that is not known"
            )
        in_range(place, shown(value), value, unbounded=unbounded)
        return float(value)


def read_limits(section: Section) -> JointLimits:
    """Return the joint limits of a section with the keys in ``LIMITS``; a missing or null one is infinite.

    Raises:
        DescriptionError: No number, negative, or the lower limit above the upper one.
    """
    lower = section.number("lower", -np.inf, unbounded=True)
    upper = section.number("upper", np.inf, unbounded=True)
    check_order(section.place(), lower, upper)
    return JointLimits(lower, upper, *(section.at_least_zero(key, np.inf, unbounded=True) for key in LIMITS[2:]))


def check_order(place: Place, lower: float, upper: float) -> None:
    """Check the two position limits of a joint.

    Raises:
        DescriptionError: The lower one is above the upper one, or one is infinite on the wrong side.
    """
    if not lower <= upper or lower == np.inf or upper == -np.inf:
        raise place.error(f"the lower limit {lower:g} is above the upper limit {upper:g}", "exchange or mend them")


def read_drive(section: Section) -> Drive:
    """Return the drive of a section with the keys gear_ratio, rotor_inertia and gain.

    Raises:
        DescriptionError: No number, a ratio or gain of zero, a negative rotor inertia.
    """
    ratio = section.number("gear_ratio", 1.0)
    gain = section.number("gain") if section.has("gain") else None
    for key, value in (("gear_ratio", ratio), ("gain", gain)):
        if value == 0.0:
            raise section.place(key).error("is zero", "write the value, negative where the motor turns the other way")
    return Drive(ratio, section.at_least_zero("rotor_inertia", 0.0), gain)


def _mapping(place: Place, value: object) -> Mapping[str, object]:
    if not isinstance(value, Mapping):
        raise place.error(f"a mapping (key: value) is needed, not {_kind(value)}", "write 'key: value' lines")
    return value


def _kind(value: object) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    return shown(value)
