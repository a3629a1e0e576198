"""Logs of robots that move as their descriptions say, under any column names and units."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynident.arrays import Array
from dynident.case.case import Case, read_case
from dynident.case.case_draft import Draft
from dynident.case.questions import ASK, MARK
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Motion
from dynident.model.robot import Robot


def moved(robot: Robot, samples: int = 600, rate: float = 100.0, seed: int = 1) -> dict[str, Array]:
    """Return time (N,) and q, dq, torque (N, n) of a motion with the robot model's masses and some friction."""
    generator = np.random.default_rng(seed)
    time = np.arange(samples) / rate
    q, dq, ddq = (np.zeros((samples, robot.dof)) for _ in range(3))
    for joint in range(robot.dof):
        for speed in (1.1, 1.9, 3.1):
            size, phase, w = generator.uniform(0.1, 0.3), generator.uniform(0, 6), speed * (1 + 0.1 * joint)
            q[:, joint] += size * np.sin(w * time + phase)
            dq[:, joint] += size * w * np.cos(w * time + phase)
            ddq[:, joint] -= size * w**2 * np.sin(w * time + phase)
    model = DynamicModel(robot, (FRICTION.make("coulomb", {"width": 0.01}), FRICTION.make("viscous")))
    theta = np.array(model.nominal())
    scale = float(np.abs(model.torque(Motion(q, dq, ddq), theta)).mean())
    theta[model.inertial_count :] = 0.05 * scale
    torque = model.torque(Motion(q, dq, ddq), theta)
    torque += generator.normal(0.0, 1e-3 * scale, torque.shape)
    return {"time": time, "q": q, "dq": dq, "torque": torque}


def write_log(path: Path, columns: Mapping[str, Array], separator: str = ",", decimal: str = ".") -> str:
    """Write columns by name and return the path."""
    rows = np.column_stack(list(columns.values())).tolist()
    lines = [separator.join(columns), *(separator.join(repr(x).replace(".", decimal) for x in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


def named(motion: Mapping[str, Array], time: str, names: Mapping[str, Sequence[str]]) -> dict[str, Array]:
    """Return the columns of a motion under the names of each signal."""
    found = {time: motion["time"]}
    for signal, columns in names.items():
        found |= dict(zip(columns, motion[signal].T, strict=True))
    return found


def numbered(motion: Mapping[str, Array], q: str = "q{}", torque: str = "tau{}", time: str = "t") -> dict[str, Array]:
    """Return time, positions and torques under names with a number from 1."""
    count = range(1, motion["q"].shape[1] + 1)
    return named(motion, time, {"q": [q.format(k) for k in count], "torque": [torque.format(k) for k in count]})


def write_robot(path: Path, robot: Robot) -> str:
    """Write a robot in the native format and return the path."""
    path.write_text(json.dumps(robot_to_dict(robot)), encoding="utf-8")
    return str(path)


def joints_called(robot: Robot, *names: str) -> Robot:
    """Return the robot with other names of its joints."""
    return replace(robot, joints=tuple(replace(j, name=n) for j, n in zip(robot.joints, names, strict=True)))


def read(draft: Draft, folder: Path, answers: Mapping[str, str] | None = None) -> Case:
    """Return the case of a draft with an answer at every line whose question has the words of one."""
    lines = draft.text.splitlines()
    for k, line in enumerate(lines):
        before, mark, question = line.partition(MARK)
        answer = next((value for words, value in (answers or {}).items() if words in question), None)
        if mark and answer is not None:
            lines[k] = re.sub(rf"\b{ASK}\b", answer, before)
    (folder / "case.yaml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_case(folder / "case.yaml")
