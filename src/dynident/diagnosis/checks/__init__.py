"""Log checks, a family: what is wrong with a log before anything is fitted to it, and what to do about it.

A check looks at one side of a log and returns findings. Checks of the raw file come first, then those of the signals,
then those of a quick fit; an error that no repair removes ends the examination, since what comes after it would only
repeat it in other words.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dynident.case.case import Case
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import SEVERITIES, Finding
from dynident.diagnosis.recording import Recording, read_recording
from dynident.diagnosis.repair import Repaired, repair
from dynident.errors import LogFormatError, LogMismatch
from dynident.identification.estimate.estimate import Estimate
from dynident.model.threads import one_blas_thread
from dynident.plugins import Family

CHECKS: Family[Check] = Family("dynident.diagnosis.checks", Check, "check")  # type: ignore[type-abstract]

__all__ = ["CHECKS", "Check", "CheckedLog", "Examination", "Finding", "examine", "examine_recording"]

_STAGES = (0, 1, 2)

#: Errors that are gone once the safe repairs are made.
_MENDABLE = ("values that are not finite", "repeated rows", "rows out of order", "encoder wrap")


@dataclass(frozen=True)
class Examination:
    """Findings of the checks on one log.

    Attributes:
        path: The log.
        findings: Gravest first.
        left_out: Why checks were left out; empty where all were made.
        repaired: The log after the safe repairs; None where it could not be read.
    """

    path: str
    findings: tuple[Finding, ...]
    left_out: str = ""
    repaired: Repaired | None = None

    @property
    def sound(self) -> bool:
        """Whether there is no finding at error level."""
        return not any(finding.severity == "error" for finding in self.findings)

    def figures(self) -> dict[str, Any]:
        """Return the examination as plain data for JSON."""
        return {
            "path": self.path,
            "sound": self.sound,
            "left_out": self.left_out,
            "findings": [finding.figures() for finding in self.findings],
        }


def examine(case: Case, name: str, earlier: Estimate | None = None) -> Examination:
    """Return what is wrong with a log of a case; nothing is changed and nothing refused.

    Args:
        case: Robot, columns and preparation.
        name: The log, as the case or the command line names it.
        earlier: An estimate of the same robot, whose bodies take the place of the robot model's.

    Raises:
        FileError: The file cannot be read at all.
    """
    try:
        recording = read_recording(case, name)
    except (LogFormatError, LogMismatch) as error:
        finding = Finding("error", "unreadable", "", error.evidence, error.step)
        return Examination(str(case.find(name)), (finding,), "no check was made, the file is no table of the case")
    return examine_recording(case, recording, earlier)


@one_blas_thread()
def examine_recording(case: Case, recording: Recording, earlier: Estimate | None = None) -> Examination:
    """Return what is wrong with a recording; see :func:`examine`."""
    repaired = repair(recording, case.robot)
    subject = CheckedLog(case, recording, repaired.recording, earlier)
    found: list[Finding] = []
    left_out = ""
    checks = [CHECKS.make(name) for name in CHECKS.names()]
    for stage in _STAGES:
        found += _of_stage([check for check in checks if check.stage == stage], subject, found)
        lasting = [each.name for each in found if each.severity == "error" and each.name not in _MENDABLE]
        if lasting and stage < _STAGES[-1]:
            left_out = f"checks that need sound {'signals' if stage == 0 else 'units'} were left out: fix {lasting[0]}"
            break
    return Examination(recording.log.name, ordered(found), left_out, repaired)


def _of_stage(checks: Sequence[Check], subject: CheckedLog, before: Sequence[Finding]) -> list[Finding]:
    """Return the findings of some checks in their order; one is left out where others explain all that it can tell."""
    told: dict[int, Sequence[Finding]] = {}
    for k in sorted(range(len(checks)), key=lambda k: bool(checks[k].tells)):
        explained = {name for each in (before, *told.values()) for finding in each for name in finding.explains}
        names = set(checks[k].tells)
        told[k] = () if names and names <= explained else checks[k].findings(subject)
    return [finding for k in sorted(told) for finding in told[k]]


def ordered(found: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return findings with the gravest first, those that another one explains left out."""
    explained = {name for finding in found for name in finding.explains}
    first: dict[tuple[str, str], Finding] = {}
    for finding in sorted(found, key=_rank):  # two checks may see one thing: the gravest tells it
        first.setdefault((finding.name, finding.joint), finding)
    kept = [finding for finding in first.values() if finding.name not in explained]
    return tuple(sorted(kept, key=_rank))


def _rank(finding: Finding) -> int:
    return SEVERITIES.index(finding.severity)
