"""The key ``log`` of a drafted case file: profile, columns, units, side."""

from __future__ import annotations

import numpy as np

from dynident.actuators.lerobot_calibration import SHARES
from dynident.case.draft.column_groups import groups_of_robot
from dynident.case.draft.column_words import is_pressure
from dynident.case.draft.profile_fit import equally_good
from dynident.case.draft.recognition import Recognised
from dynident.case.draft.servo_text import has_counts, is_servo_log
from dynident.case.draft.signal_units import SignalUnit
from dynident.case.draft.stated_units import stated_unit, units_in_names
from dynident.case.draft.time_columns import split_time, unit_of_time
from dynident.case.draft.yaml_words import asked, few, listed, offered, plain, quoted
from dynident.case.questions import MARK
from dynident.data.formats._clocked_table import sum_of
from dynident.data.formats._units import RATED

#: What the signals are called in questions.
_WORDS = {
    "q": "the measured positions",
    "dq": "the measured velocities",
    "torque": "the measured joint torques",
    "current": "the motor currents",
    "temperature": "the temperatures of the drives",
}

#: Groups of columns that are not read, at most, in one line.
_SHOWN = 8


def log_lines(found: Recognised) -> list[str]:
    """Return the key log."""
    lines = ["log:"]
    if found.form:
        lines.append(f"  {found.form}")
    if found.profiles:
        return [*lines, *_profile(found), *_profile_gaps(found), *_side(found), *_wrapped(found), *_repeats(found)]
    return [*lines, *_columns(found), *_units(found), *_rated(found), *_side(found), *_wrapped(found), *_repeats(found)]


def _repeats(found: Recognised) -> list[str]:
    most = max((reading for reading in found.readings), key=lambda reading: reading.repeated, default=None)
    if most is None or not most.repeated:
        return []
    return [f"  repeats: drop   # {most.repeated} of {most.rows} rows repeat the previous row"]


def _wrapped(found: Recognised) -> list[str]:
    if not found.wrapped:
        return []
    return [
        f"  wrapped: {listed(found.wrapped)}   # positions start again after {found.turn:.4g}; turns are counted on"
    ]


def _profile(found: Recognised) -> list[str]:
    best, *others = found.profiles
    equal = equally_good(found.profiles)
    if len(equal) > 1:
        kinds = " or ".join(f"{fit.name} ({_effort(found, fit.name)})" for fit in equal)
        return [asked("  profile", f"the kind of log: {kinds}; both have these columns", best.name)]
    also = f"; less well: {', '.join(fit.name for fit in others)}" if others else ""
    line = f"  profile: {best.name}   # {plain(best.why())}{also}"
    if not found.drivers_differ or not found.units["torque"].certain:
        return [line]
    told = found.units["torque"].why
    return [line, f"  {MARK} is the effort a torque in N m? Drivers differ, see the manual; seen: {plain(told)}"]


def _effort(found: Recognised, name: str) -> str:
    channel = next(fit.effort for fit in found.profiles if fit.name == name)
    if channel is None:
        return "no torque"
    note = f", {channel.note}" if channel.note else ""
    return f"{channel.pattern} is a {channel.signal}{note}"


def _more_motors(found: Recognised) -> list[str]:
    """Return what has to be said where more motors are logged than the robot model has joints."""
    channel, dof = found.profiles[0].profile.read_channels()["q"], len(found.joints.names)
    logged = sum(channel.matches(name) for name in found.header)
    if logged <= dof:
        return []
    text = f"{logged} motors are logged, the robot has {dof} joints: are the first {dof} its joints, in their order?"
    return [f"    # ask: {text} Else name them: q: [...], q_ref: [...]"]


def _may_be_shares(found: Recognised) -> bool:
    """Return whether the positions of servos may be shares of the calibrated range: none is beyond 100."""
    return is_servo_log(found) and all(np.nanmax(np.abs(one.signals["q"])) <= SHARES for one in found.readings)


def _of_shares(found: Recognised) -> str:
    """Return what is said of positions under the names of LeRobot that may be shares; nothing of others."""
    names = found.sources["q"].columns + found.sources["q_ref"].columns if "q_ref" in found.sources else ()
    if not any(name.startswith(("observation.", "action")) for name in names) or not _may_be_shares(found):
        return ""
    return (
        "; by its names a recording of LeRobot, and none is beyond 100: percent of the calibrated range or degrees? As "
        "percent take this line out and name the JSON of lerobot-calibrate (servo: {calibration: FILE}); neither "
        "limits nor motion tell them apart"
    )


def _profile_gaps(found: Recognised) -> list[str]:
    """Return what the profile does not say: units that only the user knows, and the missing effort."""
    lines = []
    if is_servo_log(found):
        lines += ["  columns:", *_more_motors(found), "    torque: none"]
    elif not found.effort:
        lines += ["  columns:", f"    {_missing_effort(found)}"]
    told = found.units.get("position")
    channel = next(c for c in found.profiles[0].channels if c.signal == "q")
    if told is not None and not channel.unit:
        note = f"the unit of {found.sources['q'].shown()} (deg, rad, m, mm; {channel.note}): {told.why}"
        lines += ["  units:", asked("    position", note, "" if _may_be_shares(found) else told.text)]
    torque = found.units.get("torque")
    if found.drivers_differ and torque is not None and not torque.certain:
        note = (
            f"the unit of {found.sources['torque'].shown()} (N m, mN m, N, percent, permille), drivers differ: "
            f"{torque.why}{_or_currents(found, 'columns: ')}"
        )
        lines += [*(["  units:"] if "  units:" not in lines else []), asked("    torque", note)]
    return lines


def _or_currents(found: Recognised, key: str = "") -> str:
    """Return what to write where columns of torques are motor currents."""
    effort = found.sources["torque"]
    names = quoted(effort.pattern) if effort.pattern else listed(effort.columns)
    return (
        f"; where they are motor currents, write {key}{{torque: none, current: {names}}} in place of units, and gains "
        "(drives: {JOINT: {gain: ...}})"
    )


def _columns(found: Recognised) -> list[str]:
    lines = ["  columns:"]
    if found.time:
        line, told = f"    time: {quoted(found.time)}", found.structure
        rated = told is not None and told.rate_hz > 0
        lines.append(offered(line, f"no column runs forward as a time; {told.rate_why}") if rated and told else line)
    else:
        text = f"the column of the time; the log has {few(found.header)}; where none is, draft again with --rate"
        lines.append(asked("    time", text))
    for signal in ("q", "dq", "torque", "current", "q_ref", "dq_ref"):
        if signal in found.sources:
            lines.append(_column(found, signal))
        elif signal in found.rivals:
            lines.append(_rivals(found, signal))
    if "q" not in found.sources and "q" not in found.rivals:
        lines.append(asked("    q", f"{_WORDS['q']}, one column per joint{_refused(found, 'q')}{_listing(found)}"))
    effort = {"torque", "current"}
    if is_servo_log(found):
        lines.append("    torque: none")
    elif not found.effort and not effort & found.rivals.keys():
        lines.append(f"    {_missing_effort(found)}")
    if found.effort == "current":
        lines.append("    torque: none")
    if "dq" not in found.sources and "dq" not in found.rivals:
        lines.append("    dq: none")
    if (drives := found.temperature) is not None:
        value = quoted(drives.pattern) if drives.pattern else listed(drives.columns)
        lines.append(f"    temperature: {value}   # of the drives, in degrees Celsius; {plain(drives.how)}")
    lines += [f"    # {key}: {plain(why)}" for key, why in found.left_out.items()]
    lines += [f"    # not read: {plain(group.shown())}, {plain(why)}" for group, why in found.refused]
    return [*lines, *_others(found, "\n".join(lines))]


def _others(found: Recognised, told: str) -> list[str]:
    """Return which further columns the log has, those apart that are named in what is ``told``."""
    if found.structure is not None:
        return []
    times = {name for name, _ in split_time(found.header) or ()} if found.is_clocked else {found.time}
    groups = groups_of_robot(found.header, found.robot, found.stated)
    grouped = {name for group in groups for name in group.names}
    columns = {group.names: group.shown() for group in groups} | {(n,): n for n in found.header if n not in grouped}
    sources = (*found.sources.values(), *((found.temperature,) if found.temperature else ()))
    read = times | {name for source in sources for name in source.columns}
    read |= {*found.stated.columns, *(column for name in read for column, _ in sum_of(name, found.header))}
    free = [names for names, shown in columns.items() if not read & {*names} and plain(shown) not in told]
    free.sort(key=lambda names: found.header.index(names[0]))
    return [f"    # not read: {few([columns[names] for names in free], _SHOWN)}"] if free else []


def _column(found: Recognised, signal: str) -> str:
    """Return the line of a signal; what is not understood of the name of an effort is asked."""
    source = found.sources[signal]
    value = quoted(source.pattern) if source.pattern else listed(source.columns)
    line = f"    {signal}: {value}"
    if found.structure is not None and signal in found.structure.rivals:
        names = " or ".join(group.shown() for group in found.structure.rivals[signal])
        return offered(line, f"which are {_WORDS[signal]}: {names}? {source.how}")
    if source.doubt:
        return asked(f"    {signal}", source.doubt, value)
    if signal not in ("torque", "current") or not source.unknown:
        return f"{line}   # {plain(source.how)}"
    text = f"are {source.shown()} {_WORDS[signal]}? The word {' '.join(map(repr, source.unknown))} is not known"
    text += f"; {source.how}" if found.torque_is_unnamed else ""
    return offered(line, text) if signal == "current" or found.torques_agree else asked(f"    {signal}", text, value)


def _missing_effort(found: Recognised) -> str:
    text = f"{_WORDS['torque']} in N m (else state units: torque), one column per joint"
    return asked(
        "torque",
        f"{text}; or write current: for motor currents{_refused(found, 'torque')}{_pressures(found)}{_listing(found)}",
    )


def _pressures(found: Recognised) -> str:
    """Return what is said of pressures, where no torques are there."""
    names = [name for name in found.header if is_pressure(name)]
    if not names or found.effort:
        return ""
    what = "cylinder forces (pressure times area, of both chambers) times the lever arms are torques"
    return f"; {few(names, 4)} are pressures by their names: {what}, in columns of their own"


def _listing(found: Recognised) -> str:
    known = {found.time, *(name for source in found.sources.values() for name in source.columns)}
    free = [name for name in found.header if name not in known]
    if found.likely_effort:
        return f"; likely {found.likely_effort}"
    return f"; the log also has {few(free)}" if free else "; the log has no other columns"


def _refused(found: Recognised, signal: str) -> str:
    mine = [f"{g.shown()} are {why}" for g, why in found.refused if g.meaning.signal == signal]
    return f" ({'; '.join(mine)})" if mine else ""


def _rivals(found: Recognised, signal: str) -> str:
    groups = found.rivals[signal]
    names = [group.pattern or f"{group.shown()}" for group in groups]
    evidence = found.structure.evidence.get(signal, "") if found.structure is not None else ""
    told = f"; {evidence}" if evidence else ""
    return asked(f"    {signal}", f"which columns are {_WORDS[signal]}: {' or '.join(map(repr, names))}{told}")


def _units(found: Recognised) -> list[str]:
    lines = ["  units:"]
    choices = {"time": "s, ms, us, ns", "position": "rad, deg, m, mm", "torque": "N m, mN m, N, percent, permille"}
    for key in ("time", "position", "velocity", "torque", "current"):
        told = found.units.get(key)
        if key == "position" and has_counts(found):
            continue
        if told is None:
            if key in choices and (key != "torque" or found.effort == "torque" or "torque" in found.rivals):
                lines.append(_unseen(found, key, choices[key]))
            continue
        if told.certain:
            lines.append(f"    {key}: {told.text}   # {plain(told.why)}")
        else:
            signal = {"time": "time", "position": "q", "torque": "torque"}.get(key, key)
            what = found.time if key == "time" else found.sources[signal].shown()
            other = _other_kind(found, key) if found.structure is not None else ""
            shares = _of_shares(found) if key == "position" and not told.from_header else ""
            text = f"the unit of {what} ({choices[key]}): {told.why}{shares or other}"
            lines.append(asked(f"    {key}", text, "" if shares else told.text))
    return lines if len(lines) > 1 else []


def _other_kind(found: Recognised, key: str) -> str:
    """Return what else columns without names may be whose unit is asked."""
    if key == "torque":
        return _or_currents(found)
    return "; or they are motor positions before the gears: then state side and gear_ratio" if key == "position" else ""


def _unseen(found: Recognised, key: str, choices: str) -> str:
    """Return the question for a unit of columns that the draft could not tell, or the default would be taken for it."""
    which = {"time": "the time", "position": "the positions", "torque": "the torques"}[key]
    signal = {"position": "q"}.get(key, key)
    each = units_in_names(found, signal) if signal in found.sources else ()
    likely = SignalUnit(each, False, "").text if each else stated_unit(found, signal) if signal in found.sources else ""
    likely = unit_of_time(found.time, found.header) if key == "time" and found.time else likely
    return asked(f"    {key}", f"the unit of {which} ({choices}): it could not be looked at", likely)


def _rated(found: Recognised) -> list[str]:
    """Return the question for the rated torques that shares of them need."""
    unit = stated_unit(found, "torque") if found.effort == "torque" else ""
    if unit not in RATED:
        return []
    source = found.sources["torque"]
    whole = {"percent": "100 percent", "permille": "1000 permille"}[unit]
    where = "motor, before its gear" if source.side == "motor" else "joint, after its gear"
    text = f"the rated torque of each {where}, in N m (N of a slide): what {whole} of {source.shown()} stand for"
    other = _other_kind(found, "torque") if found.structure is not None else ""
    return [asked("  rated", f"{text} by the manual, a list of {len(source.columns)}{other}")]


def _side(found: Recognised) -> list[str]:
    if not found.on_motors or found.profiles:
        return []
    sides = ", ".join(f"{signal}: motor" for signal in found.on_motors)
    side = f"  side: {{{sides}}}   # by the names of the columns"
    if "q" not in found.on_motors:
        return [side]
    count = len(found.sources["q"].columns)
    zero = f"  # zero: [{', '.join(['0'] * count)}]"
    return [side, offered(zero, "at which position, in rad or m, does each joint stand where its motor says 0?")]
