"""Scale of one joint's torque, 0.05 to 20 on every joint of six robots: python -m benchmarks.faults.scales [ROBOT ...].

A joint whose scale the clean log tells must be named with a factor within 5 % of the one that undoes the fault, another
one must get no figure. Of a recorded log the factor on the clean log counts as right.
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from benchmarks.faults import injections as put
from benchmarks.faults.trials import REAL, Trial, recorded, tracked, virtual
from dynident.case.case import read_case
from dynident.diagnosis.checks import ordered
from dynident.diagnosis.checks.base import CheckedLog
from dynident.diagnosis.checks.readings import Readings
from dynident.diagnosis.checks.torque_scale import TorqueScale
from dynident.diagnosis.finding import Finding
from dynident.diagnosis.recording import read_recording
from dynident.diagnosis.repair import repair

FACTORS = (0.05, 0.1, 0.2, 0.495, 0.8, 1.25, 2.0, 2.5, 4.0, 10.0, 20.0)
ROBOTS = ("er16", "generic-6r", "generic-7r", "generic-scara", *REAL)

#: Relative standard deviation of a scale below which the log tells it, and the largest error of its figure.
TOLD, EXACT = 0.05, 0.05


@dataclass
class Count:
    """Outcomes of the faults of one robot."""

    right: int = 0
    known: int = 0
    silent: int = 0
    unknown: int = 0


def subject_of(trial: Trial, folder: Path) -> CheckedLog:
    recording = read_recording(trial.case, str(trial.written(folder)))
    return CheckedLog(trial.case, recording, repair(recording, trial.case.robot).recording)


def told(subject: CheckedLog) -> list[Finding]:
    """Return what is said of readings and scales of one joint, warnings and errors."""
    found = [*Readings().findings(subject), *TorqueScale().findings(subject)]
    return [one for one in ordered(found) if one.severity != "note"]


def count(trial: Trial, folder: Path) -> Count:
    clean = subject_of(trial, folder)
    if told(clean):
        raise SystemExit(f"clean log: {[one.line() for one in told(clean)]}")
    total, names = Count(), trial.case.robot.joint_names
    cases = [(joint, own, factor) for joint, own in enumerate(clean.scales) for factor in FACTORS]
    for joint, own, factor in tracked(cases, f"scales of {trial.case.robot.name}"):
        known = own.spread / 1.96 < TOLD
        found = told(subject_of(put.scaled(trial, factor - 1, joint), folder))
        scales = [one for one in found if one.name == "torque scale"]
        if known:
            total.known += 1
            hit = len(found) == 1 and bool(scales) and names[joint] in scales[0].joint.split(", ")
            figure = scales[0].numbers["factor"] * factor / own.factor if hit else float("nan")
            good = hit and scales[0].joint.startswith(names[joint]) and abs(figure - 1) <= EXACT
            total.right += good
        else:
            total.unknown += 1
            good = not scales
            total.silent += good
        if not good:
            print(f"  {names[joint]} times {factor:g}: {[one.line()[:120] for one in found]}", flush=True)
    return total


def main() -> None:
    wanted = sys.argv[1:] or [name for name in ROBOTS if name not in REAL or os.environ.get("DYNIDENT_DATA")]
    right = known = silent = unknown = 0
    with tempfile.TemporaryDirectory() as folder:
        for name in wanted:
            got = count(recorded(name) if name in REAL else virtual(read_case(name)), Path(folder))
            print(f"{name}: {got.right} of {got.known} named with their figure; {got.silent} of {got.unknown} "
                  "that the log does not tell without a figure", flush=True)  # fmt: skip
            right, known, silent, unknown = (
                right + got.right, known + got.known, silent + got.silent, unknown + got.unknown
            )  # fmt: skip
    print(f"all: {right} of {known} ({right / max(known, 1):.1%}), {silent} of {unknown}")


if __name__ == "__main__":
    main()
