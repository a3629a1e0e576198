"""What all pools have in common: work that is sent to each worker once, and tasks that are handed out one by one."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from typing import Any, Protocol

from dynident.errors import BadOption

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
