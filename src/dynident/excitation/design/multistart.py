"""All starts of an excitation design, in this process or by workers; the result does not depend on how many."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass

from dynident.errors import BadOption, PoolFailed
from dynident.excitation.design.design_problem import DesignProblem
from dynident.excitation.design.start import News, StartResult, run_start
from dynident.workers.pool import Pool, Tell
from dynident.workers.processes import local_pool


@dataclass(frozen=True)
class SearchState:
    """How far a search is.

    Attributes:
        start: Number of the start that the news is of, counted from 1.
        starts: Number of starts.
        finished: Number of starts that are done.
        evaluations: Evaluations so far, over all starts.
        objective: Smoothed objective of the last iterate of this start.
        figure: The criterion itself at the best motion of this start so far that keeps its bounds; NaN before.
        used: Greatest share of a bound that the last iterate uses; of a start that is done, its best motion.
        worst: What that bound is about, such as ``torque of joint2``.
        seconds: Time since the search began.
    """

    start: int
    starts: int
    finished: int
    evaluations: int
    objective: float
    figure: float
    used: float
    worst: str
    seconds: float


@dataclass(frozen=True)
class MultistartSearch:
    """What is to be searched, and how far.

    Attributes:
        problem: Criterion and limits.
        starts: Number of starts.
        seed: Of the starts.
        time_limit: Time in s after which the best so far is taken.
        jobs: Number of processes; 1 for this one, None for one a core.
        done: Starts that are known already, by number.
        pool: Where starts are run in place of ``jobs`` processes.
    """

    problem: DesignProblem
    starts: int
    seed: int
    time_limit: float
    jobs: int | None
    done: Mapping[int, StartResult]
    pool: Pool | None = None


def run_starts(
    search: MultistartSearch, progress: Callable[[SearchState], None], keep: Callable[[StartResult], None]
) -> list[StartResult]:
    """Return what the starts found, in their order.

    Starts run to their end one after the other, ``jobs`` at a time; the time limit cuts those that run, and those after
    them are missing. Ctrl-C ends the workers within a fraction of a second and is raised again.

    Args:
        search: What is to be searched.
        progress: Called now and then, and when a start is done.
        keep: Given every start that ended by itself, when it does.

    Raises:
        BadOption: Fewer jobs than one.
        PoolFailed: A worker died, or none can be had.
    """
    found = {k: search.done[k] for k in range(1, search.starts + 1) if k in search.done}
    watch = _Watch(search, progress, dict(found))
    jobs = min(_checked_jobs(search.jobs), search.starts - len(found))
    pool = search.pool or local_pool(max(jobs, 1))
    with closing(pool.run(_Starts(search.problem, search.seed), _tasks(search, watch), news=watch.tell)) as ended:
        for done in ended:
            if done.failure:
                step = "give --jobs 1, or look whether the machine ran out of memory"
                raise PoolFailed("excitation design", f"a worker process died ({done.failure})", step)
            result: StartResult = done.result
            found[result.start] = result
            if result.whole:  # kept before it is told: who stops the search at the news does not lose the start
                keep(result)
            watch.finished(result)
    return [found[k] for k in sorted(found)]


class _Watch:
    """The clock and the news of all starts.

    Attributes:
        has_some: Whether there is a motion to be taken when the time is over.
    """

    def __init__(
        self, search: MultistartSearch, progress: Callable[[SearchState], None], found: dict[int, StartResult]
    ) -> None:
        self._search, self._progress, self._begun = search, progress, time.perf_counter()
        self._counts = dict.fromkeys(found, 0)  # those of an earlier run do not count as this run's work
        self._finished = len(found)
        self.has_some = bool(found)
        self._last: dict[int, News] = {}

    def left(self) -> float:
        """Return the time in s until the limit, not below 0."""
        return max(self._search.time_limit - (time.perf_counter() - self._begun), 0.0)

    def tell(self, news: News) -> None:
        """Pass the news of a start on."""
        self._counts[news.start], self._last[news.start] = news.evaluations, news
        self._progress(self._state(news))

    def finished(self, result: StartResult) -> None:
        """Count a start as done."""
        self._finished += 1
        self.has_some = self.has_some or bool(result.candidates)
        self._counts[result.start] = result.evaluations
        larger = self._search.problem.criterion.larger_is_better
        figures = [-one.figure if larger else one.figure for one in result.candidates]
        best = (max if larger else min)(figures) if figures else float("nan")
        last = self._last.get(result.start)
        objective = float("nan") if last is None else last.objective
        self._progress(self._state(News(result.start, result.evaluations, objective, result.used, result.worst, best)))

    def _state(self, news: News) -> SearchState:
        return SearchState(
            start=news.start,
            starts=self._search.starts,
            finished=self._finished,
            evaluations=sum(self._counts.values()),
            objective=news.objective,
            figure=news.figure,
            used=news.used,
            worst=news.worst,
            seconds=time.perf_counter() - self._begun,
        )


def _tasks(search: MultistartSearch, watch: _Watch) -> Iterator[tuple[int, float]]:
    """Yield the starts that are missing and the time that each has, until there is no time left."""
    for number in range(1, search.starts + 1):
        if number in search.done:
            continue
        if watch.has_some and watch.left() == 0.0:
            return
        yield number, watch.left()


@dataclass(frozen=True, eq=False)
class _Starts:
    """Starts of a search as pools take them; a task is the number of a start and its time in s."""

    problem: DesignProblem
    seed: int

    def prepare(self) -> None:
        """Do nothing: a start has its time from when it is handed out."""

    def do(self, task: tuple[int, float], tell: Tell) -> StartResult:
        """Return what a start finds."""
        number, seconds = task
        return run_start(self.problem, number, self.seed, seconds, tell)


def _checked_jobs(jobs: int | None) -> int:
    """Return the number of processes: that given, or one for each core that this process may use.

    Raises:
        BadOption: Fewer than one.
    """
    if jobs is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if jobs < 1:
        raise BadOption("jobs", jobs, "give 1 or more")
    return jobs
