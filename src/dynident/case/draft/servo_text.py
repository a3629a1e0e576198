"""The key ``servo`` of a drafted case file, for logs of commanded and measured positions without torques."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dynident.actuators.drive_law import COUNTS, PRESETS
from dynident.actuators.lerobot_calibration import GRIPPER, SHARES
from dynident.case.draft.column_words import ENABLED, KIND, OTHER, SHARE_WORDS, SIGNAL, tokens_of
from dynident.case.draft.readings import LogReading
from dynident.case.draft.recognition import Recognised, SignalSource
from dynident.case.draft.yaml_words import asked, few, offered, quoted
from dynident.case.evidence.positions import strays

#: A turn in degrees.
_TURN = 360.0

#: Least share of the rows in which a joint that moves both ways goes either way.
_BOTH_WAYS = 0.1

#: A position gain in the name of a log; the letter alone stands as a word (ep0 is an episode).
_GAIN = re.compile(r"(kp|gain|(?<![a-zA-Z])[pP])[_-]?(?=\d)")


def is_servo_log(found: Recognised) -> bool:
    """Return whether the logs have commanded and measured positions and nothing that may be a torque or a current."""
    efforts = {"torque", "current"}
    return {"q", "q_ref"} <= found.sources.keys() and not efforts & (found.sources.keys() | found.rivals.keys())


def without_sign(sources: Mapping[str, SignalSource], reading: LogReading) -> str:
    """Return why the currents of servos tell no torques, which have none below zero; empty where they may.

    Their joints move both ways, and stray from what they are told.
    """
    q, q_ref, current = (reading.signals.get(key, np.empty((0, 0))) for key in ("q", "q_ref", "current"))
    if "torque" in sources or not current.size or not q.shape == q_ref.shape == current.shape or current.min() < 0:
        return ""
    steps = np.diff(q, axis=0)
    turns = np.minimum(np.mean(steps > 0, axis=0), np.mean(steps < 0, axis=0)) > _BOTH_WAYS
    if not np.any(turns) or not np.all(np.ptp(current[:, turns], axis=0)) or not np.any(strays(q, q_ref)):
        return ""
    return f"currents without a sign, {current.min():g} to {current.max():g} while the joints move both ways"


def has_counts(found: Recognised) -> bool:
    """Return whether the positions of servos are whole numbers beyond a turn in degrees: raw counts of a register."""
    if not is_servo_log(found) or found.profiles:
        return False
    values = [one.signals[key] for one in found.readings for key in ("q", "q_ref")]
    is_whole = bool(values) and all(bool(np.all((own == np.round(own)) | ~np.isfinite(own))) for own in values)
    return is_whole and max(float(np.nanmax(np.abs(own))) for own in values) > _TURN


def _not_read(found: Recognised) -> tuple[list[str], list[str]]:
    """Return the columns that are no joint torques though they may look so: shares of drives, torques and currents."""
    used = {name for source in found.sources.values() for name in source.columns}
    shares, others = [], []
    for name in found.header:
        words = set(tokens_of(name))
        if name in used or OTHER & words or ENABLED.fullmatch(name):
            continue
        if any(SIGNAL.get(word) in ("torque", "current") for word in words):
            others.append(name)
        elif SHARE_WORDS & words:
            shares.append(name)
    return shares, others


def servo_remark(found: Recognised) -> str:
    """Return why the case is for actuators, with the columns that are no joint torques though they may look so."""
    shares, others = _not_read(found)
    told = "the case is for the actuators, from commands and positions"
    if not shares and not others:
        return f"no torques and no currents: {told}"
    step = "where they are torques or currents of all joints, name them (log: columns) and take servo out"
    why = "load and duty of a servo are shares of its drive, no torques" if not others else "not measured at each joint"
    return f"not read: {few([*others, *shares], 8)} ({why}); {told}; {step}"


def _gripper_line(found: Recognised) -> list[str]:
    """Return the question whether a gripper is logged as a share of its range where other joints may be in degrees."""
    columns, readings = found.sources["q"].columns, [one.signals["q"] for one in found.readings]
    if found.units.get("position") is None or len({q.shape[1] for q in readings} | {len(columns)}) != 1:
        return []
    low, high = (np.array([edge(q, axis=0) for q in readings]) for edge in (np.nanmin, np.nanmax))
    low, high = low.min(axis=0), high.max(axis=0)
    for k, (joint, column) in enumerate(zip(found.joints.names, columns, strict=False)):
        others = np.delete(high - low, k)
        is_share = -1.0 <= low[k] and high[k] <= SHARES + 1.0 and high[k] - low[k] > 2.0 * np.pi
        if GRIPPER in f"{joint} {column}".lower() and is_share and np.any(others > 2.0 * np.pi):
            text = (
                f"{column} runs from {low[k]:.3g} to {high[k]:.3g}: percent of its range, as LeRobot has a gripper "
                f"beside degrees too? Name the JSON of lerobot-calibrate; else lock it (locked: {{{joint}: 0}}), or "
                "take this line out where it is in degrees"
            )
            return [asked("  calibration", text)]
    return []


def _is_velocity_command(name: str) -> bool:
    words = tokens_of(name)
    return any(SIGNAL.get(word) == "dq" for word in words) and any(KIND.get(word) == "commanded" for word in words)


def servo_lines(found: Recognised, logs: Sequence[str]) -> list[str]:
    """Return the key servo.

    Args:
        found: What was recognised.
        logs: Names of all logs, whose names may have their position gains.
    """
    laws = ", ".join(PRESETS)
    lines = [
        "servo:                        # no torques: actuators from commanded and measured positions",
        offered("  law: position_servo", f"which servos? {laws}; position_servo knows nothing of the drive"),
    ]
    prefixes = [match and match[0] for match in (_GAIN.search(Path(log).name) for log in logs)]
    if prefixes and prefixes[0] and set(prefixes) == {prefixes[0]}:
        lines.append(f"  kp: {quoted(prefixes[0] + '{}')}   # the number after {prefixes[0]} in the name of each log")
    elif "kp" in found.header:
        lines.append("  kp: kp   # by its name")
    else:
        lines.append(offered("  kp: unknown", "which position gain is set in the drive? A number, or a column"))
    enabled = [name for name in found.header if ENABLED.fullmatch(name)]
    if len(enabled) in (1, len(found.sources["q"].columns)) and enabled:
        names = quoted(enabled[0]) if len(enabled) == 1 else f"[{', '.join(map(quoted, enabled))}]"
        lines.append(f"  enabled: {names}   # 1 where the drive is on, by its name")
    else:
        lines.append(offered("  # enabled: torque_enable", "is the drive off in a part of the log? Name the column"))
    joints, sent = len(found.sources["q"].columns), _not_read(found)[1]
    told = [name for name in found.header if _is_velocity_command(name)]
    if len(told) == joints and "dq_ref" not in found.sources:
        text = f"are {few(told, 8)} sent too, and damped by a gain? Then name them: log: {{columns: {{dq_ref: [...]}}}}"
        lines.append(offered("  # damping_gain: free", text))
    if len(sent) == joints:
        columns = f"  # feedforward: [{', '.join(map(quoted, sent))}]"
        lines.append(offered(columns, "are they torques that are sent beside the command (law: mit)?"))
    if has_counts(found):
        largest = max(float(np.nanmax(np.abs(one.signals["q"]))) for one in found.readings)
        text = (
            f"whole numbers up to {largest:.4g}: counts of the position register? Of which family: {', '.join(COUNTS)}"
        )
        lines.append(asked("  counts", f"{text}; else take this line out and state units: {{position: ...}} under log"))
    lines += _gripper_line(found)
    lines.append("  friction: auto              # by roll-outs of held-out logs")
    return lines
