"""A command of the studio as a process: it ends with the studio, even where that is killed.

``python -m dynident.studio.child ARGUMENTS`` is ``dynident ARGUMENTS`` with two differences. Its standard input is a
pipe that the studio holds open: when the studio is gone, however it went, the system closes the pipe. And SIGINT, by
which the studio cancels it, ends it also where the studio was started with SIGINT ignored, as in the background of a
script: a command has a session of its own, so that no terminal sends it this signal.
"""

from __future__ import annotations

import contextlib
import os
import runpy
import signal
import sys
import threading


def _end_with_the_studio() -> None:
    with contextlib.suppress(OSError):
        while os.read(0, 1024):
            pass
    if hasattr(os, "killpg") and os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)  # with its own processes: the command leads a group
    os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=_end_with_the_studio, daemon=True).start()
    sys.argv[0] = "dynident"
    runpy.run_module("dynident", run_name="__main__", alter_sys=False)
