"""What was found from the logs before the fit: delays, friction parts, non-linear fields."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dynident.results.choices import choice_tables
from dynident.results.report.sections.base import Section
from dynident.results.report.subject import Subject


@dataclass(frozen=True)
class Choices(Section):
    """Delays of the torque, the friction of each joint, fields of friction parts; left out where all was given."""

    title: ClassVar = "Found from the logs"
    template: ClassVar = "choices.html"

    def context(self, subject: Subject) -> dict[str, Any]:
        tables = choice_tables(subject.estimate.extras)
        return {"tables": tables} if tables else {}
