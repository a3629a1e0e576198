"""Time and memory against samples, joints, logs and workers. Run: python -m benchmarks.speed.scaling [PART]

Times are of the processor, summed over threads; memory is the peak beyond the inputs. Samples: 6R arm, arrays to
triangles; above a million the same arrays pass in pieces of a million, as a stream does, and the triangles are merged.
Joints: serial arms with axes at right angles, 4000 samples: base parameters, the first thousand rows (trace and
compilation included) and the time a sample afterwards. Logs: so many logs of a second at 1 kHz in one problem. Workers:
logs reduced by one and two processes, by the clock, and by more as their schedule would be (`worker_schedule`). Each
part leaves its figures in benchmarks/results/scaling.json and its figure in docs/figures.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.speed.arms import motion
from benchmarks.speed.machine import machine
from benchmarks.speed.page import RESULTS, ROOT
from benchmarks.speed.rows.identification import as_taken, noisy_log
from benchmarks.speed.worker_schedule import measure as by_workers
from dynident.data.log import Log
from dynident.identification.problem.problem import make_problem
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import Inertia
from dynident.model.joint import Joint, rotation_about
from dynident.model.robot import Link, Robot
from dynident.results.figures.chart import Across, Line, Plot, chart
from dynident.results.figures.files import figure_file
from dynident.robot_files import read_robot

PLACE, FIGURES = RESULTS / "scaling.json", ROOT / "docs/figures"
SAMPLES = (10_000, 100_000, 1_000_000, 10_000_000, 100_000_000)
PIECE, CUT = 1_000_000, 300.0  # s of the processor that one point may take
JOINTS, LOGS = (2, 3, 4, 6, 8, 10, 12, 15, 20, 25, 30), (1, 10, 100, 1000)
PARTS = ("coulomb", "viscous", "rotor_inertia")


def peak_beyond(work: Callable[[], object]) -> tuple[float, float]:
    """Return the time of the processor in s and the peak of memory beyond what was there, in MiB (Linux)."""
    with open("/proc/self/clear_refs", "w") as reset:
        reset.write("5")
    before, began = _status("VmRSS"), time.process_time()
    work()
    return time.process_time() - began, _status("VmHWM") - before


def _status(key: str) -> float:
    with open("/proc/self/status") as lines:
        return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(key))


def by_samples() -> list[dict[str, Any]]:
    """Return time and memory against the number of samples; the last ones are cut where they would take too long."""
    model = DynamicModel(read_robot("generic-6r"), PARTS)
    regressor = RegressorStream(model, base_parameters(model))
    found: list[dict[str, Any]] = []
    for samples in SAMPLES:
        if found and found[-1]["processor_s"] * samples / found[-1]["samples"] > CUT:
            return [*found, {"samples": samples, "cut": f"more than {CUT:g} s of the processor"}]
        prepared = as_taken(noisy_log(model, min(samples, PIECE)))
        mask = np.ones(prepared.log.q.shape, bool)
        regressor.triangles(as_taken(noisy_log(model, 2000)), mask[:2000])

        def work(pieces: int = max(1, samples // PIECE), given: Any = (prepared, mask)) -> None:
            whole = regressor.triangles(*given)
            for _ in range(pieces - 1):
                whole = tuple(a.merged([b]) for a, b in zip(whole, regressor.triangles(*given), strict=True))

        spent, memory = peak_beyond(work)
        found.append({"samples": samples, "processor_s": spent, "memory_mib": memory})
        print(found[-1], flush=True)
    return found


def long_arm(joints: int) -> Robot:
    """Return a serial arm whose axes turn by right angles, every third one parallel to the one before."""
    body = Inertia.from_centre_of_mass(2.0, [0.05, -0.04, 0.06], np.diag([0.02, 0.03, 0.025]))
    each = []
    for k in range(joints):
        turn = rotation_about([1.0, 0.0, 0.0], (np.pi / 2, 0.0, -np.pi / 2)[k % 3])
        each.append(Joint(f"joint{k + 1}", "revolute", k - 1, turn, np.array([0.2, 0.0, 0.1]), [0.0, 0.0, 1.0]))
    return Robot(f"arm{joints}", tuple(Link(f"link{k + 1}", body) for k in range(joints)), tuple(each))


def by_joints() -> list[dict[str, Any]]:
    """Return times against the number of joints; the last ones are cut where they would take too long."""
    found: list[dict[str, Any]] = []
    for joints in JOINTS:
        if found and found[-1]["base_s"] * (joints / found[-1]["joints"]) ** 4 > CUT:
            return [*found, {"joints": joints, "cut": f"more than {CUT:g} s of the processor"}]
        model = DynamicModel(long_arm(joints), PARTS)
        began = time.process_time()
        base = base_parameters(model)
        based = time.process_time() - began
        states = motion(4000, joints)
        torque = np.random.default_rng(0).normal(size=states.q.shape)
        log = Log(model.robot.joint_names, np.arange(4000) / 1000, states.q, states.dq, states.ddq, torque)
        prepared, mask = as_taken(log), np.ones(states.q.shape, bool)
        began = time.process_time()
        regressor = RegressorStream(model, base)
        regressor.triangles(as_taken(log.rows(slice(0, 1000), "cut")), mask[:1000])
        first = time.process_time() - began
        spent, memory = peak_beyond(lambda o=regressor, p=prepared, m=mask: o.triangles(p, m))
        point = {"joints": joints, "base_parameters": base.count, "base_s": based, "first_s": first}
        found.append(point | {"processor_s_per_sample": spent / 4000, "memory_mib": memory})
        print(found[-1], flush=True)
    return found


def by_logs() -> list[dict[str, Any]]:
    """Return time and memory against the number of logs of 1000 samples."""
    model = DynamicModel(read_robot("generic-6r"), PARTS)
    base, whole = base_parameters(model), noisy_log(model, 100_000)
    kinds = [as_taken(whole.rows(slice(start, start + 1000), "cut")) for start in range(0, 100_000, 1000)]
    make_problem(model, base, kinds[:10])
    found = []
    for logs in LOGS:
        given = [kinds[k % len(kinds)] for k in range(logs)]
        spent, memory = peak_beyond(lambda g=given: make_problem(model, base, g))
        found.append({"logs": logs, "processor_s": spent, "memory_mib": memory})
        print(found[-1], flush=True)
    return found


def draw(data: dict[str, Any]) -> None:
    """Write the figures of what is there."""
    FIGURES.mkdir(exist_ok=True)
    for part, heading, curves in (
        ("samples", "samples", (("processor_s", "time [s]"),)),
        (
            "joints",
            "joints",
            (
                ("processor_s_per_sample", "time a sample [us]"),
                ("first_s", "first rows, trace and compilation [s]"),
                ("base_s", "base parameters [s]"),
            ),
        ),
        ("logs", "logs of 1000 samples", (("processor_s", "time [s]"),)),
    ):
        points = [point for point in data.get(part, ()) if "cut" not in point]
        if not points:
            continue
        x = np.array([point[part] for point in points], dtype=float)
        plots = []
        for key, name in curves:
            size = 1e6 if name.endswith("[us]") else 1.0
            y = size * np.maximum([point[key] for point in points], 1e-9)
            plots.append(Plot(name, (Line("", x, np.asarray(y, dtype=float), 1, width=1.6),), 110.0, log=True))
        title = f"Identification against {heading}"
        told = "; ".join(f"{point[part]}: " + ", ".join(f"{point[key]:.3g}" for key, _ in curves) for point in points)
        drawing = chart(title, told, Across(heading, log=True), plots)
        (FIGURES / f"scaling-{part}.svg").write_bytes(figure_file(drawing, title, told))
    if "workers" in data:
        draw_workers(data["workers"])


def draw_workers(data: dict[str, Any]) -> None:
    """Write the figure of logs against workers: as scheduled, and as measured."""
    scheduled = data["scheduled"]
    times, shares = [], []
    for colour, logs in enumerate(dict.fromkeys(point["logs"] for point in scheduled), start=1):
        workers, wall = np.array([(p["workers"], p["wall_s"]) for p in scheduled if p["logs"] == logs], dtype=float).T
        times.append(Line(f"{logs} logs, scheduled", workers, wall, colour, width=1.6))
        shares.append(Line("", workers, wall[0] / wall, colour, width=1.6))
    if data["load"] < 1:  # the clock of a machine with other work says nothing about this one
        measured = [(p["workers"], min(p["wall_s"])) for p in data["measured"]]
        x, y = np.array(measured, dtype=float).T
        times.append(Line(f"{data['logs']} logs, measured", x, y, len(times) + 1, width=3.5))
    shares.append(Line("as many times as workers", workers, workers, len(times) + 1, dashed=True))
    title = f"Logs of {data['rows']} rows against workers"
    told = "; ".join(f"{p['logs']} logs, {p['workers']} workers: {p['wall_s']:.3g} s" for p in scheduled)
    plots = [Plot("time [s]", tuple(times), 130.0, log=True), Plot("times as fast", tuple(shares), 130.0, log=True)]
    drawing = chart(title, told, Across("workers", log=True), plots)
    (FIGURES / "scaling-workers.svg").write_bytes(figure_file(drawing, title, told))


def main() -> None:
    parts = {"samples": by_samples, "joints": by_joints, "logs": by_logs, "workers": by_workers}
    parser = argparse.ArgumentParser(prog="python -m benchmarks.speed.scaling", description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", help=f"of {', '.join(parts)}; all unless stated")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    data = json.loads(PLACE.read_text(encoding="utf-8")) if PLACE.is_file() else {}
    for name in parser.parse_args().parts or parts:
        data[name] = parts[name]()
        data["machine"] = machine()
        PLACE.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    draw(data)


if __name__ == "__main__":
    main()
