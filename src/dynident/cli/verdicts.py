"""The verdict on an estimate and its nominal model in the terminal."""

from __future__ import annotations

from shlex import quote
from typing import TYPE_CHECKING

from dynident.cli import console

if TYPE_CHECKING:
    from dynident.diagnosis.verdict import Verdict
    from dynident.identification.estimate.estimate import Estimate
    from dynident.identification.estimate.validation import Validation


def show(verdict: Verdict) -> None:
    """Print what speaks against an estimate, before its figures; nothing where nothing does and nothing was asked."""
    from dynident.results.verdict import NOT_CHECKED, cause_lines, criteria_table, headline, new_lines

    line = headline(verdict)
    if line:
        console.answer(line)
    for cause in cause_lines(verdict):
        console.answer(f"  error: {cause}")
    for told in new_lines(verdict):
        console.answer(told)
    if verdict.criteria:
        console.answer_table(criteria_table(verdict))
    if not verdict.is_checked:
        console.answer(NOT_CHECKED)
    if line or not verdict.is_checked:
        console.answer()


def show_rest(validation: Validation) -> None:
    """Print how the samples at rest lie to what static friction can hold, where that is known."""
    from dynident.results.text import rest_table

    if (table := rest_table(validation)) is not None:
        console.answer()
        console.answer_table(table, "samples at rest, against what static friction can hold")


def show_nominal(estimate: Estimate, test: Validation | None) -> None:
    """Print the errors and bodies of the robot model beside those identified."""
    from dynident.results.nominal import MEANINGS, errors_table, link_changes, links_table, missing_reason

    for title, validation in (("training data", estimate.train), ("test data", test)):
        if validation is not None and validation.nominal is not None and (test is None or validation is test):
            console.answer()
            console.answer_table(errors_table(validation), f"relative torque error beside the robot model, {title}")
    changes = link_changes(estimate)
    console.answer()
    if changes:
        console.answer_table(links_table(changes), f"links beside the robot model; the mass is {MEANINGS}")
    else:
        console.answer(missing_reason(estimate))


def show_ranges(estimate: Estimate) -> None:
    """Print the ranges of the masses, where they were asked for."""
    from dynident.results.plausibility import ranges_table

    table = ranges_table(estimate)
    if table.rows:
        console.answer_table(table, "masses that data and bounds allow")
        console.answer(table.note)


def show_short(
    estimate: Estimate, test: Validation | None, verdict: Verdict, more: str = "--full, --report FILE, --json"
) -> None:
    """Print an identification in one screen: the verdict, the errors, the links, the data, the warnings.

    Args:
        estimate: The estimate.
        test: Its figures on data that had no part in the fit.
        verdict: The verdict on it.
        more: Where all tables are.
    """
    from dynident.diagnosis.warnings import warnings_of
    from dynident.results import short_answer
    from dynident.results.verdict import cause_lines, criteria_table, headline, new_lines, reason_of

    console.answer(headline(verdict) or reason_of(verdict))
    for cause in cause_lines(verdict):
        console.answer(f"error: {cause}")
    for told in new_lines(verdict):
        console.answer(told)
    if verdict.criteria:
        console.answer_table(criteria_table(verdict))
    console.answer()
    for line in short_answer.error_lines(estimate, test):
        console.answer(line)
    table = short_answer.joints_table(estimate, test)
    console.answer_table(table, f"relative torque error, {'training' if test is None else 'test'} data")
    for line in (table.note, "", *short_answer.summary_lines(estimate, test, verdict.new is not None)):
        if line or line != table.note:
            console.answer(line)
    show_ranges(estimate)
    new = verdict.new
    named = "" if new is None or new.quality is None else new.warning  # its causes stand above
    warnings = [each for each in warnings_of(estimate, test, new) if each != named]
    for line in () if verdict.causes else short_answer.warning_lines(warnings, console.line_width()):
        console.answer(line)
    console.answer(f"all tables: {more}")


def next_step(place: str, estimate: Estimate, verdict: Verdict) -> str:
    """Return what to do with an estimate that has this verdict on test logs."""
    from dynident.exports.models import own_target

    if verdict.new_causes:
        return "next: correct the log, or the case that reads it (--case), and validate again"
    if verdict.causes:
        return "next: correct the cause, and dynident identify again"
    if (new := verdict.new) is not None and new.unlike:
        return f"next: {new.command if any(each['findings'] for each in new.quality or ()) else new.step}"
    if verdict.code:
        return "next: see where it errs (--full), record what is missing (dynident excite), and dynident identify again"
    target = own_target(estimate)
    lost = " --description FILE" if target.is_lost else ""
    return f"next: dynident export {quote(place)} --to {target.name} -o identified{target.ending}{lost}"
