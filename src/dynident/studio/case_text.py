"""The columns and units of a case file: what they are, and the file with others in their place, its comments kept."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dynident.case.case import read_case
from dynident.case.draft.yaml_words import listed, quoted
from dynident.case.questions import ASK
from dynident.data.formats import open_log
from dynident.data.formats._units import UNITS, counted_unit
from dynident.data.profiles import pattern_names
from dynident.data.profiles.base import MARKS
from dynident.errors import BadOption, DynidentError
from dynident.robot_files import read_robot
from dynident.robot_files.strict_yaml import load_yaml
from dynident.studio.orders import QUANTITIES, SIGNALS

#: Keys under ``log`` that a mapping replaces.
_REPLACED = ("profile", "columns", "units")


@dataclass(frozen=True)
class Mapped:
    """Which columns are which signals.

    Attributes:
        joints: Names of the joints, in the order of the columns.
        time: Column of the time.
        signals: Columns of each signal, one per joint.
        units: Unit of each quantity that is read, or one per joint; time, position and torque are never left open.
    """

    joints: tuple[str, ...]
    time: str
    signals: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    units: Mapping[str, str | tuple[str, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.time:
            raise BadOption("time", "", "choose the column of the time")
        for name, columns in self.signals.items():
            if name not in SIGNALS:
                raise BadOption("signal", name, f"choose one of: {', '.join(SIGNALS)}")
            if len(columns) != len(self.joints) or not all(columns):
                raise BadOption(name, list(columns), f"choose a column for each of the {len(self.joints)} joints")
        if "q" not in self.signals:
            raise BadOption("q", "", "choose the columns of the positions")
        if "torque" in self.signals and "current" in self.signals:
            raise BadOption("current", "", "choose torques or currents: one of the two is read")
        needed = ("time", "position", *(["torque"] if "torque" in self.signals else []))
        for quantity in needed:
            if quantity not in self.units:
                raise BadOption(f"units.{quantity}", "", "choose the unit: it is not guessed")
        for quantity, words in self.units.items():
            for word in (words,) if isinstance(words, str) else words:
                if quantity not in QUANTITIES or counted_unit(word)[1] not in UNITS[quantity]:
                    raise BadOption(f"units.{quantity}", word, f"choose one of: {', '.join(UNITS.get(quantity, ()))}")

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Mapped:
        """Return the mapping of a request.

        Raises:
            BadOption: Something is missing or cannot be.
        """
        joints, signals = data.get("joints"), data.get("signals")
        if not _is_texts(joints) or not isinstance(signals, dict) or not all(map(_is_texts, signals.values())):
            raise BadOption("columns", "", "choose the joints and a column for each of them")
        units = data.get("units")
        return cls(
            tuple(joints),  # type: ignore[arg-type]
            str(data.get("time", "")),
            {str(name): tuple(columns) for name, columns in signals.items() if columns},
            {str(key): tuple(word) if _is_texts(word) else str(word) for key, word in units.items() if word}
            if isinstance(units, dict)
            else {},
        )


def with_columns(text: str, mapped: Mapped) -> str:
    """Return a case file with other columns and units; other keys under ``log``, and all comments there, stay."""
    lines = text.splitlines()
    lines = _without(lines, "joints", 0)
    start, stop = _block(lines, "log")
    inside = lines[start + 1 : stop] if start >= 0 else []
    for key in _REPLACED:
        inside = _without(inside, key, 2)
    new = ["log:", "  columns:", f"    time: {quoted(mapped.time)}"]
    new += [f"    {name}: {listed(mapped.signals[name])}" for name in SIGNALS if name in mapped.signals]
    if "current" in mapped.signals:
        new.append("    torque: none")
    if "dq" not in mapped.signals:
        new.append("    dq: none")
    if mapped.units:
        words = {key: word if isinstance(word, str) else listed(word) for key, word in mapped.units.items()}
        new += ["  units:", *(f"    {key}: {word}" for key, word in words.items())]
    joints = f"joints: {listed(mapped.joints)}"
    if start < 0:
        return "\n".join([*lines, joints, *new]) + "\n"
    return "\n".join([*lines[:start], joints, *new, *inside, *lines[stop:]]) + "\n"


def mapping_of(path: Path) -> dict[str, Any]:
    """Return the mapping of a case file and the columns of its first log as plain data.

    Raises:
        DynidentError: The case cannot be read, or its log.
    """
    case = read_case(path)
    names = case.train or case.test
    columns = case.columns
    header: tuple[str, ...] = ()
    if names:
        table = open_log(case.find(names[0]), columns)
        header = table.header
        columns = columns.resolved(header, names[0], table.line)
    units = {quantity: getattr(columns.units, quantity) for quantity in QUANTITIES}
    stated = columns.stated()
    return {
        "header": list(header),
        "all_joints": list(read_robot(case.robot_path).joint_names),
        "joints": list(columns.joints),
        "time": columns.time,
        "signals": {name: list(stated[name]) for name in SIGNALS if name in stated},
        "units": units,
    }


def open_mapping(path: Path) -> dict[str, Any] | None:
    """Return what a case file that cannot be used yet says about columns, as :func:`mapping_of` does.

    Returns:
        None where the file, its robot or its first log cannot be read at all.
    """
    try:
        top, _ = load_yaml(path, path.read_bytes())
        if not isinstance(top, dict):
            return None
        names = _texts_of(top.get("train")) or _texts_of(top.get("test"))
        robot = str(top.get("robot"))
        beside = path.parent / robot
        every = read_robot(beside if beside.is_file() else robot).joint_names
        header = open_log(path.parent / names[0]).header if names else ()
    except DynidentError:
        return None
    log = top.get("log")
    inside: dict[str, Any] = log if isinstance(log, dict) else {}
    columns, units = ({} if not isinstance(inside.get(k), dict) else inside[k] for k in ("columns", "units"))
    joints = _texts_of(top.get("joints"))
    if not joints:  # they are asked for: the likely ones are those whose columns are there
        count = max(k for k in range(len(every) + 1) if set(_named(columns.get("q"), every[:k])) <= set(header))
        joints = every[:count] if _named(columns.get("q"), every[:count]) else every
    found = {name: _named(columns.get(name), joints) for name in SIGNALS}
    return {
        "header": list(header),
        "all_joints": list(every),
        "joints": list(joints),
        "time": columns.get("time") if columns.get("time") in header else "",
        "signals": {name: list(cells) for name, cells in found.items() if cells and set(cells) <= set(header)},
        "units": {key: _known_unit(units.get(key), key) for key in QUANTITIES},
    }


def _texts_of(value: object) -> tuple[str, ...]:
    if isinstance(value, str):
        return () if value == ASK else (value,)
    return tuple(map(str, value)) if isinstance(value, list) else ()


def _known_unit(value: object, quantity: str) -> str | list[str]:
    """Return one unit, or one per joint, as it stands; an empty text where it is asked for or not known."""
    words = _texts_of(value)
    if not words or not {counted_unit(word)[1] for word in words} <= set(UNITS[quantity]):
        return ""
    return words[0] if isinstance(value, str) else list(words)


def _named(value: object, joints: Sequence[str]) -> tuple[str, ...]:
    if isinstance(value, str) and any(mark in value for mark in MARKS):
        return pattern_names(value, joints)
    names = _texts_of(value)
    return names if len(names) == len(joints) else ()


def _block(lines: Sequence[str], key: str, indent: int = 0) -> tuple[int, int]:
    """Return the first line of a key and the line after its value; -1 twice where it is not there."""
    pad = " " * indent
    begin = next((k for k, line in enumerate(lines) if re.match(rf"{pad}{key}\s*:", line)), -1)
    if begin < 0:
        return -1, -1
    end = begin + 1
    while end < len(lines):
        line = lines[end]
        deeper = len(line) - len(line.lstrip()) > indent or line.startswith(f"{pad}- ")
        if line.strip() and not deeper:
            break
        end += 1
    return begin, end


def _without(lines: Sequence[str], key: str, indent: int) -> list[str]:
    start, stop = _block(lines, key, indent)
    return list(lines) if start < 0 else [*lines[:start], *lines[stop:]]


def _is_texts(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(item, str) for item in value)
