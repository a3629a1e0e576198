"""Motions of servos as command files: time, commands and torque-enable in the columns and units of the case's logs."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynident.actuators.servo_excitation import JointExcitation, MotionRequest
from dynident.actuators.servo_files import column_names, written_positions
from dynident.actuators.servo_log import ServoColumns
from dynident.arrays import Array, BoolArray
from dynident.files import write_atomically


@dataclass(frozen=True)
class CommandFile:
    """A motion of one joint to be replayed, and recorded under the same name.

    Attributes:
        name: Name of the file.
        joint: The joint that moves.
        kind: Kind of the motion.
        kp: Position gain to record at, in the drive's unit.
        payload: Name of the payload to carry; empty for none.
        text: Table with a header.
    """

    name: str
    joint: str
    kind: str
    kp: float
    payload: str
    text: str


@dataclass(frozen=True)
class ServoMotions:
    """Motions for the servos of a robot.

    Attributes:
        robot: Name of the robot.
        request: What was asked.
        pose: Positions at which joints are held, shape (n,), in rad or m.
        limits: Lower and upper limit and largest speed of each joint, shape (n, 3).
        joints: Motions and intervals, joint by joint.
        files: The motions as command files.
        clearance: The smallest distance to spare in m, and between what; None where the case has no workspace.
        remarks: What the user has to know.
    """

    robot: str
    request: MotionRequest
    pose: Array
    limits: Array
    joints: tuple[JointExcitation, ...]
    files: tuple[CommandFile, ...]
    clearance: tuple[float, str] | None
    remarks: tuple[str, ...]


def command_files(
    found: Sequence[JointExcitation], pose: Array, request: MotionRequest, how: ServoColumns
) -> tuple[CommandFile, ...]:
    """Return a file for each motion, gain and payload.

    The name of a file has the gain as the case reads it from the names of logs, and the name of the payload.

    Args:
        found: The motions.
        pose: Positions at which the other joints are held, shape (n,), in rad or m.
        request: What was asked.
        how: Columns and units of the case's logs.
    """
    pattern = how.kp if isinstance(how.kp, str) and "{}" in how.kp else "kp{}" if len(request.gains) > 1 else ""
    files = []
    for k, joint in enumerate(found):
        for one in joint.motions:
            text = _table(one.motion.time, k, one.motion.command, one.motion.enabled, pose, how)
            for kp in request.gains:
                for payload in ("", *(request.payloads or {})):
                    parts = [joint.joint, one.motion.kind, pattern.replace("{}", f"{kp:.15g}"), payload]
                    name = re.sub(r"[^\w.+-]", "_", "_".join(filter(None, parts)))
                    files.append(CommandFile(f"{name}.csv", joint.joint, one.motion.kind, kp, payload, text))
    return tuple(files)


def _table(time: Array, joint: int, command: Array, enabled: BoolArray, pose: Array, how: ServoColumns) -> str:
    """Return t in s, the command of every joint and, where the case names columns of it, the torque-enable."""
    commands = np.tile(pose, (len(time), 1))
    commands[:, joint] = command
    states = np.ones((len(time), len(how.enabled)))
    if how.enabled:
        states[:, joint if len(how.enabled) > 1 else 0] = enabled
    columns = [time[:, None], written_positions(how, commands), states]
    header = ["t", *column_names(how, "q_ref"), *how.enabled]
    text = io.StringIO()
    formats = ["%.9g"] * (1 + commands.shape[1]) + ["%d"] * states.shape[1]
    np.savetxt(text, np.hstack(columns), formats, ",", header=",".join(header), comments="")
    return text.getvalue()


def write_motions(found: ServoMotions, folder: str | Path) -> None:
    """Write the command files into a folder, which is made where it is missing.

    Raises:
        FileError: A file cannot be written.
    """
    Path(folder).mkdir(parents=True, exist_ok=True)
    for file in found.files:
        write_atomically(Path(folder) / file.name, file.text)


def motions_data(found: ServoMotions) -> dict[str, Any]:
    """Return motions and intervals as plain data; what is infinite or not known is null."""

    def finite(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    joints = []
    for joint, limits in zip(found.joints, found.limits.tolist(), strict=True):
        motions = [
            {
                "kind": one.motion.kind,
                "words": one.motion.words,
                "lowest": one.lowest,
                "highest": one.highest,
                "fastest": one.fastest,
                "saturated": one.saturated,
            }
            for one in joint.motions
        ]
        known = {
            name: [{**asdict(one), "half_width": finite(one.half_width)} for one in own]
            for name, own in joint.known.items()
        }
        servo = {"from": list(joint.servo.words), "friction": joint.servo.friction}
        servo |= {"encoder_step": joint.resolution, "full_torque": joint.servo.value("full_torque")}
        lower, upper, speed = map(finite, limits)
        bounds = {"lower": lower, "upper": upper, "velocity": speed}
        joints.append({"name": joint.joint, "limits": bounds, "servo": servo, "motions": motions, "known": known})
    return {
        "kind": "servo motions",
        "robot": found.robot,
        "rate": found.request.rate,
        "seconds": found.request.seconds,
        "pose": found.pose.tolist(),
        "gains": list(found.request.gains),
        "joints": joints,
        "files": [{key: value for key, value in vars(file).items() if key != "text"} for file in found.files],
        "least_spare_distance": None if found.clearance is None else found.clearance[0],
        "remarks": list(found.remarks),
    }
