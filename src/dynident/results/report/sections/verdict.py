"""The verdict: what the report comes to, in plain words, three numbers, and the torques of each joint in small."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from dynident.diagnosis.verdict import ACCEPTED, NO_CRITERIA, Verdict
from dynident.diagnosis.warnings import warnings_of
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.plausibility import Plausibility
from dynident.results.figures import error_chart, small_torque_chart
from dynident.results.plausibility import links_of_unknown_mass
from dynident.results.report.sections.base import Drawing, ReportSection, drawn
from dynident.results.report.subject import Dataset, Subject
from dynident.results.short_answer import not_significant, of_training
from dynident.results.text import format_percent, label, pretty_unit, rest_words, shorten
from dynident.results.verdict import NOT_CHECKED, cause_lines, criteria_table, reason_of

#: How the words of a verdict that speak not against the estimate are coloured.
_TONES = {ACCEPTED: "good", NO_CRITERIA: "fair"}

_WITHOUT_PRAISE = {"good": "fair"}

_NO_TEST = "no test on other data"

_LOGS = 3  # in a small figure

_NAME = (8, 12)  # first and last letters of the name of a joint above a small figure

_REASONS = 3  # of what breaks consistency, in full


@dataclass(frozen=True)
class VerdictAnswer:
    """One of the numbers that matter.

    Attributes:
        value: The number.
        meaning: What it is.
        detail: What to know with it.
        tone: ``good``, ``fair`` or ``bad``.
    """

    value: str
    meaning: str
    detail: str
    tone: str


@dataclass(frozen=True)
class VerdictSection(ReportSection):
    """Verdict, test error, physical consistency, precision of the parameters, and the torques in small."""

    title: ClassVar = "Verdict"

    def context(self, subject: Subject) -> dict[str, Any]:
        estimate, judged = subject.estimate, subject.verdict
        answers = [_prediction(subject), _consistency(estimate), _knowledge(estimate)]
        if not _is_praised(judged):
            answers = [replace(answer, tone=_WITHOUT_PRAISE.get(answer.tone, answer.tone)) for answer in answers]
        shown = _worst_data(subject)
        return {
            "tone": _TONES.get(judged.word, "bad"),
            "word": _word(judged),
            "reason": reason_of(judged),
            "data": shown,
            "caption": "" if shown is None else _caption(shown),
            "errors": None if shown is None else _errors(shown),
            "plots": [] if shown is None else _small_torques(shown),
            "causes": cause_lines(judged),
            "criteria": criteria_table(judged) if judged.criteria else None,
            "unchecked": "" if judged.is_checked else NOT_CHECKED,
            "answers": answers,
            "sentences": [*_about_prediction(subject), *_about_robot(subject), *_about_parameters(estimate)],
        }


def _word(judged: Verdict) -> str:
    """Return the verdict in a word or two; without acceptance criteria what came of the log checks."""
    if judged.word != NO_CRITERIA:
        return judged.word.capitalize()
    if not judged.is_checked:
        return "Logs not checked"
    return "Log checks passed" if _is_praised(judged) else "Warnings"


def _is_praised(judged: Verdict) -> bool:
    """Return whether figures may be called good: not those of an estimate that is not accepted, or has warnings."""
    return judged.word in _TONES and not (judged.warned or judged.apart or judged.against)


def _worst_data(subject: Subject) -> Dataset | None:
    """Return the test with the largest error, the training data where there is no test, or None without any."""
    tests = subject.held_out or subject.datasets[:1]
    return max(tests, key=lambda data: np.nan_to_num(data.validation.total_relative_error, nan=-1.0), default=None)


def _errors(data: Dataset) -> Drawing:
    """Draw the relative error of each joint and in total, that of the robot model's inertias beside it."""
    found = data.validation
    sets = [("identified", np.array([*(fit.relative_error for fit in found.joints), found.total_relative_error]))]
    if found.nominal is not None:
        nominal = np.array([*found.nominal.joints_friction_fitted, found.nominal.friction_fitted])
        sets.insert(0, ("robot model, friction fitted", nominal))
    title = f"Relative torque error, {'test' if data.held_out else 'training'} data"
    return drawn(error_chart(title, [*(fit.name for fit in found.joints), "total"], sets), "errors")


def _caption(data: Dataset) -> str:
    """Return what the small figures show, with the unit where all joints have the same."""
    logs, units = data.validation.logs, {fit.unit for fit in data.validation.joints}
    part = f" (drawn: the first {_LOGS} of {len(logs)} logs)" if len(logs) > _LOGS else ""
    unit = f", in {pretty_unit(units.pop())}" if len(units) == 1 else ""
    return f"{data.logs}{part}{unit} over time in s."


def _small_torques(data: Dataset) -> list[Drawing]:
    v = data.validation
    starts, rows = v.starts[:_LOGS], slice(0, v.starts[_LOGS] if len(v.starts) > _LOGS else None)
    mixed = len({fit.unit for fit in v.joints}) > 1
    return [
        drawn(
            small_torque_chart(
                f"{_both_ends(label(fit.name))}{f' [{pretty_unit(fit.unit)}]' if mixed else ''}, "
                f"{format_percent(fit.relative_error)}",
                *(fit.unit, v.time[rows], v.measured[rows, i], v.predicted[rows, i], starts, v.residual[rows, i]),
            ),
            *("overview", fit.name),
        )
        for i, fit in enumerate(v.joints)
    ]


def _both_ends(name: str) -> str:
    """Return a long name without its middle: names of joints differ at their ends."""
    first, last = _NAME
    return name if len(name) <= first + last else f"{name[:first]}…{name[-last:]}"


def _worst(subject: Subject) -> float:
    """Return the largest total relative error of the tests; NaN where none has one."""
    errors = [dataset.validation.total_relative_error for dataset in subject.held_out]
    known = [error for error in errors if np.isfinite(error)]
    return max(known, default=float("nan"))


def _prediction(subject: Subject) -> VerdictAnswer:
    train = subject.estimate.train.total_relative_error
    if not subject.held_out:
        return VerdictAnswer(format_percent(train), "training error of the torque", _NO_TEST, "fair")
    worst = _worst(subject)
    largest = f", largest of {len(subject.held_out)} tests" if len(subject.held_out) > 1 else ""
    meaning = f"test error of the torque{largest}"
    return VerdictAnswer(format_percent(worst), meaning, f"training error: {format_percent(train)}", tone(worst))


def _about_prediction(subject: Subject) -> list[str]:
    estimate = subject.estimate
    train = estimate.train.total_relative_error
    if not subject.held_out:
        return [f"The training error is {format_percent(train)} of the measured torque.", _untested(subject)]
    worst = _worst(subject)
    is_told = _is_praised(subject.verdict) or tone(worst) != "good"
    graded = f": {grade(worst)}" if is_told else ""
    said = [f"The test error is {format_percent(worst)} of the measured torque{graded}."]
    tests = [dataset.validation for dataset in subject.held_out]
    resting = [test for test in tests if test.rests]
    moving = max((test.moving_relative_error for test in resting), default=np.nan)
    if moving < 0.9 * worst or any(test.held is not None for test in resting):
        also = of_training(estimate.train, resting[0])
        said.append(f"It {rest_words(resting[0])}; without them it is {format_percent(moving)}{also}.")
    if np.isfinite(worst) and worst > GAP * train > 0:
        said.append(
            f"That is {worst / train:.1f} times the training error: see in the residuals whether the "
            "tests leave the training range, or only have smaller torques or more noise."
        )
    return said


def _untested(subject: Subject) -> str:
    """Return why there is no test and what to do about it."""
    why = label(subject.why_no_test) if subject.why_no_test else ""
    splits = (str(log.get("split", "")) for log in subject.estimate.provenance.get("logs", ()))
    split = next(filter(None, splits), "")
    flatters = "training error is optimistic"
    if split:
        also = f" ({why})" if why else ""
        return (
            f"The fit has kept a part of its log apart, which this report does not use{also}: test on it with --test "
            f"LOG --split {split}, since {flatters}."
        )
    lead = f"No test can be repeated ({why})" if why else "No log was held out"
    return f"{lead}, and {flatters}: record a second, different motion and test on it with --test LOG."


def _consistency(estimate: Estimate) -> VerdictAnswer:
    found = estimate.consistency
    if links := found.consistent and links_of_unknown_mass(estimate.model.robot, Plausibility.of(estimate.run)):
        detail = f"but masses of {links} are not known: its bodies are one choice of many"
        return VerdictAnswer("Yes", "physically consistent", detail, "fair")
    if found.consistent:
        return VerdictAnswer("Yes", "physically consistent", "pseudo-inertia positive definite for each link", "good")
    count = len(found.reasons)
    return VerdictAnswer("No", "physically consistent", f"{count} condition{'s' if count != 1 else ''} broken", "bad")


def _about_robot(subject: Subject) -> list[str]:
    estimate, found = subject.estimate, subject.estimate.consistency
    if found.consistent:
        said = ["The parameters are physically consistent: the mass matrix is positive definite in every posture."]
        seen = [warnings_of(estimate, test) for test in (None, *subject.tests)]
        return said + [f"Warning: {label(text)}." for text in dict.fromkeys(t for texts in seen for t in texts)]
    reasons = "; ".join(label(reason) for reason in found.reasons[:_REASONS])
    more = len(found.reasons) - _REASONS
    return [
        f"The parameters are physically inconsistent ({reasons}{f' and {more} more' if more > 0 else ''}): use the "
        "model to predict torques near the recorded motions, not to simulate, or identify with a physically consistent "
        "estimator."
    ]


def _knowledge(estimate: Estimate) -> VerdictAnswer:
    relative = np.where(np.isfinite(estimate.relative_std), estimate.relative_std, 0.0)
    zero = np.flatnonzero(~np.isfinite(estimate.relative_std))
    known = int(np.sum(relative <= WELL_KNOWN)) - len(zero)
    share = known / max(len(relative), 1)
    worst = int(np.argmax(relative)) if len(relative) else -1
    said = [f"largest: {format_percent(relative[worst])}, {_short(estimate, worst)}"] if relative.any() else []
    said += [f"{len(zero)} at 0, such as {_short(estimate, zero[0])}"] if len(zero) else []
    detail = "; ".join(said)
    meaning = f"base parameters with relative std up to {format_percent(WELL_KNOWN)}"
    return VerdictAnswer(f"{known} of {len(relative)}", meaning, detail, "good" if share >= 0.8 else "fair")


def _about_parameters(estimate: Estimate) -> list[str]:
    lost = not_significant(estimate)
    if not lost:
        return ["Every base parameter is significant at 95 %."]
    names = ", ".join(_short(estimate, k) for k in lost[:_REASONS])
    more = len(lost) - _REASONS
    return [
        f"{len(lost)} of {estimate.base.count} base parameters are not significant at 95 %: {names}"
        f"{f' and {more} more' if more > 0 else ''}. They have little effect on the recorded torques, and on those of "
        "similar motions. Do not rely on their values."
    ]


def _short(estimate: Estimate, row: int) -> str:
    """Return the leading term of a base parameter, with an ellipsis where it has more."""
    base = estimate.base
    lead = label(base.parameters[int(base.independent[row])].name)
    return shorten(lead, 40) + (" + …" if np.count_nonzero(base.matrix[row]) > 1 else "")


#: A base parameter is well known when its standard deviation is at most this share of its value.
WELL_KNOWN = 0.10

#: Total relative error up to which a fit is called so.
GRADES = ((0.05, "very good"), (0.10, "good"), (0.20, "usable"))

#: A test error above this many training errors deserves a word.
GAP = 1.5


def grade(relative_error: float) -> str:
    """Return a word for a total relative error; ``not known`` for NaN."""
    if np.isnan(relative_error):
        return "not known"
    return next((word for limit, word in GRADES if relative_error <= limit), "poor")


def tone(relative_error: float) -> str:
    """Return ``good``, ``fair`` or ``bad`` for a total relative error."""
    return {"very good": "good", "good": "good", "usable": "fair"}.get(grade(relative_error), "bad")
