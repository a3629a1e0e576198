"""A case file drafted from a robot model and logs: columns by profiles and names, facts and doubts as comments.

Nothing is converted on a guess: a unit that neither the profile nor the header states, and that the values do not
support, is asked for with the likely answer; so is what no log can tell (drive gains, mounting, couplings).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.case.case_values import model_place
from dynident.case.draft.case_text import Files, case_text
from dynident.case.draft.commands import command_topics, recording, topic_of_joints
from dynident.case.draft.joint_choice import outside_limits
from dynident.case.draft.long_table import refuse_long
from dynident.case.draft.moving_base import moving_base
from dynident.case.draft.profile_fit import fitting_profiles
from dynident.case.draft.readings import ONE_FILE, long_gap, opened
from dynident.case.draft.recognise import cutoff_of, recognised
from dynident.case.draft.recognition import Recognised
from dynident.case.draft.servo_text import is_servo_log, servo_remark
from dynident.case.draft.signal_units import position_factors
from dynident.case.draft.stated_joints import names_of_echo
from dynident.case.draft.tied_columns import led_by_columns, with_sums
from dynident.case.draft.time_columns import split_time
from dynident.case.draft.yaml_words import few, listed
from dynident.case.evidence.positions import turns_into_limits
from dynident.case.questions import Question, questions_in
from dynident.data.formats import FORMATS, LARGE, LogFormat, LogTable, bytes_of
from dynident.data.formats._clocked_table import with_clock, with_sum
from dynident.data.formats._text_header import DATE, cells_of
from dynident.data.formats._text_table import TextTable
from dynident.data.preprocessing import BRIDGED, SPLIT
from dynident.data.profiles import PROFILES
from dynident.errors import BadOption, DynidentError, LogFormatError
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.robot import Robot
from dynident.robot_files import read_robot
from dynident.robot_files.tree import PLACEHOLDERS

#: Rows by which two columns of a time are told to be one.
_FIRST_ROWS = 1 << 12

#: Share of the largest torque of gravity from which it loads a joint.
_LOADED = 1e-6

#: What to do where a file holds one signal.
_ELSEWHERE = f"; where each signal has a file of its own, {ONE_FILE}"


@dataclass(frozen=True)
class Draft:
    """A drafted case file.

    Attributes:
        text: The YAML text.
        remarks: What the user has to check.
        questions: What the file asks for.
        recognition: What was recognised, and how.
        files: The files it is about.
    """

    text: str
    remarks: tuple[str, ...]
    questions: tuple[Question, ...]
    recognition: Recognised
    files: Files

    @property
    def needed(self) -> tuple[Question, ...]:
        """The questions that have to be answered before the file can be used."""
        return tuple(question for question in self.questions if question.needed)


def told_gravity(draft: Draft, gravity: Array | None) -> Draft:
    """Return a draft that says which gravity (3,) the torques of its logs follow; None where they do not tell."""
    found = replace(draft.recognition, gravity=gravity)
    text = case_text(found, draft.files, draft.remarks)
    return replace(draft, text=text, questions=questions_in(text), recognition=found)


def draft_case(
    robot: str,
    logs: str | Sequence[str],
    folder: str | Path = ".",
    *,
    test: Sequence[str] = (),
    profile: str = "",
    form: str = "",
    form_options: Mapping[str, str | None] | None = None,
    rate_hz: float | None = None,
) -> Draft:
    """Draft the case file of a robot and its logs.

    Args:
        robot: Robot model, or the name of a robot that ships.
        logs: Log of a motion, or several with the same columns; the first says what the columns are.
        folder: Where the case file will stand; paths in it are relative to it.
        test: Logs to test on.
        profile: Profile of the logs; empty for the one that their columns fit.
        form: Format of the logs; empty for the one by their suffix.
        form_options: Options of the format as text.
        rate_hz: Samples a second of logs that have no column of the time; None where one is there.

    Raises:
        FileError: A file cannot be read.
        DescriptionError: A fault in the robot model.
        LogFormatError: No sound log.
        UnknownChoice: No such profile or format.
        BadOption: A profile that does not fit the columns, or is named beside a rate; a rate that is none.
    """
    described = read_robot(model_place(robot))
    train = (logs,) if isinstance(logs, str) else tuple(logs)
    if not train:
        raise BadOption("LOG", "", "name at least one log")
    if profile:
        PROFILES.get(profile)
    tables, written = _tables((*train, *test), form, dict(form_options or {}), described.joint_names)
    if rate_hz is not None:
        if profile or not 0 < rate_hz < np.inf:
            step = (
                "leave the profile out, it names a column of the time"
                if profile
                else "give the samples a second, above 0"
            )
            raise BadOption("rate", f"{rate_hz:g}", step)
        clock = f"{np.format_float_positional(rate_hz, trim='-')} Hz"
        tables = [with_clock(table, clock, rate_hz) for table in tables]
    elif not fitting_profiles(tables[0].header, described.joint_names):
        tables = _summed(tables)
    described, ties, pairs = led_by_columns(described, tables[0])
    found = with_sums(recognised(described, tables, profile), pairs)
    if profile and not found.profiles:
        reads = ", ".join(channel.pattern for channel in PROFILES.make(profile).read_channels().values())
        step = f"it reads {PROFILES.make(profile).time}, {reads}, for each joint of the robot; leave the profile out"
        raise BadOption("profile", profile, step)
    found = replace(found, form=written, is_large=sum(bytes_of(Path(log)) for log in train) > LARGE)
    remarks = (*ties, *_placeholders(described), *_unread(tables), *moving_base(found.robot, tables), *_remarks(found))
    files = Files(robot, train, tuple(test), Path(folder))
    text = case_text(found, files, remarks)
    return Draft(text, remarks, questions_in(text), found, files)


def draft_summary(draft: Draft) -> dict[str, Any]:
    """Return what was recognised, with how sure it is in words, as plain data for JSON."""
    found = draft.recognition
    units = {
        quantity: {"unit": told.text, "confidence": _word(told.certain, told.text), "evidence": told.why}
        for quantity, told in found.units.items()
    }
    signals = {
        signal: {"columns": list(source.columns), "side": source.side, "evidence": source.how}
        for signal, source in found.sources.items()
    }
    is_timed = found.readings and bool(found.units["time"].words)
    logs = [
        {"path": r.path, "rows": r.rows, "duration_s": r.duration * found.to_seconds if is_timed else None,
         "rate_hz": 1 / (r.step * found.to_seconds) if is_timed else None, "faults": list(r.notes)}
        for r in found.readings
    ]  # fmt: skip
    joints = found.joints
    return {
        "robot": found.robot.name,
        "profiles": [{"name": fit.name, "known_columns": fit.known, "evidence": fit.why()} for fit in found.profiles],
        "time": found.time,
        "joints": {
            "names": list(joints.names), "confidence": _word(joints.certain, bool(joints.names)), "evidence": joints.why
        },
        "signals": signals,
        "units": units,
        "left_out": dict(found.left_out),
        "refused": {group.shown(): why for group, why in found.refused},
        "logs": logs,
        "band_hz": found.band_hz,
        "cutoff_hz": cutoff_of(found),
        "remarks": list(draft.remarks),
        "questions": [{"line": q.line, "asks_for": q.text, "needed": q.needed} for q in draft.questions],
    }  # fmt: skip


def _word(certain: bool, likely: object) -> str:
    return "certain" if certain else "likely, asked" if likely else "asked"


def _tables(
    logs: Sequence[str], form: str, options: dict[str, str | None], joints: Sequence[str]
) -> tuple[list[LogTable], str]:
    """Return the opened logs, and the line of the case file that says how, where the suffix does not."""
    if form:
        made = FORMATS.make_from_text(form, options)
        inside = ", ".join(f"{key}: {value}" for key, value in options.items())
        return [opened(log, made) for log in logs], f"format: {f'{{{form}: {{{inside}}}}}' if options else form}"
    first: LogFormatError
    topics = command_topics(logs[0])
    if topics:
        found = [recording(log, topics) for log in logs]
        return [table for table, _ in found], found[0][1]
    if topics := topic_of_joints(logs[0], joints):
        tables = [opened(log, FORMATS.make("rosbag", {"topics": topics})) for log in logs]
        return tables, f"format: {{rosbag: {{topics: [{topics[0]}]}}}}   # the topic with joints of the robot"
    if Path(logs[0]).suffix.lower() in FORMATS.get("csv").suffixes and (echo := names_of_echo(logs[0])):
        tables = [opened(log, FORMATS.make("csv", {"names": echo})) for log in logs]
        return (
            tables,
            f"format: {{csv: {{names: {listed(echo)}}}}}   # as ros2 topic echo --csv writes, without a header",
        )
    refuse_long(logs[0])
    try:
        tables = [opened(log) for log in logs]
        numbers = _numbers(tables[0])
        if _is_table(tables[0]) and (numbers == len(tables[0].header) or _numbers_with_commas(logs[0]) <= numbers):
            return tables, ""
        first = LogFormatError(logs[0], tables[0].line, "no rows of numbers", "is it a log?")
    except LogFormatError as error:
        first = error
    if Path(logs[0]).suffix.lower() in FORMATS.get("csv").suffixes:
        for line, kind in (
            ("format: {csv: {names: ['c{}']}}", FORMATS.make("csv", {"names": ("c{}",)})),
            ("format: {csv: {names: ['c{}'], decimal: ','}}", FORMATS.make("csv", {"names": ("c{}",), "decimal": ","})),
            ('decimal: ","', FORMATS.make("csv", {"decimal": ","})),
            ("format: twincat_scope", _scope()),
        ):
            tables = _readable(logs, kind)
            if tables:
                return tables, f"{line}   # the file reads as this only"
    raise first


def _summed(tables: Sequence[LogTable]) -> list[LogTable]:
    """Return the tables with a time that is the sum of two columns, where whole seconds and parts of one say so."""
    parts = None if tables[0].has_frames else split_time(tables[0].header)
    if parts is None or any(not {name for name, _ in parts} <= set(table.header) for table in tables):
        return list(tables)
    (whole, _), (part, unit) = parts
    for table in tables:
        first = next(table.batches([whole, part], _FIRST_ROWS), np.empty((0, 2)))
        if np.any(first[:, 0] % 1) or np.any((first[:, 1] < 0) | (first[:, 1] >= {"us": 1e6, "ns": 1e9}[unit])):
            return list(tables)  # each of them is the whole time, or none is
    return [with_sum(table, f"{whole} s + {part} {unit}", parts) for table in tables]


def _scope() -> LogFormat:
    return FORMATS.make("twincat_scope")


def _readable(logs: Sequence[str], form: LogFormat) -> list[LogTable]:
    try:
        tables = [opened(log, form) for log in logs]
        return tables if _is_table(tables[0]) else []
    except DynidentError:
        return []


def _numbers_with_commas(log: str) -> int:
    """Return how many columns of a text hold numbers where commas are decimal signs."""
    if Path(log).suffix.lower() not in FORMATS.get("csv").suffixes:
        return 0
    try:
        return _numbers(opened(log, FORMATS.make("csv", {"decimal": ","})))
    except DynidentError:
        return 0


def _numbers(table: LogTable) -> int:
    """Return how many columns hold a number in the first row; all of a file that is no text."""
    if table.line is None:
        return len(table.header)
    found = 0
    for name in table.header:
        try:
            next(table.batches([name], 1), None)
            found += 1
        except LogFormatError:
            continue
    return found


def _is_table(table: LogTable) -> bool:
    """Return whether the first column without dates holds numbers; a header alone proves no text to be read rightly."""
    if table.line is None:
        return True
    names = table.header
    if isinstance(table, TextTable):
        cells = cells_of(next(table.rows(), (0, ""))[1], table.delimiter)
        names = (
            tuple(name for name, cell in zip(names, cells, strict=False) if not DATE.fullmatch(cell.strip())) or names
        )
    table.columns(names[:1])
    return True


def _placeholders(robot: Robot) -> list[str]:
    told = [text for text in robot.note.split("; ") if text.startswith(PLACEHOLDERS)]
    return [f"the robot model's {text}; they tell no gain and no unit" for text in told]


def _unread(tables: Sequence[LogTable]) -> list[str]:
    """Return what files hold and no format reads."""
    texts = dict.fromkeys(table.how.partition("; left out: ")[2] for table in tables)
    return [f"not read: {text}" for text in texts if text]


def _remarks(found: Recognised) -> list[str]:
    noted = [pair for reading in found.readings for pair in zip(reading.notes, reading.remedies, strict=True)]
    remarks = [f"{note}: {step}" for note, step in dict.fromkeys(noted)]
    for why in dict.fromkeys(found.unread.values()):
        names = [name for name, own in found.unread.items() if own == why]
        remarks.append(f"{few(names, 4)}: {why}: not read")
    for reading in found.readings:
        gap = long_gap(reading.time * found.to_seconds)
        if gap:
            told = f"{Path(reading.path).name} has gaps in time, the longest of {gap:.3g} s"
            remarks.append(f"{told}: {SPLIT if gap > BRIDGED else 'samples near them are left out'}")
    if not found.time or "q" not in found.sources:
        what = "time" if not found.time else "positions"
        rate = "; where the log has none, draft again with --rate, its samples a second, and units are looked at"
        step = f"fill them in, or draft again with --profile{'' if found.time else rate}"
        remarks.append(f"the columns of the {what} are not recognised: {step}{_ELSEWHERE if found.time else ''}")
        return remarks
    moving, told = found.moving, found.units["position"]
    if moving is not None and told.certain and "q" not in found.on_motors:
        order = [found.joints.names.index(joint.name) for joint in moving.active]
        q = np.concatenate([reading.signals["q"] for reading in found.readings])
        q = (q * position_factors(told, q.shape[1]))[:, order]
        for k in (k for k, joint in enumerate(moving.active) if joint.name in found.wrapped):
            q[:, k] += turns_into_limits(moving.active[k], q[:, k].min(), q[:, k].max())
        outside = outside_limits(moving.active, q)
        remarks += [f"{text}: check units, sign and order of the columns" for text in outside]
    if still := list(found.still):
        one, many = "never moves; it is locked where it stands", "never move; they are locked where they stand"
        step = "record a motion of all joints to identify all"
        remarks.append(f"{few(still)} {many if len(still) > 1 else one}; {step}")
    for name, (_, why) in found.grippers.items():
        remarks.append(f"{name} {why}: its columns are not read, and it is locked in the middle of its positions")
    if held := found.without_effort:
        what = f"{few(list(held), 4)} {'has' if len(held) == 1 else 'have'} positions and neither torques nor currents"
        remarks.append(f"{what}: locked in the middle of the positions; locked: rest is at 0, a mimic joint follows")
    if "torque" in found.sources and "drives estimate" in found.sources["torque"].how:
        remarks.append(
            f"{found.sources['torque'].shown()} are what the drives estimate; read, as the log has no measured torques"
        )
    bare = found.without_positions.values()
    remarks += [f"{told}: correct the name in the log and draft again" for told in bare]
    if is_servo_log(found):
        remarks.append(servo_remark(found))
    elif not bare and not found.effort and not {"torque", "current"} & found.rivals.keys():
        told = "nothing can be identified without one of them, or the commanded positions of position servos"
        remarks.append(f"no torques and no currents: {told}{_ELSEWHERE}")
    return remarks + _against(found)


def _against(found: Recognised) -> list[str]:
    evidence, moving = found.evidence, found.moving
    if found.effort != "torque" or evidence is None or moving is None or found.sample is None:
        return []
    against = [
        name
        for name, ratio, telling in zip(moving.joint_names, evidence.ratios, evidence.telling, strict=True)
        if telling and ratio < 0
    ]
    if not against:
        return []
    model, place = DynamicModel(moving), [moving.joint_names.index(name) for name in against]
    q = found.sample[1].q[::100]
    held = np.abs(model.torque(Motion(q, 0.0 * q, 0.0 * q), np.asarray(model.nominal()))).max(axis=0)
    loaded = bool(np.any(held[place] > _LOADED * held.max()))
    step = f"check the sign and the order of the columns{', and the direction of gravity' if loaded else ''}"
    what = f"the robot model's {'gravity torque' if loaded else 'inertia'}"
    return [f"the torque of {', '.join(against)} has the opposite sign of {what}: {step}"]
