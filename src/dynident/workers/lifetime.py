"""Worker processes that do not outlive the process that began them, however that ended."""

from __future__ import annotations

import multiprocessing
import signal
import threading


def end_with_parent() -> None:
    """End this worker when the process that wants its answer is gone, even one that was killed."""
    threading.Thread(target=_watch, daemon=True).start()


def _watch() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        signal.raise_signal(signal.SIGTERM)
