"""Remedies obeyed: a fault, what the checks say of it, the edit that they ask for, and the fit after it.

    python -m benchmarks.faults.obeyed [ROBOT ...] [--only WORDS]

Errors and warnings are obeyed, the gravest first, and the log is examined again, as a user would; where none is left,
the notes of a delay, a tilt or a scale. The same edits are made in the log that is held out, which has the same fault.
The test error after that is held against the one of the clean log. Faults whose remedy is another recording, another
robot model or a look at the drives are not tried.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.faults.effect import reference
from benchmarks.faults.kinds import KINDS
from benchmarks.faults.matrix import strengths
from benchmarks.faults.remedies import EDITS
from benchmarks.faults.trials import Trial, robots
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
