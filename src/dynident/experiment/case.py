"""The case file: the one place where a user describes their robot, their log and how the two are used.

Format 1, YAML. Keys: case (the format), robot, gravity, locked, joints, coupling, drives, friction, log (columns,
units, decimal), preprocessing (filter, rate_hz, trim_s, standstill, rest), estimator, train, test, split, note. Unknown
keys are errors that name the nearest known one. docs/case-file.md describes each.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynident.errors import BadOption, DescriptionError, DynidentError, LogMismatch
from dynident.experiment.formats import FORMATS, ColumnMap, Units, read_log
from dynident.experiment.formats.base import UNITS
from dynident.experiment.log import Log, torque_from_current
from dynident.experiment.preprocessing import FILTERS, Preprocessing
from dynident.experiment.preprocessing.base import Filter
from dynident.experiment.split import Split
from dynident.files import unreadable
from dynident.model.descriptions import read_robot
from dynident.model.documents.numbers import Place
from dynident.model.documents.sections import Section
from dynident.model.documents.strict_yaml import load_yaml
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Friction
from dynident.model.robot import Drive, Robot
from dynident.plugins import Family

FORMAT = 1

#: The folder under which logs and robots are looked for when they are neither beside the case file nor where it says.
DATA_VARIABLE = "DYNIDENT_DATA"

#: How far, in rad or m, a locked joint may stand from where the case says it does.
LOCKED_TOLERANCE = 0.05

DEFAULT_FRICTION = ("coulomb", "viscous", "offset")

_KEYS = ("case", "robot", "gravity", "locked", "joints", "coupling", "drives", "friction", "log", "preprocessing")
_KEYS += ("estimator", "train", "test", "split", "note")
_LOG_KEYS = ("columns", "units", "decimal")
_COLUMN_KEYS = ("time", "q", "dq", "ddq", "torque", "current", "temperature")
_UNIT_KEYS = ("time", "position", "velocity", "acceleration", "torque", "current")
_PREPROCESSING_KEYS = ("filter", "rate_hz", "trim_s", "standstill", "rest")


@dataclass(frozen=True)
class Choice:
    """A part by name with its options as text."""

    name: str
    options: Mapping[str, str | None] = field(default_factory=dict)


@dataclass(frozen=True)
class Case:
    """A robot, how its logs are read and prepared, and what is asked.

    Attributes:
        robot: With locked joints, gravity, drives and coupling applied.
        friction: Friction parts.
        columns: How columns become signals.
        preprocessing: How logs become rows.
        estimator: Name and options.
        train: Logs to learn from, as written.
        test: Logs to test on, as written.
        split: How a single log is split; None where it is not.
        locked: Positions of the joints that do not move, by name.
        path: The case file; empty for a case made from a robot alone.
        robot_path: The robot description.
    """

    robot: Robot
    friction: tuple[Friction, ...]
    columns: ColumnMap
    preprocessing: Preprocessing
    estimator: Choice = field(default_factory=lambda: Choice("consistent"))
    train: tuple[str, ...] = ()
    test: tuple[str, ...] = ()
    split: Split | None = None
    locked: Mapping[str, float] = field(default_factory=dict)
    path: str = ""
    robot_path: str = ""

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that the case stands on: itself, its robot and the logs it names."""
        own = [Path(name) for name in (self.path, self.robot_path) if name]
        return (*own, *(self.find(name) for name in (*self.train, *self.test)))

    @property
    def model(self) -> DynamicModel:
        """The dynamic model of the case."""
        return DynamicModel(self.robot, self.friction)

    def find(self, name: str) -> Path:
        """Return a file named in the case: as it is, beside the case file, or under the folder DYNIDENT_DATA."""
        return _find(name, self.path)

    def read(self, name: str | Path) -> Log:
        """Return a log with torques, from its currents where it has no torques.

        Raises:
            LogMismatch: A joint is missing, currents have no gain, or a locked joint moves.
        """
        return read_with(self.find(str(name)), self.columns, self.robot, self.locked)


def read_with(path: str | Path, columns: ColumnMap, robot: Robot, locked: Mapping[str, float] | None = None) -> Log:
    """Return a log with the joints of a robot and with torques, currents times drive gains where it has none.

    Raises:
        LogFormatError: The file is no sound log.
        LogMismatch: A joint is missing, currents have no gain, or a locked joint moves or stands elsewhere.
    """
    form = None if columns.decimal == "." else FORMATS.make("csv", decimal=columns.decimal)
    log = read_log(path, columns, form=form)
    for name, position in (locked or {}).items():
        if name in log.joints:
            away = float(np.abs(log.q[:, log.joints.index(name)] - position).max())
            if away > LOCKED_TOLERANCE:
                step = f"lock it where it stands (locked: {{{name}: ...}}), or do not lock it"
                raise LogMismatch(log.name, f"{name} is locked at {position:g} but up to {away:.3g} away", step)
    log = log.ordered(robot.joint_names)
    if log.torque is not None or log.current is None:
        return log
    gains = {joint.name: joint.drive.gain for joint in robot.active if joint.drive.gain is not None}
    return torque_from_current(log, gains, robot.coupling if robot.is_coupled else None)


def default_preprocessing() -> Preprocessing:
    """Return the stated default: zero-phase Butterworth at 5 Hz, order 4, on both sides; rows at rest left out."""
    return Preprocessing(FILTERS.make("butterworth", cutoff_hz=5.0), rate_hz=200.0, trim_s=0.5, standstill=0.02)


def case_of_robot(path: str) -> Case:
    """Return the case that stands for a robot description alone: its joints, default friction and filter."""
    robot = read_robot(path)
    friction = tuple(FRICTION.make(name) for name in DEFAULT_FRICTION)
    return Case(robot, friction, ColumnMap(joints=robot.joint_names), default_preprocessing(), robot_path=path)


def read_case(path: str | Path) -> Case:
    """Read a case file, or a robot description as a case with all defaults.

    Raises:
        FileError: No such file.
        DescriptionError: A fault in the case file or the robot description, with the key.
        UnknownChoice: A part that does not exist.
        BadOption: An option of a part with a value it cannot take.
    """
    file = Path(path)
    if file.suffix.lower() not in (".yaml", ".yml") or not file.is_file():
        return case_of_robot(str(path))
    try:
        data = file.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    value, lines = load_yaml(path, data)
    if isinstance(value, dict) and not {"case", "robot"} & value.keys():
        return case_of_robot(str(path))  # a DH table, or meant to be one
    top = Section.top(path, value, _KEYS, lines)
    version = top.text("case")
    if version != str(FORMAT):
        raise top.place("case").error(f"format {version}", f"this version reads format {FORMAT}")
    robot_path = str(_find(top.text("robot"), str(path)))
    full = read_robot(robot_path)
    robot, locked = _robot(top, full)
    return Case(
        robot=robot,
        friction=tuple(_parts(top, "friction", FRICTION, DEFAULT_FRICTION)),
        columns=_columns(top, full),
        preprocessing=_preprocessing(top),
        estimator=_choice(top, "estimator", "consistent"),
        train=_texts(top, "train"),
        test=_texts(top, "test"),
        split=_guard(top.place("split"), lambda: Split.parse(top.text("split"))) if top.has("split") else None,
        locked=locked,
        path=str(path),
        robot_path=robot_path,
    )


def _find(name: str, case: str) -> Path:
    """Return where a file named in a case file is; the name itself where it is nowhere, for the reader to refuse."""
    written = Path(name).expanduser()
    if written.is_absolute():
        return written
    roots = [Path(case).parent] if case else []
    roots += [Path()] + ([Path(os.environ[DATA_VARIABLE])] if os.environ.get(DATA_VARIABLE) else [])
    return next((root / written for root in roots if (root / written).exists()), written)


def _robot(top: Section, robot: Robot) -> tuple[Robot, dict[str, float]]:
    """Apply gravity, drives, coupling and locked joints, in this order; return also the locked positions."""
    if top.has("gravity"):
        robot = robot.with_gravity(top.numbers("gravity", 3))
    names = robot.joint_names
    drives: dict[str, Drive] = {}
    if top.has("drives"):
        section = top.section("drives", names)
        for name, joint in zip(names, robot.active, strict=True):
            if section.has(name):
                own = section.section(name, ("gear_ratio", "rotor_inertia", "gain"))
                drives[name] = _guard(section.place(name), lambda own=own, joint=joint: _drive(own, joint.drive))
    coupling = top.matrix("coupling", len(names), len(names)) if top.has("coupling") else None
    robot = _guard(top.place("coupling"), lambda: robot.with_drives(drives, coupling))
    if not top.has("locked"):
        return robot, {}
    if top.value("locked") == "rest":
        positions = dict.fromkeys((name for name in names if name not in _texts(top, "joints")), 0.0)
    else:
        section = top.section("locked", names)
        positions = {name: section.number(name) for name in names if section.has(name)}
    return _guard(top.place("locked"), lambda: robot.locked(positions)), positions


def _drive(section: Section, stated: Drive) -> Drive:
    return replace(
        stated,
        gear_ratio=section.number("gear_ratio", stated.gear_ratio),
        rotor_inertia=section.number("rotor_inertia", stated.rotor_inertia),
        gain=section.number("gain") if section.has("gain") else stated.gain,
    )


def _columns(top: Section, robot: Robot) -> ColumnMap:
    joints = _texts(top, "joints") or robot.joint_names
    unknown = [name for name in joints if name not in robot.joint_names]
    if unknown:
        step = f"the robot has {', '.join(robot.joint_names)}"
        raise top.place("joints").error(f"no joint called '{unknown[0]}'", step)
    if not top.has("log"):
        return _guard(top.place("joints"), lambda: ColumnMap(joints=joints))
    log = top.section("log", _LOG_KEYS)
    named: dict[str, Any] = {}
    if log.has("columns"):
        columns = log.section("columns", _COLUMN_KEYS)
        for key in _COLUMN_KEYS:
            if columns.has(key):
                named[key] = columns.text("time") if key == "time" else _column_names(columns, key, len(joints))
    words: dict[str, Any] = {}
    if log.has("units"):
        units = log.section("units", _UNIT_KEYS)
        words = {key: _one_or_many(units, key) for key in _UNIT_KEYS if units.has(key)}
    decimal = log.choice("decimal", (".", ","), ".")
    _guard(log.place("units"), lambda: _check_units(Units(**words), joints, robot))
    return _guard(log.place(), lambda: ColumnMap(joints=joints, units=Units(**words), decimal=decimal, **named))


def _check_units(units: Units, joints: Sequence[str], robot: Robot) -> None:
    """Refuse a unit that does not fit the kind of its joint, and lists of another length than the joints."""
    kinds = {joint.name: joint.kind for joint in robot.active}
    for quantity in ("position", "velocity", "acceleration", "torque"):
        for name, word in zip(joints, units.of(quantity, len(joints)), strict=True):
            kind = UNITS[quantity][word][1]
            if kind not in ("", kinds[name]):
                step = f"{name} is {kinds[name]}; give a unit that fits, one per joint where they differ"
                raise BadOption(f"units.{quantity}", word, step)


def _column_names(section: Section, key: str, joints: int) -> tuple[str, ...]:
    """Return the columns of a signal: a list, or one text with {} for the number of the joint, counted from 1."""
    value = _one_or_many(section, key)
    if not isinstance(value, str):
        return value
    if value == "none":
        return ()
    if "{}" not in value:
        raise section.place(key).error(f"one name '{value}' for {joints} joints", "write a list, or a pattern as q{}")
    return tuple(value.replace("{}", str(k)) for k in range(1, joints + 1))


def _preprocessing(top: Section) -> Preprocessing:
    stated = default_preprocessing()
    if not top.has("preprocessing"):
        return stated
    section = top.section("preprocessing", _PREPROCESSING_KEYS)
    how = Preprocessing(
        filter=_part(section, "filter", FILTERS) if section.has("filter") else stated.filter,
        rate_hz=stated.rate_hz,
    )
    rate = section.value("rate_hz") if section.has("rate_hz") else stated.rate_hz
    return _guard(
        section.place(),
        lambda: replace(
            how,
            rate_hz=None if rate in (None, "all") else section.number("rate_hz", stated.rate_hz),
            trim_s=section.number("trim_s", stated.trim_s),
            standstill=section.number("standstill", stated.standstill),
            rest=section.choice("rest", ("mask", "keep"), stated.rest),
        ),
    )


def _parts(top: Section, key: str, family: Family[Any], default: Sequence[str]) -> list[Any]:
    if not top.has(key):
        return [family.make(name) for name in default]
    value = top.value(key)
    if not isinstance(value, list):
        raise top.place(key).error("not a list", f"write a list such as [{', '.join(default)}]")
    return [_made(top.place(f"{key}.{i}"), item, family) for i, item in enumerate(value, start=1)]


def _part(section: Section, key: str, family: Family[Filter]) -> Any:
    return _made(section.place(key), section.value(key), family)


def _made(place: Place, value: object, family: Family[Any]) -> Any:
    choice = _choice_of(place, value)
    return _guard(place, lambda: family.make_from_text(choice.name, choice.options))


def _choice(top: Section, key: str, default: str) -> Choice:
    return _choice_of(top.place(key), top.value(key)) if top.has(key) else Choice(default)


def _choice_of(place: Place, value: object) -> Choice:
    """Return a part written as ``name`` or as ``name: {option: value}``."""
    if isinstance(value, str):
        return Choice(value)
    if isinstance(value, dict) and len(value) == 1:
        ((name, options),) = value.items()
        if options is None or (isinstance(options, dict) and all(_is_plain(v) for v in options.values())):
            texts = {k: _text_of(v) for k, v in (options or {}).items()}
            return Choice(str(name), texts)
    raise place.error("neither a name nor one name with its options", "write name, or name: {option: value}")


def _is_plain(value: object) -> bool:
    return value is None or isinstance(value, str) or (isinstance(value, list) and all(map(_is_plain, value)))


def _text_of(value: object) -> str | None:
    return ",".join(str(item) for item in value) if isinstance(value, list) else None if value is None else str(value)


def _texts(section: Section, key: str) -> tuple[str, ...]:
    if not section.has(key):
        return ()
    value = _one_or_many(section, key)
    return (value,) if isinstance(value, str) else value


def _one_or_many(section: Section, key: str) -> str | tuple[str, ...]:
    value = section.value(key)
    if isinstance(value, str):
        return value
    if isinstance(value, list) and value and all(isinstance(item, str) for item in value):
        return tuple(value)
    raise section.place(key).error("neither a text nor a list of texts", "write one, or a list [a, b]")


def _guard(place: Place, make: Any) -> Any:
    """Return ``make()``; an error about a value then also names the place in the case file."""
    try:
        return make()
    except DescriptionError:
        raise
    except (DynidentError, ValueError) as error:
        raise DescriptionError(place.path, place.where, str(error), "see docs/case-file.md") from error
