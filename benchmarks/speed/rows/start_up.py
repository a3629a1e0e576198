"""Start-up: `dynident --help`, and the first identification of a robot with an empty cache, with a full one.

Each call is a process of its own, the interpreter's start included; the empty cache is a folder of its own for
NUMBA_CACHE_DIR. The log has six joints and 2000 samples; the estimator is the default, cross-validation is off.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.speed.harness import Line, Record, Times
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.robot_files import read_robot

REPEATS = 9
COMMAND = [sys.executable, "-c", "from dynident.cli.main import entry_point; entry_point()"]
CASE = """\
case: 2
robot: generic-6r
train: [run.csv]
preprocessing: {filter: {butterworth: {cutoff_hz: 5}}, rate_hz: 50}
"""


def measure() -> Record:
    found = Record("start_up", "processes from their start to their end; 6R arm, 20 s at 100 Hz in a CSV file")
    help_, bare = "dynident --help", "python -c pass"
    empty, full = "first identification, empty cache", "first identification in a process, full cache"
    imports = "import numba, scipy.linalg and clarabel"
    for name in (help_, bare, empty, full, imports):
        found.times[name] = Times()
    with tempfile.TemporaryDirectory() as folder:
        _write_case(Path(folder))
        identify = [*COMMAND, "identify", f"{folder}/case.yaml", "--quiet", "--cross-validate", "0"]
        environment = dict(os.environ)
        for k in range(REPEATS):
            fresh = {**os.environ, "NUMBA_CACHE_DIR": f"{folder}/cache{k}"}
            loads = [sys.executable, "-c", "import numba, scipy.linalg, clarabel"]
            for name, words, variables in (
                (bare, [sys.executable, "-c", "pass"], environment),
                (help_, [*COMMAND, "--help"], environment),
                (empty, identify, fresh),
                (full, identify, fresh),
                (imports, loads, environment),
            ):
                wall, processor = process(words, variables)
                found.times[name].wall.append(wall)
                found.times[name].processor.append(processor)
    found.lines = [
        Line("`dynident --help`", help_, reach=0.3),
        Line("first identification of a robot, compilation included", empty, reach=10.0),
        Line("the same from the cache", full, reach=1.0),
    ]
    found.facts["a bare Python process, s"] = found.times[bare].summary("processor")["median"]
    found.facts["imports of an identification alone, s"] = found.times[imports].summary("processor")["median"]
    return found


def process(words: list[str], environment: dict[str, str]) -> tuple[float, float]:
    """Return the wall clock and the time of the processor of one process, its children included.

    Python's byte code may be kept: an installed package, and all that the peers import, has it.
    """
    environment = {name: value for name, value in environment.items() if name != "PYTHONDONTWRITEBYTECODE"}
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(words, env=environment, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - began, processor


def _write_case(folder: Path) -> None:
    """Write a case and its log."""
    model = DynamicModel(read_robot("generic-6r"), ("coulomb", "viscous"))
    theta = model.nominal()
    assert theta is not None
    generator = np.random.default_rng(0)
    sine, cosine = 0.3 * generator.normal(size=(2, 6, 5))
    moments = np.arange(2000) / 100
    motion = Motion(*FourierSeries(np.zeros(6), sine, cosine, 10.0).evaluate(moments))
    torque = model.torque(motion, theta) + 0.2 * generator.normal(size=motion.q.shape)
    header = ",".join(["t", *(f"q{i}" for i in range(1, 7)), *(f"tau{i}" for i in range(1, 7))])
    table = np.column_stack([moments, motion.q, torque])
    np.savetxt(folder / "run.csv", table, delimiter=",", header=header, comments="")
    (folder / "case.yaml").write_text(CASE)
