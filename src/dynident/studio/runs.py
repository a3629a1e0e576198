"""Commands that run beside the server: their progress line by line, their answer, and how they are broken off."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import IO, Any

from dynident.errors import BadOption
from dynident.studio.folder import Folder, store_of
from dynident.studio.orders import Order

#: Commands that run at the same time at most.
AT_ONCE = 2

#: Commands that a session remembers; the oldest finished ones are forgotten.
REMEMBERED = 200

#: Characters of an answer and lines of progress that are kept of one command.
MAX_ANSWER, MAX_LINES = 16_000_000, 2_000

#: Time in s that a command has to clean up after it was told to stop.
GRACE = 5.0


class Run:
    """A command of this session, running or done; what becomes of it is written by the one thread that follows it.

    Attributes:
        number: Its number, from 1.
        order: What was asked.
        process: What runs; None for a command of an earlier session.
        state: running, done, failed or cancelled.
        code: Exit code; None while it runs.
        progress: Lines of its standard error.
        answer: Its standard output.
        outputs: Files that it writes, by the names that they have in the folder.
        began: Time of the clock at which it began, in s.
        took: How long it took, in s; 0 while it runs.
    """

    def __init__(self, number: int, order: Order, process: subprocess.Popen[str] | None) -> None:
        self.number, self.order, self.process = number, order, process
        self.state, self.answer, self.outputs = "running", "", list(order.outputs)
        self.code: int | None = None
        self.progress: list[str] = []
        self.began, self.took = time.monotonic(), 0.0

    def figures(self, since: int = 0, whole: bool = True) -> dict[str, Any]:
        """Return the run as plain data.

        Args:
            since: Lines of progress that are known already.
            whole: Whether the answer is wanted.
        """
        running = self.state == "running"
        return {
            "number": self.number,
            "verb": self.order.verb,
            "command": self.order.command,
            "arguments": list(self.order.arguments),
            "outputs": self.outputs,
            "limit_s": self.order.limit,
            "state": self.state,
            "code": self.code,
            "took_s": time.monotonic() - self.began if running else self.took,
            "lines": len(self.progress),
            "progress": self.progress[since:],
            "answer": self.answer if whole and not running else "",
        }


class Runs:
    """The commands of a session.

    Args:
        folder: Where they run.
        earlier: Those of earlier sessions in this folder, with their numbers.
        ended: Called with each command that came to its end.
    """

    def __init__(
        self, folder: Folder, earlier: Sequence[Run] = (), ended: Callable[[Run], None] = lambda run: None
    ) -> None:
        self.folder, self._ended = folder, ended
        self._runs = {run.number: run for run in earlier}
        self._lock = threading.Lock()
        self._count = max(self._runs, default=0)
        self._followers: dict[int, threading.Thread] = {}
        self._closed = False

    def start(self, order: Order) -> Run:
        """Start a command in the folder of the session; the names that it has reserved are given up where it cannot.

        Raises:
            BadOption: As many run already as may, or the session has ended.
        """
        try:
            return self._started(order)
        except BaseException:
            self.folder.release(order.outputs)
            raise

    def _started(self, order: Order) -> Run:
        with self._lock:
            if self._closed:
                raise BadOption("command", order.verb, "the session has ended")
            if sum(run.state == "running" for run in self._runs.values()) >= AT_ONCE:
                raise BadOption("command", order.verb, f"{AT_ONCE} commands run already; wait for one, or cancel it")
            self._count += 1
            process = self.start_process(order)
            run = Run(self._count, order, process)
            self._runs[run.number] = run
            finished = [number for number, known in self._runs.items() if known.state != "running"]
            for number in finished[: max(0, len(self._runs) - REMEMBERED)]:
                del self._runs[number]
            follower = self._followers[run.number] = threading.Thread(
                target=self._follow, args=(run, process), daemon=True
            )
            follower.start()
        return run

    @property
    def count(self) -> int:
        """How many commands were started, which is the number of the last one."""
        with self._lock:
            return self._count

    def get(self, number: int) -> Run:
        """Return a command by its number.

        Raises:
            BadOption: There is none with this number.
        """
        with self._lock:
            if number not in self._runs:
                raise BadOption("run", number, "the session has no command with this number")
            return self._runs[number]

    def all(self) -> tuple[Run, ...]:
        """Return the commands of the session in their order."""
        with self._lock:
            return tuple(self._runs.values())

    def cancel(self, number: int) -> None:
        """Break off a command, and remove what it has written; one that is done stays as it is.

        Raises:
            BadOption: There is none with this number.
        """
        run = self.get(number)
        with self._lock:
            if run.state != "running":
                return
            run.state = "cancelled"
        if run.process is not None:
            _stop(run.process)

    def close(self) -> None:
        """Break off all that run, and wait until what they have written is removed; nothing starts any more."""
        with self._lock:
            self._closed = True
            followers = tuple(self._followers.values())
        for run in self.all():
            with contextlib.suppress(BadOption):
                self.cancel(run.number)
        for follower in followers:
            follower.join(2 * GRACE)

    def start_process(self, order: Order) -> subprocess.Popen[str]:
        """Return the started process of an order, which ends when its input is closed."""
        stores = ",".join(dict.fromkeys(map(store_of, order.outputs)))
        return subprocess.Popen(
            [sys.executable, "-m", "dynident.studio.child", stores, *order.arguments],
            cwd=self.folder.path,
            stdin=subprocess.PIPE,  # closed when this process ends, by which the command knows
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="replace",
            env={**os.environ, "PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": "utf-8", "COLUMNS": "160"},
            start_new_session=True,
        )

    def _follow(self, run: Run, process: subprocess.Popen[str]) -> None:
        assert process.stdin is not None and process.stdout is not None and process.stderr is not None
        listener = threading.Thread(target=_listen, args=(process.stderr, run.progress), daemon=True)
        listener.start()
        answer = process.stdout.read(MAX_ANSWER)
        while process.stdout.read(1 << 16):  # what is beyond is let go, so that the command can end
            pass
        code = process.wait()
        listener.join(timeout=GRACE)
        for stream in (process.stdin, process.stdout, process.stderr):
            stream.close()
        with self._lock:
            run.answer, run.code, run.took = answer, code, time.monotonic() - run.began
            cancelled = run.state == "cancelled"
            done = not cancelled and code in run.order.good and self._kept(run)
            self.folder.release(run.order.outputs)
            if not cancelled:
                run.state = "done" if done else "failed"
        if done:
            self._ended(run)
        with self._lock:
            del self._followers[run.number]

    def _kept(self, run: Run) -> bool:
        """Give the files of a command their names, and say whether that was possible."""
        try:
            names = self.folder.keep(run.order.outputs)
        except OSError as error:
            run.progress.append(f"error: its files cannot be written ({error.strerror}); check the space left")
            return False
        run.outputs = [names.get(name, name) for name in run.outputs]
        other = [(name, kept) for name, kept in names.items() if name != kept]
        run.progress += [f"{name} was written by another program meanwhile: kept as {kept}" for name, kept in other]
        return True


def _listen(stream: IO[str], lines: list[str]) -> None:
    for line in stream:
        if len(lines) < MAX_LINES and line.strip():
            lines.append(line.rstrip()[:1000])


def _stop(process: subprocess.Popen[str]) -> None:
    """Tell a command and its processes to stop, and end them where they do not."""
    for number in (signal.SIGINT, signal.SIGTERM):
        _tell(process, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(GRACE / 2)
            break
    else:
        process.kill()
    if hasattr(os, "killpg"):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)  # type: ignore[attr-defined]


def _tell(process: subprocess.Popen[str], number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, number)
        else:
            process.terminate()
