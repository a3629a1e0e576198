"""Which columns of a file are which signals, and the units they are in."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dynident.arrays import Array
from dynident.data.formats._units import ONE, QUANTITY, RATED, Units, converted, counted_unit, unit_of
from dynident.data.profiles import unmeasured
from dynident.data.turns import turns_counted
from dynident.errors import BadOption, LogFormatError, nearest

#: Default column names: the signal's word and the number of the joint, counted from 1.
NUMBERED = {
    "q": "q",
    "dq": "dq",
    "ddq": "ddq",
    "torque": "tau",
    "current": "i",
    "raw_torque": "raw_tau",
    "temperature": "temperature",
    "q_ref": "q_ref",
    "dq_ref": "dq_ref",
}
#: Clocks whose speeds differ by a larger share are another fault.
MOST_APART = 0.1

_NUMBER = re.compile(r"[1-9][0-9]{0,3}")


@dataclass(frozen=True)
class ColumnMap:
    """Which columns of a file are which signals; what is left as None has the numbered names (q1, q2, ... tau1, ...).

    An empty tuple says that the signal is not to be read. Of torques and currents that are both there under their
    numbered names, and both None here, the torques are read.

    Attributes:
        joints: Names of the n joints in the order of the columns; empty: as many as there are, joint1, joint2, ...
        time: Column of the time (without a ``t`` also one called time, in capitals or not), the samples a second where
            a file has none, such as ``200 Hz``, or the sum of two columns, such as ``sec s + nanosec ns``.
        q: Columns of the positions.
        dq: Columns of the velocities; None takes dq1, ... where they are there.
        ddq: Columns of the accelerations; not read unless named.
        torque: Columns of the joint torques.
        current: Columns of the motor currents.
        raw_torque: Columns of the torques before any filter; not read unless named.
        temperature: Columns of the drives' temperatures in degrees Celsius, or one column n times, that of a sensor
            for all; not read unless named.
        q_ref: Columns of the commanded positions; not read unless named.
        dq_ref: Columns of the commanded velocities; not read unless named.
        units: Units of the columns.
        decimal: Decimal sign of text files, ``.`` or ``,``; it is never guessed.
        rated: Rated torque of each joint in N m (or N), for torques in percent or permille of it.
        optional: Signals that are left out where a file lacks their columns.
        force: Signals that are read although their columns are known not to be measured.
        motor: Signals that are on the side of the motors; :func:`dynident.data.motor_side.joint_side` turns them.
        zero: Position in rad or m that is added to the positions of each joint; empty for none.
        wrapped: Joints whose positions start again after a whole turn; their turns are counted on.
        torque_clock: How many times as fast as that of the positions the clock of torques and currents ran.
        repeats: ``drop`` leaves rows out that repeat the row before them, ``refuse`` takes them for a fault.
        leave_out: Spells of logs that do not count, starts and ends in s since the log began, by the name of its file.
        form: Format of the files; empty for the one by their suffix.
        form_options: Its options, as name and text.

    Raises:
        BadOption: Lists of different lengths, a column or a joint named twice, units that do not fit each other, or
            torques in percent without rated torques.
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
    q_ref: tuple[str, ...] | None = ()
    dq_ref: tuple[str, ...] | None = ()
    units: Units = field(default_factory=Units)
    decimal: str = "."
    rated: tuple[float, ...] = ()
    optional: tuple[str, ...] = ()
    force: tuple[str, ...] = ()
    motor: tuple[str, ...] = ()
    zero: tuple[float, ...] = ()
    wrapped: tuple[str, ...] = ()
    torque_clock: float = 1.0
    repeats: str = "refuse"
    leave_out: tuple[tuple[str, tuple[tuple[float, float], ...]], ...] = ()
    form: str = ""
    form_options: tuple[tuple[str, str | None], ...] = ()

    def __post_init__(self) -> None:
        for name in ("rated", "zero"):
            object.__setattr__(self, name, tuple(map(float, getattr(self, name))))
        for name in ("optional", "force", "motor"):
            object.__setattr__(self, name, _signals(name, getattr(self, name)))
        object.__setattr__(self, "wrapped", tuple(self.wrapped))
        spells = ((name, tuple((float(a), float(b)) for a, b in own)) for name, own in self.leave_out)
        object.__setattr__(self, "leave_out", tuple(spells))
        object.__setattr__(self, "form_options", tuple((key, value) for key, value in self.form_options))
        for name in ("joints", *NUMBERED):
            names = getattr(self, name)
            if isinstance(names, str):
                raise BadOption(name, names, "give a list of names, one per joint")
            if names is not None:
                object.__setattr__(self, name, tuple(names))
        if self.repeats not in ("refuse", "drop"):
            raise BadOption("repeats", self.repeats, "choose 'refuse' or 'drop'")
        if not abs(self.torque_clock - 1.0) < MOST_APART:
            step = f"give a ratio between {1.0 - MOST_APART:g} and {1.0 + MOST_APART:g}"
            raise BadOption("torque_clock", self.torque_clock, step)
        if self.q == ():
            raise BadOption("q", [], "name the columns of the positions")
        self._check_lengths()
        stated = self.stated()
        if len(set(stated.get("temperature", ()))) == 1:
            stated["temperature"] = stated["temperature"][:1]
        used = [self.time, *(name for signal in stated.values() for name in signal)]
        for what, names in (("joints", list(self.joints)), ("columns", used)):
            twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
            if twice:
                raise BadOption(what, twice[0], "it is named twice; name each once")
        self._check_measured()

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
        chosen = {
            name: names
            for name, names in self.stated().items()
            if name not in self.optional or not set(names).isdisjoint(header)
        }
        for name in self._numbered_signals(found):
            if max(found[name], default=0) > count:
                evidence = f"a column '{NUMBERED[name]}{max(found[name])}' where the number of joints is {count}"
                step = "name the columns of these joints with columns: in the case file"
                raise LogFormatError(path, line, evidence, step)
            chosen[name] = tuple(f"{NUMBERED[name]}{k}" for k in range(1, count + 1))
        called = [name for name in header if name.lower() == "time"] if self.time == "t" not in header else []
        time = called[0] if len(called) == 1 else self.time
        used = (time, *(name for names in chosen.values() for name in names))
        for column in used:
            if column not in header:
                raise missing_column(column, header, path, line, used)
        joints = self.joints or tuple(f"joint{k}" for k in range(1, count + 1))
        empty: dict[str, tuple[str, ...]] = dict.fromkeys(NUMBERED, ())
        resolved = replace(self, joints=joints, time=time, **(empty | chosen))  # type: ignore[arg-type]
        resolved._check_kinds()
        return resolved

    def to_si(self, signal: str, values: Array) -> Array:
        """Return the values (N, n) of a signal in SI units."""
        words = self.units.of(QUANTITY[signal], values.shape[1])
        found = converted(values, QUANTITY[signal], words)
        shares = [QUANTITY[signal] == "torque" and counted_unit(word)[1] in RATED for word in words]
        return found * np.where(shares, self.rated, 1.0) if any(shares) else found

    def counted(self, signal: str, values: Array, before: Array | None = None) -> Array:
        """Return positions in SI units, shape (N, n), with the turns of the wrapped joints counted on.

        Args:
            signal: Signal that they are; others than positions stay as they are.
            values: Shape (N, n).
            before: Counted positions of the row before, shape (n,); None where the log begins.
        """
        places = [k for k, name in enumerate(self.joints) if name in self.wrapped]
        if not places or QUANTITY[signal] != "position":
            return values
        counted = np.array(values)
        counted[:, places] = turns_counted(values[:, places], None if before is None else before[places])
        return counted

    def time_to_si(self, values: Array) -> Array:
        """Return the time (N,) in s."""
        return converted(values[:, None], "time", (self.units.time,))[:, 0]

    def conversions(self) -> str:
        """Return in words what is converted, such as ``"position from deg"``; empty where all is in SI units."""
        texts = [] if self.units.time == "s" else [f"time from {self.units.time}"]
        for quantity in dict.fromkeys(QUANTITY[signal] for signal in self.stated()):
            words = dict.fromkeys(self.units.of(quantity, len(self.joints)))
            changed = [word for word in words if unit_of(quantity, word)[0] != ONE]
            if changed:
                texts.append(f"{quantity} from {', '.join(changed)}")
        if self.wrapped:
            texts.append(f"turns of {', '.join(self.wrapped)} counted on")
        return "; ".join(texts)

    def spells_left_out(self, path: object) -> Array:
        """Return start and end of what does not count of the log of a file or address, in s since it began, (k, 2)."""
        name = re.split(r"[/\\]", str(path))[-1]
        return np.array(dict(self.leave_out).get(name, ()), dtype=float).reshape(-1, 2)

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
        for name in ("rated", "zero"):
            numbers = getattr(self, name)
            if numbers and (len(numbers) != count or not np.all(np.isfinite(numbers))):
                raise BadOption(name, list(numbers), f"give one number for each of the {count} joints")
        words = (self.units.torque,) if isinstance(self.units.torque, str) else self.units.torque
        if RATED.intersection(counted_unit(word)[1] for word in words) and not (self.rated and min(self.rated) > 0):
            step = "state the rated torque of each joint in N m, of each motor with side: motor (log: {rated: [...]})"
            raise BadOption("units.torque", words[0], step)

    def _check_measured(self) -> None:
        """Refuse columns that are known to hold commands or values of a model where measurements are wanted."""
        for signal, names in self.stated().items():
            if signal in self.force or signal in ("q_ref", "dq_ref"):
                continue
            for name in names:
                known = unmeasured(name)
                if known is not None:
                    where, channel = known
                    kind = "computed by a model" if channel.kind == "model" else channel.kind
                    why = f"{kind}, not measured ({where}{channel.note and ': '}{channel.note})"
                    step = f"it is {why}; map a measured column, or say force: [{signal}]"
                    raise BadOption(signal, name, step)

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
            for quantity in dict.fromkeys(QUANTITY[signal] for signal in self.stated() if signal not in self.motor):
                word = self.units.of(quantity, len(self.joints))[joint]
                kinds.setdefault(unit_of(quantity, word)[1] or "any", f"{quantity} in {word}")
            if "revolute" in kinds and "prismatic" in kinds:
                step = f"joint '{name}' cannot both turn and slide; give one unit per joint"
                raise BadOption("units", f"{kinds['revolute']}, {kinds['prismatic']}", step)


def _signals(option: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return names of signals, checked."""
    for name in names:
        if name not in NUMBERED:
            raise BadOption(option, name, f"the signals are {', '.join(NUMBERED)}")
    return tuple(names)


def missing_column(
    name: str, header: Sequence[str], path: object, line: int | None, used: Sequence[str] = ()
) -> LogFormatError:
    """Return the error to raise for a column that is not in the header; ``used`` are other columns of the map."""
    free = [other for other in header if other not in used]
    listed = ", ".join(map(shown, header[:12])) + (f", ... ({len(header)} columns)" if len(header) > 12 else "")
    how = "which 'dynident init ROBOT LOG' drafts (in Python dynident.init)"
    step = f"the header has {listed}; map it with columns: in the case file, {how}"
    return LogFormatError(path, line, f"no column '{shown(name)}'", step + nearest(name, map(shown, free)))


def shown(text: str) -> str:
    """Return text of a file as a message shows it: on one line, signs that cannot be printed escaped, 60 at most."""
    plain = "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in text[:60])
    return plain if len(text) <= 60 else f"{plain}..."


def _numbers(word: str, header: Sequence[str]) -> list[int]:
    numbers = (_NUMBER.fullmatch(name, len(word)) for name in header if name.startswith(word))
    return [int(match[0]) for match in numbers if match]
