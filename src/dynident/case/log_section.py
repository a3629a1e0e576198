"""The keys ``joints`` and ``log`` of a case file: which columns are which signals, and in which units.

A profile gives the columns of a maker; what the user states goes before it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from dynident.case.case_values import LEVER_ARM, guarded, one_or_many, part_of, texts
from dynident.data.formats import FORMATS, ColumnMap, Units
from dynident.data.formats._units import QUANTITY, unit_of
from dynident.data.profiles import PROFILES, Channel, Profile, pattern_names
from dynident.data.profiles.base import MARKS, SIDES
from dynident.errors import BadOption
from dynident.model.documents.sections import Section
from dynident.model.robot import Robot
from dynident.robot_files.leaders import followed, led_by

_LOG_KEYS = ("profile", "format", "columns", "units", "decimal", "rated", "side", "zero")
_LOG_KEYS += ("wrapped", "torque_clock", "repeats", "leave_out", "force")
_COLUMN_KEYS = ("time", "q", "dq", "ddq", "torque", "current", "temperature", "q_ref", "dq_ref")
_UNIT_KEYS = ("time", "position", "velocity", "acceleration", "torque", "current")


def led_by_joints(top: Section, robot: Robot) -> Robot:
    """Return the robot in which followers that ``joints`` names move on their own, in place of what they followed.

    Args:
        top: The whole case.
        robot: As its file ties joints.

    Raises:
        DescriptionError: Two of them are one motion.
    """
    names = texts(top, "joints")
    for name in names:
        joint = next((one for one in robot.joints if one.name == name and one.mimic is not None), None)
        if joint is None or joint.mimic is None:
            continue
        if joint.mimic.joint in names:
            step = f"leave one of the two out, they are one motion: {followed(joint)}"
            raise top.place("joints").error(f"'{name}' follows '{joint.mimic.joint}'", step)
        robot = guarded(top.place("joints"), partial(led_by, robot, name))
    return robot


def read_columns(top: Section, robot: Robot) -> ColumnMap:
    """Return how the columns of the logs become signals.

    Args:
        top: The whole case.
        robot: The robot with all its joints.

    Raises:
        DescriptionError: A fault in one of the keys, with the key.
    """
    joints = texts(top, "joints") or robot.joint_names
    unknown = [name for name in joints if name not in robot.joint_names]
    if unknown:
        step = f"the robot has {', '.join(robot.joint_names)}"
        raise top.place("joints").error(f"no joint called '{unknown[0]}'", step)
    if not top.has("log"):
        return guarded(top.place("joints"), lambda: ColumnMap(joints=joints))
    log = top.section("log", _LOG_KEYS)
    found: dict[str, Any] = {"joints": joints, "decimal": log.choice("decimal", (".", ","), ".")}
    found["repeats"], found["leave_out"] = log.choice("repeats", ("refuse", "drop"), "refuse"), _left_out(top, log)
    if log.has("columns"):
        columns = log.section("columns", _COLUMN_KEYS)
        for key in _COLUMN_KEYS:
            if columns.has(key):
                found[key] = columns.text("time") if key == "time" else _column_names(columns, key, joints)
    words = _unit_words(top, log)
    for key in ("rated", "zero"):
        if log.has(key):
            found[key] = tuple(log.numbers(key, len(joints)))
    if log.has("wrapped"):
        found["wrapped"] = _wrapped(log, joints, robot)
    if log.has("torque_clock"):
        found["torque_clock"] = log.number("torque_clock")
    if log.has("force"):
        found["force"] = texts(log, "force")
    if log.has("format"):
        found["form"], options = part_of(log.place("format"), log.value("format"))
        found["form_options"] = tuple(options.items())
        guarded(log.place("format"), lambda: FORMATS.make_from_text(found["form"], options))
    if log.has("side"):
        found["motor"] = _motor(log)
    guarded(log.place("units"), lambda: _check_units(Units(**words), joints, robot, found.get("motor", ())))
    return guarded(log.place(), lambda: _map(log, words, found))


def _unit_words(top: Section, log: Section) -> dict[str, Any]:
    """Return the stated units; positions that the key ``servo`` turns into rad count as rad."""
    servo = top.value("servo") if top.has("servo") else None
    words: dict[str, Any] = {}
    if isinstance(servo, dict) and {"counts", "calibration"} & servo.keys():
        words["position"] = "rad"
    if log.has("units"):
        units = log.section("units", _UNIT_KEYS)
        words |= {key: one_or_many(units, key) for key in _UNIT_KEYS if units.has(key)}
    return words


def _map(log: Section, words: dict[str, Any], found: dict[str, Any]) -> ColumnMap:
    """Return the map of a log section, with what its profile says where the section does not."""
    if not log.has("profile"):
        return ColumnMap(units=Units(**words), **found)
    joints = found.pop("joints")
    return profile_columns(log.text("profile"), joints, words, found)


def _motor(log: Section) -> tuple[str, ...]:
    """Return the signals on the motors' side: of a word for all, or of signals and their words."""
    if isinstance(log.value("side"), str):
        return SIDED if log.choice("side", SIDES) == "motor" else ()
    side = log.section("side", SIDED)
    return tuple(key for key in SIDED if side.has(key) and side.choice(key, SIDES) == "motor")


def _wrapped(log: Section, joints: Sequence[str], robot: Robot) -> tuple[str, ...]:
    """Return the joints whose turns are counted on, which must turn and be in the log."""
    wrapped = texts(log, "wrapped")
    turning = [joint.name for joint in robot.active if joint.kind == "revolute" and joint.name in joints]
    strange = [name for name in wrapped if name not in turning]
    if strange:
        step = f"name joints of the log that turn: {', '.join(turning)}"
        raise log.place("wrapped").error(f"no turning joint called '{strange[0]}'", step)
    return wrapped


def _left_out(top: Section, log: Section) -> tuple[tuple[str, Any], ...]:
    """Return the spells of each log that do not count; each must be one of the logs that the case names, if it does."""
    given, place = log.value("leave_out") if log.has("leave_out") else {}, log.place("leave_out")
    step = "give starts and ends in s since the log began, by its name: leave_out: {run.csv: [[3, 4.5], [8, 9]]}"
    if not isinstance(given, dict):
        raise place.error("spells without the name of a log", step)
    named = [re.split(r"[/\\]", name)[-1] for key in ("train", "test") for name in texts(top, key)]
    for name, spells in given.items():
        if named and name not in named:
            raise place.error(f"no log of this case is called '{name}'", f"it has {', '.join(dict.fromkeys(named))}")
        try:
            ends = np.asarray(spells, dtype=float)
        except (TypeError, ValueError):
            ends = np.zeros(0)
        if ends.ndim != 2 or ends.shape[-1] != 2 or not np.all((ends[:, 0] >= 0.0) & (np.diff(ends)[:, 0] > 0.0)):
            raise place.error(f"{name}: {spells}", step)
    return tuple(given.items())


def _check_units(units: Units, joints: Sequence[str], robot: Robot, motor: Sequence[str]) -> None:
    """Refuse a unit that does not fit the kind of its joint, and lists of another length than the joints.

    Motors turn, those of slides as well: of signals at the ``motor`` side units of turns fit all.
    """
    turning = {QUANTITY[signal] for signal in motor}
    kinds = {joint.name: joint.kind for joint in robot.active}
    for quantity in ("position", "velocity", "acceleration", "torque"):
        for name, word in zip(joints, units.of(quantity, len(joints)), strict=True):
            kind = unit_of(quantity, word)[1]
            if kind not in ("", kinds[name], "revolute" if quantity in turning else ""):
                step = f"{name} is {kinds[name]}; give a unit that fits, one per joint where they differ"
                step += f"; {LEVER_ARM}" * (quantity == "torque" and kind == "prismatic")
                raise BadOption(f"units.{quantity}", word, step)


def _column_names(section: Section, key: str, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of a signal: a list, or one text with a mark for the joint (see :func:`pattern_names`)."""
    value = one_or_many(section, key)
    if not isinstance(value, str):
        return value
    if value == "none":
        return ()
    if key == "temperature" and not any(mark in value for mark in MARKS):
        return (value,) * len(joints)  # of one sensor for all
    if not any(mark in value for mark in MARKS):
        step = "write a list, or a pattern as q{}"
        raise section.place(key).error(f"one name '{value}' for {len(joints)} joints", step)
    return pattern_names(value, joints)


#: Signals that have a side: those of motion and torque. A current is always the motor's.
SIDED = ("q", "dq", "ddq", "torque", "raw_torque", "q_ref", "dq_ref")


def profile_columns(
    profile: str | Profile,
    joints: Sequence[str],
    units: Mapping[str, str | tuple[str, ...]] | None = None,
    stated: Mapping[str, Any] | None = None,
) -> ColumnMap:
    """Return how the columns of a log become signals by a profile.

    Args:
        profile: Name of the profile, or the profile.
        joints: Names of the joints, in the order of their numbers.
        units: Units that stand in place of the profile's, by quantity; words of the case file.
        stated: Fields of :class:`ColumnMap`, by name, that stand in place of the profile's.

    Raises:
        UnknownChoice: No such profile.
        BadOption: A unit that only the user can know is missing, or a column is not what it is read as.
    """
    name = profile if isinstance(profile, str) else PROFILES.name_of(profile)
    found = PROFILES.make(profile)
    channels = found.read_channels()
    columns: dict[str, Any] = {
        signal: channels[signal].names(joints) if signal in channels else () for signal in QUANTITY
    }
    columns |= stated or {}
    _check(name, found, columns)
    used = {signal: _channel(found, signal, columns[signal]) for signal in QUANTITY if columns[signal]}
    words: dict[str, Any] = {"time": found.time_unit} if columns.get("time", found.time) == found.time else {}
    for signal, channel in used.items():
        quantity = QUANTITY[signal]
        if channel is None or quantity == "temperature" or quantity in words or quantity in (units or {}):
            continue
        if not channel.unit:
            step = f"state it (units: {{{quantity}: ...}}): {name} does not state it ({channel.note})"
            raise BadOption(f"units.{quantity}", None, step)
        words[quantity] = channel.unit
    motor = [s for s, channel in used.items() if channel is not None and channel.side == "motor" and s in SIDED]
    optional = [s for s, channel in channels.items() if not channel.needed and s not in (stated or {})]
    settings: dict[str, Any] = {"time": found.time, "motor": tuple(motor), "optional": tuple(optional)}
    words |= dict(units or {})
    settings["units"] = Units(**words)
    return ColumnMap(joints=tuple(joints), **(settings | columns))


def _check(name: str, profile: Profile, columns: Mapping[str, Any]) -> None:
    """Refuse columns of the profile that are read as another quantity than they are, such as currents as torques."""
    forced = columns.get("force", ())
    for signal, quantity in QUANTITY.items():
        for column in columns[signal] or ():
            known = [channel for channel in profile.channels if channel.matches(column)]
            if known and signal not in forced and quantity not in {QUANTITY[channel.signal] for channel in known}:
                step = f"in {name} it is a {QUANTITY[known[0].signal]}; map another column, or say force: [{signal}]"
                raise BadOption(signal, column, step)


def _channel(profile: Profile, signal: str, names: Sequence[str]) -> Channel | None:
    """Return the channel of the profile that the columns of a signal are; None for columns that it does not know."""
    for channel in profile.channels:
        if QUANTITY[channel.signal] == QUANTITY[signal] and all(channel.matches(name) for name in names):
            return channel
    return None
