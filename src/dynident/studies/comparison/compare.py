"""compare: one problem, many estimators, one figure of each on logs that none has seen."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import preprocess
from dynident.errors import LogMismatch
from dynident.identification.problem.problem import Problem
from dynident.studies.comparison.contest import Contest, Method, Outcome
from dynident.workers.processes import Tell, local_pool


def contest_of(problem: Problem, tests: Sequence[Log] = (), truth: Array | None = None) -> Contest:
    """Return a contest with test logs prepared as those of the problem.

    Args:
        problem: The problem, of :func:`dynident.identification.identify.pose`.
        tests: Raw logs that the fit has not seen.
        truth: Standard parameters behind the logs, shape (p,), where they are known.

    Raises:
        LogMismatch: A test log does not fit the robot, is too short, or has no torques.
    """
    how = problem.preprocessing
    prepared = tuple(preprocess(log.ordered(problem.model.robot.joint_names), how) for log in tests)
    for log in prepared:
        if log.log.torque is None:
            raise LogMismatch(log.log.name, "no torques to compare with", "map torque columns in the case file")
    return Contest(problem, prepared, truth)


def compare(
    contest: Contest,
    methods: Sequence[Method],
    *,
    time_limit: float | None = None,
    jobs: int = 1,
    progress: Callable[[str], None] = lambda step: None,
) -> Generator[Outcome, None, None]:
    """Yield the outcome of each method when it is done; what is done stays done when the rest is broken off.

    Without a time limit and with one job all methods run in this process, one after the other. Else each runs in a
    process of its own kind, that is ended at the limit; figures are the same, times are those of processes that run
    side by side, and every process holds the problem.

    Args:
        contest: What they are given.
        methods: Who takes part.
        time_limit: Wall-clock time in s of a method, in which it is fitted and tested.
        jobs: Processes that run at a time.
        progress: Called with each step in words.

    Raises:
        BadOption: A time limit or a number of jobs that cannot be.
        PoolFailed: Worker processes cannot be started.
    """
    numbers = {id(method): number for number, method in enumerate(methods, start=1)}

    def begins(method: Method) -> None:
        progress(f"{method.label} ({numbers[id(method)]} of {len(methods)})")

    pool = local_pool(jobs, time_limit)
    with closing(pool.run(_Attempts(contest), methods, time_limit=time_limit, begins=begins)) as ended:
        for done in ended:
            yield done.result or Outcome(done.task.label, done.seconds, failure=done.failure)


@dataclass(frozen=True, eq=False)
class _Attempts:
    """Methods of a contest as pools take them."""

    contest: Contest

    def prepare(self) -> None:
        """Compile what all methods share before the clock of the first one begins."""
        _ = self.contest.least

    def do(self, task: Method, tell: Tell) -> Outcome:
        """Return what a method comes to."""
        return self.contest.attempt(task)


def ranked(outcomes: Sequence[Outcome]) -> list[Outcome]:
    """Return outcomes by their error on test logs (on training logs where there are none), failures last."""
    return sorted(outcomes, key=lambda outcome: outcome.figure)
