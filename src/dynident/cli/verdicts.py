"""The verdict on an estimate and its nominal model in the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynident.diagnosis.verdict import Verdict
    from dynident.identification.estimate.estimate import Estimate
    from dynident.identification.estimate.validation import Validation


def show(verdict: Verdict) -> None:
    """Print what speaks against an estimate, before its figures; nothing where nothing does and nothing was asked."""
    from dynident.cli import console
    from dynident.results.verdict import NOT_CHECKED, cause_lines, criteria_table, headline

    line = headline(verdict)
    if line:
        console.answer(line)
    for cause in cause_lines(verdict):
        console.answer(f"  error: {cause}")
    if verdict.criteria:
        console.answer_table(criteria_table(verdict))
    if not verdict.is_checked:
        console.answer(NOT_CHECKED)
    if line or not verdict.is_checked:
        console.answer()


def show_nominal(estimate: Estimate, test: Validation | None) -> None:
    """Print the errors and bodies of the robot model beside those identified."""
    from dynident.cli import console
    from dynident.results.nominal import errors_table, link_changes, links_table, missing_reason

    for title, validation in (("training data", estimate.train), ("test data", test)):
        if validation is not None and validation.nominal is not None and (test is None or validation is test):
            console.answer()
            console.answer_table(errors_table(validation), f"relative torque error beside the robot model, {title}")
    changes = link_changes(estimate)
    console.answer()
    if changes:
        console.answer_table(links_table(changes), "links beside the robot model")
    else:
        console.answer(missing_reason(estimate))
