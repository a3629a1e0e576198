"""All starts of an excitation design, in this process or by workers; the result does not depend on how many.

Finished starts are kept in a file, so that a search can go on where it was stopped.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynident.errors import BadOption, FileError, PoolFailed
from dynident.excitation.criteria import CRITERIA
from dynident.excitation.design.design_problem import DesignProblem
from dynident.excitation.design.finishing import FinishingCandidate
from dynident.excitation.design.start import News, StartResult, run_start
from dynident.file_versions import FileVersions
from dynident.files import DAMAGE, read_json, write_atomically
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.friction import FRICTION
from dynident.workers.processes import Pool, Tell, local_pool


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


KIND = "dynident search"

#: Files of finished starts.
VERSIONS = FileVersions("a search")

#: Goes up when the same start of the same problem gives another motion.
SEARCH = 1


@dataclass(frozen=True)
class DesignCheckpoint:
    """A file that keeps the starts of one problem and one seed.

    Attributes:
        path: The file.
        facts: What the starts depend on, each as a hash, by name.
        size: Number of free numbers of a motion, n m.
    """

    path: str | Path
    facts: Mapping[str, str]
    size: int

    def read(self) -> dict[int, StartResult]:
        """Return the finished starts by number; none where there is no file yet.

        Raises:
            FileError: The file is none of this kind, damaged, or of another problem.
        """
        step = "give another file, or remove this one to search anew"
        if not Path(self.path).exists():
            return {}
        data = read_json(self.path, step, FileError)
        if not isinstance(data, dict) or data.get("kind") != KIND:
            raise FileError(self.path, "no search", step)
        data = VERSIONS.migrated(data, lambda evidence, advice: FileError(self.path, evidence, advice))
        kept = data.get("problem")
        if kept != dict(self.facts):
            names = [name for name, own in self.facts.items() if not isinstance(kept, dict) or kept.get(name) != own]
            evidence = f"these starts are of another problem; different: {', '.join(names) or 'its parts'}"
            raise FileError(self.path, evidence, f"give the options of that search, or {step}")
        try:
            return {int(number): self._result(int(number), own) for number, own in data["starts"].items()}
        except DAMAGE as error:
            raise FileError(self.path, f"damaged ({type(error).__name__}: {error})", step) from error

    def write(self, results: Mapping[int, StartResult]) -> None:
        """Write all finished starts; the old file or the new one is there, never half of one.

        Raises:
            FileError: The file cannot be written.
        """
        starts = {str(number): _data(results[number]) for number in sorted(results)}
        data = {"kind": KIND, "format": VERSIONS.current, "problem": dict(self.facts), "starts": starts}
        write_atomically(self.path, json.dumps(data, allow_nan=False) + "\n")

    def _result(self, number: int, data: Mapping[str, Any]) -> StartResult:
        found = []
        for item in data["candidates"]:
            free = np.array(item["free"], dtype=np.float64)
            if free.shape != (self.size,) or not np.all(np.isfinite(free)) or number < 1:
                raise ValueError(f"start {number} has no {self.size} finite numbers")
            found.append(FinishingCandidate(free, float(item["figure"]), number))
        return StartResult(number, tuple(found), int(data["evaluations"]), True)


def _data(result: StartResult) -> dict[str, Any]:
    candidates = [{"free": one.free.tolist(), "figure": one.figure} for one in result.candidates]
    return {"candidates": candidates, "evaluations": result.evaluations}


def problem_facts(problem: DesignProblem, seed: int) -> dict[str, str]:
    """Return the hash of everything that the starts of a problem and a seed depend on, by name."""
    model, part, shape = problem.observation.model, problem.criterion, problem.parametrisation
    facts: dict[str, object] = {
        "search": SEARCH,
        "robot": robot_to_dict(model.robot),
        "friction": [(FRICTION.name_of(item), _plain(item)) for item in model.friction],
        "criterion": (CRITERIA.name_of(part), _plain(part)),
        "trajectory": (shape.kind, shape.period, shape.harmonics),
        "samples": problem.samples,
        "limits": _plain(problem.limits),
        "noise": _plain(problem.noise),
        "torque parameters": _plain(problem.theta),
        "torque uncertainty": _plain(problem.uncertainty),
        "clearance": _plain(problem.clearance),
        "tool speed": _plain(problem.tool),
        "earlier runs": _plain(problem.earlier),
        "seed": seed,
    }
    return {name: hashlib.sha256(json.dumps(fact).encode()).hexdigest()[:16] for name, fact in facts.items()}


def _plain(value: object) -> object:
    """Return a value as plain data that is the same for equal values, in this and in every other process.

    Raises:
        BadOption: A value that is neither plain data nor a dataclass of plain data.
    """
    if value is None or isinstance(value, str | int | float | bool):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    step = "its parts are no plain values, so a search with it cannot be resumed; leave the checkpoint out"
    raise BadOption("checkpoint", type(value).__name__, step)
