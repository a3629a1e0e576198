"""Log quality: findings of the log checks before the fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from dynident.results.report.sections.base import ReportSection
from dynident.results.report.subject import Subject
from dynident.results.text import label

#: Tone of a severity, as of the verdict.
_TONES = {"error": "bad", "warning": "fair", "note": "plain"}


@dataclass(frozen=True)
class Remark:
    """A finding in words.

    Attributes:
        severity: ``error``, ``warning`` or ``note``.
        tone: How it is coloured.
        name: What was found, and at which joint.
        evidence: The figures that show it.
        step: What to do.
    """

    severity: str
    tone: str
    name: str
    evidence: str
    step: str


@dataclass(frozen=True)
class Examined:
    """A log that was looked at.

    Attributes:
        log: Its name.
        remarks: What was found, gravest first.
        left_out: What was not looked at, and why; empty where all was.
    """

    log: str
    remarks: tuple[Remark, ...]
    left_out: str


@dataclass(frozen=True)
class LogQuality(ReportSection):
    """Findings on each log; left out where the logs were not examined."""

    title: ClassVar = "Log quality"

    def context(self, subject: Subject) -> dict[str, Any]:
        known = subject.log_quality or subject.estimate.provenance.get("log_quality", ())
        examined = [_examined(log) for log in known if isinstance(log, Mapping)]
        if not examined:
            return {}
        sound = [each.log for each in examined if not each.remarks]
        return {"logs": [each for each in examined if each.remarks or each.left_out], "sound": sound}


def _examined(log: Mapping[str, Any]) -> Examined:
    remarks = tuple(map(_remark, log["findings"]))
    return Examined(label(str(log["path"])), remarks, label(str(log["left_out"])) if log["left_out"] else "")


def _remark(finding: Mapping[str, Any]) -> Remark:
    severity, name = str(finding["severity"]), label(str(finding["name"]))
    where = f", {label(str(finding['joint']))}" if finding["joint"] else ""
    texts = (label(str(finding[key])).replace("+-", "±") for key in ("evidence", "remedy"))
    return Remark(severity, _TONES.get(severity, "plain"), f"{name}{where}", *texts)
