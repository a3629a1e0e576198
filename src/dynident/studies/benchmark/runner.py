"""Tasks of a benchmark done one after the other or by workers; each result is kept as soon as it is there."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass
from typing import Any, Protocol

from threadpoolctl import threadpool_limits

from dynident.errors import BadOption
from dynident.studies.benchmark.records import Records
from dynident.workers.pool import Done, Here, Pool, Tell
from dynident.workers.processes import local_pool


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
