"""Columns of the time, in one column or in two, and their unit.

They are found by their names; the unit by its name, the rate that the steps have, and velocities beside positions.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.case.draft.column_words import (
    SIGNAL,
    UNIT_WORDS,
    container_of,
    meaning_of,
    split_unit,
    tokens_of,
    words_of,
)
from dynident.case.draft.readings import LogReading, band
from dynident.case.draft.signal_units import SignalUnit, factor_of
from dynident.case.evidence.rows import USUAL_STEPS, is_step, time_units
from dynident.case.evidence.velocities import BAND_HZ, is_near, velocity_pair

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


#: Frequency in Hz at which the band of the motion ends, for a comparison of velocities below :data:`BAND_HZ`.
_IN_BAND = 0.5 * BAND_HZ

#: What is to be stated of a counter of rows.
_COUNTER = "the rows are counted without a gap, which tells no rate: state the time from one row to the next"


def time_unit(step: float, stated: str) -> SignalUnit:
    """Return the unit of the time from the median step in the file's unit and from what the header states."""
    fitting = time_units(step)
    rates = ", ".join(f"{1 / (step * factor_of('time', word)):.4g} Hz in {word}" for word in fitting[:2])
    if stated and stated in fitting:
        return SignalUnit((stated,), True, f"the header states {stated}: {rates.split(',')[0]}")
    if not stated and "s" in fitting:
        return SignalUnit(("s",), True, f"{1 / step:.5g} Hz")
    said = f"the header states {stated}, but steps are {step:.4g}" if stated else f"steps are {step:.4g}"
    return SignalUnit(fitting[:1], False, f"{said}{f', which is {rates}' if rates else ''}")


def time_unit_of(readings: tuple[LogReading, ...], stated: str, units: tuple[str, str]) -> SignalUnit:
    """Return the unit of the time of logs; a counter of rows has one only where velocities tell it.

    Args:
        readings: The logs.
        stated: Unit in the name of the time's column; empty for none.
        units: Those in the names of the columns of positions and velocities; empty for none.
    """
    first = readings[0]
    if not stated and all(np.all(np.diff(reading.time) == 1.0) for reading in readings):
        return _of_counter(first, units)
    told = time_unit(first.step, stated)
    if told.certain or not told.words or not _has_velocities(first):
        return told
    seconds = first.time * factor_of("time", told.text)
    if not is_near(velocity_ratio(seconds, first.signals["q"], first.signals["dq"])):
        return told
    return replace(told, certain=True, why=f"{told.why}; in {told.text} velocities are the derivative of the positions")


def _of_counter(reading: LogReading, units: tuple[str, str]) -> SignalUnit:
    """Return the time of one row, by which velocities are the derivative of the positions; nothing where none are."""
    if not _has_velocities(reading):
        return SignalUnit((), False, f"{_COUNTER}, such as 4 ms")
    q, dq = reading.signals["q"], reading.signals["dq"]
    is_stated = all(units)
    if is_stated:
        q, dq = q * factor_of("position", units[0]), dq * factor_of("velocity", units[1])
    unit = band(reading.time, q) / _IN_BAND  # of the motion; beyond, values that are held for several rows have steps
    pair = velocity_pair(reading.time * unit, q, dq) if unit else None
    ratios = np.empty(0) if pair is None else pair.ratios[pair.moving] / unit
    rate = float(np.median(ratios)) if len(ratios) else 0.0
    if rate <= 0 or not is_step(1 / rate, USUAL_STEPS) or not all(is_near(ratio, rate) for ratio in ratios.tolist()):
        return SignalUnit((), False, f"{_COUNTER}, such as 4 ms")
    word = f"{1e3 / rate:.3g} ms"
    why = f"the rows are counted; by {word} a row velocities are the derivative of the positions"
    return SignalUnit((word,), is_stated, why if is_stated else f"{why}, if both have the same unit of angles")


def _has_velocities(reading: LogReading) -> bool:
    return "dq" in reading.signals and reading.signals["dq"].shape == reading.signals["q"].shape


def velocity_ratio(time: Array, q: Array, dq: Array) -> float:
    """Return logged velocities over the derivative of the positions, over joints that move; NaN for none."""
    pair = velocity_pair(time, q, dq)
    return float("nan") if pair is None or not pair.moving.any() else float(np.median(pair.ratios[pair.moving]))
