"""Ctrl-C at a terminal, which interrupts all processes of a command: one line, code 130, no traceback of a worker."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from short_benchmark import benchmark_text

pytestmark = [pytest.mark.battery, pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")]

CASE = """case: 1
robot: generic-scara
friction: [viscous]
train: [run.npz]
preprocessing: {filter: {butterworth: {cutoff_hz: 5}}, rate_hz: 50}
"""
#: Begins a command as a shell does in the foreground, and says when it begins to load.
STARTED = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
if __name__ == "__main__":
    from dynident.cli.main import entry_point
    print("loaded", flush=True)
    entry_point()
"""
COMMANDS = (
    "excite generic-scara --starts 400 --period 4 --harmonics 2 --jobs 2 -o plan.json",
    "compare case.yaml --estimators wls,ga:iterations=20000,ga:iterations=30000 --jobs 2",
    "compare case.yaml --estimators wls,ga:iterations=20000 --time-limit 60",
    "benchmark mine.yaml --jobs 2 --out kept",
    "reduce case.yaml logs -o all.tri --jobs 2",
    "identify case.yaml logs",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a case, a benchmark and logs, so many that no command is done before it is interrupted."""
    place = tmp_path_factory.mktemp("interrupted")
    (place / "case.yaml").write_text(CASE)
    (place / "mine.yaml").write_text(benchmark_text("generic-scara", "[viscous]", draws=200))
    clock = np.arange(20_000) / 100
    q = np.sin(np.outer(clock, [1.7, 2.1, 2.5, 2.9])) * [1, 1, 0.05, 1]
    random = np.random.default_rng(0)
    (place / "logs").mkdir()
    for path in (place / "run.npz", *(place / "logs" / f"{k}.npz" for k in range(200))):
        np.savez(path, t=clock, q=q, tau=random.normal(0, 1, q.shape))  # logs of the same content are refused
    return place


@pytest.mark.parametrize("command", COMMANDS)
def test_an_interrupt_of_all_processes_of_a_command(command: str, folder: Path) -> None:
    """At moments while it loads, starts its workers and works with them."""
    for moment in np.linspace(0.3, 2.5, 12):
        process = subprocess.Popen(
            [sys.executable, "-c", STARTED, *command.split()],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        assert process.stdout is not None and process.stdout.readline() == "loaded\n"
        time.sleep(moment)
        os.killpg(process.pid, signal.SIGINT)
        _, said = process.communicate(timeout=120)
        assert process.returncode == 130 and said.splitlines()[-1].startswith("stopped"), (moment, said)
        assert "Traceback" not in said and "KeyboardInterrupt" not in said, (moment, said)
