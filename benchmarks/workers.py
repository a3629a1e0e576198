"""Many logs, many workers: a folder of logs reduced by one and two workers of each pool, and what a task costs.

The pools take turns within a round, each command a process of its own; the triangles of all are compared bit by bit.
Times of the processor are those of the command with all its workers. The load of the machine is told.
Run: python -m benchmarks.workers [LOGS, 40 unless stated] [ROWS of each, 100,000 unless stated] [ROUNDS, 3]
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.readers import CASE, measured, parts
from dynident.workers.dask_pool import DaskPool
from dynident.workers.processes import Here, Processes

LOGS, ROWS, ROUNDS, TASKS = 40, 100_000, 3, 200

POOLS: dict[str, list[str]] = {
    "this process": [],
    "2 processes": ["--jobs", "2"],
    "Dask, 1 worker": ["--scheduler", "local:1"],
    "Dask, 2 workers": ["--scheduler", "local:2"],
}


class Nothing:
    """Work that is none, so that the pool is what is measured."""

    def prepare(self):
        """Do nothing."""

    def do(self, task, tell):
        """Return the task."""
        return task


def write_logs(folder, logs, rows):
    """Write logs of one motion, each with noise of its own."""
    blocks = list(parts(rows))
    time_, q, torque = (np.concatenate(part) for part in zip(*blocks, strict=True))
    for k in range(logs):
        noise = 0.5 * np.random.default_rng(k).normal(size=torque.shape)
        np.savez(folder / f"run{k:04d}.npz", t=time_, q=q, tau=torque + noise)


def bits(path):
    """Return all arrays of a triangle file as bytes."""
    with np.load(path) as archive:
        return {name: archive[name].tobytes() for name in archive.files}


def reductions(logs, rows, rounds):
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "logs"
        folder.mkdir()
        write_logs(folder, logs, rows)
        case = Path(place) / "case.yaml"
        case.write_text(CASE.format(columns=""))
        code = "import sys; from dynident.cli.main import main; sys.exit(main())"
        found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in POOLS}
        for _ in range(rounds):
            for number, (name, more) in enumerate(POOLS.items()):
                target = Path(place) / f"{number}.tri"
                words = [sys.executable, "-c", code, "reduce", str(case), str(folder), "-o", str(target)]
                found[name].append(measured([*words, "--checkpoint", "0", "--quiet", *more]))
        same = all(bits(Path(place) / f"{n}.tri") == bits(Path(place) / "0.tri") for n in range(1, len(POOLS)))
    print(f"{logs} logs of {rows:,} rows; same bits: {same}; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    first = [wall for wall, _, _ in found["this process"]]
    for name, runs in found.items():
        wall, processor, memory = (statistics.median(values) for values in zip(*runs, strict=True))
        ratio = statistics.median(one / own for one, (own, _, _) in zip(first, runs, strict=True))
        used = f"{wall:7.1f} s, of processors {processor:6.1f} s, peak {memory:5.0f} MB"
        print(f"{name:16} {used}, {ratio:5.2f} times as fast", flush=True)


def overheads():
    """Print what an empty task costs: start of the pool with its first task, then each of the others."""
    pools = {"this process": Here(), "1 process": Processes(1), "Dask, 1 worker": DaskPool("local:1")}
    for name, pool in pools.items():
        begun, marks = time.perf_counter(), []
        for _ in pool.run(Nothing(), range(TASKS)):
            marks.append((time.perf_counter(), time.process_time()))
        wall, own = ((last - first) / (TASKS - 1) for first, last in zip(marks[0], marks[-1], strict=True))
        start = marks[0][0] - begun
        each = f"a task {1e3 * wall:6.2f} ms, {1e3 * own:5.2f} ms of them of this process's processor"
        print(f"{name:16} start {start:6.2f} s; {each}", flush=True)


def main() -> None:
    """Print the figures of docs/performance.md."""
    stated = [int(word) for word in sys.argv[1:]]
    logs, rows, rounds = (stated + [LOGS, ROWS, ROUNDS][len(stated) :])[:3]
    overheads()
    reductions(logs, rows, rounds)


if __name__ == "__main__":
    main()
