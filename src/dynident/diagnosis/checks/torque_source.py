"""Whether there is a torque at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from shlex import quote

from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding, listed


@dataclass(frozen=True)
class TorqueSource(Check):
    """Currents without drive gains, and logs without torques and currents."""

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        log = subject.sound.log
        if log.torque is not None:
            return []
        if log.current is None:
            remedy = "record torques or motor currents: positions alone give no masses (log: columns: torque)"
            return [Finding("error", "no torque", "", "the log has neither torques nor currents", remedy)]
        bare = [joint.name for joint in subject.case.robot.active if joint.drive.gain is None]
        remedy = (
            "state gains, torque at the joint per unit of current (drives: {JOINT: {gain: ...}}), from a data sheet; "
            f"'dynident gains {quote(subject.case.path or 'CASE')}' finds gains from runs with and without a known load"
        )
        return [Finding("error", "no drive gain", listed(bare), "currents and no gain", remedy)]
