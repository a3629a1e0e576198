"""All starts of an excitation design, in this process or in several; the result does not depend on how many."""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any

from threadpoolctl import threadpool_limits

from dynident.errors import BadOption, SolverFailed
from dynident.experiment.design.design_problem import DesignProblem
from dynident.experiment.design.start import News, StartResult, run_start
from dynident.workers import end_with_parent

#: Time in s between two looks at the news of the workers.
_LOOK = 0.1


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
class Search:
    """What is to be searched, and how far.

    Attributes:
        problem: Criterion and limits.
        starts: Number of starts.
        seed: Of the starts.
        time_limit: Time in s after which the best so far is taken.
        jobs: Number of processes; 1 for this one.
        done: Starts that are known already, by number.
    """

    problem: DesignProblem
    starts: int
    seed: int
    time_limit: float
    jobs: int
    done: Mapping[int, StartResult]


def run_starts(
    search: Search, progress: Callable[[SearchState], None], keep: Callable[[StartResult], None]
) -> list[StartResult]:
    """Return what the starts found, in their order.

    Starts run to their end one after the other, ``jobs`` at a time; the time limit cuts those that run, and those after
    them are missing. Ctrl-C ends the workers within a fraction of a second and is raised again.

    Args:
        search: What is to be searched.
        progress: Told now and then, and when a start is done.
        keep: Given every start that ended by itself, when it does.

    Raises:
        SolverFailed: A worker process died.
    """
    missing = [k for k in range(1, search.starts + 1) if k not in search.done]
    found = {k: search.done[k] for k in range(1, search.starts + 1) if k in search.done}
    watch = _Watch(search, progress, dict(found))
    jobs = min(search.jobs, len(missing))
    for result in _in_processes(search, missing, jobs, watch) if jobs > 1 else _here(search, missing, watch):
        found[result.start] = result
        if result.whole:  # kept before it is told: who stops the search at the news does not lose the start
            keep(result)
        watch.finished(result)
    return [found[k] for k in sorted(found)]


class _Watch:
    """The clock and the news of all starts."""

    def __init__(self, search: Search, progress: Callable[[SearchState], None], found: dict[int, StartResult]) -> None:
        self._search, self._progress, self._begun = search, progress, time.perf_counter()
        self._counts = dict.fromkeys(found, 0)  # those of an earlier run do not count as this run's work
        self._finished = len(found)
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


def _here(search: Search, missing: list[int], watch: _Watch) -> Iterator[StartResult]:
    """Yield the results of the starts, one after the other."""
    yielded = bool(search.done)
    for number in missing:
        if yielded and watch.left() == 0.0:
            return
        result = run_start(search.problem, number, search.seed, watch.left(), watch.tell)
        yielded = yielded or bool(result.candidates)
        yield result


def _in_processes(search: Search, missing: list[int], jobs: int, watch: _Watch) -> Iterator[StartResult]:
    """Yield the results of the starts as worker processes finish them."""
    context = multiprocessing.get_context("spawn")
    news: Any = context.Queue()
    stop = context.Event()
    waiting = list(missing)
    running: set[Future[StartResult]] = set()
    yielded = bool(search.done)
    pool = ProcessPoolExecutor(jobs, context, _begin, (search.problem, search.seed, news, stop))
    try:
        while waiting or running:
            while waiting and len(running) < jobs and not (yielded and watch.left() == 0.0):
                running.add(pool.submit(_work, waiting.pop(0), watch.left()))
            if not running:
                return
            ended, running = wait(running, timeout=_LOOK, return_when=FIRST_COMPLETED)
            _pass_on(news, watch)
            for future in ended:
                result = future.result()
                yielded = yielded or bool(result.candidates)
                yield result
    except BrokenProcessPool as error:
        step = "give --jobs 1, or look whether the machine ran out of memory"
        raise SolverFailed("excitation design", "a worker process died", step) from error
    finally:
        stop.set()
        pool.shutdown(wait=True, cancel_futures=True)
        news.close()
        news.cancel_join_thread()


def _pass_on(news: Any, watch: _Watch) -> None:
    while True:
        try:
            watch.tell(news.get_nowait())
        except queue.Empty:
            return


class _Worker:
    """What a worker process has: the problem, once, and the way back."""

    problem: DesignProblem
    seed: int
    news: Any
    stop: Any


class _Stopped(Exception):
    """The search was ended from outside."""


def _begin(problem: DesignProblem, seed: int, news: Any, stop: Any) -> None:
    """Set a worker process up: one thread, and Ctrl-C left to the process that the user sees."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    news.cancel_join_thread()  # news that nobody reads any more must not keep the process alive
    threadpool_limits(1)
    _Worker.problem, _Worker.seed, _Worker.news, _Worker.stop = problem, seed, news, stop


def _work(number: int, seconds: float) -> StartResult:
    """Run one start in a worker process."""

    def tell(one: News) -> None:
        if _Worker.stop.is_set():
            raise _Stopped
        _Worker.news.put(one)

    return run_start(_Worker.problem, number, _Worker.seed, seconds, tell)


def checked_jobs(jobs: int | None) -> int:
    """Return the number of processes: that given, or one for each core that this process may use.

    Raises:
        BadOption: Fewer than one.
    """
    if jobs is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if jobs < 1:
        raise BadOption("jobs", jobs, "give 1 or more")
    return jobs
