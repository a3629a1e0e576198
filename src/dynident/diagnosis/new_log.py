"""What a log that had no part in a fit says of the estimate: as the training, or far beyond it, and why."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import PurePath
from typing import Any

from dynident.diagnosis.constant_residual import constant_residual
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Fit, Validation

#: Residual of a joint on test data over that on training data above which the test log is told to be another one (twice
#: as fast a motion of a real arm had 2.6); the share of the torque that it has to be, below which the first has to be
#: larger in proportion; and the ratio above which a motion beyond the fit is a less likely cause.
UNLIKE, UNLIKE_ERROR, GRAVELY = 4.0, 0.15, 10.0

#: Names of logs that are written out, and of those that have no file.
NAMED, IN_MEMORY = 3, ("arrays", "simulated log")

Quality = Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class NewLog:
    """What logs say of an estimate that they had no part in.

    Attributes:
        name: Of the log, or of several together.
        error: Total relative error.
        trained: The same of the training data.
        unlike: Where its residual is far beyond that of the training; empty where it is not.
        step: What to do about that.
        worthless: At how many of its joints, of how many, the model is worse than a constant.
        is_still: Whether no joint moves in it.
        resting: Joints that rest in it all along, which the training moves.
        quality: What the log checks found in it against the estimate; None where they were not made.
        command: The command that looks for causes.
    """

    name: str
    error: float
    trained: float
    unlike: str
    step: str
    worthless: tuple[int, int]
    is_still: bool
    resting: tuple[str, ...]
    quality: Quality | None
    command: str

    @property
    def warning(self) -> str:
        """Where its residual is far beyond that of the training, and what to do; empty where it is not."""
        return f"{self.unlike}: {self.step}" if self.unlike else ""

    @property
    def explains_nothing(self) -> bool:
        """Whether the model is worse than a constant at most joints."""
        return 2 * self.worthless[0] > self.worthless[1]

    def figures(self) -> dict[str, Any]:
        """Return it as plain data."""
        findings = None if self.quality is None else [own for each in self.quality for own in each["findings"]]
        found = {name: value for name, value in asdict(self).items() if name != "quality"}
        return {**found, "worthless": self.worthless[0], "findings": findings}


def new_log(
    estimate: Estimate, test: Validation, command: str, check: Callable[[], Quality], is_asked: bool = False
) -> NewLog:
    """Return what a comparison with new logs says; their checks are made where the error asks for a cause.

    Args:
        estimate: The estimate.
        test: Its comparison with the logs.
        command: See :func:`check_command`.
        check: Makes the log checks against the estimate.
        is_asked: Whether they are made in any case.
    """
    told, step = unlike(estimate, test)  # without the command: where it is told, the checks are made
    worthless = sum(map(_is_worthless, test.joints, estimate.train.joints)), len(test.joints)
    names = [PurePath(name).name for name in test.logs]
    name = ", ".join(names) if len(names) <= NAMED else f"{names[0]} and {len(names) - 1} more"
    error, trained = test.total_relative_error, estimate.train.total_relative_error
    quality = check() if told or 2 * worthless[0] > worthless[1] or is_asked else None
    is_still = not any(fit.samples for fit in test.moving)
    pairs = zip(test.moving, estimate.train.moving, strict=True)
    resting = tuple(now.name for now, then in pairs if then.samples and not now.samples)
    return NewLog(name, error, trained, told, step, worthless, is_still, resting, quality, command)


def _is_worthless(now: Fit, then: Fit) -> bool:
    """Return whether the model is worse than a constant at a joint; one that merely rests is not counted."""
    return now.r2 < 0 and now.relative_error > UNLIKE_ERROR and now.rmse > UNLIKE * then.rmse


def check_command(logs: Sequence[str], place: str = "ESTIMATE", case: str = "") -> str:
    """Return the command that looks for what is another one in some logs than in those of an estimate.

    Args:
        logs: Their names; those of the memory have no file.
        place: The file of the estimate.
        case: The case file that reads them.
    """
    files = ["LOG" if name in IN_MEMORY else name for name in logs]
    return f"dynident check {' '.join(map(shlex.quote, (case or 'CASE', *files)))} --against {shlex.quote(place)}"


def unlike(estimate: Estimate, test: Validation, command: str = "") -> tuple[str, str]:
    """Say where a log has another residual than the fit, and what to do; empty where it has none.

    Another load, robot or unit is why, or a motion far from that of the fit. ``command`` looks for the cause; empty
    where that has been done.
    """
    signals = (test.measured, test.predicted, test.dq)
    if constant := constant_residual(estimate, *signals, test.standstill, test.deviations):
        told, _, step = constant.partition(": ")
        return told, step
    pairs = zip(test.moving, estimate.train.moving, strict=True)
    times = {now.name: now.rmse / then.rmse for now, then in pairs if then.rmse and now.relative_error > 0}
    least = {now.name: UNLIKE * max(1.0, UNLIKE_ERROR / now.relative_error) for now in test.moving if now.name in times}
    times = {name: ratio for name, ratio in times.items() if ratio > least[name]}
    if not times:
        return "", ""
    joint = max(times, key=lambda name: times[name])
    told = f"{joint}: the test residual is {times[joint]:.0f} times that of the training data"
    look = [f"'{command}' looks for a load, a unit or another robot as its cause"] if command else []
    weigh = "'dynident payload' weighs a load"
    if test.departure is not None and estimate.envelope is not None and test.departure.leaves():
        motion = "it leaves the ranges of the fit, train on such a log as well"
        if times[joint] < GRAVELY:
            return told, "; or ".join((motion, *look))
        return told, "; ".join((*look, weigh, motion))
    return told, "; ".join((*look, weigh))
