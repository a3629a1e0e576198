"""Provenance: how to repeat it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dynident.results.report.sections.base import ReportSection
from dynident.results.report.subject import Subject
from dynident.results.text import format_number, label, plain_value, term

#: Lists longer than this are counted, not written out.
_LONG = 12

#: Shown elsewhere: the files with the data, findings on them, the command above the facts, the trace as a figure.
_ELSEWHERE = ("logs", "log_quality", "command", "trace")


@dataclass(frozen=True)
class Provenance(ReportSection):
    """Method, options, news of the method, versions and the exact command."""

    title: ClassVar = "Provenance"

    def context(self, subject: Subject) -> dict[str, Any]:
        estimate, choices = subject.estimate, subject.estimate.choices
        aside = {"delay_s": choices.delay_s, "constraints_not_kept": choices.constraints_not_kept}
        facts = {**estimate.run.data(), **{name: value for name, value in aside.items() if value is not None}}
        groups = [
            ("Estimator", [("method", label(estimate.estimator)), *_entries(estimate.options)]),
            ("What the method reports", list(_entries(facts))),
            ("Preparation", list(_entries(estimate.preprocessing.statement()))),
            (
                "Fit",
                [("samples", str(estimate.samples)), ("condition number", format_number(estimate.condition_number))],
            ),
            ("Origin", list(_entries(estimate.provenance))),
        ]
        commands = [_command(each) for each in (estimate.provenance.get("command"), subject.command)]
        lines = [line for command in dict.fromkeys(commands) for line in command.splitlines()]
        return {"groups": [group for group in groups if group[1]], "command": lines}


def _command(stated: object) -> str:
    """Return a command line, which stands in an estimate as text or as its parts."""
    if isinstance(stated, list | tuple):
        return " ".join(str(part) for part in stated)
    return str(stated or "")


def _entries(facts: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Return facts in words, nested ones with the way to them before their name."""
    for key, value in facts.items():
        name = f"{prefix}{term(key)}"
        if (not prefix and key in _ELSEWHERE) or (isinstance(value, str | list | tuple) and not value):
            continue
        if isinstance(value, Mapping):
            yield from _entries(value, f"{name} ")
        elif isinstance(value, list | tuple | np.ndarray) and np.size(np.asarray(value, dtype=object)) > _LONG:
            yield name, f"{len(value)} values"
        elif isinstance(value, list | tuple) and value and all(isinstance(one, Mapping) for one in value):
            for number, one in enumerate(value, start=1):
                yield from _entries(one, f"{name} {number} ")
        else:
            yield name, plain_value(value)
