"""The key ``servo`` of a drafted case file, for logs of commanded and measured positions without torques."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from dynident.actuators.drive_law import PRESETS
from dynident.case.draft.recognition import Recognised
from dynident.case.draft.yaml_words import offered, quoted

#: Columns that say whether a drive is on.
_ENABLED = re.compile(r"(torque|motor|drive|servo)[_ ]?(enabled?|on)\d*|enabled?\d*", re.IGNORECASE)

#: A position gain in the name of a log.
_GAIN = re.compile(r"(kp|gain|[pP])[_-]?(?=\d)")


def is_servo_log(found: Recognised) -> bool:
    """Return whether the logs have commanded and measured positions and nothing that may be a torque or a current."""
    efforts = {"torque", "current"}
    return {"q", "q_ref"} <= found.sources.keys() and not efforts & (found.sources.keys() | found.rivals.keys())


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
    else:
        lines.append(offered("  kp: unknown", "which position gain is set in the drive? A number, or a column"))
    enabled = [name for name in found.header if _ENABLED.fullmatch(name)]
    if len(enabled) in (1, len(found.sources["q"].columns)) and enabled:
        names = quoted(enabled[0]) if len(enabled) == 1 else f"[{', '.join(map(quoted, enabled))}]"
        lines.append(f"  enabled: {names}   # 1 where the drive is on, by its name")
    else:
        lines.append(offered("  # enabled: torque_enable", "is the drive off in a part of the log? Name the column"))
    lines.append("  friction: auto              # by roll-outs of held-out logs")
    return lines
