"""Answers compared: JSON leaf by leaf, texts line by line, arrays by column, archives by their members."""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from functools import cache
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import yaml

#: Keys of a JSON file, and positions in its lists.
Place = tuple[str | int, ...]
#: The same as a pattern: None is any position in a list.
Pattern = tuple[str | None, ...]

#: What says nothing of the numbers: times, versions, where it ran.
IGNORED = (
    "extras.seconds",
    "medians.seconds",
    "methods[].seconds",
    "settings.seconds",
    "tails.seconds",
    "time [s]",
    "provenance.platform",
    "provenance.python",
    "provenance.versions",
)
#: Sizes of rounding errors and of what an iteration leaves over: that they stay below NOTHING is enough.
RESIDUES = ("active_slack", "proofs[].difference", "proofs[].relative")
NOTHING = 1e-6
#: Parts of texts that say nothing of the numbers, and what stands for them.
SCRUBBED = (
    (re.compile(r"\b[0-9a-f]{32,128}\b"), "<hash>"),
    (re.compile(r"\bdynident \d+(\.\d+)+\S*"), "dynident <version>"),
    (re.compile(r"\b\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d)?(\.\d+)?(Z|[+-]\d\d:?\d\d)?"), "<time>"),
    (re.compile(r'(?<=data-label="time \[s\]">)[^<]*|(?<=<bdi>seconds</bdi></dt><dd><bdi>)[^<]*'), "<seconds>"),
)
NUMBER = re.compile(r"(?<![\w.])([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?![\w.])")
#: Compiled for one machine: that they are there is enough.
COMPILED = (".so", ".dll", ".dylib")


@dataclass(frozen=True)
class Tolerance:
    """How far numbers may be apart.

    Attributes:
        relative: Share of the number.
        floor: Share of the largest number of its vector, column or line.
    """

    relative: float
    floor: float

    def apart(self, a: Any, b: Any, scale: Any) -> Any:
        """Return where two numbers or arrays differ."""
        a, b = np.asarray(a, float), np.asarray(b, float)
        with np.errstate(invalid="ignore"):
            bound = self.relative * np.maximum(np.abs(a), np.abs(b)) + self.floor * np.asarray(scale)
            near = np.isfinite(a) & np.isfinite(b) & (np.abs(a - b) <= bound)
        return ~(near | (a == b) | (np.isnan(a) & np.isnan(b)))


EXACT = Tolerance(1e-9, 1e-12)
ITERATED = Tolerance(1e-6, 1e-9)


@dataclass(frozen=True)
class Difference:
    """What differs at one place of a file, list positions left open.

    Attributes:
        file: Below the folder of answers.
        place: Path of keys, line, or column.
        message: What differs, the most of several.
        size: Largest relative difference of numbers; infinite for everything else.
        count: How many values differ there.
    """

    file: str
    place: str
    message: str
    size: float = np.inf
    count: int = 1

    def __str__(self) -> str:
        more = f" ({self.count} differ, this the most)" if self.count > 1 else ""
        return f"{self.file}: {self.place}: {self.message}{more}"


@dataclass(frozen=True)
class Renames:
    """The table of what was renamed on purpose."""

    keys: Mapping[Pattern, Pattern] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=dict)
    values: Mapping[str, Mapping[Any, Any]] = field(default_factory=dict)
    gone: tuple[Pattern, ...] = ()
    added: tuple[Pattern, ...] = ()

    @staticmethod
    def read(file: Path) -> Renames:
        """Return the table of a YAML file.

        Raises:
            ValueError: A key of the table is not known, or a path and its new one have other numbers of lists.
        """
        table = yaml.safe_load(file.read_text(encoding="utf-8")) or {}
        if wrong := set(table) - {"keys", "words", "values", "gone", "added"}:
            raise ValueError(f"{file}: unknown key {', '.join(sorted(wrong))}")
        keys = {pattern(old): pattern(new) for old, new in (table.get("keys") or {}).items()}
        for old, new in keys.items():
            if old.count(None) != new.count(None):
                raise ValueError(f"{file}: {shown(old)} and {shown(new)} have other numbers of []")
        gone, added = (tuple(map(pattern, table.get(name) or ())) for name in ("gone", "added"))
        return Renames(keys, table.get("words") or {}, table.get("values") or {}, gone, added)

    def place(self, place: Place) -> Place:
        """Return what a place of the older answers is called now."""
        for old, new in self.keys.items():
            at = index_of(place, old)
            if at is not None:
                numbers = iter([part for part in place[at : at + len(old)] if isinstance(part, int)])
                now = tuple(next(numbers) if part is None else part for part in new)
                place = (*place[:at], *now, *place[at + len(old) :])
        return place

    def text(self, text: str) -> str:
        """Return what a text of the older answers says now."""
        for old, new in self.words.items():
            text = re.sub(rf"(?<!\w){re.escape(old)}(?!\w)", new.replace("\\", r"\\"), text)
        return text


def pattern(text: str) -> Pattern:
    """Return the pattern that ``train.joints[].rmse`` writes."""
    parts: list[str | None] = []
    for part in text.split("."):
        name = part.replace("[]", "")
        parts += ([name] if name else []) + [None] * part.count("[]")
    return tuple(parts)


def index_of(place: Place, wanted: Pattern) -> int | None:
    """Return where a place has a pattern, or None."""
    for start in range(len(place) - len(wanted) + 1):
        pairs = zip(place[start:], wanted, strict=False)
        if all(isinstance(part, int) if want is None else part == want for part, want in pairs):
            return start
    return None


def shown(place: tuple[Any, ...]) -> str:
    """Return a place as it is written; positions in lists are left open."""
    text = "".join("[]" if part is None or isinstance(part, int) else f".{part}" for part in place)
    return text.removeprefix(".") or "(all)"


def leaves(value: Any, place: Place = ()) -> Iterator[tuple[Place, Any]]:
    """Yield the places and values of a JSON value; a list of numbers only is one."""
    if isinstance(value, dict) and value:
        for key, item in value.items():
            yield from leaves(item, (*place, key))
    elif isinstance(value, list) and value and not all(map(is_number, value)):
        for k, item in enumerate(value):
            yield from leaves(item, (*place, k))
    else:
        yield place, value


def is_number(value: Any) -> bool:
    """Return whether a value is a number; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


@dataclass(frozen=True)
class Comparison:
    """How two folders of answers are compared.

    Attributes:
        renames: What was renamed on purpose.
        scrub: What is done to a text before it is compared, for the older and the newer one.
        numbers_only: Leave texts and strings out.
    """

    renames: Renames = field(default_factory=Renames)
    scrub: tuple[Callable[[str], str], Callable[[str], str]] = (str, str)
    numbers_only: bool = False

    def _clean(self, text: str, which: int) -> str:
        text = self.scrub[which](text)
        for what, stand_in in SCRUBBED:
            text = what.sub(stand_in, text)
        return text if which else self.renames.text(text)

    def values(self, file: str, a: Any, b: Any, tolerance: Tolerance) -> list[Difference]:
        """Return the differences of two JSON values, those of the items of a list as one."""
        old, new = self._leaves(a, 0), self._leaves(b, 1)
        scales: dict[Place, float] = {}
        residues = tuple(map(pattern, RESIDUES))
        for place, value in [*old.items(), *new.items()]:
            if is_number(value) and np.isfinite(value):
                key = _group(place)
                scales[key] = max(scales.get(key, 0.0), abs(value))
        by_place: dict[tuple[str, str], Difference] = {}
        for place in [*old, *(place for place in new if place not in old)]:
            here = shown(place)
            if place not in new or place not in old:
                which, value = ("older", old[place]) if place in old else ("newer", new[place])
                _add(by_place, which, Difference(file, here, f"only in the {which} answers: {_short(value)}"))
            else:
                cut = _cut if _matches(_open(place), residues) else lambda value: value
                one = self._apart(cut(old[place]), cut(new[place]), scales.get(_group(place), 0.0), tolerance)
                if one is not None:
                    _add(by_place, "", Difference(file, here, *one))
        return list(by_place.values())

    def _leaves(self, value: Any, which: int) -> dict[Place, Any]:
        """Return what is compared of a JSON value, by place, as it is called now."""
        left_out = tuple(map(pattern, IGNORED)) + (self.renames.added if which else self.renames.gone)
        kept: dict[Place, Any] = {}
        for place, item in leaves(value):
            if _matches(_open(place), left_out):
                continue
            leaf, now = item, place if which else self.renames.place(place)
            if not which and place and isinstance(leaf, str | int | float):
                leaf = self.renames.values.get(str(place[-1]), {}).get(leaf, leaf)
            kept[now] = self._clean(leaf, which) if isinstance(leaf, str) else leaf
        return kept

    def _apart(self, a: Any, b: Any, scale: float, tolerance: Tolerance) -> tuple[str, float, int] | None:
        """Return what differs, how far and how often, or None."""
        if is_number(a) and is_number(b):
            return (f"{a!r} -> {b!r}", _relative(a, b), 1) if tolerance.apart(a, b, scale) else None
        if isinstance(a, list) and isinstance(b, list):
            if len(a) != len(b):
                return f"{len(a)} -> {len(b)} items", np.inf, 1
            return _arrays_apart(np.array(a, float), np.array(b, float), tolerance)
        if isinstance(a, str) and isinstance(b, str) and (self.numbers_only or a == b):
            return None
        return None if type(a) is type(b) and a == b else (f"{_short(a)} -> {_short(b)}", np.inf, 1)

    def texts(self, file: str, a: str, b: str, tolerance: Tolerance) -> list[Difference]:
        """Return the differences of two texts; numbers in them are compared as numbers."""
        old, new = self._clean(a, 0).splitlines(), self._clean(b, 1).splitlines()
        by_place: dict[tuple[str, str], Difference] = {}
        for first, second, number, same in _lines(old, new):
            if first is None or second is None or not same:
                if not self.numbers_only:
                    message = f"line {number}: {_beside(first, second)}"
                    _add(by_place, "words", Difference(file, "words", message))
            elif first != second:
                ours, theirs = (np.array(NUMBER.findall(line), float) for line in (first, second))
                one = _arrays_apart(ours, theirs, tolerance)
                if one is not None:
                    message, size, count = one
                    _add(by_place, "", Difference(file, "numbers", f"line {number}: {message}", size, count))
        return list(by_place.values())

    def contents(self, file: str, a: bytes, b: bytes, tolerance: Tolerance) -> list[Difference]:
        """Return the differences of two files or members of an archive."""
        if a == b or file.endswith(COMPILED):
            return []
        if file.endswith(".npy"):
            return self._arrays(file, a, b, tolerance)
        if all(zipfile.is_zipfile(io.BytesIO(data)) for data in (a, b)):
            return self._archives(file, a, b, tolerance)
        try:
            old, new = a.decode("utf-8"), b.decode("utf-8")
        except UnicodeDecodeError:
            return [Difference(file, "bytes", f"{len(a)} -> {len(b)} bytes that are no text, and differ")]
        if file.endswith(".json"):
            try:
                values = json.loads(old), json.loads(new)
            except ValueError:
                pass  # lines of JSON, or none: a text
            else:
                return self.values(file, *values, tolerance)
        return self.texts(file, old, new, tolerance)

    def _archives(self, file: str, a: bytes, b: bytes, tolerance: Tolerance) -> list[Difference]:
        with zipfile.ZipFile(io.BytesIO(a)) as older, zipfile.ZipFile(io.BytesIO(b)) as newer:
            old, new = ({f"{file}/{name}": box.read(name) for name in box.namelist()} for box in (older, newer))
        return self.folders(old, new, lambda _: tolerance)

    def _arrays(self, file: str, a: bytes, b: bytes, tolerance: Tolerance) -> list[Difference]:
        old, new = (np.load(io.BytesIO(data), allow_pickle=False) for data in (a, b))
        if old.dtype == new.dtype == np.uint8 and old.ndim == 1:  # a text
            return self.contents(file.removesuffix(".npy") + ".json", old.tobytes(), new.tobytes(), tolerance)
        if old.shape != new.shape or old.dtype.kind != new.dtype.kind:
            return [Difference(file, "array", f"{old.dtype} {old.shape} -> {new.dtype} {new.shape}")]
        if old.dtype.kind in "iufb":
            one = _arrays_apart(old.astype(float), new.astype(float), tolerance)
            return [] if one is None else [Difference(file, "array", *one)]
        if old.dtype.kind in "SU" and old.ndim == 0:
            return self.contents(file + ".json", str(old).encode(), str(new).encode(), tolerance)
        return self.texts(file, *("\n".join(map(str, data.ravel())) for data in (old, new)), tolerance)

    def folders(
        self, old: Mapping[str, bytes], new: Mapping[str, bytes], tolerance: Callable[[str], Tolerance]
    ) -> list[Difference]:
        """Return the differences of files by name."""
        differences: list[Difference] = []
        named = {self.renames.text(name): data for name, data in old.items()}
        for name in sorted({*named, *new}):
            if name not in named or name not in new:
                which = "older" if name in named else "newer"
                differences.append(Difference(name, "file", f"only in the {which} answers"))
            else:
                differences += self.contents(name, named[name], new[name], tolerance(name))
        return differences


def _group(place: Place) -> Place:
    """Return what numbers share a scale: those of a list, or under one key of its items."""
    last = max((k for k, part in enumerate(place) if isinstance(part, int)), default=None)
    return place if last is None else (*place[:last], "[]", *place[last + 1 :])


@cache
def _matches(place: tuple[str | None, ...], wanted: tuple[Pattern, ...]) -> bool:
    """Return whether a place, its positions in lists left open, has one of several patterns."""
    numbered = tuple(0 if part is None else part for part in place)
    return any(index_of(numbered, one) is not None for one in wanted)


def _open(place: Place) -> tuple[str | None, ...]:
    return tuple(None if isinstance(part, int) else part for part in place)


def _cut(value: Any) -> Any:
    """Return a number or list with 0 for what is below NOTHING."""
    if isinstance(value, list):
        return [_cut(one) for one in value]
    return 0.0 if is_number(value) and abs(value) < NOTHING else value


def _add(by_place: dict[tuple[str, str], Difference], kind: str, one: Difference) -> None:
    """Keep the largest difference of a place, and how many there are."""
    before = by_place.get((one.place, kind))
    if before is None:
        by_place[one.place, kind] = one
    else:
        most = one if one.size > before.size else before
        by_place[one.place, kind] = Difference(one.file, one.place, most.message, most.size, before.count + one.count)


def _arrays_apart(a: Any, b: Any, tolerance: Tolerance) -> tuple[str, float, int] | None:
    """Return the largest difference of two arrays, its size and how many there are; columns have their own scale."""
    if a.shape != b.shape:
        return f"{a.shape} -> {b.shape} numbers", np.inf, 1
    sizes = np.where(np.isfinite(a) & np.isfinite(b), np.maximum(np.abs(a), np.abs(b)), 0.0)
    apart = tolerance.apart(a, b, sizes.max(axis=0, initial=0.0) if a.ndim else sizes)
    if not apart.any():
        return None
    places = np.argwhere(np.atleast_1d(apart))
    pairs = np.stack([np.atleast_1d(data)[np.atleast_1d(apart)] for data in (a, b)], axis=1).tolist()
    most = max(range(len(pairs)), key=lambda k: _relative(*pairs[k]))
    one, two = pairs[most]
    return f"at {', '.join(map(str, places[most]))}: {one!r} -> {two!r}", _relative(one, two), len(pairs)


def _relative(a: float, b: float) -> float:
    size = max(abs(a), abs(b))
    return abs(a - b) / size if size and np.isfinite(size) else np.inf


def _short(value: Any) -> str:
    text = "nothing" if value is None else str(value) if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 90 else f"{text[:60]} ... {text[-25:]}"


def _lines(old: list[str], new: list[str]) -> Iterator[tuple[str | None, str | None, int, bool]]:
    """Yield lines that belong together, the number of the newer one, and whether they are the same but for numbers."""
    ours, theirs = ([NUMBER.sub("0", line) for line in lines] for lines in (old, new))
    if ours == theirs:
        yield from ((*pair, k, True) for k, pair in enumerate(zip(old, new, strict=True), 1))
        return
    for tag, start, end, first, last in SequenceMatcher(None, ours, theirs).get_opcodes():
        pairs = zip_longest(old[start:end], new[first:last])
        yield from ((*pair, k, tag == "equal") for k, pair in enumerate(pairs, first + 1))


def _beside(old: str | None, new: str | None) -> str:
    """Return two lines from shortly before where they differ."""
    if old is None or new is None:
        return f"{_short(old)} -> {_short(new)}"
    pairs = enumerate(zip_longest(old, new))
    start = max(0, next((k for k, (one, other) in pairs if one != other), 0) - 30)
    return f"{_short(old[start:])} -> {_short(new[start:])}"
