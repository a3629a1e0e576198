"""A command of the studio as a process: it ends with the studio, even where that is killed.

``python -m dynident.studio.child STORES ARGUMENTS`` is ``dynident ARGUMENTS`` with three differences. Its standard
input is a pipe that the studio holds open: when the studio is gone, however it went, the system closes it. SIGINT,
by which the studio cancels it, ends it also where the studio was started with SIGINT ignored, as in the background of a
script: a command has a session of its own, so that no terminal sends it this signal. What it writes for the folder in
which it runs goes to the first of STORES, folders of its own with commas between; the studio moves it from there to
names that nothing has. Where the studio is gone, all of them are removed. STORES is empty where nothing is written.
"""

from __future__ import annotations

import contextlib
import os
import runpy
import shutil
import signal
import sys
import threading
from pathlib import Path

from dynident.files import stage


def _end_with_the_studio(stores: list[str]) -> None:
    with contextlib.suppress(OSError):
        while os.read(0, 1024):
            pass
    for store in stores:
        shutil.rmtree(store, ignore_errors=True)
    if hasattr(os, "killpg") and os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)  # with its own processes: the command leads a group
    os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    own = [store for store in sys.argv.pop(1).split(",") if store]
    if own:
        stage(Path.cwd().resolve(), Path(own[0]).resolve())
    threading.Thread(target=_end_with_the_studio, args=(own,), daemon=True).start()
    sys.argv[0] = "dynident"
    runpy.run_module("dynident", run_name="__main__", alter_sys=False)
