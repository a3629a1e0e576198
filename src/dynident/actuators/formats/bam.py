"""Logs of one servo in the JSON that Rhoban BAM records."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.data.formats._arrays import ArrayTable, checked_file, columns_of
from dynident.data.formats.base import LogFormat
from dynident.errors import LogFormatError

#: Bytes that are read at once at most, and those among which BAM has the word "entries".
MAX_BYTES, _HEAD = 1 << 28, 1 << 12

#: Column of each signal of an entry; entries that lack it have the number.
_SIGNALS: Mapping[str, tuple[str, float]] = {
    "t": ("timestamp", np.nan),
    "q1": ("position", np.nan),
    "q_ref1": ("goal_position", np.nan),
    "torque_enable": ("torque_enable", 1.0),
    "input_volts": ("input_volts", np.nan),
}


@dataclass(frozen=True)
class Bam(LogFormat):
    """JSON of Rhoban BAM, one servo: t, q1, q_ref1, torque_enable, input_volts and kp; other JSON is no log."""

    suffixes: ClassVar = (".json",)

    @classmethod
    def takes(cls, path: str | Path) -> bool:
        """Return whether a file is of this kind by its name and, where it can be read, its first bytes."""
        if not super().takes(path):
            return False
        try:
            with open(path, "rb") as file:
                return b'"entries"' in file.read(_HEAD)
        except OSError:
            return True

    def open(self, path: str | Path) -> ArrayTable:
        digest = checked_file(path, MAX_BYTES)
        try:
            data: Any = json.loads(Path(path).read_bytes())
            arrays = _columns(data)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            step = "logs of BAM have 'entries', each with timestamp, position, goal_position and torque_enable"
            raise LogFormatError(path, None, f"no log of BAM ({type(error).__name__}: {error})", step) from error
        found = columns_of(path, {name: values.shape for name, values in arrays.items()}, number_vectors=True)
        return replace(ArrayTable.of(path, digest, "JSON of BAM", found), load=arrays.__getitem__)


def _number(value: Any, name: str, entry: int) -> float:
    if isinstance(value, bool | int | float):
        return float(value)
    raise ValueError(f"{name} of entry {entry + 1} is {value!r}, no number")


def _columns(data: Any) -> dict[str, Array]:
    """Return the columns of a log, each (N,): the gain where the log states one."""
    entries = data["entries"]
    found = {
        column: np.array([_number(entry.get(name, fallback), name, k) for k, entry in enumerate(entries)])
        for column, (name, fallback) in _SIGNALS.items()
    }
    rows = len(entries)
    if not rows:
        raise ValueError("there is no entry")
    if np.isnan(found["t"]).all() and "dt" in data:
        found["t"] = np.arange(rows) * float(data["dt"])
    if data.get("kp") is not None:
        found["kp"] = np.full(rows, float(data["kp"]))
    return found
