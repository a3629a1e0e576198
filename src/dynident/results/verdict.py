"""The verdict on an estimate in words, the same for the terminal, the report and the studio."""

from __future__ import annotations

from collections.abc import Sequence

from dynident.diagnosis.finding import EXPLAINED
from dynident.diagnosis.new_log import NewLog, Quality
from dynident.diagnosis.verdict import (
    ACCEPTED,
    NO_CRITERIA,
    NOT_MET,
    OF_FIT,
    AcceptanceCriterion,
    Verdict,
    check_lines,
    errors_in,
)
from dynident.results.text import MISSING, Table, columns_of, counted, format_percent, label

#: What is said where nobody has looked at the logs of a fit.
NOT_CHECKED = "log checks: not made on the logs of this fit ('dynident check' makes them)"

#: Logs, and warnings, that are named at most.
_NAMED = 4

#: Causes of an error on new logs that are named at most.
_CAUSES = 2

#: What the exports say of an estimate that findings speak against.
STEP = "correct the cause and identify again"


def new_log_line(new: NewLog) -> str:
    """Return in one line how the error on new logs lies to that of the training."""
    totals = f"total error {format_percent(new.error)}, training {format_percent(new.trained)}"
    if new.explains_nothing:
        where = f"worse than a constant torque at {new.worthless[0]} of {new.worthless[1]} joints"
        return f"{label(new.name)}: the estimate does not explain this log: {where} ({totals})"
    if new.unlike:
        return f"{label(new.name)}: {label(new.unlike)} ({totals})"
    if new.is_still:
        return f"{label(new.name)}: no joint moves, so that only the weight is compared ({totals})"
    if new.resting:
        rest = f"{_first_names(new.resting)}, moved in the training, rest{'s' * (len(new.resting) == 1)}"
        return f"{label(new.name)}: {rest}; no other joint errs far beyond the training ({totals})"
    return f"{label(new.name)}: no joint errs far beyond the training ({totals})"


def new_lines(verdict: Verdict) -> list[str]:
    """Return what is said of new logs below the headline: their error, and causes that are less than errors."""
    new = verdict.new
    if new is None:
        return []
    lines = [new_log_line(new)] if verdict.word in (ACCEPTED, NOT_MET) else []
    if new.quality is None or not (new.unlike or new.explains_nothing) or errors_in(new.quality):
        return lines
    found = check_lines(new.quality, "warning") or check_lines(_with_large_notes(new.quality), "note")
    told = [f"log checks: {label(line)}" for line in found[:_CAUSES]]
    return [*lines, *(told or ["the checks of this log name no cause", *filter(None, [label(new.step)])])]


def _with_large_notes(quality: Quality) -> Quality:
    """Return what checks found without what explains less than half of a residual, which is no cause of a large one."""
    return [
        {**each, "findings": [own for own in each["findings"] if own["numbers"].get("share", 1.0) > EXPLAINED]}
        for each in quality
    ]


def headline(verdict: Verdict) -> str:
    """Return the verdict in one line; empty where nothing speaks against the estimate and nothing was asked."""
    if verdict.word == NO_CRITERIA and verdict.new is not None:
        return new_log_line(verdict.new)
    return "" if verdict.word == NO_CRITERIA else f"{verdict.word.upper()}: {reason_of(verdict)}"


def reason_of(verdict: Verdict) -> str:
    """Return why the verdict is what it is; without criteria, what the log checks found."""
    if verdict.new is not None and verdict.new_causes == verdict.causes != ():
        if verdict.new.explains_nothing:
            return new_log_line(verdict.new)
        told = counted(len(verdict.causes), "finding")
        return f"{label(verdict.new.name)}: its log checks have {told} at error level; correct the log or its case"
    if verdict.causes:
        count = sum(cause.log != OF_FIT for cause in verdict.causes)
        told = f"the log checks have {count} finding{'s' * (count > 1)} at error level"
        return f"{told if count else 'it explains next to nothing of its own data'}; {STEP}"
    if verdict.word == NO_CRITERIA:
        told = (
            "the checks of the training logs found no error" if verdict.is_checked else "the log checks were not made"
        )
        but = [
            f"{what}: {_first_names(names)}"
            for what, names in (
                ("logs that do not go with the others", verdict.apart),
                (counted(len(verdict.warned), "warning"), verdict.warned),
            )
            if names
        ]
        but += map(label, verdict.against)
        return f"{told}, but {'; '.join(but)}" if but else told
    missed = [criterion.criterion for criterion in verdict.criteria if not criterion.is_met]
    return ", ".join(missed) or f"{len(verdict.criteria)} of {len(verdict.criteria)} criteria met"


def _first_names(names: Sequence[str]) -> str:
    return ", ".join(map(label, [*names[:_NAMED], *["..."] * (len(names) > _NAMED)]))


def cause_lines(verdict: Verdict) -> list[str]:
    """Return the findings that speak against the estimate, one a line."""
    return [label(str(cause)) for cause in verdict.causes]


def criteria_table(verdict: Verdict) -> Table:
    """Return the criteria with value and limit."""
    columns = columns_of("criterion", "value", "limit", "met", "of")
    rows = tuple(
        (
            criterion.criterion,
            _figure(criterion, criterion.value),
            _figure(criterion, criterion.limit),
            "yes" if criterion.is_met else "NO",
            label(criterion.detail) if criterion.detail else "",
        )
        for criterion in verdict.criteria
    )
    return Table(columns, rows)


def _figure(criterion: AcceptanceCriterion, value: float | None) -> str:
    if value is None:
        return MISSING
    return f"{value:g}" if criterion.criterion == "log_checks" else format_percent(value)
