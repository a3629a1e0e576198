"""Methods of a comparison in processes of their own, that can be ended when their time is over."""

from __future__ import annotations

import math
import multiprocessing
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any

from threadpoolctl import threadpool_limits

from dynident.errors import BadOption, SolverFailed
from dynident.estimation.comparison.contest import Contest, Method, Outcome
from dynident.workers import end_with_parent

#: What a worker says when it stands ready.
_READY = "ready"


def in_processes(
    contest: Contest,
    methods: Sequence[Method],
    time_limit: float | None,
    jobs: int,
    progress: Callable[[str], None],
) -> Iterator[Outcome]:
    """Yield outcomes as they come; see :func:`dynident.estimation.comparison.compare.compare`.

    A method that is over its time, or whose process dies, fails; another process takes its place. The clock of a method
    begins when its process stands ready. All processes are ended when the caller stops asking.

    Raises:
        BadOption: A time limit or a number of jobs that cannot be.
        SolverFailed: A process ended before it was ready.
    """
    if time_limit is not None and not 0 < time_limit < math.inf:
        raise BadOption("time limit", time_limit, "give a time above 0 in s")
    if jobs < 1:
        raise BadOption("jobs", jobs, "give 1 or more")
    waiting = list(enumerate(methods, start=1))
    workers: list[_Worker] = []
    try:
        while waiting or workers:
            while waiting and len(workers) < jobs and len(workers) < len(waiting) + _busy(workers):
                workers.append(_Worker(contest))
            for worker in list(_with_news(workers, time_limit)):
                outcome = worker.outcome(time_limit)
                if outcome is not None:
                    yield outcome
                if worker.ready and waiting:
                    number, method = waiting.pop(0)
                    progress(f"{method.label} ({number} of {len(methods)})")
                    worker.begin(method)
                elif worker.ready or worker.ended:
                    worker.end()
                    workers.remove(worker)
    finally:
        for worker in workers:
            worker.end()


def _busy(workers: Sequence[_Worker]) -> int:
    return sum(worker.method is not None for worker in workers)


def _with_news(workers: Sequence[_Worker], time_limit: float | None) -> Iterator[_Worker]:
    """Yield the workers that have said something, have ended or are over their time; wait until there is one."""
    lasts = [worker.begun + time_limit for worker in workers if worker.method is not None and time_limit is not None]
    patience = max(min(lasts) - time.monotonic(), 0.0) if lasts else None
    speaking = set(map(id, wait([worker.pipe for worker in workers], patience)))
    for worker in workers:
        if id(worker.pipe) in speaking or worker.overdue(time_limit):
            yield worker


class _Worker:
    """A process that takes one method after the other.

    Attributes:
        pipe: The way to it.
        method: What it works on; None for nothing.
        begun: When it began that, on the monotonic clock.
        ready: Whether it waits for a method.
        ended: Whether its process is no more.
    """

    def __init__(self, contest: Contest) -> None:
        context: Any = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.method: Method | None = None
        self.begun = 0.0
        self.ready = self.ended = False
        self._process = context.Process(target=_serve, args=(theirs, contest), daemon=True)
        self._process.start()
        theirs.close()  # so that the end of the process is the end of the pipe

    def begin(self, method: Method) -> None:
        """Hand it a method."""
        self.pipe.send(method)
        self.method, self.begun, self.ready = method, time.monotonic(), False

    def overdue(self, time_limit: float | None) -> bool:
        """Return whether its method is over its time."""
        return self.method is not None and time_limit is not None and time.monotonic() - self.begun >= time_limit

    def outcome(self, time_limit: float | None) -> Outcome | None:
        """Return what came of its method; None where it has only got ready."""
        method, seconds = self.method, time.monotonic() - self.begun
        if not self.pipe.poll():  # it has said nothing, so it is over its time
            assert method is not None
            self.ended, self.method = True, None
            return Outcome(method.label, seconds, failure=f"ended at the time limit of {time_limit:g} s")
        try:
            said = self.pipe.recv()
        except EOFError:
            self._process.join()
            code = self._process.exitcode
            self.ended, self.method = True, None
            if method is None:
                step = "run all methods in this process: one job, no time limit"
                raise SolverFailed("a worker process", f"it ended with code {code} before it began", step) from None
            return Outcome(method.label, seconds, failure=f"its process ended with code {code}: out of memory?")
        self.ready, self.method = True, None
        return None if said == _READY else said

    def end(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.join()
        self.pipe.close()


def _serve(pipe: Connection, contest: Contest) -> None:
    """Solve in a worker process: one thread, and Ctrl-C left to the process that the user sees."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threadpool_limits(1)
    end_with_parent()
    _ = contest.least  # compiles what all methods share before the clock of the first one begins
    pipe.send(_READY)
    while True:
        try:
            method: Method = pipe.recv()
        except EOFError:
            return
        pipe.send(contest.attempt(method))
