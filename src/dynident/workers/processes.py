"""Processes of this machine; one that is over its time is ended, and another takes its place.

None outlives the process that began it, however that ended, and all leave Ctrl-C to it.

All pools send work to each worker once, and hand out tasks one by one; that of this process does them in turn.
"""

from __future__ import annotations

import math
import multiprocessing
import signal
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol

from threadpoolctl import threadpool_limits

from dynident.errors import BadOption, PoolFailed

#: Takes what a task says on its way.
Tell = Callable[[Any], None]


class Work(Protocol):
    """What tasks are done by; it and the tasks can be pickled."""

    def prepare(self) -> None:
        """Do in a worker what all tasks share, before the clock of the first one begins; tasks work without it."""
        ...

    def do(self, task: Any, tell: Tell) -> Any:
        """Return the result of a task, which can be pickled; the same wherever and how often it is done."""
        ...


@dataclass(frozen=True)
class Done:
    """A task that has ended.

    Attributes:
        task: The task.
        seconds: Wall-clock time in s that it took.
        result: What the work returned; None where there is no result.
        failure: Why there is no result, in words; empty where there is one.
        late: Whether it was ended at a limit of its time.
    """

    task: Any
    seconds: float
    result: Any = None
    failure: str = ""
    late: bool = False


class Pool(ABC):
    """Workers that do tasks side by side.

    Attributes:
        is_local: Whether they see the files of this machine under the same names.
    """

    is_local: bool = True

    @abstractmethod
    def run(
        self,
        work: Work,
        tasks: Iterable[Any],
        *,
        time_limit: float | None = None,
        begins: Tell = lambda task: None,
        news: Tell = lambda said: None,
    ) -> Generator[Done, None, None]:
        """Yield tasks as they end, each once; all workers are let go of when the caller stops asking.

        Args:
            work: Does a task.
            tasks: What is to be done; the next one is taken when a worker has room for it, after the results before it
                have been yielded.
            time_limit: Wall-clock time of a task in s; it fails after that.
            begins: Called with each task that begins; again where it begins anew, because its worker was lost.
            news: Called with what tasks say on their way.

        Raises:
            PoolFailed: Workers cannot be had.
            Exception: What the work raised.
        """


class Here(Pool):
    """This process, one task after the other; it cannot end a task that takes too long."""

    def run(
        self,
        work: Work,
        tasks: Iterable[Any],
        *,
        time_limit: float | None = None,
        begins: Tell = lambda task: None,
        news: Tell = lambda said: None,
    ) -> Generator[Done, None, None]:
        """Yield tasks as they end; see :meth:`Pool.run`.

        Raises:
            BadOption: A time limit.
        """
        if time_limit is not None:
            raise BadOption("time limit", time_limit, "tasks of this process are not ended; take processes")
        for task in tasks:
            begins(task)
            begun = time.monotonic()
            result = work.do(task, news)
            yield Done(task, time.monotonic() - begun, result)


def check_time_limit(time_limit: float | None, name: str = "time limit") -> None:
    """Refuse a time limit that cannot be.

    Raises:
        BadOption: It is not above 0, or not finite.
    """
    if time_limit is not None and not 0 < time_limit < math.inf:
        raise BadOption(name, time_limit, "give a time above 0 in s")


#: What a worker says: that it stands ready, something on its way, a result, or what the work raised.
_READY, _NEWS, _RESULT, _RAISED = "ready", "news", "result", "raised"

_NO_TASK: Any = object()


@dataclass(frozen=True)
class Processes(Pool):
    """Processes of this machine, each with one thread, that take one task after the other.

    A task that is over its time, or whose process dies, fails. The clock of a task begins when its process stands
    ready. Processes are ended when the caller stops asking, and when the process that began them is gone.

    Attributes:
        jobs: Processes that run at a time.
        processor_limit: Processor time of a task in s, which does not depend on what else the machine does; it fails
            after that. None for any.

    Raises:
        BadOption: A limit of the processor time where the system has no clock for it.
    """

    jobs: int
    processor_limit: float | None = None

    def __post_init__(self) -> None:
        if self.processor_limit is not None and not hasattr(signal, "setitimer"):
            step = "this system does not end processes by their processor time; give a time limit"
            raise BadOption("processor limit", self.processor_limit, step)

    def run(
        self,
        work: Work,
        tasks: Iterable[Any],
        *,
        time_limit: float | None = None,
        begins: Tell = lambda task: None,
        news: Tell = lambda said: None,
    ) -> Generator[Done, None, None]:
        waiting = iter(tasks)
        workers: list[_Worker] = []
        try:
            while True:
                while len(workers) < self.jobs and (task := next(waiting, _NO_TASK)) is not _NO_TASK:
                    with uninterrupted_start():
                        workers.append(_Worker(work, task, self.processor_limit))
                if not workers:
                    return
                for worker in _with_news(workers, time_limit):
                    kind, said = worker.heard(time_limit)
                    if kind == _NEWS:
                        news(said)
                        continue
                    if kind == _RESULT:
                        yield said
                        worker.task = _NO_TASK if worker.ended else next(waiting, _NO_TASK)
                    if worker.task is _NO_TASK:
                        worker.end()
                        workers.remove(worker)
                    else:
                        begins(worker.task)
                        worker.begin()
        finally:
            for worker in workers:
                worker.end()


def _with_news(workers: Sequence[_Worker], time_limit: float | None) -> list[_Worker]:
    """Return the workers that have said something, have ended or are over their time; wait until there is one."""
    begun = [worker.begun for worker in workers if worker.begun is not None]
    patience = max(min(begun) + time_limit - time.monotonic(), 0.0) if begun and time_limit is not None else None
    speaking = set(map(id, wait([worker.pipe for worker in workers], patience)))
    return [worker for worker in workers if id(worker.pipe) in speaking or worker.overdue(time_limit)]


class _Worker:
    """A process that takes one task after the other.

    Attributes:
        pipe: The way to it.
        task: What it works on, or will when it stands ready.
        begun: When it began that, on the monotonic clock; None before.
        ended: Whether it is of no more use.
    """

    def __init__(self, work: Work, task: Any, processor_limit: float | None) -> None:
        context: Any = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.task = task
        self.begun: float | None = None
        self.ended = False
        self._processor_limit = processor_limit
        self._process = context.Process(target=_serve, args=(theirs, work, processor_limit), daemon=True)
        self._process.start()
        theirs.close()  # so that the end of the process is the end of the pipe

    def begin(self) -> None:
        """Hand it its task."""
        self.pipe.send(self.task)
        self.begun = time.monotonic()

    def overdue(self, time_limit: float | None) -> bool:
        """Return whether its task is over its time."""
        return self.begun is not None and time_limit is not None and time.monotonic() - self.begun >= time_limit

    def heard(self, time_limit: float | None) -> tuple[str, Any]:
        """Return what it says, a :class:`Done` with a result; what the work raised is raised."""
        seconds = 0.0 if self.begun is None else time.monotonic() - self.begun
        if not self.pipe.poll():  # it has said nothing, so it is over its time
            self.ended, self.begun = True, None
            failure = f"ended at the time limit of {time_limit:g} s"
            return _RESULT, Done(self.task, seconds, failure=failure, late=True)
        try:
            kind, said = self.pipe.recv()
        except EOFError:
            return _RESULT, self._died(seconds)
        if kind == _RAISED:
            raise said
        if kind == _RESULT:
            self.begun = None
            said = Done(self.task, seconds, said)
        return kind, said

    def _died(self, seconds: float) -> Done:
        self._process.join()
        code = self._process.exitcode
        if self.begun is None:
            step = "do all in this process: one job, no time limit"
            raise PoolFailed("a worker process", f"it ended with code {code} before it began", step) from None
        self.ended, self.begun = True, None
        if self._processor_limit is not None and code == -signal.SIGPROF:
            failure = f"ended after {self._processor_limit:g} s of processor time"
            return Done(self.task, seconds, failure=failure, late=True)
        return Done(self.task, seconds, failure=f"its process ended with code {code}: out of memory?")

    def end(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.join()
        self.pipe.close()


def _serve(pipe: Connection, work: Work, processor_limit: float | None) -> None:
    """Do tasks in a worker process: one thread, and Ctrl-C left to the process that the user sees.

    On POSIX it was started with Ctrl-C blocked, as a signal may come before this function runs. At the limit of the
    processor time the system ends the process, whatever it does: nobody handles SIGPROF.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threadpool_limits(1)
    end_with_parent()
    work.prepare()
    pipe.send((_READY, None))
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        if processor_limit is not None:
            signal.setitimer(signal.ITIMER_PROF, processor_limit)
        try:
            answer = _RESULT, work.do(task, lambda said: pipe.send((_NEWS, said)))
        except Exception as error:  # told to the process that the user sees, which raises it
            answer = _RAISED, error
        if processor_limit is not None:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        pipe.send(answer)


def local_pool(jobs: int, time_limit: float | None = None, processor_limit: float | None = None) -> Pool:
    """Return this process where that can do it, one job without a limit, and else processes of this machine.

    Raises:
        BadOption: A number of jobs or a limit that cannot be.
    """
    check_time_limit(time_limit)
    check_time_limit(processor_limit, "processor limit")
    if jobs < 1:
        raise BadOption("jobs", jobs, "give 1 or more")
    return Here() if jobs == 1 and time_limit is None and processor_limit is None else Processes(jobs, processor_limit)


def end_with_parent() -> None:
    """End this worker when the process that wants its answer is gone, even one that was killed."""
    threading.Thread(target=_watch, daemon=True).start()


def _watch() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        signal.raise_signal(signal.SIGTERM)


@contextmanager
def uninterrupted_start() -> Generator[None, None, None]:
    """Start a process within: Ctrl-C of this one takes effect afterwards, and that one inherits it as blocked.

    A terminal interrupts all processes of a command. One that is interrupted while it loads its modules prints a
    traceback; one that is interrupted while it starts another loses it.
    """
    with _delayed(), _blocked():
        yield


@contextmanager
def _delayed() -> Generator[None, None, None]:
    """Raise an interrupt of this process at the end, whichever thread it was sent to."""
    handler: Any = signal.getsignal(signal.SIGINT)
    if handler is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    interrupts: list[int] = []
    signal.signal(signal.SIGINT, lambda number, frame: interrupts.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if interrupts:
            signal.raise_signal(signal.SIGINT)


@contextmanager
def _blocked() -> Generator[None, None, None]:
    """Block the interrupt for this thread, which processes inherit; Windows has no such mask."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker  # not on Windows

    resource_tracker.ensure_running()  # its own start unblocks the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
