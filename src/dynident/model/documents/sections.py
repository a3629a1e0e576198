"""A mapping of a YAML or JSON description, read key by key: no unknown keys, no wrong types, no missing values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from dynident.arrays import Array
from dynident.errors import nearest
from dynident.file_versions import FileVersions
from dynident.model.documents.numbers import LARGEST, Place, check_name, check_order, expression, in_range, shown
from dynident.model.joint import Drive, JointLimits

LIMITS: Final = ("lower", "upper", "velocity", "acceleration", "jerk", "effort", "effort_rate")

_LARGEST_RATIO: Final = 1e6


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

    @classmethod
    def versioned(
        cls, path: object, value: object, keys: Sequence[str], lines: Mapping[str, int], versions: FileVersions
    ) -> Section:
        """Return the whole of a file that states its version, as the current version has it; see :meth:`top`.

        Raises:
            DescriptionError: As of :meth:`top`, or of a version that cannot be read.
        """
        data = _mapping(Place(path), value)
        place = cls(path, data, "", lines, True).place(versions.key)
        return cls.top(path, versions.migrated(data, place.error), keys, lines)

    def place(self, key: str = "") -> Place:
        """Return the place of a key, or of the section itself."""
        full = ".".join(part for part in (self.key, key) if part)
        line = self.lines.get(full) or self.lines.get(self.key)
        return Place(self.path, ", ".join(part for part in (f"line {line}" if line else "", full) if part))

    def _beside(self, key: str) -> Place:
        """Return the section as a place, with the line of one of its keys."""
        line = self.lines.get(self._full(key)) or self.lines.get(self.key)
        return Place(self.path, ", ".join(part for part in (f"line {line}" if line else "", self.key) if part))

    def known(self, keys: Sequence[str]) -> Section:
        """Return the section itself after a check that it has no other keys.

        Raises:
            DescriptionError: An unknown key; the message has the nearest known one.
        """
        for key in self.values:
            if key not in keys:
                step = f"known keys: {', '.join(keys)}{nearest(key, keys)}"
                raise self._beside(key).error(f"unknown key {shown(key)}", step)
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
        return self._number(key, self.value(key), unbounded=unbounded)

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
        value = self.value(key)
        if not isinstance(value, list) or len(value) != rows:
            evidence = f"{rows} rows are needed, not {_kind(value)}"
            raise self.place(key).error(evidence, f"write {rows} lists of {columns} numbers")
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
        if not isinstance(value, list) or len(value) != count:
            evidence = f"{count} numbers are needed, not {_kind(value)}"
            raise self.place(key).error(evidence, f"write a list of {count} numbers")
        found = [self._number(f"{key}.{i}", item) for i, item in enumerate(value, start=1)]
        return np.array(found, dtype=float)

    def _number(self, key: str, value: object, *, unbounded: bool = False) -> float:
        if type(value) is float and abs(value) <= LARGEST:  # the most there are: no words for what is not wrong
            return value
        place = self.place(key)
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


def read_drive(section: Section) -> Drive:
    """Return the drive of a section with gear_ratio, rotor_inertia, gain, bias and gain_std (or gain_deviation).

    Raises:
        DescriptionError: No number, a ratio or gain of zero, a negative rotor inertia, a deviation that is no share.
    """
    ratio = section.number("gear_ratio", 1.0)
    gain = section.number("gain") if section.has("gain") else None
    for key, value in (("gear_ratio", ratio), ("gain", gain)):
        if value == 0.0:
            raise section.place(key).error("is zero", "write the value, negative where the motor turns the other way")
    key = "gain_std" if section.has("gain_std") else "gain_deviation"
    deviation = section.at_least_zero(key, 0.0)
    if deviation >= 1.0:
        raise section.place(key).error(f"is {deviation:g}", "write a share of the gain, such as 0.02")
    return Drive(ratio, section.at_least_zero("rotor_inertia", 0.0), gain, section.number("bias", 0.0), deviation)


def read_coupling(section: Section, count: int) -> Array:
    """Return the coupling matrix under the key coupling, shape (count, count): motor speed = coupling @ joint speed.

    Raises:
        DescriptionError: Another shape, singular, or entries that are no gear ratios.
    """
    matrix = section.matrix("coupling", count, count)
    place = section.place("coupling")
    if np.abs(matrix).max() > _LARGEST_RATIO:
        raise place.error(f"an entry is {np.abs(matrix).max():.4g}", f"write ratios of up to {_LARGEST_RATIO:g}")
    if np.linalg.matrix_rank(matrix) < len(matrix):
        raise place.error("the coupling matrix is singular", "write motor speed = coupling @ joint speed")
    return matrix


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
