"""2.5 million samples of a 6R arm, arrays to base parameters and covariance: time and memory beyond the inputs.

A process of its own makes the arrays, notes its peak memory, identifies and notes it again. A Pinocchio loop with lstsq
would hold a matrix of 6.2 GB, and as much again inside lstsq; it is not run.
"""

from __future__ import annotations

import json
import subprocess
import sys

from benchmarks.speed.harness import Line, Record, Times

SAMPLES, REPEATS = 2_500_000, 2

CODE = """
import json, sys, time
import numpy as np
from benchmarks.speed.rows.identification import as_taken, noisy_log, streamed
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.model.base_parameters import base_parameters
from dynident.robot_files import read_robot
from dynident.model.dynamic_model import DynamicModel

def status(key):
    with open("/proc/self/status") as lines:
        return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(key))

samples = int(sys.argv[1])
model = DynamicModel(read_robot("generic-6r"), ("coulomb", "viscous", "rotor_inertia"))
regressor = RegressorStream(model, base_parameters(model))
streamed(regressor, as_taken(noisy_log(model, 5000)))  # compiles
log = noisy_log(model, samples)
inputs = sum(part.nbytes for part in (log.time, log.q, log.dq, log.ddq, log.torque)) / 2**20
with open("/proc/self/clear_refs", "w") as reset:
    reset.write("5")  # the peak counts from here
before, wall, processor = status("VmRSS"), time.perf_counter(), time.process_time()
beta, _ = streamed(regressor, as_taken(log))
times = time.perf_counter() - wall, time.process_time() - processor
print(json.dumps({"wall": times[0], "processor": times[1], "inputs_mib": inputs, "beyond_mib": status("VmHWM") - before,
                  "beta": beta.tolist()}))
"""


def run(samples: int) -> dict[str, float]:
    """Return times and memory of one process."""
    done = subprocess.run([sys.executable, "-c", CODE, str(samples)], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def measure() -> Record:
    found = Record("long_log", f"6R arm, {SAMPLES} samples x 6 joints, arrays to base parameters and covariance")
    runs = [run(SAMPLES) for _ in range(REPEATS)]
    name = "streamed triangles"
    found.times[name] = Times([one["processor"] for one in runs], [one["wall"] for one in runs])
    found.facts["inputs, MiB"] = round(runs[0]["inputs_mib"])
    room = round(max(one["beyond_mib"] for one in runs))
    found.facts["peak memory beyond the inputs, MiB"] = room
    found.lines = [
        Line("2.5 million samples x 6 joints to base parameters, wall clock", name, reach=2.0, clock="wall"),
        Line(f"the same, of the processor; peak {room} MiB beyond the inputs", name),
    ]
    return found
