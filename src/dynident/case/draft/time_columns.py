"""Columns of the time: by their names, in one column or in two, and the unit that a name states."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from dynident.case.draft.column_words import (
    SIGNAL,
    UNIT_WORDS,
    container_of,
    meaning_of,
    split_unit,
    tokens_of,
    words_of,
)

#: Words for a second and its parts, and what else the names of the two columns of a time say.
_SECONDS: Mapping[str, str] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("us", "usec", "usecs", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanosec", "nanosecs", "nanosecond", "nanoseconds"), "ns"),
}
_CLOCKS = frozenset("t tv time timestamp stamp header".split())
_PARTS_OF_A_SECOND = re.compile(r"(nano|micro)[_ ]?sec(?:ond)?(?=s?\b|s?_)")


def time_columns(header: Sequence[str]) -> list[str]:
    """Return the columns that may be the time, the most telling names first: a stamp of a header, then short ones."""
    found, container = [], container_of(header)
    for name in header:
        base, unit = split_unit(name)
        tokens = words_of(base, container)
        words = [word for word in tokens if not word.isdigit()]
        if words and len(words) == len(tokens) and meaning_of(words, unit).signal == "time":
            found.append((words[-2:] != ["header", "stamp"], len(words), name))
    return [name for *_, name in sorted(found, key=lambda item: item[:2])]


def clock_columns(header: Sequence[str]) -> list[str]:
    """Return the columns that a word for the time and others name, as ``EgmTime_ms``: clocks, commands or durations."""
    found, container = [], container_of(header)
    for name in header:
        base, unit = split_unit(name)
        words = words_of(base, container)
        told = meaning_of(words, unit)
        words = words[:-1] if told.unit and not unit and words[-1] in UNIT_WORDS else words
        if words and not told.signal and "time" in {SIGNAL.get(word) for word in (words[0], words[-1])}:
            found.append(name)
    return found


def split_time(header: Sequence[str]) -> tuple[tuple[str, str], tuple[str, str]] | None:
    """Return two columns that are the time together, with the unit of each, such as seconds and nanoseconds."""
    found: dict[tuple[str, ...], dict[str, str]] = {}
    for name in header:
        words = _PARTS_OF_A_SECOND.sub(r"\1second", name.lower())
        tokens = tokens_of(words)
        units = [k for k, word in enumerate(tokens) if word in _SECONDS]
        rest = tuple(word for k, word in enumerate(tokens) if k not in units)
        if len(units) == 1 and (not rest or _CLOCKS.intersection(rest)):
            found.setdefault(rest, {}).setdefault(_SECONDS[tokens[units[0]]], name)
    for columns in found.values():
        part = next((unit for unit in ("ns", "us") if unit in columns), "")
        if part and "s" in columns:
            return (columns["s"], "s"), (columns[part], part)
    return None


def unit_of_time(name: str, header: Sequence[str] = ()) -> str:
    """Return the unit that the name of a time column of a header states; empty where it states none."""
    base, unit = split_unit(name)
    return meaning_of([word for word in words_of(base, container_of(header)) if not word.isdigit()], unit).unit
