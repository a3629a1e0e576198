"""What a log format is, which columns of a file are which signals, and the units they are in."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, LogFormatError, UnknownChoice, nearest
from dynident.experiment.log import Log

#: Default column names: the signal's word and the number of the joint, counted from 1.
NUMBERED = {
    "q": "q",
    "dq": "dq",
    "ddq": "ddq",
    "torque": "tau",
    "current": "i",
    "raw_torque": "raw_tau",
    "temperature": "temperature",
}

_TURN = (math.pi, 180.0)
_MILLI = (1.0, 1e3)
_ONE = (1.0, 1.0)

#: Per quantity, unit word -> ((numerator, denominator) to SI, kind of joint it belongs to; empty for any).
UNITS: dict[str, dict[str, tuple[tuple[float, float], str]]] = {
    "time": {"s": (_ONE, ""), "ms": (_MILLI, ""), "us": ((1.0, 1e6), ""), "ns": ((1.0, 1e9), "")},
    "position": {
        "SI": (_ONE, ""),
        "rad": (_ONE, "revolute"),
        "deg": (_TURN, "revolute"),
        "m": (_ONE, "prismatic"),
        "mm": (_MILLI, "prismatic"),
    },
    "velocity": {
        "SI": (_ONE, ""),
        "rad/s": (_ONE, "revolute"),
        "deg/s": (_TURN, "revolute"),
        "m/s": (_ONE, "prismatic"),
        "mm/s": (_MILLI, "prismatic"),
    },
    "acceleration": {
        "SI": (_ONE, ""),
        "rad/s^2": (_ONE, "revolute"),
        "deg/s^2": (_TURN, "revolute"),
        "m/s^2": (_ONE, "prismatic"),
        "mm/s^2": (_MILLI, "prismatic"),
    },
    "torque": {
        "SI": (_ONE, ""),
        "N m": (_ONE, "revolute"),
        "mN m": (_MILLI, "revolute"),
        "N": (_ONE, "prismatic"),
    },
    "current": {"A": (_ONE, ""), "mA": (_MILLI, "")},
    "temperature": {"degC": (_ONE, "")},
}

#: The quantity of each signal, by the field of the log.
QUANTITY = {
    "q": "position",
    "dq": "velocity",
    "ddq": "acceleration",
    "torque": "torque",
    "current": "current",
    "raw_torque": "torque",
    "temperature": "temperature",
}


@dataclass(frozen=True)
class Units:
    """Units of the columns: one word for all joints or one per joint; nothing is ever converted on a guess.

    The word ``"SI"`` stands for rad or m (and what follows from it), as the joint moves.

    Attributes:
        time: s, ms, us or ns.
        position: SI, rad, deg, m or mm.
        velocity: SI, rad/s, deg/s, m/s or mm/s.
        acceleration: SI, rad/s^2, deg/s^2, m/s^2 or mm/s^2.
        torque: SI, N m, mN m or N; of filtered and unfiltered torques.
        current: A or mA.

    Raises:
        UnknownChoice: A word that is not listed.
    """

    time: str = "s"
    position: str | tuple[str, ...] = "SI"
    velocity: str | tuple[str, ...] = "SI"
    acceleration: str | tuple[str, ...] = "SI"
    torque: str | tuple[str, ...] = "SI"
    current: str | tuple[str, ...] = "A"

    def __post_init__(self) -> None:
        for f in fields(self):
            words = getattr(self, f.name)
            if not isinstance(words, str):
                words = tuple(words)
                object.__setattr__(self, f.name, words)
            for word in (words,) if isinstance(words, str) else words:
                if word not in UNITS[f.name]:
                    raise UnknownChoice(f"unit of {f.name}", str(word), list(UNITS[f.name]))
        if not isinstance(self.time, str):
            raise BadOption("units.time", self.time, "give one unit")

    def of(self, quantity: str, joints: int) -> tuple[str, ...]:
        """Return the unit of a quantity for each of the joints.

        Raises:
            BadOption: One unit per joint was given, for another number of joints.
        """
        words = getattr(self, quantity, "degC")
        if isinstance(words, str):
            return (words,) * joints
        if len(words) != joints:
            raise BadOption(f"units.{quantity}", list(words), f"give one unit, or one for each of the {joints} joints")
        return words


@dataclass(frozen=True)
class ColumnMap:
    """Which columns of a file are which signals; what is left as None has the numbered names (q1, q2, ... tau1, ...).

    An empty tuple says that the signal is not to be read. Of torques and currents that are both there under their
    numbered names, and both None here, the torques are read.

    Attributes:
        joints: Names of the n joints in the order of the columns; empty: as many as there are, joint1, joint2, ...
        time: Column of the time.
        q: Columns of the positions.
        dq: Columns of the velocities; None takes dq1, ... where they are there.
        ddq: Columns of the accelerations; not read unless named.
        torque: Columns of the joint torques.
        current: Columns of the motor currents.
        raw_torque: Columns of the torques before any filter; not read unless named.
        temperature: Columns of the drives' temperatures in degrees Celsius; not read unless named.
        units: Units of the columns.
        decimal: Decimal sign of text files, ``.`` or ``,``; it is never guessed.

    Raises:
        BadOption: Lists of different lengths, a column or a joint named twice, or units that do not fit each other.
    """

    joints: tuple[str, ...] = ()
    time: str = "t"
    q: tuple[str, ...] | None = None
    dq: tuple[str, ...] | None = None
    ddq: tuple[str, ...] | None = ()
    torque: tuple[str, ...] | None = None
    current: tuple[str, ...] | None = None
    raw_torque: tuple[str, ...] | None = ()
    temperature: tuple[str, ...] | None = ()
    units: Units = field(default_factory=Units)
    decimal: str = "."

    def __post_init__(self) -> None:
        for name in ("joints", *NUMBERED):
            names = getattr(self, name)
            if isinstance(names, str):
                raise BadOption(name, names, "give a list of names, one per joint")
            if names is not None:
                object.__setattr__(self, name, tuple(names))
        if self.q == ():
            raise BadOption("q", [], "name the columns of the positions")
        self._check_lengths()
        used = [self.time, *(name for signal in self.stated().values() for name in signal)]
        for what, names in (("joints", list(self.joints)), ("columns", used)):
            twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
            if twice:
                raise BadOption(what, twice[0], "it is named twice; name each once")

    def stated(self) -> dict[str, tuple[str, ...]]:
        """Return the columns that are named, by signal."""
        return {name: getattr(self, name) for name in NUMBERED if getattr(self, name)}

    def resolved(self, header: Sequence[str], path: object, line: int | None = None) -> ColumnMap:
        """Return the map for one file: every signal named or empty, every column in its header.

        Args:
            header: Names of the columns of the file.
            path: The file, for messages.
            line: Line of the header, for messages.

        Raises:
            LogFormatError: A column is missing, or the numbered columns are not as many as the joints.
        """
        found = {name: _numbers(word, header) for name, word in NUMBERED.items()}
        count = self._joint_count() or max(found["q"], default=0)
        if not count:
            raise missing_column("q1", header, path, line)
        chosen = dict(self.stated())
        for name in self._numbered_signals(found):
            if max(found[name], default=0) > count:
                evidence = f"a column '{NUMBERED[name]}{max(found[name])}' where the number of joints is {count}"
                step = "name the columns of these joints with columns: in the case file"
                raise LogFormatError(path, line, evidence, step)
            chosen[name] = tuple(f"{NUMBERED[name]}{k}" for k in range(1, count + 1))
        used = (self.time, *(name for names in chosen.values() for name in names))
        for column in used:
            if column not in header:
                raise missing_column(column, header, path, line, used)
        joints = self.joints or tuple(f"joint{k}" for k in range(1, count + 1))
        empty: dict[str, tuple[str, ...]] = dict.fromkeys(NUMBERED, ())
        resolved = replace(self, joints=joints, **(empty | chosen))  # type: ignore[arg-type]
        resolved._check_kinds()
        return resolved

    def to_si(self, signal: str, values: Array) -> Array:
        """Return the values (N, n) of a signal in SI units."""
        words = self.units.of(QUANTITY[signal], values.shape[1])
        return _converted(values, QUANTITY[signal], words)

    def time_to_si(self, values: Array) -> Array:
        """Return the time (N,) in s."""
        return _converted(values[:, None], "time", (self.units.time,))[:, 0]

    def conversions(self) -> str:
        """Return in words what is converted, such as ``"position from deg"``; empty where all is in SI units."""
        texts = [] if self.units.time == "s" else [f"time from {self.units.time}"]
        for quantity in dict.fromkeys(QUANTITY[signal] for signal in self.stated()):
            words = dict.fromkeys(self.units.of(quantity, len(self.joints)))
            changed = [word for word in words if UNITS[quantity][word][0] != _ONE]
            if changed:
                texts.append(f"{quantity} from {', '.join(changed)}")
        return "; ".join(texts)

    def _joint_count(self) -> int:
        lengths = [len(self.joints), *(len(names) for names in self.stated().values())]
        return max(lengths)

    def _check_lengths(self) -> None:
        count = self._joint_count()
        for name in ("joints", *NUMBERED):
            names = getattr(self, name)
            if names and len(names) != count:
                step = f"{len(names)} names, elsewhere {count}; name one column per joint, in the order of joints"
                raise BadOption(name, list(names), step)

    def _numbered_signals(self, found: dict[str, list[int]]) -> list[str]:
        """Return the signals that are to be read under their numbered names."""
        wanted = [name for name in ("q", "dq") if getattr(self, name) is None and (name == "q" or found[name])]
        if self.torque is None and not self.current:
            if found["torque"] or not (self.current is None and found["current"]):
                return [*wanted, "torque"]
            return [*wanted, "current"]
        if self.torque == () and self.current is None and found["current"]:
            return [*wanted, "current"]
        return wanted

    def _check_kinds(self) -> None:
        """Refuse units that make one joint both turn and slide."""
        for joint, name in enumerate(self.joints):
            kinds: dict[str, str] = {}
            for quantity in dict.fromkeys(QUANTITY[signal] for signal in self.stated()):
                word = self.units.of(quantity, len(self.joints))[joint]
                kinds.setdefault(UNITS[quantity][word][1] or "any", f"{quantity} in {word}")
            if "revolute" in kinds and "prismatic" in kinds:
                step = f"joint '{name}' cannot both turn and slide; give one unit per joint"
                raise BadOption("units", f"{kinds['revolute']}, {kinds['prismatic']}", step)


class LogFormat(ABC):
    """A kind of file that holds a log; the fields of the part are its options."""

    suffixes: ClassVar[tuple[str, ...]]

    @abstractmethod
    def header(self, path: str | Path) -> tuple[str, ...]:
        """Return the names of the columns in a file, without reading the rows.

        Raises:
            FileError: The file cannot be read at all.
            LogFormatError: It has no sound header.
        """

    @abstractmethod
    def read(self, path: str | Path, columns: ColumnMap) -> Log:
        """Return the log in a file, in SI units.

        Raises:
            FileError: The file cannot be read at all.
            LogFormatError: It is not a sound log; the message names file, line and column.
        """

    @abstractmethod
    def write(self, log: Log, path: str | Path) -> None:
        """Write a log in SI units so that :func:`written_columns` reads it back bit for bit.

        Raises:
            FileError: The file cannot be written.
            LogMismatch: The log holds a value that is not finite.
        """


def written_columns(log: Log) -> ColumnMap:
    """Return the map under which a written log reads back: its joints, all its signals, SI units."""
    count = range(1, len(log.joints) + 1)
    names: dict[str, tuple[str, ...]] = {
        signal: tuple(f"{word}{k}" for k in count) if getattr(log, signal) is not None else ()
        for signal, word in NUMBERED.items()
    }
    return ColumnMap(joints=log.joints, **names)  # type: ignore[arg-type]


def missing_column(
    name: str, header: Sequence[str], path: object, line: int | None, used: Sequence[str] = ()
) -> LogFormatError:
    """Return the error to raise for a column that is not in the header; ``used`` are other columns of the map."""
    free = [other for other in header if other not in used]
    listed = ", ".join(map(shown, header[:40])) + (f", ... ({len(header)} columns)" if len(header) > 40 else "")
    step = f"the header has {listed}; map it with columns: in the case file{nearest(name, map(shown, free))}"
    return LogFormatError(path, line, f"no column '{shown(name)}'", step)


def shown(text: str) -> str:
    """Return text of a file as a message shows it: on one line, signs that cannot be printed escaped, 60 at most."""
    plain = "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in text[:60])
    return plain if len(text) <= 60 else f"{plain}..."


def _numbers(word: str, header: Sequence[str]) -> list[int]:
    pattern = re.compile(re.escape(word) + r"([1-9][0-9]{0,3})")
    return [int(match[1]) for name in header if (match := pattern.fullmatch(name))]


def _converted(values: Array, quantity: str, words: Sequence[str]) -> Array:
    factors = np.array([UNITS[quantity][word][0] for word in words])
    # Multiplied and divided: 3 ms is then exactly the double nearest to 0.003 s.
    return values if np.all(factors == 1.0) else values * factors[:, 0] / factors[:, 1]
