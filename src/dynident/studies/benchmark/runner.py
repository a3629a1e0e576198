"""Tasks of a benchmark done one after the other or by workers; each result is kept as soon as it is there.

What is done stays done: one small file a task, named after everything that its result depends on.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from threadpoolctl import threadpool_limits

from dynident.errors import BadOption, DynidentError, FileError
from dynident.file_versions import Document, FileVersions, renamed
from dynident.files import write_atomically
from dynident.workers.processes import Done, Here, Pool, Tell, local_pool


class BenchmarkWork(Protocol):
    """What tasks are done by; sent to each worker once."""

    def result(self, task: Any) -> dict[str, Any]:
        """Return the result of a task as plain data; a method that fails is a result."""
        ...


def run_tasks(
    work: BenchmarkWork,
    tasks: Sequence[Any],
    records: Records,
    *,
    jobs: int = 1,
    time_limit: float | None = None,
    processor_limit: float | None = None,
    pool: Pool | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield tasks with their results: those that are kept, then the others as they are done.

    Args:
        work: Does a task.
        tasks: What is to be done.
        records: Where results are kept.
        jobs: Processes that run at a time; with one and no limit all is done in this process.
        time_limit: Wall-clock time of a task in s, its log included; it fails after that.
        processor_limit: The same of its processor time, which does not depend on what else the machine does.
        pool: Where tasks are done in place of ``jobs`` processes; they know no limit of the processor time.
        progress: Called with each task that begins.

    Raises:
        BadOption: A number of jobs or a limit that cannot be.
        FileError: A result cannot be written.
        PoolFailed: Workers cannot be had.
    """
    if pool is not None and processor_limit is not None:
        step = "a cluster does not count it; give a time limit, or processes of this machine"
        raise BadOption("processor limit", processor_limit, step)
    doing = pool or local_pool(jobs, time_limit, processor_limit)
    limits = {"time_limit": time_limit, "processor_limit": processor_limit}
    missing = []
    for task in tasks:
        kept = records.read(task)
        if kept is None or worth_another_try(kept, limits):
            missing.append(task)
        else:
            yield task, kept
    if not missing:
        return
    ended = doing.run(_Doing(work), missing, time_limit=time_limit, begins=lambda task: progress(task.label))
    # One thread here too, as workers have, so that times mean the same.
    with closing(ended), threadpool_limits(1) if isinstance(doing, Here) else nullcontext():
        for done in ended:
            result = _failure(done, limits) if done.failure else done.result
            if not result.get("process_died"):
                records.write(done.task, result)
            yield done.task, result


@dataclass(frozen=True, eq=False)
class _Doing:
    """The work of a benchmark as pools take it."""

    work: BenchmarkWork

    def prepare(self) -> None:
        """Do nothing: what a task needs beforehand counts as its time."""

    def do(self, task: Any, tell: Tell) -> dict[str, Any]:
        """Return the result of a task."""
        return self.work.result(task)


def _failure(done: Done, limits: Mapping[str, float | None]) -> dict[str, Any]:
    """Return the result of a task that has none; only one that was late is worth keeping."""
    stated = {name: limit for name, limit in limits.items() if limit is not None}
    more = stated if done.late else {"process_died": True}
    return {**failed(done.failure, done.seconds), **more}


def worth_another_try(kept: Mapping[str, Any], limits: Mapping[str, float | None]) -> bool:
    """Return whether a kept result ended at a limit that is shorter than that of now."""
    ended_at = {name: kept[name] for name in limits if kept.get(name) is not None}
    return any((now := limits[name]) is None or now > limit for name, limit in ended_at.items())


def failed(why: str, seconds: float) -> dict[str, Any]:
    """Return the result of a task that came to nothing."""
    return {"failure": why, "seconds": seconds}


def reasons(results: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """Return why results failed, and how often, the most frequent first."""
    found: dict[str, int] = {}
    for result in results:
        if result.get("failure"):
            found[result["failure"]] = found.get(result["failure"], 0) + 1
    return dict(sorted(found.items(), key=lambda each: -each[1]))


KIND = "dynident benchmark record"


def _to_2(data: Document) -> Document:
    return renamed(data, {"result.held_out_error": "test_error", "result.joints[].rows": "samples"})


#: Records.
VERSIONS = FileVersions("a record", (_to_2,))


class Task(Protocol):
    """One piece of work."""

    @property
    def label(self) -> str:
        """What it is called in progress."""
        ...

    @property
    def facts(self) -> Mapping[str, Any]:
        """Everything that its result depends on, as plain data."""
        ...


class Records:
    """A folder of results, each written whole or not at all, so that a run may be killed at any moment.

    The name of a file is the hash of the task's facts: a changed robot, motion, method, option or version is another
    task, and no result stands for one that it does not belong to. The order in which tasks are done leaves no trace.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(self.folder, f"cannot be made ({error.strerror})", "choose another folder") from error

    def read(self, task: Task) -> dict[str, Any] | None:
        """Return the result of a task; None where there is none, or where its file is damaged."""
        try:
            data = json.loads(self._place(task).read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return None
        if not isinstance(data, dict) or data.get("kind") != KIND or data.get("facts") != json.loads(_text(task.facts)):
            return None
        try:
            data = VERSIONS.migrated(data, lambda evidence, step: FileError(self._place(task), evidence, step))
        except DynidentError:
            return None
        return data["result"] if isinstance(data.get("result"), dict) else None

    def write(self, task: Task, result: Mapping[str, Any]) -> None:
        """Keep the result of a task.

        Raises:
            FileError: It cannot be written.
        """
        data = {"kind": KIND, "format": VERSIONS.current, "facts": task.facts, "result": result}
        write_atomically(self._place(task), json.dumps(data, indent=1, allow_nan=False, sort_keys=True) + "\n")

    def _place(self, task: Task) -> Path:
        return self.folder / f"{hashlib.sha256(_text(task.facts).encode()).hexdigest()[:24]}.json"


def _text(facts: Mapping[str, Any]) -> str:
    return json.dumps(facts, sort_keys=True, allow_nan=False)
