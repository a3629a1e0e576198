"""The time that logs take with any number of workers: list scheduling with measured times of the tasks.

A command with workers does this: it settles what all logs share, begins its workers side by side, hands each one the
next log when it has taken that worker's last result, and merges what is left at the end. The times of all these are
measured in one process, as times of the processor; a schedule of W workers follows from them. The command itself takes
results one at a time, so it is what many workers wait for at last.
"""

from __future__ import annotations

import heapq
import os
import pickle
import resource
import tempfile
import time
from collections.abc import Generator, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.readers import CASE
from benchmarks.workers import write_logs
from dynident.case.case import Case, read_case
from dynident.identification.streaming.reduction import reduce_logs
from dynident.workers.processes import Done, Pool, Processes, Tell, Work

LOGS, ROWS, ROUNDS = 24, 20_000, 3
WORKERS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
MANY = 1000


@dataclass(frozen=True)
class Costs:
    """What the work is made of, in s.

    Attributes:
        before: Of the command, before the first task.
        start: Of a worker, until it stands ready and has made what all its tasks share.
        tasks: Of a worker, each task.
        takes: Of the command, each result: taken, merged with those beside it, and the next task sent.
        after: Of the command, behind the last result.
    """

    before: float
    start: float
    tasks: tuple[float, ...]
    takes: tuple[float, ...]
    after: float

    def repeated(self, count: int) -> Costs:
        """Return the same with so many tasks, those measured over and over."""
        turns = range(count)
        tasks, takes = (tuple(part[k % len(part)] for k in turns) for part in (self.tasks, self.takes))
        return Costs(self.before, self.start, tasks, takes, self.after)


def schedule(costs: Costs, workers: int) -> float:
    """Return the time in s from the call to its result with so many workers, each with a processor of its own.

    Tasks are handed out in their order, each to the first worker that is free; results wait until the command has taken
    those that came before (list scheduling: Graham 1966).
    """
    waiting = list(range(len(costs.tasks)))[::-1]
    results: list[tuple[float, int]] = []
    for _ in range(min(workers, len(waiting))):
        task = waiting.pop()
        heapq.heappush(results, (costs.before + costs.start + costs.tasks[task], task))
    free = costs.before  # when the command can take the next result
    while results:
        ready, task = heapq.heappop(results)
        free = max(free, ready) + costs.takes[task]
        if waiting:
            following = waiting.pop()
            heapq.heappush(results, (free + costs.tasks[following], following))
    return free + costs.after


class Recorder(Pool):
    """One worker in this process that notes the time of the processor of each part of the work."""

    def __init__(self) -> None:
        self.tasks: list[float] = []
        self.takes: list[float] = []
        self.began = self.ended = 0.0

    def run(
        self,
        work: Work,
        tasks: Iterable[Any],
        *,
        time_limit: float | None = None,
        begins: Tell = lambda task: None,
        news: Tell = lambda said: None,
    ) -> Generator[Done, None, None]:
        """Yield tasks as they end; see :meth:`Pool.run`."""
        self.began = time.process_time()
        for task in tasks:
            begun = time.process_time()
            sent = pickle.dumps(work.do(pickle.loads(pickle.dumps(task)), news))
            done = time.process_time()
            yield Done(task, done - begun, pickle.loads(sent))
            self.tasks.append(done - begun)
            self.takes.append(time.process_time() - done)
        self.ended = time.process_time()


def measure(logs: int = LOGS, rows: int = ROWS, rounds: int = ROUNDS) -> dict[str, Any]:
    """Return the times of the parts, of one and two workers as they are, and of more by the schedule."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_logs(folder, logs, rows)
        names = [str(path) for path in sorted(folder.glob("*.npz"))]
        (folder / "case.yaml").write_text(CASE.format(columns=""))
        case = read_case(str(folder / "case.yaml"))
        costs = measured_costs(case, names)
        load = os.getloadavg()[0]
        walls: dict[int, list[float]] = {1: [], 2: []}
        for _ in range(rounds):
            for workers, found in walls.items():
                begun = time.perf_counter()
                reduce_logs(case.stream_setup(), names, pool=Processes(workers))
                found.append(time.perf_counter() - begun)
    plans = {logs: costs, MANY: costs.repeated(MANY)}
    return {
        "logs": logs,
        "rows": rows,
        "costs": asdict(costs),
        "load": load,
        "measured": [{"workers": workers, "wall_s": found} for workers, found in walls.items()],
        "scheduled": [
            {"logs": count, "workers": workers, "wall_s": schedule(plan, workers)}
            for count, plan in plans.items()
            for workers in WORKERS
        ],
    }


def measured_costs(case: Case, names: Sequence[str]) -> Costs:
    """Return the times of the processor of all parts of a reduction; this process is warm behind its first log."""
    reduce_logs(case.stream_setup(), names[:1], pool=Recorder())
    recorder, begun = Recorder(), time.process_time()
    reduce_logs(case.stream_setup(), names, pool=recorder)
    after = time.process_time() - recorder.ended
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    reduce_logs(case.stream_setup(), names[:2], pool=Processes(1))
    whole = resource.getrusage(resource.RUSAGE_CHILDREN)
    worker = whole.ru_utime + whole.ru_stime - spent.ru_utime - spent.ru_stime
    start = max(worker - sum(recorder.tasks[:2]), 0.0)
    return Costs(recorder.began - begun, start, tuple(recorder.tasks), tuple(recorder.takes), after)
