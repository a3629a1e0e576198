"""The verdict on an estimate: whether findings of the log checks or acceptance criteria speak against it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import PurePath
from typing import Any

import numpy as np

from dynident.arrays import finite
from dynident.case.acceptance import CONDITIONS, CRITERIA, Acceptance
from dynident.diagnosis.finding import LOST, SHORT, UNLIKE_OTHERS, Severity, listed
from dynident.diagnosis.new_log import NewLog, unlike
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.plausibility import Plausibility
from dynident.identification.estimate.validation import Z_95, Validation

ACCEPTED, NOT_ACCEPTED, NOT_MET, NO_CRITERIA = "accepted", "not accepted", "criteria not met", "no criteria"

#: Share of the torque's variation at a joint that is left of it from which the joint is not explained.
LEFT_UNEXPLAINED = 0.9

#: Rise of the residual over the fit of inconsistent links from which consistent ones are why: twice.
RISES = 1.0

#: Share of the torque that the robot model's own masses leave, beside friction that is fitted, above which it may be
#: another robot's, and multiple of what those identified leave that it has to be.
MODEL_FAR, TIMES = 0.4, 3.0

#: What a finding is about that is of a fit and of no log.
OF_FIT = "the estimate"

#: What is written before findings beside another error.
SUSPECT = "the log checks found"


@dataclass(frozen=True)
class ErrorFinding:
    """A finding at error level of a log of the fit, or of the fit.

    Attributes:
        log: Name of the log, and of how many others it is true.
        name: What it is, such as ``torque sign``.
        joint: Joints that it is about; empty for the whole log.
        evidence: What was seen, with figures.
        remedy: What to do.
    """

    log: str
    name: str
    joint: str
    evidence: str
    remedy: str

    @property
    def title(self) -> str:
        """What was found, and at which joints."""
        return f"{self.name} ({self.joint})" if self.joint else self.name

    def __str__(self) -> str:
        return f"{self.log}: {self.title}: {self.evidence}; {self.remedy}"


@dataclass(frozen=True)
class AcceptanceCriterion:
    """An acceptance criterion, judged.

    Attributes:
        criterion: Its key.
        value: What the estimate has: a fraction, or a count of findings; None where it cannot be judged.
        limit: What it may have at most; None for a condition without a number.
        is_met: Whether it is met; one that cannot be judged is not.
        detail: The joint, the data or the reason.
    """

    criterion: str
    value: float | None
    limit: float | None
    is_met: bool
    detail: str

    def figures(self) -> dict[str, Any]:
        """Return the criterion as plain data."""
        return {**asdict(self), "meaning": CRITERIA[self.criterion]}


@dataclass(frozen=True)
class Verdict:
    """What speaks against an estimate.

    Attributes:
        causes: Findings of the log checks at error level.
        criteria: The acceptance criteria, judged; none where none are stated.
        is_checked: Whether the log checks were made on the logs of the fit.
        apart: Logs of the fit that parameters of the other ones do not explain, by a warning.
        warned: Other findings of the log checks at warning level, each name once with its joints.
        new: What logs that had no part in the fit say, where the verdict is on these.
        against: What relative errors say of the fit: a test far beyond the training, a robot model far from the data.
    """

    causes: tuple[ErrorFinding, ...]
    criteria: tuple[AcceptanceCriterion, ...]
    is_checked: bool
    apart: tuple[str, ...] = ()
    warned: tuple[str, ...] = ()
    new: NewLog | None = None
    against: tuple[str, ...] = ()

    @property
    def new_causes(self) -> tuple[ErrorFinding, ...]:
        """Those of the causes that are of new logs."""
        return () if self.new is None else _causes_in(self.new)

    @property
    def word(self) -> str:
        """``not accepted`` for a cause, ``criteria not met``, ``accepted``, or ``no criteria``."""
        if self.causes:
            return NOT_ACCEPTED
        if not self.criteria:
            return NO_CRITERIA
        return ACCEPTED if all(criterion.is_met for criterion in self.criteria) else NOT_MET

    @property
    def code(self) -> int:
        """Exit code: 4 for an error of the log checks, 3 for criteria that are not met, else 0."""
        return {NOT_ACCEPTED: 4, NOT_MET: 3}.get(self.word, 0)

    def figures(self) -> dict[str, Any]:
        """Return the verdict as plain data."""
        return {
            "word": self.word,
            "exit_code": self.code,
            "log_checks_made": self.is_checked,
            "causes": [asdict(cause) for cause in self.causes],
            "criteria": [criterion.figures() for criterion in self.criteria],
            **({} if self.new is None else {"new_log": self.new.figures()}),
        }


def errors_in(quality: Sequence[Mapping[str, Any]]) -> tuple[ErrorFinding, ...]:
    """Return the findings at error level of examinations as plain data; one of several logs is told once."""
    return _told_once(quality, "error", ("name", "joint"))


def check_lines(quality: Sequence[Mapping[str, Any]], severity: Severity = "warning") -> list[str]:
    """Return the findings at one level of examinations as plain data, each in one line; see :func:`errors_in`."""
    found = _told_once(quality, severity, ("name",))
    return [str(finding) for finding in sorted(found, key=lambda finding: finding.name != UNLIKE_OTHERS)]


def _told_once(
    quality: Sequence[Mapping[str, Any]], severity: Severity, keys: tuple[str, ...]
) -> tuple[ErrorFinding, ...]:
    """Return findings of one severity; of those that agree in ``keys`` the first, with the number of other logs."""
    names = [PurePath(str(each["path"])).name for each in quality]
    if len(set(names)) < len(names):
        names = [str(each["path"]) for each in quality]
    found: dict[tuple[str, ...], dict[str, Mapping[str, Any]]] = {}
    for name, each in zip(names, quality, strict=True):
        for finding in each["findings"]:
            if finding["severity"] == severity:
                found.setdefault(tuple(str(finding[key]) for key in keys), {}).setdefault(name, finding)
    told = []
    for logs in found.values():
        (log, first), others = next(iter(logs.items())), len(logs) - 1
        more = f" and {others} other log{'s' * (others > 1)}" if others else ""
        told.append(ErrorFinding(log + more, *(str(first[key]) for key in ("name", "joint", "evidence", "remedy"))))
    return tuple(told)


def quality_of(estimate: Estimate) -> Sequence[Mapping[str, Any]] | None:
    """Return what the checks found in the logs of an estimate, as plain data; None where they were not made."""
    return estimate.provenance.get("log_quality")


def is_too_short(estimate: Estimate) -> bool:
    """Return whether logs of an estimate are too short for one: what else is wrong, they do not tell."""
    told = (found for each in quality_of(estimate) or () for found in each["findings"])
    return any(found["name"] == SHORT and found["severity"] != "note" for found in told)


def _left_in_full(train: Validation) -> dict[str, float]:
    """Return the share of each joint's torque that is left, joints at rest against the model's torque as in motion.

    What static friction can hold explains nothing: a fit of nothing may have much of it.
    """
    names = [joint.name for joint in train.joints]
    if not len(train.time):
        return {joint.name: float(np.sqrt(1.0 - joint.r2)) for joint in train.joints if np.isfinite(joint.r2)}
    spread = np.std(train.measured, axis=0)
    left = np.sqrt(np.mean((train.measured - train.predicted) ** 2, axis=0))
    return {name: float(one / size) for name, one, size in zip(names, left, spread, strict=True) if size > 0}


def causes_against(estimate: Estimate, quality: Sequence[Mapping[str, Any]] | None = None) -> tuple[ErrorFinding, ...]:
    """Return what speaks against an estimate at error level: findings of the log checks, and a fit of nothing.

    Args:
        estimate: The estimate.
        quality: What the checks found in the logs of the fit; None for what its provenance has.
    """
    found = errors_in((quality_of(estimate) if quality is None else quality) or ())
    left = _left_in_full(estimate.train)
    poor = [share for share in left.values() if share > LEFT_UNEXPLAINED]
    if len(poor) > len(left) / 2:  # a few rows far out are those of some joints
        evidence = (
            f"at {len(poor)} of {len(left)} joints {100 * min(poor):.0f} % or more of the torque's variation is left "
            "on the data of the fit, about as much as of a constant torque"
        )
        remedy = "check columns, signs, units, gains and coupling"
        return (*found, ErrorFinding(OF_FIT, "nothing explained", "", evidence, remedy))
    rise = estimate.run.data().get("residual_above_unconstrained") or 0.0
    lost = {name: share for name, share in left.items() if share > LOST}
    if found or not lost or not rise > RISES:
        return found
    shares = listed([f"{name} {100 * one:.0f} %" for name, one in lost.items()])
    evidence = (
        f"links of positive mass density leave of the torque's variation on the data of the fit: {shares}; they make "
        f"its residual {1.0 + rise:.3g} times that of parameters without this condition"
    )
    remedy = "check units of positions and torques, gains and gear ratios, and lengths and axes of the robot model"
    return (ErrorFinding(OF_FIT, "inconsistent links", listed([*lost]), evidence, remedy),)


def verdict_of(
    estimate: Estimate,
    test: Validation | None = None,
    acceptance: Acceptance | None = None,
    quality: Sequence[Mapping[str, Any]] | None = None,
    is_held_out: bool = True,
    new: NewLog | None = None,
) -> Verdict:
    """Return the verdict on an estimate; with ``new`` that on logs which had no part in its fit.

    Args:
        estimate: The estimate.
        test: Its comparison with data that had no part in the fit; the criteria then hold there.
        acceptance: The criteria; None for those that its provenance has.
        quality: What the checks found in the logs of the fit; None for what its provenance has.
        is_held_out: Whether ``test`` had no part in the fit.
        new: What the logs of ``test`` say; causes are then theirs too, and of the log checks theirs count.
    """
    known = quality_of(estimate) if quality is None else quality
    causes = (*causes_against(estimate, known), *(() if new is None else _causes_in(new)))
    stated = Acceptance(estimate.provenance.get("accept") or {}) if acceptance is None else acceptance
    on = "training data" if test is None or not is_held_out else "test data"
    checked = known if new is None else new.quality
    judged = [_judged(name, limit, estimate, test, checked, on) for name, limit in stated.limits.items()]
    if new is not None:
        judged = [replace(one, detail=one.detail or on) if one.criterion == "log_checks" else one for one in judged]
    told = ["" if test is None or not is_held_out else unlike(estimate, test)[0], model_doubt(estimate)[0]]
    against = () if new is not None else tuple(filter(None, told))
    return Verdict(
        causes, tuple(judged), known is not None, logs_apart(known or ()), _warned(known or ()), new, against
    )


def model_doubt(estimate: Estimate) -> tuple[str, str]:
    """Return where the robot model's own masses leave far more torque than those identified, and what to check.

    On five real robots they leave 2 to 12 % beside friction that is fitted, on arms whose masses and inertias are off
    by a factor of 1.6 up to 20 %; with the model of another size of robot, or torques half as large, 42 % and more.
    Torques that are too large by a factor k leave 1 - 1 / k at most, so that twice is not told here.
    """
    nominal, found = estimate.train.nominal, estimate.train.total_relative_error
    if nominal is None or not nominal.friction_fitted > max(MODEL_FAR, TIMES * found):
        return "", ""
    told = f"the robot model's own masses leave {100 * nominal.friction_fitted:.0f} % of the torque, those identified "
    step = "make sure that it is the model of this robot, in its size, with its tool; and units and gains of the torque"
    return f"{told}{100 * found:.2g} %", step


def _warned(quality: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Return the names of findings at warning level, each once with its joints; logs apart are told elsewhere."""
    joints: dict[str, dict[str, None]] = {}
    for own in _told_once(quality, "warning", ("name", "joint")):
        joints.setdefault(own.name, {}).update(dict.fromkeys(filter(None, own.joint.split(", "))))
    return tuple(f"{name} ({', '.join(at)})" if at else name for name, at in joints.items() if name != UNLIKE_OTHERS)


def _causes_in(new: NewLog) -> tuple[ErrorFinding, ...]:
    """Return what speaks against an estimate in new logs at error level."""
    found = errors_in(new.quality or ())
    if found or not new.explains_nothing:
        return found
    evidence = f"the model is worse than a constant torque at {new.worthless[0]} of {new.worthless[1]} joints"
    remedy = "make sure that robot, mounting, load, columns and units are those of the training"
    return (ErrorFinding(new.name, "nothing explained", "", evidence, remedy),)


def logs_apart(quality: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Return the names of the logs that are said to be unlike the others, where a warning says so of one of them."""
    said = [(str(each["path"]), own) for each in quality for own in each["findings"] if own["name"] == UNLIKE_OTHERS]
    is_grave = any(own["severity"] == "warning" for _, own in said)
    return tuple(PurePath(path).name for path, _ in said) if is_grave else ()


def _judged(
    name: str,
    limit: float,
    estimate: Estimate,
    test: Validation | None,
    quality: Sequence[Mapping[str, Any]] | None,
    on: str,
) -> AcceptanceCriterion:
    data = estimate.train if test is None else test
    if name == "consistent":
        reasons = "; ".join(estimate.consistency.reasons[:2])
        return AcceptanceCriterion(name, None, None, estimate.consistency.consistent, reasons)
    if name == "plausible":
        facts = Plausibility.of(estimate.run)
        relaxed = [f"{one.bound} of {one.name}" for one in facts.contradicted if one.is_relaxed] if facts else []
        why = f"relaxed: {', '.join(relaxed)}" if relaxed else ""
        why = why if facts else "the fit has no bounds of plausible links: --bodies plausible"
        return AcceptanceCriterion(name, None, None, not why and estimate.consistency.consistent, why)
    if name == "log_checks":
        count = None if quality is None else len(errors_in(quality))
        detail = "the log checks were not made" if count is None else ""
        return AcceptanceCriterion(name, count, 0, count == 0, detail)
    value: float | None = data.total_relative_error
    detail = on
    if name == "joint_error":
        value, detail = _largest(data, np.array([fit.relative_error for fit in data.joints]), on)
    elif name == "interval":
        value, detail = _interval(estimate, test, on)
    elif name == "better_than_nominal":
        value, limit, detail = _against_nominal(data, on)
    below = False
    if value is not None and np.isfinite(value) and np.isfinite(limit):
        below = bool(value < limit if name in CONDITIONS else value <= limit)
    return AcceptanceCriterion(name, None if value is None else finite(value), finite(limit), below, detail)


def _largest(data: Validation, values: np.ndarray, on: str) -> tuple[float, str]:
    """Return the largest value of the joints with its joint; NaN where a joint has none."""
    worst = int(np.argmax(np.where(np.isnan(values), np.inf, values)))
    return float(values[worst]), f"{data.joints[worst].name}, {on}"


def _interval(estimate: Estimate, test: Validation | None, on: str) -> tuple[float | None, str]:
    """Return the largest half-width of the predicted torque's interval over the root mean square of the torque."""
    data = estimate.train if test is None else test
    place = estimate.envelope if test is None else test.departure
    if place is None:
        return None, "the file states no intervals of the torque"
    sizes = np.array([fit.rmse / fit.relative_error if fit.relative_error > 0 else np.nan for fit in data.joints])
    return _largest(data, Z_95 * np.asarray(place.bands) / sizes, on)


def _against_nominal(data: Validation, on: str) -> tuple[float | None, float, str]:
    """Return the total error, that of the nominal inertias with friction fitted alone, and where both were taken."""
    if data.nominal is None:
        return None, np.nan, "the nominal model cannot be compared: it states no inertias, or the log was streamed"
    return data.total_relative_error, data.nominal.friction_fitted, on
