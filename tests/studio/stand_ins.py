"""Short processes that stand for the commands of a studio."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable

from dynident.studio.folder import Folder, store_of
from dynident.studio.history import History
from dynident.studio.orders import Order
from dynident.studio.runs import Runs

#: Writes a file whose content is its name as the commands of a studio do, waits, and ends with a code, or its studio.
WRITES = """
import os, shutil, sys, threading, time
from pathlib import Path
from dynident.files import stage, write_atomically
stage(Path.cwd(), Path(sys.argv[1]).resolve())
def gone():
    while os.read(0, 1024): pass
    shutil.rmtree(sys.argv[1], ignore_errors=True)
    os._exit(9)
threading.Thread(target=gone, daemon=True).start()
write_atomically(sys.argv[2], sys.argv[2])
print("written", file=sys.stderr, flush=True)
time.sleep(float(sys.argv[3]))
print("answer", flush=True)
os._exit(int(sys.argv[4]))
"""


def order(name: str, wait: float = 0.0, code: int = 0) -> Order:
    """Return the order of what writes a file, waits so many s and ends with a code."""
    return Order("identify", ("identify", name, str(wait), str(code)), (name,))


class StandInRuns(Runs):
    """Runs whose commands are short processes."""

    def __init__(self, folder: Folder, history: History | None = None) -> None:
        super().__init__(folder, *(() if history is None else (history.runs, history.ran)))
        self.processes: list[subprocess.Popen[str]] = []

    def start_process(self, order: Order) -> subprocess.Popen[str]:
        pipe = subprocess.PIPE
        arguments = [sys.executable, "-c", WRITES, store_of(order.outputs[0]), *order.arguments[1:]]
        made = subprocess.Popen(
            arguments, cwd=self.folder.path, stdin=pipe, stdout=pipe, stderr=pipe, text=True, start_new_session=True
        )
        self.processes.append(made)
        return made


def until(true: Callable[[], object], seconds: float = 30.0) -> None:
    """Wait until something is true."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.005)
