"""The matrix: every kind at its strengths on a robot, and what the log checks find."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.faults.bound import log_tells, sureness
from benchmarks.faults.effect import Reference, reference, smallest
from benchmarks.faults.figures import CleanLog, grade, without_fault
from benchmarks.faults.kinds import KINDS, Kind
from benchmarks.faults.trials import Trial, subject_of
from dynident.diagnosis.finding import SEVERITIES, Finding
from dynident.identification.estimate.estimate import Estimate

#: Multiples of the smallest strength that are tried.
MULTIPLES = (1.0, 2.0, 4.0)

#: A finding that the clean log has as well counts where a figure of it moved by this share.
MOVED = 0.2

#: How a figure is stated, the best first: right, in an interval that is wide, or beside its interval.
GRADES = ("exact", "wide", "false")

#: What is right of a torque whose scale no log of this robot and motion tells, the clean one among them.
OPEN = "scale not determined"


@dataclass(frozen=True)
class Outcome:
    """One fault in one log: whether it was named, how its direction and figure were stated, and all that was said.

    ``sureness`` is how many standard deviations it is from none at most, and ``log_tells`` whether the log has more to
    tell than was told.
    """

    kind: str
    strength: float
    named: bool
    grade: str
    said: tuple[str, ...]
    searched: bool
    sureness: float = np.inf
    log_tells: bool = True


def strengths(kind: Kind, trial: Trial, against: Reference, folder: Path) -> tuple[tuple[float, ...], bool]:
    """Return the strengths to try and whether the first is the smallest one that matters."""
    if kind.between is None:
        return kind.fixed, False
    least = smallest(kind, trial, against, folder)
    return ((kind.between[1],), False) if least is None else (tuple(least * factor for factor in MULTIPLES), True)


def naming(kind: Kind, joint: str, found: tuple[Finding, ...], clean: tuple[Finding, ...]) -> list[Finding]:
    """Return the findings that name the fault, at its joint, that the clean log does not have, or not so strongly.

    That a scale cannot be determined holds of the clean log as well.
    """
    known = {(finding.name, finding.joint): finding for finding in clean}
    return [
        finding
        for finding in found
        if finding.name in kind.right
        and (not joint or joint in finding.joint.split(", "))
        and not (kind.of_all and finding.joint)
        and (finding.name == OPEN or _is_new(finding, known.get((finding.name, finding.joint))))
    ]


def joint_of(kind: Kind, trial: Trial, strength: float) -> str:
    """Return the joint that must be named; empty where it is the whole log."""
    names = trial.case.robot.joint_names
    return "" if kind.joint is None else names[kind.joint(trial, strength) % len(names)]


def _is_new(finding: Finding, known: Finding | None) -> bool:
    if known is None or SEVERITIES.index(finding.severity) < SEVERITIES.index(known.severity):
        return True
    return any(
        abs(value - known.numbers.get(key, 0.0)) > MOVED * abs(known.numbers.get(key, 0.0))
        for key, value in finding.numbers.items()
        if key != "half_width"
    )


def outcomes(trial: Trial, held: Trial, folder: Path, only: str = "", recorded: bool = False) -> Iterator[Outcome]:
    """Yield the outcome of each kind at each strength on a robot; figures of a ``recorded`` log count what it has."""
    earlier, against = held.estimate(folder), reference(trial, held, folder)
    subject = replace(subject_of(trial, folder), earlier=earlier)
    clean = CleanLog(trial, subject, trial.examined(folder, earlier).findings)
    for kind in KINDS:
        if not any(word in kind.name for word in only.split(",")) or (kind.needs and kind.needs not in trial.columns):
            continue
        tried, searched = strengths(kind, trial, against, folder)
        twice = partial(_twice, kind, trial, max(tried), earlier, folder)
        for strength in tried:
            faulty = kind.inject(trial, strength, np.random.default_rng(1))
            found = faulty.examined(folder, earlier).findings
            said = tuple(f"{one.severity}: {one.name}" + (f" ({one.joint})" * bool(one.joint)) for one in found)
            right = naming(kind, joint_of(kind, trial, strength), found, clean.findings)
            wanted = None if kind.states is None else kind.states(trial, strength)
            grades = {grade(one, wanted, faulty, clean) for one in right}
            if grades and "exact" not in grades and recorded and kind.between:
                grades = {grade(one, wanted, faulty, clean, without_fault(one, twice())) for one in right}
            best = next((word for word in GRADES if word in grades), "")
            said += tuple(one.evidence for one in right if best != "exact")
            sure = np.inf if best in ("exact", "false") else sureness(faulty, clean, earlier, folder)
            more = log_tells(best, sure, clean)
            yield Outcome(kind.name, strength, bool(right), best, said, searched, sure, more)


def _twice(
    kind: Kind, trial: Trial, strength: float, earlier: Estimate, folder: Path
) -> list[tuple[Trial, Sequence[Finding]]]:
    """Return a log with a fault and with twice as much of it, each with its findings."""
    logs = [kind.inject(trial, size, np.random.default_rng(1)) for size in (strength, 2 * strength)]
    return [(log, log.examined(folder, earlier).findings) for log in logs]


def alarms(trial: Trial, held: Trial, folder: Path) -> Mapping[str, int]:
    """Return the count of findings on a clean log by severity."""
    found = [finding.severity for finding in trial.examined(folder, held.estimate(folder)).findings]
    return {severity: found.count(severity) for severity in SEVERITIES}
