"""Acceptance criteria: ``accept:`` of a case file and ``--accept`` of the command line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dynident.errors import BadOption, nearest
from dynident.model.documents.numbers import shown
from dynident.model.documents.sections import Section

#: Criteria that are a limit, as a share, with what they limit.
LIMITS = {
    "total_error": "total relative error of the torque",
    "joint_error": "largest relative error of the torque of a joint",
    "interval": "largest half-width of the 95 % interval of the predicted torque, over the size of the joint's torque",
}

#: Criteria that hold or do not, with what they ask.
CONDITIONS = {
    "better_than_nominal": "total relative error below that of the nominal inertias with friction fitted alone",
    "consistent": "physically consistent",
    "plausible": "links within bounds from the robot model, none of them relaxed",
    "log_checks": "no finding of the log checks at error level",
}

#: All criteria.
CRITERIA = {**LIMITS, **CONDITIONS}


@dataclass(frozen=True)
class Acceptance:
    """What an estimate must meet to be accepted.

    Attributes:
        limits: Limit of each criterion that has one, as a fraction; 1.0 stands for a condition.
    """

    limits: Mapping[str, float]

    def __bool__(self) -> bool:
        return bool(self.limits)


def acceptance_of(section: Section) -> Acceptance:
    """Return the criteria of a section of a case file.

    Raises:
        DescriptionError: A value that a criterion cannot have; with file, line and key.
    """
    limits: dict[str, float] = {}
    for key, value in section.values.items():
        limit, step = _limit(key, value)
        if step:
            raise section.place(key).error(f"{shown(value)} is not possible", step)
        if limit is not None:
            limits[key] = limit
    return Acceptance(limits)


def with_accept(stated: Acceptance, words: Sequence[str]) -> Acceptance:
    """Return criteria with those of ``--accept`` in place of, or beside, those of the case.

    Args:
        stated: Those of the case.
        words: Such as ``total_error=5%`` or ``consistent``.

    Raises:
        BadOption: An unknown criterion, or a value that it cannot have.
    """
    limits = dict(stated.limits)
    for word in words:
        key, equals, text = word.partition("=")
        if key not in CRITERIA:
            raise BadOption("--accept", word, f"known criteria: {', '.join(CRITERIA)}{nearest(key, CRITERIA)}")
        limit, step = _limit(key, text if equals else True)
        if step:
            raise BadOption("--accept", word, step)
        limits.pop(key, None)
        if limit is not None:
            limits[key] = limit
    return Acceptance(limits)


def _limit(key: str, value: object) -> tuple[float | None, str]:
    """Return the limit of a criterion, None where it is not asked for, and what to write where it is none."""
    if key in CONDITIONS:
        word = str(value).strip().lower()
        known = {"true": 1.0, "yes": 1.0, "false": None, "no": None}
        return (known[word], "") if word in known else (None, f"write {key}: true, or leave it out")
    text = str(value).strip()
    step = f"write a share above 0, such as {key}: 0.05 or {key}: 5 %"
    percent = text.endswith("%")
    try:
        number = float(text.rstrip("% ")) * (0.01 if percent else 1.0)
    except ValueError:
        return None, step
    if not 0 < number <= 10 or (number > 1 and not percent):
        return None, step
    return number, ""
