"""Log quality: what the doctor found in the logs of the fit before they were fitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from dynident.results.report.sections.base import Section
from dynident.results.report.subject import Subject
from dynident.results.text import MISSING, Column, Table, label

_COLUMNS = (
    Column("log"),
    Column("severity"),
    Column("finding"),
    Column("joint"),
    Column("evidence"),
    Column("next step"),
)


@dataclass(frozen=True)
class LogQuality(Section):
    """Findings on each log; left out where the logs were not examined."""

    title: ClassVar = "Log quality"
    template: ClassVar = "log_quality.html"

    def context(self, subject: Subject) -> dict[str, Any]:
        examined = [log for log in subject.estimate.provenance.get("log_quality", ()) if isinstance(log, Mapping)]
        if not examined:
            return {}
        rows = tuple(
            (
                label(str(log["path"])),
                str(finding["severity"]),
                str(finding["name"]),
                label(str(finding["joint"])) if finding["joint"] else MISSING,
                label(str(finding["evidence"])),
                label(str(finding["remedy"])),
            )
            for log in examined
            for finding in log["findings"]
        )
        sound = [label(str(log["path"])) for log in examined if not log["findings"]]
        unfinished = [f"{label(str(log['path']))}: {log['left_out']}" for log in examined if log["left_out"]]
        return {"table": Table(_COLUMNS, rows) if rows else None, "sound": sound, "unfinished": unfinished}
