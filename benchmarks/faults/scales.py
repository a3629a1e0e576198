"""Scale of one joint's torque, 0.05 to 20 on every joint of six robots: python -m benchmarks.faults.scales [ROBOT ...].

A joint whose scale the clean log tells is to be named with a factor within 5 % of the one that undoes the fault, or an
interval of at most 10 % that holds it; another one gets no figure, or an interval that holds the right one. Of recorded
logs the factor on the clean log counts as right. Joints told as not separable are counted apart.
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import dataclass, fields
from pathlib import Path

from benchmarks.faults import injections as put
from benchmarks.faults.trials import REAL, Trial, recorded, subject_of, tracked, virtual
from dynident.case.case import read_case
from dynident.diagnosis.causes.torque_scales import JointScale, other_scales
from dynident.diagnosis.checks.base import CheckedLog
from dynident.diagnosis.checks.readings import Readings
from dynident.diagnosis.checks.torque_scale import TorqueScale
from dynident.diagnosis.finding import Finding, ordered

FACTORS = (0.05, 0.1, 0.2, 0.495, 0.8, 1.25, 2.0, 2.5, 4.0, 10.0, 20.0)
ROBOTS = ("er16", "generic-6r", "generic-7r", "generic-scara", *REAL)

#: Relative standard deviation of a scale below which the log tells it, the largest error of its
#: figure, and the half width of an interval that stands for one.
TOLD, EXACT, WIDE = 0.05, 0.05, 0.1


@dataclass
class Count:
    """Outcomes of the faults of one robot."""

    right: int = 0
    beside: int = 0
    known: int = 0
    silent: int = 0
    unknown: int = 0


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
        subject = subject_of(put.scaled(trial, factor - 1, joint), folder)
        found = told(subject)
        is_scale = [one.name for one in found] == ["torque scale"]
        named = list(other_scales(subject.scales)) if is_scale else []
        of_joint = [one for one in named if one.joint == names[joint]]
        right = any(is_right(one, own.factor / factor) for one in of_joint)
        if known:
            total.known += 1
            total.right += right and of_joint[:1] == named[:1]
            total.beside += right and of_joint[:1] != named[:1]
            good = right
        else:
            total.unknown += 1
            good = not [one for one in found if one.name == "torque scale"] or any(
                one.low <= own.factor / factor <= one.high for one in of_joint
            )
            total.silent += good
        if not good:
            print(f"  {names[joint]} times {factor:g}: {[one.line()[:120] for one in found]}", flush=True)
    return total


def is_right(scale: JointScale, undoes: float) -> bool:
    near = abs(scale.factor / undoes - 1) <= EXACT
    return near or (scale.spread <= WIDE and scale.low <= undoes <= scale.high)


def main() -> None:
    wanted = sys.argv[1:] or [name for name in ROBOTS if name not in REAL or os.environ.get("DYNIDENT_DATA")]
    total = Count()
    with tempfile.TemporaryDirectory() as folder:
        for name in wanted:
            got = count(recorded(name) if name in REAL else virtual(read_case(name)), Path(folder))
            print(f"{name}: {got.right} of {got.known} named with their figure, {got.beside} beside another joint; "
                  f"{got.silent} of {got.unknown} others without a false one", flush=True)  # fmt: skip
            for field in fields(Count):
                setattr(total, field.name, getattr(total, field.name) + getattr(got, field.name))
    share = (total.right + total.beside) / max(total.known, 1)
    print(f"all: {total.right} + {total.beside} of {total.known} ({share:.1%}), {total.silent} of {total.unknown}")


if __name__ == "__main__":
    main()
