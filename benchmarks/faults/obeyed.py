"""Remedies obeyed: a fault, what the checks say of it, the edit that they ask for, and the fit after it.

    python -m benchmarks.faults.obeyed [ROBOT ...] [--only WORDS]

Errors and warnings are obeyed, the gravest first, and the log is examined again, as a user would; where none is left,
the notes of a delay, a tilt or a scale. The same edits are made in the log that is held out, which has the same fault.
The test error after that is held against the one of the clean log. Faults whose remedy is another recording, another
robot model or a look at the drives are not tried.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from benchmarks.faults import injections as put
from benchmarks.faults.effect import reference
from benchmarks.faults.kinds import KINDS
from benchmarks.faults.matrix import strengths
from benchmarks.faults.trials import Trial, robots
from dynident.diagnosis.checks import examine
from dynident.diagnosis.finding import Finding
from dynident.errors import DynidentError
from dynident.identification.identify import identify
from dynident.identification.validate import validate

#: Rounds of obeying, and the test error over that of the clean log that is enough.
ROUNDS, ENOUGH = 4, 1.02

#: Notes that are obeyed where no error and no warning is left.
NOTES = ("torque delay", "tilt", "torque scale")

#: Findings of these kinds of faults whose remedy is another recording.
RECORD_AGAIN = ("signal missing",)

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


def negated(*names: str) -> Edit:
    def edit(trial: Trial, finding: Finding) -> Trial:
        for joint in places(trial, finding):
            trial = put.turned(trial, names, joint)
        return trial

    return edit


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


def in_unit(key: str) -> Edit:
    return lambda trial, finding: put.declared(trial, **{key: str(told(finding, key))})


def scaled(trial: Trial, finding: Finding) -> Trial:
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
    "torque sign": negated("tau"),
    "position sign": negated("q", "dq"),
    "torque order": exchanged,
    "joint order": exchanged,
    "torque scale": scaled,
    "mounting": with_gravity,
    "tilt": with_gravity,
    "torque delay": delayed,
}


def advice(found: tuple[Finding, ...], done: list[str]) -> Finding | None:
    """Return the finding to obey next; None where nothing is left."""
    open_ones = [one for one in found if one.name in EDITS and f"{one.name} {one.joint}" not in done]
    grave = [one for one in open_ones if one.severity != "note"]
    notes = [one for one in open_ones if one.name in NOTES and "not distinguishable" not in one.evidence]
    return next(iter(grave or notes), None)


def obey(trial: Trial, held: Trial, folder: Path) -> tuple[Trial, Trial, list[str]]:
    """Return both logs after all advice, and what was obeyed."""
    done: list[str] = []
    for _ in range(ROUNDS):
        finding = advice(trial.examined(folder).findings, done)
        if finding is None:
            break
        done.append(f"{finding.name} {finding.joint}")
        edit = EDITS[finding.name]
        trial, held = edit(trial, finding), edit(held, finding)
    return trial, held, done


def error_of(trial: Trial, held: Trial, folder: Path) -> float:
    """Return the relative test error of what is identified from a log."""
    case = trial.case
    estimate = identify(case.model, [case.read(trial.written(folder))], "wls", case.preprocessing)
    return validate(estimate, [held.case.read(held.written(folder, "held"))]).total_relative_error


def trials(trial: Trial, held: Trial, folder: Path, only: str) -> Iterator[tuple[str, float, float, list[str]]]:
    """Yield kind, strength, test error over that of the clean log, and what was obeyed."""
    clean, against = error_of(trial, held, folder), reference(trial, held, folder)
    for kind in KINDS:
        if not set(kind.right) & set(EDITS) or not any(word in kind.name for word in only.split(",")):
            continue
        if kind.needs and kind.needs not in trial.columns:
            continue
        for strength in strengths(kind, trial, against, folder)[0]:
            faulty, other = (kind.inject(one, strength, np.random.default_rng(1)) for one in (trial, held))
            done: list[str] = []
            try:
                faulty, other, done = obey(faulty, other, folder)
                if any(one.name in RECORD_AGAIN for one in faulty.examined(folder).findings):
                    continue
                ratio = error_of(faulty, other, folder) / clean
            except (DynidentError, LookupError) as problem:
                done, ratio = [*done, f"refused: {problem}"], np.inf
            yield kind.name, strength, ratio, done


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*")
    parser.add_argument("--only", default="", help="kinds whose name has one of these words, separated by commas")
    options = parser.parse_args()
    total = right = 0
    with tempfile.TemporaryDirectory() as name:
        for robot, (trial, held) in robots(options.robots).items():
            print(robot)
            for kind, strength, ratio, done in trials(trial, held, Path(name), options.only):
                total, right = total + 1, right + (ratio <= ENOUGH)
                word = "" if ratio <= ENOUGH else "WORSE"
                print(f"  {kind:34} {strength:<10.3g} {ratio:<8.4g} {word:6} {'; '.join(done)}", flush=True)
    print(f"{right} of {total} within {ENOUGH - 1:.0%} of the clean log's test error ({right / max(total, 1):.1%})")


if __name__ == "__main__":
    main()
