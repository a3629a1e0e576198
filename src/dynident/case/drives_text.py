"""Drive gains as text of a case file: the section to paste, and a case with it in place of its own."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from dynident.case.case import VERSIONS
from dynident.case.part_sections import DRIVE_KEYS
from dynident.case.questions import ASK, MARK
from dynident.errors import DescriptionError
from dynident.model.documents.numbers import Place
from dynident.model.robot import Robot
from dynident.robot_files.strict_yaml import load_yaml

#: Names that YAML takes for text as they are.
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*")

#: Words that YAML would take for something else.
_WORDS = ("true", "false", "yes", "no", "on", "off", "null", "y", "n")


@dataclass(frozen=True)
class GainLine:
    """A drive gain as it is written into a case.

    Attributes:
        value: In N m/A or N/A; None leaves the one that the case has.
        deviation: Relative standard deviation.
        remark: Comment beside it.
    """

    value: float | None
    deviation: float
    remark: str


def drives_section(robot: Robot, gains: Mapping[str, GainLine], stated: Mapping[str, Mapping[str, str]]) -> str:
    """Return the section ``drives`` with gains by joint, and what the case states about them beside.

    Args:
        robot: For the order of the joints.
        gains: By joint.
        stated: Keys and values that the case has under each joint, as text.
    """
    lines = ["drives:"]
    names = [*robot.joint_names, *(name for name in stated if name not in robot.joint_names)]
    for name in names:
        keys = dict(stated.get(name, {}))
        line = gains.get(name)
        if line is not None and line.value is not None:
            keys |= {"gain": f"{line.value:.6g}", "gain_std": f"{line.deviation:.2g}"}
            keys = {key: keys[key] for key in DRIVE_KEYS if key in keys}
        text = ", ".join(f"{key}: {value}" for key, value in keys.items())
        body = f"  {_key(name)}: {{{text}}}" if keys else f"  # {_printable(name)}: no gain"
        told = "" if line is None else line.remark
        remark = f"  # {_printable(told)}" if told else ""
        if keys.get("gain") == ASK:
            asked = f"the drive gain of {_printable(name)}, torque per unit of current"
            remark = f"  {MARK} {asked}; {_printable(told or 'none was found')}"
        lines.append(body + remark)
    return "\n".join(lines) + "\n"


def stated_drives(path: str, data: bytes) -> dict[str, dict[str, str]]:
    """Return the keys under each joint of the section ``drives`` of a case file, as text.

    Raises:
        DescriptionError: The file is no case.
    """
    value, _ = load_yaml(path, data)
    top = VERSIONS.migrated(value, Place(path).error) if isinstance(value, dict) else {}
    drives = top.get("drives") or {}
    if not isinstance(drives, dict):
        return {}  # the word that asks for it
    return {
        str(name): {str(key): str(text) for key, text in keys.items()}
        for name, keys in drives.items()
        if isinstance(keys, dict)
    }


def case_with_drives(path: str, data: bytes, robot: Robot, gains: Mapping[str, GainLine]) -> str:
    """Return the text of a case file with gains in its section ``drives``; the rest stays byte for byte.

    Comments within the section are lost.

    Raises:
        DescriptionError: The file is no case, or its section cannot be found as a block of lines.
    """
    stated = stated_drives(path, data)
    text = data.decode("utf-8-sig")
    section = drives_section(robot, gains, stated)
    match = re.search(r"^drives[ \t]*:.*\n?(?:^(?:[ \t].*|[ \t]*#.*|[ \t]*)(?:\n|\Z))*", text, re.MULTILINE)
    if match is None:
        found = text + ("" if text.endswith("\n") else "\n") + section
    else:
        tail = re.search(r"(?:^(?:#.*|[ \t]*)\n)*\Z", match[0], re.MULTILINE)
        kept = tail[0] if tail else ""
        found = text[: match.start()] + section + kept + text[match.end() :]
    wanted = {name: dict(keys) for name, keys in stated.items()}
    for name, line in gains.items():
        if line.value is not None:
            wanted.setdefault(name, {})
            wanted[name] |= {"gain": f"{line.value:.6g}", "gain_std": f"{line.deviation:.2g}"}
    if stated_drives(path, found.encode()) != {name: keys for name, keys in wanted.items() if keys}:
        step = "write the section as a block, one line for each joint, or paste the printed lines by hand"
        raise DescriptionError(path, "drives", "the section cannot be replaced", step)
    return found


def _key(name: str) -> str:
    """Return a name as a key of YAML."""
    if _PLAIN.fullmatch(name) and name.lower() not in _WORDS:
        return name
    return "'" + name.replace("'", "''") + "'"


def _printable(text: str) -> str:
    """Return a text on one line, without what a terminal or YAML would take for something else."""
    return "".join(character if character.isprintable() else " " for character in text)
