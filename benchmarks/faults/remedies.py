"""What the messages of the log checks ask for, done to the columns and the case of a log."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from benchmarks.faults import injections as put
from benchmarks.faults.trials import Trial
from dynident.diagnosis.examination import examine
from dynident.diagnosis.finding import Finding

Edit = Callable[[Trial, Finding], Trial]


def places(trial: Trial, finding: Finding) -> list[int]:
    """Return the joints that a finding names, by number."""
    return [trial.case.robot.joint_names.index(name) for name in finding.joint.split(", ")]


def told(finding: Finding, key: str) -> object:
    """Return the value of a key that the remedy states, such as ``gravity: [...]``."""
    found = re.search(rf"\b{key}: (\[\[.*?\]\]|\[.*?\]|[\w/]+)", finding.remedy)
    if found is None:
        raise LookupError(f"'{finding.remedy}' states no {key}")
    return yaml.safe_load(found[1])


def exchanged(trial: Trial, finding: Finding) -> Trial:
    """Put columns into the order that the evidence tells: two exchanged, or each read as that of another joint."""
    names, moved = trial.case.robot.joint_names, places(trial, finding)
    if finding.name == "velocity order":
        moved.append(names.index(re.search(r"the position of (\S+)", finding.evidence)[1]))  # type: ignore[index]
    read = re.search(r"read as those of ([^;]*?),? (?:it|they|with|the|relative)", finding.evidence)
    order = list(range(len(names)))
    others = [names.index(name) for name in re.split(r", | and ", read[1])] if read else moved[::-1]
    for joint, other in zip(moved, others, strict=True):
        order[joint] = other
    signals = {"torque order": ("tau",), "velocity order": ("dq",)}.get(finding.name, ("q", "dq"))
    if finding.name == "joint order" and "positions and torques" in finding.evidence:
        signals = ("q", "dq", "tau")
    return trial.with_columns(**{name: trial.columns[name][:, order] for name in signals if name in trial.columns})


def in_unit(*keys: str) -> Edit:
    """State the units that the remedy has; of several keys those that it names."""

    def edit(trial: Trial, finding: Finding) -> Trial:
        words = {key: told(finding, key) for key in keys if len(keys) == 1 or f"{key}: " in finding.remedy}
        return put.declared(trial, **{key: tuple(w) if isinstance(w, list) else str(w) for key, w in words.items()})

    return edit


def scaled(trial: Trial, finding: Finding) -> Trial:
    if "torque: [" in finding.remedy:
        return in_unit("torque")(trial, finding)
    factor = finding.numbers.get("factor") or 1.0 / (1.0 + finding.numbers["value"])
    for joint in places(trial, finding) if finding.joint else range(trial.joints):
        trial = put.scaled(trial, factor - 1.0, joint)
    return trial


def with_gravity(trial: Trial, finding: Finding) -> Trial:
    gravity = np.array(told(finding, "gravity"), dtype=float)
    return replace(trial, case=replace(trial.case, robot=trial.case.robot.with_gravity(gravity)))


def delayed(trial: Trial, finding: Finding) -> Trial:
    how = replace(trial.case.preprocessing, delay_s=None)
    return replace(trial, case=replace(trial.case, preprocessing=how))


def mended(trial: Trial, finding: Finding) -> Trial:
    """Write the log as ``dynident check --fix`` does."""
    with tempfile.TemporaryDirectory() as folder:
        found = examine(trial.case, str(trial.written(Path(folder)))).repaired
    assert found is not None
    log = found.recording.log
    columns = {"t": log.time, "q": log.q, "dq": log.dq, "tau": log.torque}
    return trial.with_columns(**{name: np.asarray(columns[name]) for name in trial.columns})


EDITS: dict[str, Edit] = {
    "time unit": in_unit("time"),
    "repeated rows": mended,
    "rows out of order": mended,
    "encoder wrap": mended,
    "values that are not finite": mended,
    "positions in degrees": in_unit("position"),
    "positions in radians": in_unit("position"),
    "velocity unit": in_unit("velocity"),
    "velocity sign": lambda trial, finding: trial.without("dq"),
    "velocity order": exchanged,
    "torque sign": in_unit("torque"),
    "position sign": in_unit("position", "velocity"),
    "torque order": exchanged,
    "joint order": exchanged,
    "torque scale": scaled,
    "mounting": with_gravity,
    "tilt": with_gravity,
    "torque delay": delayed,
}
