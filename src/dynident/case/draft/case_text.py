"""The text of a drafted case file: what is known as values with their evidence, what is not as questions."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynident.arrays import vector_text
from dynident.case.case import VERSIONS
from dynident.case.draft.drive_text import drive_lines
from dynident.case.draft.log_text import log_lines
from dynident.case.draft.readings import long_gap
from dynident.case.draft.recognise import cutoff_of, facts_of
from dynident.case.draft.recognition import Recognised
from dynident.case.draft.servo_text import is_servo_log, servo_lines
from dynident.case.draft.signal_units import position_factors
from dynident.case.draft.yaml_words import asked, few, listed, offered, plain, quoted
from dynident.case.evidence.torques import agrees
from dynident.data.preprocessing import BRIDGED, at_rest, bridge_over, longest_step
from dynident.identification.problem.problem import rest_speeds
from dynident.model.base_parameters import with_stated_rotors
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import WHOLE_PART, Friction, motor_ripple
from dynident.model.friction.rotor_inertia import RotorInertia
from dynident.model.friction.warm_up import WarmUp
from dynident.robot_files import shipped_robots
from dynident.robot_files.xacro import split_arguments, with_arguments

#: Logs that are described one by one at the head of the file.
_MOST_LOGS = 12

#: A log without more samples a second than this keeps all of them.
_SLOW_HZ = 250.0

#: Width of the smoothed sign of dry friction in rad/s or m/s: the filter smooths more than that at most reversals.
_WIDTH = 0.01

#: Speed in rad/s over which friction at rest fades, where held-out samples find some and no other speed of it.
_FADES = 0.1

#: Such a speed of load friction by direction that does not fade.
_NEVER = 100.0

#: Distance in rad or m over which friction builds up after a reversal, likewise.
_SLIPS = 3e-3

#: Time constant in s with which drives warm up, likewise.
_WARMS = 300.0

#: Share of a log that trains where there is no other.
_TRAINS = 0.67

#: The line of the time delay.
_DELAY = "  delay_s: auto               # found from the log; applied where it is significant"

#: Friction that is there without a choice.
_SURE = ("viscous", "offset")

#: A joint slower than this, in rad/s, is at rest; a slide below its travel times this, a second.
_STANDSTILL = 0.02


@dataclass(frozen=True)
class Files:
    """The files of a case as they were given.

    Attributes:
        robot: Robot model, or the name of a robot that ships.
        train: Logs to learn from.
        test: Logs to test on.
        folder: Where the case file will stand.
    """

    robot: str
    train: tuple[str, ...]
    test: tuple[str, ...]
    folder: Path

    def relative(self, path: str) -> str:
        """Return a path relative to the folder of the case file."""
        return Path(os.path.relpath(path, self.folder)).as_posix()

    @property
    def robot_named(self) -> str:
        """The robot as the case file names it, with the arguments of a xacro."""
        file, arguments = split_arguments(self.robot)
        return with_arguments(file if file in shipped_robots() else self.relative(file), arguments)


def case_text(found: Recognised, files: Files, remarks: Sequence[str]) -> str:
    """Return the text of the case file.

    Args:
        found: What was recognised.
        files: The files it names.
        remarks: What has to be checked.
    """
    lines = [
        *_head(found, files, remarks),
        f"case: {VERSIONS.current}",
        f"robot: {quoted(files.robot_named)}",
        *_gravity(found),
        *_joints(found),
        *(_servo(found, files) if is_servo_log(found) else _model(found, files)),
        *_data(found, files),
    ]
    return "\n".join(lines) + "\n"


def _model(found: Recognised, files: Files) -> list[str]:
    return [
        *drive_lines(found),
        *_friction(found, files),
        *log_lines(found),
        *_preprocessing(found),
        "estimator: consistent",
    ]


def _servo(found: Recognised, files: Files) -> list[str]:
    return [*servo_lines(found, (*files.train, *files.test)), *log_lines(found)]


def _head(found: Recognised, files: Files, remarks: Sequence[str]) -> list[str]:
    lines = ["# Case file of dynident; docs/case-file.md describes every key."]
    logs = [*files.train, *files.test]
    for path, reading in zip(logs[:_MOST_LOGS], found.readings, strict=False):
        notes = f"; {'; '.join(reading.notes)}" if reading.notes else ""
        facts = facts_of(reading, found.to_seconds * bool(found.units["time"].words))
        lines.append(f"# Drafted from {plain(Path(path).name)}: {facts}{plain(notes)}")
    if not found.readings:
        lines.append(f"# The columns of {plain(Path(logs[0]).name)}: {few(found.header, 100)}")
    if len(logs) > _MOST_LOGS:
        lines.append(f"# ... and {len(logs) - _MOST_LOGS} more logs")
    lines.append(
        "# '# ask' marks a value that cannot be estimated from a log; where the value is the word ask, it is required."
    )
    return lines + [f"# CHECK: {plain(remark)}" for remark in remarks]


def _gravity(found: Recognised) -> list[str]:
    stated = np.asarray(found.robot.gravity)
    value, followed, evidence = f"gravity: [{vector_text(stated)}]", found.gravity, found.evidence
    telling = [] if evidence is None else evidence.ratios[np.array(evidence.telling)].tolist()
    if followed is None and found.effort == "torque" and telling and all(map(agrees, telling)):
        how = "the log's torques agree with it under the masses of the robot model"
        return [f"# {value}   # m/s^2 in the base frame; {how}"]
    if followed is None:
        return [offered(f"# {value}", "does the base stand upright? For a wall, a ceiling or a slope turn this vector")]
    if np.array_equal(followed, stated):
        return [f"# {value}   # m/s^2 in the base frame; the log's torques agree with it"]
    better = vector_text(followed, 3)
    return [offered(f"# {value}", f"how does the base stand? the log's torques follow [{better}]")]


def _joints(found: Recognised) -> list[str]:
    robot, joints = found.robot, found.joints
    missing = [name for name in robot.joint_names if name not in joints.names]
    held = {name: middle for name, (_, middle) in found.without_effort.items()}
    known = {**found.still, **{name: middle for name, (middle, _) in found.grippers.items()}, **held}
    grips = [f"{plain(few(list(found.grippers), 4))} in the middle of the positions"] * bool(found.grippers)
    grips += [f"no torques or currents of {plain(few(list(held), 4))}: in the middle of their positions"] * bool(held)
    lines = []
    if not joints.certain:
        count = len(found.sources["q"].columns) if "q" in found.sources else 0
        what = f"the joints of the {count} columns {found.sources['q'].shown()}, in their order" if count else (
            "the joints in the log, in the order of its columns"
        )  # fmt: skip
        likely = listed(joints.names) if joints.names else ""
        why = f" ({joints.why})" if joints.why else ""
        lines.append(asked("joints", f"{what}{why}", likely) if count else f"joints: {listed(robot.joint_names)}")
    else:
        lines.append(f"joints: {listed(joints.names)}   # {plain(joints.why)}")
    if bare := found.without_positions:
        told = f"where does {next(iter(bare))} stand? {next(iter(bare.values()))}; name its column and draft again, or"
        lines.append(asked("locked", f"{told} write {{joint: position}}"))
    elif known and not set(missing) - known.keys():
        values = ", ".join(f"{quoted(name)}: {value:.6g}" for name, value in known.items())
        where = ["they stand still in the log, here"] * bool(found.still) + grips
        lines.append(f"locked: {{{values}}}   # {'; '.join(where)}")
    elif known:
        values = {**dict.fromkeys(missing, 0.0), **known}
        written = ", ".join(f"{quoted(name)}: {value:.6g}" for name, value in values.items())
        lines.append(offered(f"locked: {{{written}}}", "where do the joints stand that the log lacks? Taken at 0"))
    elif missing and (joints.names or not joints.certain) and found.readings:
        count = robot.dof - (len(joints.names) or len(found.sources["q"].columns))
        if count > 0:
            text = (
                f"where do the {count} joints stand that the log lacks? rest is all at 0; else locked: {{joint: 0.3}}"
            )
            lines.append(offered("locked: rest", text))
    return lines


def _friction(found: Recognised, files: Files) -> list[str]:
    width, say = f"width: {_WIDTH:g}", "smoothing width of the Coulomb term (tanh), rad/s"
    if found.is_large:
        coulomb = f"  - coulomb: {{{width}}}   # {say}; choose: width needs all samples at once"
    else:
        coulomb = f"  - coulomb: {{{width}, choose: width}}   # {say}; held-out data may choose another"
    lines = ["friction:", coulomb, *(f"  - {name}" for name in _SURE)]
    is_plain_torque = found.effort == "torque" and "torque" not in found.on_motors
    rotors = "  - rotor_inertia            # of the motors, seen at the joints"
    may_have_rotor = not _behind_the_gear(found)
    if found.is_large:
        text = "does a sensor behind the gear measure the torque? Then take this line out; it comes out small there"
        return [
            *lines,
            *([rotors] if not is_plain_torque else []),
            *([offered("  - rotor_inertia", text)] if is_plain_torque and may_have_rotor else []),
            "  - degressive               # gears: sub-linear viscous friction",
            "  # load: friction that grows with the torque takes several passes; logs this large get one",
        ]
    if not is_plain_torque:  # it is there; where it is left out, a delay that is not there takes its place
        lines.append(rotors)
    elif may_have_rotor:
        lines += _optional_rotors(found)
    return [
        *lines,
        "  # parts with choose: part are kept only if they improve held-out data",
        "  - degressive: {choose: part}      # gears: sub-linear viscous friction",
        f"  - load: {{{width}, choose: [part, width]}}   # load-dependent friction",
        f"  - stribeck: {{velocity: {_FADES:g}, {width}, choose: [part, width, velocity, exponent]}}"
        "   # Stribeck effect",
        f"  - load_stribeck: {{velocity: {_FADES:g}, {width}, choose: [part, width, velocity]}}   # of the load",
        f"  - load_directional: {{velocity: {_NEVER:g}, {width}, choose: [part, width, velocity]}}   # in their place",
        f"  - presliding: {{length: {_SLIPS:g}, damping: true, choose: [part, length, shape]}}"
        "   # friction built up after reversals",
        *_ripple(found),
        *_warm_up(found, files),
    ]


def _optional_rotors(found: Recognised) -> list[str]:
    """Return the inertia of the motors: held-out samples decide, but where it acts as an inertia of bodies for sure."""
    one, seen = RotorInertia(choose=(WHOLE_PART,)), "of the motors, seen at the joints"
    told = "of motors and belts: no motion tells it from inertia of the links; "
    told += "take the line out where the drives measure behind their gears"
    parts: Sequence[Friction] = [one]
    if found.moving is not None and found.joints.certain:
        held = {*found.still, *found.grippers, *found.without_effort}.intersection(found.moving.joint_names)
        if len(held) < found.moving.dof:
            robot = found.moving.locked(dict.fromkeys(held, 0.0))
            parts = with_stated_rotors(DynamicModel(robot, [one, *_SURE]), arms=True).friction[: -len(_SURE)]
    lines = []
    for part in parts:
        options = [f"joints: {listed(part.joints or ())}"] * bool(part.joints) + ["choose: part"] * part.is_optional
        lines.append(f"  - rotor_inertia: {{{', '.join(options)}}}   # {seen if part.is_optional else told}")
    return lines


def _ripple(found: Recognised) -> list[str]:
    """Return the parts for ripple over a turn of the motors whose gear ratios the robot model states."""
    parts = motor_ripple(found.moving) if found.moving else ()
    each = [f"cycles: {part.options['cycles']!r}, joints: {listed(part.joints or ())}" for part in parts]
    return [f"  - periodic: {{{own}, choose: part}}   # ripple once and twice a turn of the motor" for own in each]


def _warm_up(found: Recognised, files: Files) -> list[str]:
    """Return the part for drives that warm up, by their temperatures or where a log without is long enough to tell.

    Its time constant is within what trains.
    """
    if found.temperature is not None:
        return ["  - temperature: {choose: part}   # friction that changes with the logged temperature of the drives"]
    each, least = [one.duration * found.to_seconds for one in found.readings], WarmUp.ranges["time_constant"].least_log
    if max(each, default=0.0) < least or not found.units["time"].words:
        return []
    train = each[: len(files.train) - (len(files.train) > 1 and not files.test)]
    trained = max(train, default=0.0) * (_TRAINS if len(files.train) == 1 and not files.test else 1.0)
    value = min(_WARMS, max(10.0 * ((trained - 1.0) // 10.0), least))
    text = "friction that changes as the drives warm up"
    return [f"  - warm_up: {{time_constant: {value:g}, choose: [part, time_constant]}}   # {text}"]


def _behind_the_gear(found: Recognised) -> bool:
    """Return whether the profile says that the torque is that of a sensor behind the gear."""
    effort = found.profiles[0].effort if found.profiles else None
    return effort is not None and effort.signal == "torque" and "sensor" in effort.note


def _preprocessing(found: Recognised) -> list[str]:
    cutoff = cutoff_of(found)
    if not found.readings or not found.units["time"].certain:  # no value was looked at, or by a rate that is asked
        return ["preprocessing:", "  filter:", "    butterworth: {cutoff_hz: auto}   # from the spectra", _DELAY]
    if not cutoff:
        return []
    rates = [1.0 / (reading.step * found.to_seconds) for reading in found.readings]
    duration = min(reading.duration * found.to_seconds for reading in found.readings)
    trim = min(max(0.5, 2.5 / cutoff), duration / 10)
    rate = "all" if max(rates) <= _SLOW_HZ else f"{min(max(200.0, 10 * cutoff), max(rates)):.5g}"
    rest = _rest_share(found)
    return [
        "preprocessing:",
        "  filter:",
        f"    butterworth: {{cutoff_hz: {cutoff:g}}}   # ten times the band of the motion, {found.band_hz:.2g} Hz "
        "(99.9 % of the positions' power)",
        f"  rate_hz: {rate}               # rows that are used; the log has {max(rates):.4g} a second",
        f"  trim_s: {trim:.2g}",
        f"  standstill: {_STANDSTILL:g}            # rad/s{_of_slides(found)}; samples at rest are left out: "
        f"{rest:.0%} of the first log",
        _DELAY,
        *_bridged(found),
    ]


def _of_slides(found: Recognised) -> str:
    """Return what the speed of rest is of slides; nothing where the robot has none."""
    robot = found.robot if found.moving is None else found.moving
    speeds = zip(robot.active, rest_speeds(robot, _STANDSTILL).tolist(), strict=True)
    return "".join(f", {plain(joint.name)} {speed:.2g} m/s" for joint, speed in speeds if joint.kind == "prismatic")


def _bridged(found: Recognised) -> list[str]:
    """Return how long a gap in time may be, where the logs have longer ones than are bridged without a word."""
    gap = max(long_gap(reading.time * found.to_seconds) for reading in found.readings)
    if not 0 < gap <= BRIDGED:
        return []
    return [
        f"  longest_gap_s: {bridge_over(gap):g}         # rows so near a gap that the line over it shows are left out"
    ]


def _rest_share(found: Recognised) -> float:
    """Return the share of the rows in which a joint rests, over all joints that are not locked."""
    reading = found.readings[0]
    time = reading.time * found.to_seconds
    even = np.linspace(time[0], time[-1], min(len(time), 20_000))
    steps = np.diff(time)
    is_logged = steps[np.searchsorted(time, even[:-1], "right") - 1] <= longest_step(float(np.median(steps)))
    positions = reading.signals["q"]
    factors = position_factors(found.units["position"], positions.shape[1])
    q = np.column_stack([np.interp(even, time, column) for column in positions.T]) * factors
    names, step = found.joints.names, even[1] - even[0]
    slowest = np.full(q.shape[1], _STANDSTILL)
    if found.moving is not None and len(names) == len(slowest):
        slowest = rest_speeds(found.moving, _STANDSTILL)[[found.moving.joint_names.index(name) for name in names]]
    held = found.still.keys() | found.grippers.keys() | found.without_effort.keys()
    free = [k for k in range(len(slowest)) if len(names) != len(slowest) or names[k] not in held]
    rest = at_rest(np.gradient(q, step, axis=0), slowest, 1 / step)[:-1][is_logged]
    return float(rest[:, free].mean()) if free else 1.0


def _data(found: Recognised, files: Files) -> list[str]:
    train, test = files.train, files.test
    if test:
        return [_paths("train", files, train), _paths("test", files, test)]
    if len(train) > 1:
        text = f"which logs train and which test? Taken: the last of {len(train)} tests"
        return [_paths("train", files, train[:-1]), offered(_paths("test", files, train[-1:]), text)]
    if is_servo_log(found) and found.readings and found.readings[0].episodes > 1:
        text = "another file tests better: test: other.parquet; taken: the last third of the episodes"
        return [_paths("train", files, train), offered(f"split: first:{_TRAINS:g}", text)]
    if is_servo_log(found):
        return [_paths("train", files, train), offered("# test: other-run.csv", "is there another log to test on?")]
    if found.is_large:
        text = "is there another log to test on? One this large is reduced as a whole, no part of it is kept for a test"
        return [_paths("train", files, train), offered("# test: other-run.csv", text)]
    text = "another log tests better: test: other-run.csv in place of the last third of this one"
    return [_paths("train", files, train), offered(f"split: first:{_TRAINS:g}", text)]


def _paths(key: str, files: Files, paths: Sequence[str]) -> str:
    if len(paths) == 1:
        return f"{key}: {quoted(files.relative(paths[0]))}"
    return "\n".join([f"{key}:", *(f"  - {quoted(files.relative(path))}" for path in paths)])
