"""What a report is about: the one value that all its sections see."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from dynident.data.log import Log, Source
from dynident.diagnosis.verdict import Verdict, verdict_of
from dynident.errors import BadOption, LogMismatch
from dynident.exports.models.proving.followed_motion import MotionProof
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.results.plan_view import PlanView
from dynident.results.text import label

#: Figures of so many data sets are drawn; the tables have all of them.
MOST_DRAWN = 4

_MOST_NAMED = 3


@dataclass(frozen=True)
class Comparison:
    """Several estimators on the same data.

    Attributes:
        rows: One per estimator; keys are the headings of the columns (with units), values numbers, text, yes and no.
        traces: Objective after each iteration, by name, for those that search.
        optimum: The least objective possible, where it is known.
        objective: What the traces show, with its unit.
    """

    rows: tuple[Mapping[str, Any], ...] = ()
    traces: Mapping[str, Sequence[float]] = field(default_factory=dict)
    optimum: float | None = None
    objective: str = "objective"


@dataclass(frozen=True)
class Dataset:
    """A comparison of measured and predicted torque, with the words that say which.

    Attributes:
        name: Such as ``Training`` or ``Test 1``.
        validation: The comparison; it has signals.
        held_out: Whether the fit did not see it.
    """

    name: str
    validation: Validation
    held_out: bool

    @property
    def logs(self) -> str:
        """Names of its logs in short: files without their folder where that tells them apart, the first of many."""
        names = self.validation.logs
        files = [re.split(r"[/\\]", name.rstrip("/\\"))[-1] for name in names]
        shown = [label(name) for name in (files if len(set(files)) == len(set(names)) else names)]
        more = f" and {len(shown) - _MOST_NAMED} more" if len(shown) > _MOST_NAMED else ""
        return ", ".join(shown[:_MOST_NAMED]) + more

    @property
    def rows(self) -> tuple[slice, ...]:
        """The samples of each log among the signals."""
        starts = self.validation.starts
        return tuple(slice(a, b) for a, b in zip(starts, (*starts[1:], len(self.validation.time)), strict=True))

    @property
    def thinned(self) -> bool:
        """Whether the signals are only some of the rows, as an estimate file keeps them; figures are over all."""
        return len(self.validation.time) < self.validation.samples

    @property
    def remark(self) -> str:
        """What has to be said about thinned signals; empty where all rows are there."""
        count = len(self.validation.time)
        return f"Drawn from {count} of {self.validation.samples} rows, as the estimate file keeps them." * self.thinned


@dataclass(frozen=True)
class Subject:
    """What a report is about.

    Attributes:
        estimate: The estimate.
        tests: Comparisons with logs that the fit did not see.
        comparison: Other estimators beside it.
        trajectories: Reference motions by name: logs with time, q and, where known, dq.
        command: The command line of the report; it stands below that of the estimate, which its provenance has.
        sources: Files of the tests; those of the fit are in the estimate's provenance.
        plan: The motion that was designed, with its check; None for none.
        log_quality: Findings of the log checks on these logs, as plain data; empty for what the provenance has.
        why_no_test: Why there is no test although the fit may have kept rows apart; for a sentence of the verdict.
        motion: How the identified model follows the motion of a log in simulation; None where nothing was simulated.

    Raises:
        BadOption: The plan has other joints than the robot.
        LogMismatch: A test or a trajectory has other joints than the robot.
    """

    estimate: Estimate
    tests: tuple[Validation, ...] = ()
    comparison: Comparison = field(default_factory=Comparison)
    trajectories: Mapping[str, Log] = field(default_factory=dict)
    command: str = ""
    sources: tuple[Source, ...] = ()
    plan: PlanView | None = None
    log_quality: tuple[Mapping[str, Any], ...] = ()
    why_no_test: str = ""
    motion: MotionProof | None = None

    def __post_init__(self) -> None:
        joints = self.estimate.model.robot.joint_names
        for validation in (self.estimate.train, *self.tests):
            names = tuple(fit.name for fit in validation.joints)
            if names != joints:
                step = f"the robot has {', '.join(joints)}; validate with the estimate that the report is about"
                raise LogMismatch(", ".join(validation.logs), f"the joints {', '.join(names)}", step)
        ordered = {name: log.ordered(joints) for name, log in self.trajectories.items()}
        object.__setattr__(self, "trajectories", ordered)
        if self.plan is not None and self.plan.plan.joints != joints:
            step = f"its joints are {', '.join(self.plan.plan.joints)}, those of the estimate {', '.join(joints)}"
            raise BadOption("plan", self.plan.source or self.plan.plan.robot, f"{step}; give the plan of this robot")

    @property
    def verdict(self) -> Verdict:
        """The verdict on the estimate, its criteria judged on the worst of the tests."""
        quality = self.log_quality or None
        worst = max(self.tests, key=lambda test: test.total_relative_error, default=None)
        return verdict_of(self.estimate, worst, quality=quality)

    @property
    def datasets(self) -> tuple[Dataset, ...]:
        """Training first, then the tests, those without rows left out."""
        return tuple(self._named())

    @property
    def held_out(self) -> tuple[Dataset, ...]:
        """The tests that have rows."""
        return tuple(dataset for dataset in self.datasets if dataset.held_out)

    def _named(self) -> Iterator[Dataset]:
        if len(self.estimate.train.time):
            yield Dataset("Training", self.estimate.train, held_out=False)
        for number, test in enumerate(self.tests, start=1):
            if len(test.time):
                yield Dataset(f"Test {number}" if len(self.tests) > 1 else "Test", test, held_out=True)
