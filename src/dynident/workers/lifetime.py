"""Worker processes that do not outlive the process that began them, however that ended, and leave Ctrl-C to it."""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any


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
