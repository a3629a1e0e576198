"""One execution: a file is written, read, and what came of it is judged; counted, and kept where it is a fault."""

from __future__ import annotations

import hashlib
import json
import os
import resource
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dynident.errors import DynidentError
from fuzz.targets import Target

#: Longest time of one execution in s of the processor, longest wait in s, memory in bytes that reading may add.
LONGEST, WAIT, MEMORY = 10.0, 60.0, 1 << 30

_OUTCOMES = ("taken", "refused", "crash", "hang", "memory", "escape")

_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT
_FORBIDDEN = frozenset({
    "subprocess.Popen", "os.system", "os.exec", "os.fork", "os.forkpty", "os.posix_spawn", "os.spawn", "pty.spawn",
    "socket.bind", "socket.connect", "socket.getaddrinfo", "socket.gethostbyname", "socket.sendmsg", "socket.sendto",
})  # fmt: skip
#: Which arguments of what changes files are the places that change.
_CHANGES = {
    "os.chmod": (0,), "os.link": (1,), "os.mkdir": (0,), "os.remove": (0,), "os.rename": (0, 1), "os.rmdir": (0,),
    "os.symlink": (1,), "os.truncate": (0,), "os.utime": (0,),
}  # fmt: skip


class Hang(BaseException):
    """An execution took longer than it may."""


class Escape(BaseException):
    """A reader wrote a file outside its folder, started a process or opened a connection."""


class Trials:
    """Executes files against one target and keeps the score.

    Args:
        target: The reader.
        folder: Folder of this process; a reader may write nowhere else. The input under test lies there.
        kept: Folder of inputs that found a fault, and of the score.
    """

    def __init__(self, target: Target, folder: Path, kept: Path) -> None:
        self._target, self._kept = target, kept
        self._file = folder / f"input{target.suffix}"
        self._name = str(self._file)
        cache = os.environ.get("NUMBA_CACHE_DIR", "")
        if cache:  # where a folder of its own is made while an input is read, that passes for an escape
            os.makedirs(cache, exist_ok=True)
        self._own = tuple(f"{os.path.realpath(place)}{os.sep}" for place in (folder, cache) if str(place))
        self._watch = False
        self.score: Counter[str] = Counter()
        self.faults: dict[str, str] = {}
        self._began, self._slowest, self._said = time.process_time(), 0.0, 0.0
        sys.dont_write_bytecode = True
        sys.addaudithook(self._audit)
        signal.signal(signal.SIGALRM, self._late)
        signal.signal(signal.SIGPROF, self._late)

    def limit_memory(self) -> None:
        """Cap the address space from here on; to be called after a first reading has loaded what it needs."""
        with open("/proc/self/statm") as stream:
            now = int(stream.read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (now + MEMORY, now + MEMORY))

    def run(self, content: bytes) -> None:
        """Execute one input and count it."""
        outcome, place = self.judge(content)
        self.score[outcome] += 1
        if place:
            self._keep(outcome, place, content)
        if time.monotonic() - self._said > 2:
            self.save()

    def judge(self, content: bytes) -> tuple[str, str]:
        """Execute one input, uncounted, and return the outcome and, where it is a fault, what and where."""
        with open(self._name, "wb") as stream:
            stream.write(content)
        begun = time.process_time()
        try:
            with self._watched():
                self._target.read(self._file)
            return "taken", ""
        except DynidentError as error:
            return ("refused", "") if str(error).strip() else ("crash", "an error without words")
        except Hang:
            return "hang", _place()
        except MemoryError:
            return "memory", _place()
        except Escape as error:
            return "escape", str(error)
        except Exception:
            return "crash", _place()
        finally:
            self._slowest = max(self._slowest, time.process_time() - begun)

    def save(self) -> None:
        """Write the score; seconds are those of the processor."""
        self._said = time.monotonic()
        facts: dict[str, Any] = {
            "executions": sum(self.score.values()),
            **{name: self.score[name] for name in _OUTCOMES},
            "seconds": round(time.process_time() - self._began, 1),
            "slowest_s": round(self._slowest, 3),
            "faults": self.faults,
        }
        partial = self._kept / ".score.part"
        partial.write_text(json.dumps(facts, indent=1))
        partial.replace(self._kept / "score.json")

    def _keep(self, outcome: str, place: str, content: bytes) -> None:
        fault = f"{outcome}: {place}"
        if fault in self.faults or len(self.faults) >= 200:
            return
        name = f"{outcome}-{hashlib.sha256(content).hexdigest()[:12]}{self._target.suffix}"
        (self._kept / name).write_bytes(content)
        self.faults[fault] = name
        self.save()

    @contextmanager
    def _watched(self) -> Iterator[None]:
        self._watch = True
        signal.setitimer(signal.ITIMER_PROF, LONGEST)
        signal.setitimer(signal.ITIMER_REAL, WAIT)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.setitimer(signal.ITIMER_REAL, 0)
            self._watch = False

    @staticmethod
    def _late(*_: object) -> None:
        raise Hang

    def _audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self._watch:
            return
        if event in _FORBIDDEN:
            raise Escape(f"{event} {arguments[:1]}")
        if event == "open":
            places = arguments[:1] if isinstance(arguments[2], int) and arguments[2] & _WRITES else ()
        else:
            places = tuple(arguments[k] for k in _CHANGES.get(event, ()))
        for place in places:
            where = os.devnull if isinstance(place, int) else os.path.realpath(os.fsdecode(place))
            if where != os.devnull and not where.startswith(self._own):
                raise Escape(f"{event} {where}")


def _place() -> str:
    """Return the kind of the error being handled and the last lines of code below it."""
    kind, _, trace = sys.exc_info()
    frames = traceback.extract_tb(trace)[-3:]
    where = " < ".join(f"{Path(one.filename).name}:{one.lineno}" for one in reversed(frames))
    return f"{kind.__name__ if kind else '?'} at {where}"
