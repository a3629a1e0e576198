"""From a robot and the tables of its logs to what was recognised in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.case.draft.column_groups import StatedJoints, groups_of_robot, single_temperatures
from dynident.case.draft.commands import by_commands
from dynident.case.draft.joint_choice import JointChoice, choose_joints, lacking
from dynident.case.draft.profile_fit import ProfileFit, equally_good, fitting_profiles
from dynident.case.draft.readings import NO_NUMBERS, LogReading, band, cutoff_from, longest_part, read_rows
from dynident.case.draft.recognition import Recognised, SignalSource
from dynident.case.draft.servo_text import has_counts, is_servo_log, without_sign
from dynident.case.draft.signal_choice import choose_signals
from dynident.case.draft.signal_units import (
    HEADER,
    SignalUnit,
    factor_of,
    of_forces,
    position_factors,
    position_unit,
    torque_unit,
)
from dynident.case.draft.stated_joints import doubted, stated_joints
from dynident.case.draft.stated_units import (
    as_header,
    column_groups,
    hinges_of_forces,
    stated_unit,
    unit_of_motors,
    units_in_names,
    units_of_profile,
)
from dynident.case.draft.tied_columns import with_sums, without_followers
from dynident.case.draft.time_columns import time_columns, time_unit_of, unit_of_time, velocity_ratio
from dynident.case.draft.torque_choice import measured_torques, without_change
from dynident.case.draft.turn_counters import unit_of_turn, with_turns, with_wrapped
from dynident.case.draft.unnamed_columns import by_structure, clock_by_values, with_missing_signals, with_named_efforts
from dynident.case.draft.unread_joints import with_held, without_grippers
from dynident.case.draft.yaml_words import few, listed, quoted
from dynident.case.evidence.positions import STILL, strays, travel
from dynident.case.evidence.torques import torque_evidence
from dynident.case.evidence.velocities import is_near
from dynident.data.formats import LogTable
from dynident.data.formats._clocked_table import SUM, MadeTable
from dynident.data.formats._units import RATED
from dynident.data.log import Log
from dynident.errors import LogFormatError, NoNumbers
from dynident.model.robot import Robot

#: Commands of servos span at most this many times what the positions span, and at least the inverse.
_SPAN = 5.0

#: One over the share of the joints up to which torques near those of the masses leave the order of the joints open.
FEW = 3

#: Factor between columns that are called nothing and the torques of the robot model's masses up to which they are N m.
NEAR = 1.15


def recognised(
    robot: Robot, tables: Sequence[LogTable], profile: str = "", unread: Mapping[str, str] | None = None
) -> Recognised:
    """Return what is recognised in the logs of a robot.

    Args:
        robot: With all its joints.
        tables: The opened logs; the first one says what the columns are.
        profile: Name of a profile that is to be taken; empty for the one that fits.
        unread: Columns to leave out, and why.

    Raises:
        LogFormatError: A log lacks a column of the first, or a cell is no number.
    """
    given, unread, clock = tables, unread or {}, tables[0].made[0] if isinstance(tables[0], MadeTable) else ""
    header = tuple(name for name in tables[0].header if name != clock and name not in unread)
    fits = [] if clock else fitting_profiles(header, robot.joint_names)  # a profile knows its column of the time
    fits = [fit for fit in fits if not profile or fit.name == profile]
    stated = StatedJoints() if fits else stated_joints(tables, robot.joint_names)
    found = Recognised(robot, header, stated, clock, bool(clock), profiles=tuple(fits), unread=unread)
    found = _by_profile(found, fits) if fits else _by_names(found, tables[0])
    if not fits and not {"q_ref", "torque", "current"} & (found.sources.keys() | found.rivals.keys()):
        found = by_commands(found)
    if not fits and "q" not in found.sources and "q" not in found.rivals:
        found, tables = by_structure(found, tables)
    elif not fits and "q_ref" not in found.sources:
        found, tables = with_missing_signals(found, tables)
    if not found.time or "q" not in found.sources:
        return with_named_efforts(found)
    columns = {signal: source.columns for signal, source in found.sources.items()}
    try:
        readings = tuple(read_rows(table, found.time, columns) for table in tables)
    except NoNumbers as error:
        if not error.columns or profile or error.path != tables[0].path or found.time in error.columns:
            raise
        return recognised(robot, given, profile, {**unread, **dict.fromkeys(error.columns, NO_NUMBERS)})
    if not profile and (why := without_sign(found.sources, readings[0])):
        return recognised(robot, given, profile, {**unread, **dict.fromkeys(found.sources["current"].columns, why)})
    found = with_held(_with_temperature(_by_values(replace(found, readings=readings)), tables), tables)
    found, computed = measured_torques(found, tables)
    return recognised(robot, given, profile, {**unread, **computed}) if computed else found


def _with_temperature(found: Recognised, tables: Sequence[LogTable]) -> Recognised:
    """Return the temperatures of the drives left out where the logs cannot tell what they change.

    One column that says temperature is that of one sensor for all joints.
    """
    names = [] if found.temperature or found.profiles else single_temperatures(found.header)
    if len(names) == 1:
        one = SignalSource((names[0],), names[0], "link", "one sensor for all joints")
        found = replace(found, temperature=one)
    elif names:
        text = f"{few(names, 8)}: for the friction part temperature name one column per joint, or one for all"
        found = replace(found, left_out={**found.left_out, "temperature": text})
    if (source := found.temperature) is None:
        return found
    try:
        own = [read_rows(table, found.time, {"temperature": source.columns}) for table in tables]
    except LogFormatError:
        own = []
    changes, lengths = any(np.ptp(one.signals["temperature"], axis=0).any() for one in own), [len(r.time) for r in own]
    why = "" if changes else "they do not change"
    if lengths != [len(reading.time) for reading in found.readings]:
        why = "cells without a number"
    if len(source.columns) not in (1, len(found.sources["q"].columns)) or found.is_large:
        why = "one column per joint, or one for all, is needed, in logs that are read as a whole"
    text = {"temperature": f"{source.shown()}: for the friction part temperature; {why}"}
    return replace(found, temperature=None, left_out={**found.left_out, **text}) if why else found


def cutoff_of(found: Recognised) -> float:
    """Return the cut-off in Hz that a draft proposes; 0 where the band of the motion is not known."""
    if not found.band_hz:
        return 0.0
    rate = min(1.0 / (reading.step * found.to_seconds) for reading in found.readings)
    return cutoff_from(found.band_hz, rate)


def _by_profile(found: Recognised, fits: Sequence[ProfileFit]) -> Recognised:
    fit = fits[0]
    how = f"profile {fit.name}" if len(equally_good(fits)) == 1 else "a profile that is asked for"
    sources = {
        channel.signal: SignalSource(channel.names(fit.joints), channel.pattern, channel.side, how)
        for channel in fit.channels
    }
    found = replace(found, temperature=sources.pop("temperature", None))
    named = any("{joint}" in channel.pattern for channel in fit.channels)
    why = "by their names" if named else "in the order of the chain"
    joints = JointChoice(fit.joints, True, f"{why}{lacking(found.robot, fit.joints)}")
    likely = ""
    if fit.effort is None:
        groups = choose_signals(groups_of_robot(found.header, found.robot, found.stated), found.robot.dof, True).groups
        group = groups.get("torque") or groups.get("current")
        likely = "" if group is None else quoted(group.pattern) if group.pattern else listed(group.names)
    return replace(found, time=fit.profile.time, sources=sources, joints=joints, likely_effort=likely)


def _by_names(found: Recognised, table: LogTable) -> Recognised:
    groups = groups_of_robot(found.header, found.robot, found.stated)
    choice = choose_signals(groups, found.robot.dof)
    if {"torque", "current"} & choice.rivals.keys() and (still := without_change(choice.rivals, table)):
        choice = choose_signals([group for group in groups if group not in still], found.robot.dof)
    times = [found.time] if found.is_clocked else time_columns(found.header)
    times = times or [clock_by_values(found.header, table)]
    sources = {
        signal: SignalSource.of_group(group) for signal, group in choice.groups.items() if signal not in choice.rivals
    }
    left_out = {}
    if "torque" in sources and "current" in sources:
        left_out["current"] = f"{sources.pop('current').shown()} are there as well; the torques are read"
    if "temperature" in sources:
        found = replace(found, temperature=sources.pop("temperature"))
    rivals = dict(choice.rivals)
    if "torque" in sources and "current" in rivals:
        both = " and ".join(group.shown() for group in rivals.pop("current"))
        left_out["current"] = f"{both} are there as well; the torques are read"
    if "dq" in rivals:
        both = " or ".join(group.shown() for group in rivals.pop("dq"))
        left_out["dq"] = f"{both}: only the filter as_given reads velocities"
    if "q" in choice.groups and "q" not in sources:
        sources = {}
    group = choice.groups.get("q")
    if "q" in sources and group is not None and (choice.without_effort or group.count == found.robot.dof):
        found = replace(found, joints=choose_joints(found.robot, group, np.zeros((1, group.count))))
    return replace(
        found,
        time=times[0],
        sources=sources,
        rivals=rivals,
        refused=choice.refused,
        left_out=left_out,
        without_effort={found.robot.joint_names[k]: (name, 0.0) for k, name in choice.without_effort.items()},
    )


def _by_values(found: Recognised) -> Recognised:
    """Return what is recognised once the rows are read: joints, units, band, joints that stand still."""
    units = units_of_profile(found)
    stated = {signal: stated_unit(found, signal) for signal in found.sources}
    if found.is_clocked:
        made = "the sum of two columns" if SUM.fullmatch(found.time) else f"made of the rate, {found.time}"
        units["time"] = SignalUnit(("s",), True, made)
    elif "time" not in units:
        of_motion = stated.get("q", ""), stated.get("dq", "")
        units["time"] = time_unit_of(found.readings, unit_of_time(found.time, found.header), of_motion)
    tied = None if found.profiles else without_followers(found)
    if tied is not None:
        found = tied[0]
    elif not found.profiles and len(found.sources["q"].columns) > found.robot.dof:
        found = _first_columns(found)
    found = with_turns(found)
    q = np.concatenate([reading.signals["q"] for reading in found.readings])
    if not found.profiles and tied is None and not found.without_effort:
        group = next(g for g in column_groups(found) if g.names[: q.shape[1]] == found.sources["q"].columns)
        found = replace(found, joints=choose_joints(found.robot, group, _likely_si(q, stated["q"])))
    found = without_grippers(replace(found, units=units, joints=doubted(found)))
    q = np.concatenate([reading.signals["q"] for reading in found.readings])
    moving = found.moving
    found = with_wrapped(found)
    if found.turn and "position" not in units:
        units["position"] = unit_of_turn(found, stated["q"])
    if "position" not in units and "q" in found.on_motors:
        units["position"] = unit_of_motors(stated["q"])
    elif "position" not in units and moving is not None and len(found.joints.names) == q.shape[1]:
        own = {joint.name: joint for joint in moving.active}
        each = units_in_names(found, "q")
        units["position"] = as_header(position_unit(q, [own[n] for n in found.joints.names], stated["q"], each), each)
    elif "position" not in units and found.joints.in_si:
        units["position"] = SignalUnit(("SI",), True, found.joints.why)
    elif "position" not in units:
        units["position"] = SignalUnit((), False, "the joints are not known")
    if found.profiles and "q" in found.sources and not found.profiles[0].states("q"):
        units["position"] = replace(units["position"], certain=False)
    factors = position_factors(units["position"], q.shape[1])
    travel = np.ptp(q, axis=0).max() if "q" in found.on_motors else 1.0  # of a motor a turn says nothing of the joint
    bands = [band(r.time * found.to_seconds, r.signals["q"] * factors / max(travel, 1e-300)) for r in found.readings]
    found = replace(found, band_hz=max(bands) if units["time"].words else 0.0)
    found = _with_effort(replace(found, units=units), moving, factors, stated)
    return with_sums(_with_motion(found, q, factors), tied[1] if tied is not None else ())


def _with_effort(found: Recognised, moving: Robot | None, factors: Array, stated: Mapping[str, str]) -> Recognised:
    units = dict(found.units)
    effort = found.effort
    if not effort:
        return found
    evidence = sample = None
    reading = max(found.readings, key=lambda one: one.duration)
    fits_joints = moving is not None and moving.dof == reading.signals["q"].shape[1]
    if moving is not None and fits_joints and not found.on_motors and units["time"].words:
        order = [found.joints.names.index(name) for name in moving.joint_names]
        rows = longest_part(reading.time * found.to_seconds)
        q = (reading.signals["q"] * factors)[rows, order]
        cutoff = min(cutoff_of(found), 0.2 / (reading.step * found.to_seconds))
        time, logged = reading.time[rows] * found.to_seconds, reading.signals[effort][rows, order]
        evidence = torque_evidence(moving, time, q, logged, cutoff)
        sample = (moving, Log(moving.joint_names, time, q, torque=logged))
    if effort == "current" and "current" not in units:
        unit = stated["current"]
        per = f"gains are per {unit or 'unit'}{'' if unit in RATED else ' of these columns'}"
        why = f"{HEADER} {unit}, {per if unit in RATED else 'gains are per A'}" if unit else per
        units["current"] = SignalUnit((unit or "A",), True, why, from_header=bool(unit))
    if effort == "torque" and ("torque" not in units or found.drivers_differ):
        joints = () if moving is None or not fits_joints else moving.active
        count = len(joints)
        ratios = np.full(count, np.nan) if evidence is None else evidence.ratios
        telling = (False,) * count if evidence is None else evidence.telling
        largest = np.abs(np.concatenate([r.signals["torque"] for r in found.readings])).max(axis=0)
        if count and not found.on_motors:
            told = torque_unit(joints, stated["torque"], ratios, telling, largest)
            is_ordered = found.profiles or found.joints.by_names or FEW * sum(telling) > count
            if told.certain and not (stated["torque"] or is_ordered):
                told = replace(told, certain=False, why=f"{told.why}, too few for the order of the joints to be sure")
            told = of_forces(told, hinges_of_forces(found), stated["torque"])
            if found.drivers_differ:  # what the profile says stands, unless the robot model's masses are against it
                told = SignalUnit(units["torque"].words, told.certain or not any(telling), told.why)
            seen = np.abs(ratios[np.asarray(telling, bool)])
            if found.torque_is_unnamed and not stated["torque"] and not 1 / NEAR < np.median([*seen] or [0.0]) < NEAR:
                told = replace(told, certain=False, why=f"{told.why}; their names do not say torque")
            units["torque"] = told
        elif "torque" not in units:
            word = stated["torque"]
            why = f"{HEADER} {word}" if word else "no evidence in the log"
            units["torque"] = SignalUnit((word if word not in ("", "N m", "N") else "SI",), bool(word), why)
    return replace(found, units=units, evidence=evidence, sample=sample)


def _is_alike(q: Array, q_ref: Array) -> bool:
    """Return whether commands span about as much as positions, or neither moves: a servo strays, in the same unit."""
    way, told = np.ptp(q, axis=0), np.ptp(q_ref, axis=0)
    spans = told[told > STILL] / np.maximum(way, STILL)[told > STILL]  # the other joints are held
    return bool((len(spans) or way.max() < 10.0 * STILL) and np.all((spans > 1 / _SPAN) & (spans < _SPAN)))


def _with_motion(found: Recognised, q: Array, factors: Array) -> Recognised:
    """Return which velocities and commanded positions are read, and which joints stand still."""
    sources, left_out, units = dict(found.sources), dict(found.left_out), dict(found.units)
    first = found.readings[0]
    if "dq" in sources and "velocity" not in units:
        seconds = found.to_seconds
        ratio = velocity_ratio(first.time * seconds, first.signals["q"] * factors, first.signals["dq"])
        stated = stated_unit(found, "dq")
        certain = found.units["position"].certain
        in_stated = ratio * factor_of("velocity", stated) if stated else np.nan
        if is_near(ratio) and certain:
            words = {"m": "m/s", "mm": "m/s"}
            told = tuple(words.get(word, "rad/s") for word in found.units["position"].words)
            units["velocity"] = SignalUnit(told, True, f"{ratio:.3g} times the derivative of the positions")
        elif is_near(in_stated) and certain and _all_of_a_kind(found):
            why = f"the header states {stated}, and so they are {in_stated:.3g} times the derivative of the positions"
            units["velocity"] = SignalUnit((stated,), True, why)
        else:
            said = f"{ratio:.3g} times the derivative of the positions" + (
                f", the header states {stated}" * bool(stated)
            )
            left_out["dq"] = f"{sources.pop('dq').shown()}: {said}; only the filter as_given reads velocities"
    if "q_ref" in sources:
        apart = np.any(strays(first.signals["q"], first.signals["q_ref"]))
        is_servo = is_servo_log(found) and (has_counts(found) or _is_alike(first.signals["q"], first.signals["q_ref"]))
        if apart and not is_servo:
            told = "; where they command servos, a log without the currents becomes a case of servos"
            told = f"stray from the measured positions{told * ('current' in sources)}"
            left_out["q_ref"] = f"{sources.pop('q_ref').shown()} {told}"
            sources.pop("dq_ref", None)
    if "dq_ref" in sources and ("q_ref" not in sources or "velocity" not in units):
        sources.pop("dq_ref")
    still = {}
    if found.joints.certain and found.units["position"].certain and not found.on_motors:
        si = q * factors
        way = travel(si)
        still = {name: float(np.median(si[:, k])) for k, name in enumerate(found.joints.names) if way[k] < STILL}
        still = still if len(still) < len(found.joints.names) else {}
    return replace(found, sources=sources, left_out=left_out, units=units, still=still)


def _all_of_a_kind(found: Recognised) -> bool:
    return found.moving is not None and len({joint.kind for joint in found.moving.active}) == 1


def _first_columns(found: Recognised) -> Recognised:
    """Return what was found with as many columns of each signal as the robot has joints, the first ones."""
    count = found.robot.dof
    sources = {key: replace(source, columns=source.columns[:count]) for key, source in found.sources.items()}
    readings = tuple(
        replace(reading, signals={key: values[:, :count] for key, values in reading.signals.items()})
        for reading in found.readings
    )
    return replace(found, sources=sources, readings=readings)


def _likely_si(q: Array, stated: str) -> Array:
    return q * factor_of("position", stated) if stated else q


def facts_of(reading: LogReading, seconds: float) -> str:
    """Return a log in words: samples, duration, rate.

    Args:
        reading: The log.
        seconds: Factor of its time's unit; 0 for unknown.
    """
    rows = f"the first {reading.rows} rows" if reading.is_head else f"{reading.rows} rows"
    if reading.episodes > 1:
        rows = f"{rows} in {reading.episodes} episodes, each a log of its own; the first"
    if not seconds:
        return f"{rows}, counted: no rate is known"
    return f"{rows}, {reading.duration * seconds:.4g} s, {1 / (reading.step * seconds):.5g} Hz"
