"""Tasks of a benchmark done one after the other or in processes; each result is kept as soon as it is there."""

from __future__ import annotations

import math
import multiprocessing
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol

from threadpoolctl import threadpool_limits

from dynident.errors import BadOption, SolverFailed
from dynident.estimation.monte_carlo.records import Records, Task
from dynident.workers import end_with_parent

_READY = "ready"


class Work(Protocol):
    """What tasks are done by; sent to each process once."""

    def result(self, task: Any) -> dict[str, Any]:
        """Return the result of a task as plain data; a method that fails is a result."""
        ...


def run_tasks(
    work: Work,
    tasks: Sequence[Any],
    records: Records,
    *,
    jobs: int = 1,
    time_limit: float | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield tasks with their results: those that are kept, then the others as they are done.

    Args:
        work: Does a task.
        tasks: What is to be done.
        records: Where results are kept.
        jobs: Processes that run at a time; with one and no time limit all is done in this process.
        time_limit: Wall-clock time of a task in s, its log included; it fails after that.
        progress: Told each task that begins.

    Raises:
        BadOption: A number of jobs or a time limit that cannot be.
        FileError: A result cannot be written.
        SolverFailed: Worker processes cannot be started.
    """
    if jobs < 1:
        raise BadOption("jobs", jobs, "give 1 or more")
    if time_limit is not None and not 0 < time_limit < math.inf:
        raise BadOption("time limit", time_limit, "give a time above 0 in s")
    missing = []
    for task in tasks:
        kept = records.read(task)
        if kept is None or _worth_another_try(kept, time_limit):
            missing.append(task)
        else:
            yield task, kept
    if jobs == 1 and time_limit is None:
        done = _here(work, missing, progress)
    else:
        done = _in_processes(work, missing, jobs, time_limit, progress)
    for task, result in done:
        if not result.get("process_died"):
            records.write(task, result)
        yield task, result


def _worth_another_try(kept: Mapping[str, Any], time_limit: float | None) -> bool:
    """Return whether a kept result ended at a time limit that is shorter than that of now."""
    ended_at = kept.get("time_limit")
    return ended_at is not None and (time_limit is None or time_limit > ended_at)


def _here(work: Work, tasks: Sequence[Task], progress: Callable[[str], None]) -> Iterator[tuple[Task, dict[str, Any]]]:
    with threadpool_limits(1):  # as in worker processes, so that times mean the same
        for task in tasks:
            progress(task.label)
            yield task, work.result(task)


def _in_processes(
    work: Work, tasks: Sequence[Task], jobs: int, time_limit: float | None, progress: Callable[[str], None]
) -> Iterator[tuple[Task, dict[str, Any]]]:
    """Yield results as they come; a process that is over its time is ended, and another takes its place."""
    waiting = list(tasks)
    workers: list[_Worker] = []
    try:
        while waiting or any(worker.task is not None for worker in workers):
            while waiting and len(workers) < min(jobs, len(waiting) + sum(w.task is not None for w in workers)):
                workers.append(_Worker(work))
            for worker in _with_news(workers, time_limit):
                task, result = worker.news(time_limit)
                if task is not None and result is not None:
                    yield task, result
                if worker.ended:
                    worker.end()
                    workers.remove(worker)
                elif worker.task is None and waiting:
                    progress(waiting[0].label)
                    worker.begin(waiting.pop(0))
    finally:
        for worker in workers:
            worker.end()


def _with_news(workers: Sequence[_Worker], time_limit: float | None) -> list[_Worker]:
    """Return the workers that have said something, have ended or are over their time; wait until there is one."""
    busy = [worker for worker in workers if worker.task is not None or not worker.ready]
    ends = [worker.begun + time_limit for worker in busy if worker.task is not None and time_limit is not None]
    patience = max(min(ends) - time.monotonic(), 0.0) if ends else None
    speaking = set(map(id, wait([worker.pipe for worker in busy], patience)))
    late = [worker for worker in busy if worker.overdue(time_limit)]
    return [worker for worker in busy if id(worker.pipe) in speaking or worker in late]


class _Worker:
    """A process that does one task after the other."""

    def __init__(self, work: Work) -> None:
        context: Any = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.task: Task | None = None
        self.begun = 0.0
        self.ready = self.ended = False
        self._process = context.Process(target=_serve, args=(theirs, work), daemon=True)
        self._process.start()
        theirs.close()  # so that the end of the process is the end of the pipe

    def begin(self, task: Task) -> None:
        """Hand it a task."""
        self.pipe.send(task)
        self.task, self.begun = task, time.monotonic()

    def overdue(self, time_limit: float | None) -> bool:
        """Return whether its task is over its time."""
        return self.task is not None and time_limit is not None and time.monotonic() - self.begun >= time_limit

    def news(self, time_limit: float | None) -> tuple[Task | None, dict[str, Any] | None]:
        """Return its task and the result; nothing where it has only got ready."""
        task = self.task
        self.task = None
        if not self.pipe.poll():  # it has said nothing, so it is over its time
            self.ended = True
            late = failed(f"ended at the time limit of {time_limit:g} s", time.monotonic() - self.begun)
            return task, {**late, "time_limit": time_limit}
        try:
            said = self.pipe.recv()
        except EOFError:
            self._process.join()
            self.ended = True
            code = self._process.exitcode
            if task is None:
                step = "do all tasks in this process: one job, no time limit"
                raise SolverFailed("a worker process", f"it ended with code {code} before it began", step) from None
            died = failed(f"its process ended with code {code}: out of memory?", time.monotonic() - self.begun)
            return task, {**died, "process_died": True}
        if isinstance(said, BaseException):
            raise said
        self.ready = True
        return (None, None) if said == _READY else (task, said)

    def end(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.join()
        self.pipe.close()


def failed(why: str, seconds: float) -> dict[str, Any]:
    """Return the result of a task that came to nothing."""
    return {"failure": why, "seconds": seconds}


def reasons(results: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """Return why results failed, and how often, the most frequent first."""
    found: dict[str, int] = {}
    for result in results:
        if result.get("failure"):
            found[result["failure"]] = found.get(result["failure"], 0) + 1
    return dict(sorted(found.items(), key=lambda each: -each[1]))


def _serve(pipe: Connection, work: Work) -> None:
    """Do tasks in a worker process: one thread, and Ctrl-C left to the process that the user sees."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threadpool_limits(1)
    end_with_parent()
    pipe.send(_READY)
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        try:
            pipe.send(work.result(task))
        except Exception as error:  # told to the process that the user sees, which raises it
            pipe.send(error)
