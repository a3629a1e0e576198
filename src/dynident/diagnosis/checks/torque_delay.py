"""Torques that lag behind positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.diagnosis.causes.trend_texts import Z95
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding

#: Share of the torque that the delay displaces, root mean square over the joints, above which the result suffers.
HARM = 0.05


@dataclass(frozen=True)
class TorqueDelay(Check):
    """Time delay between torque and position signals, to a fraction of a sample."""

    stage: ClassVar[int] = 2
    tells: ClassVar[tuple[str, ...]] = ("torque delay",)

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        fit, delay, stated = subject.fit, subject.delay, subject.case.preprocessing.delay_s
        if fit is None or delay is None or subject.trends is None or not (delay.applied or stated):
            return []
        seconds, std = (delay.seconds, delay.std) if delay.applied else subject.trends.delay
        away = seconds - (stated or 0.0)
        is_late = abs(seconds) > Z95 * std  # friction that the quick fit lacks may leave it open
        if not (is_late or stated):
            return []
        slope = np.gradient(fit.rows.torque, np.asarray(fit.rows.prepared.kept.time), axis=0)
        harm = abs(away) * float(np.median(slope.std(axis=0) / np.maximum(fit.rows.torque.std(axis=0), 1e-12)))
        samples = f", {seconds * subject.sound.log.rate:.2f} samples" * (subject.pooled is None)  # rates differ
        evidence = (
            f"torques {'lag' if seconds > 0 else 'lead'} {1e3 * abs(seconds):.3g} ms "
            f"(+- {1e3 * Z95 * std:.2g} ms{samples}) against positions"
        )
        numbers = {"delay_s": seconds, "std_s": std, "displaced": harm}
        if stated is None:
            return [Finding("note", "torque delay", "", evidence, "the case compensates it (delay_s: auto)", numbers)]
        if abs(away) < 3 * std:
            return []
        if stated:
            evidence = evidence if is_late else f"torques have no delay (+- {1e3 * Z95 * std:.2g} ms)"
            evidence += f", and {1e3 * stated:.3g} ms are taken off"
        remedy = "compensate it (preprocessing: delay_s: auto)"
        if subject.earlier is not None:
            remedy = "record it as the logs of the fit were, or fit logs of both with preprocessing: delay_s: auto"
        return [Finding("warning" if harm > HARM else "note", "torque delay", "", evidence, remedy, numbers)]
