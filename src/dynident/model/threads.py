"""Threads: one for BLAS on small matrices, on which several are slower; several for work that comes in pieces."""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, ContextDecorator, nullcontext
from functools import cache
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

Item = TypeVar("Item")
Result = TypeVar("Result")


def libraries() -> ThreadpoolController:
    """Return what holds the libraries of NumPy, and of SciPy where that is loaded: its BLAS may be another one."""
    return _libraries("scipy.linalg" in sys.modules)


@cache
def _libraries(with_scipy: bool) -> ThreadpoolController:  # finding them takes long enough to be done once
    return ThreadpoolController()


class _OneBlasThread(threading.local, ContextDecorator):
    """Holds the libraries at one thread while its own thread is inside: calls within calls cost nothing.

    A call within a call holds the BLAS of SciPy too where that was loaded in between. Between threads the rules are
    those of threadpoolctl.
    """

    def __init__(self) -> None:
        self._held: list[tuple[ThreadpoolController, AbstractContextManager[Any]]] = []

    def __enter__(self) -> None:
        found = libraries()
        is_held = bool(self._held) and self._held[-1][0] is found
        limit = nullcontext() if is_held else found.limit(limits=1, user_api="blas")
        limit.__enter__()
        self._held.append((found, limit))

    def __exit__(self, *raised: Any) -> None:
        self._held.pop()[1].__exit__(*raised)


_one_blas_thread = _OneBlasThread()


def one_blas_thread() -> _OneBlasThread:
    """Return a context, or a decorator, in which NumPy and SciPy work on one thread: for small matrices."""
    return _one_blas_thread


def usable_processors() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def threads_that_pay(most: int) -> int:
    """Return how many threads to use: one for each processor, or one where another process began this one.

    The siblings of a worker have the other processors.
    """
    return 1 if multiprocessing.parent_process() is not None else min(usable_processors(), most)


def in_order(work: Callable[[Item], Result], items: Iterable[Item], threads: int) -> Iterator[Result]:
    """Yield ``work(item)`` of each item, in their order, worked on by some threads while the caller does its part.

    At most ``threads`` + 1 results are held. Items are taken by the caller's own thread.

    Args:
        work: Holds the interpreter lock little, or nothing is gained.
        items: What is worked on.
        threads: Number of threads; 1 works in the caller's own.
    """
    if threads < 2:
        yield from map(work, items)
        return
    with ThreadPoolExecutor(threads) as pool:
        waiting = deque[Future[Result]]()
        for item in items:
            waiting.append(pool.submit(work, item))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
