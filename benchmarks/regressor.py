"""The torque regressor of a UR10, sample by sample in Pinocchio and by the kernels of this package, in one run.

The arm is the table of Denavit-Hartenberg parameters that its maker publishes, with bodies of our own (the times do not
depend on them). Columns: the base parameters, streamed in chunks into buffers that stay in the cache, as identification
does; the whole regressor; the exact derivative of a weighted sum of it; inverse dynamics. The repeats of all rows are
interleaved, so that a busy machine slows all alike. Run: python -m benchmarks.regressor [--out FILE]
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pinocchio

from benchmarks.simulation import as_pinocchio
from dynident.arrays import Array
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import Inertia
from dynident.model.kernels import batched
from dynident.model.kernels.batched import JointColumns
from dynident.model.kernels.inputs import VARIABLE
from dynident.model.parameters import to_pinocchio
from dynident.model.robot import Joint, Link, Robot, rotation_about

SAMPLES, CHUNK, REPEATS = 25_000, 1000, 9
#: a (m), alpha (rad), d (m) of the UR10, standard convention, as its maker publishes them.
TABLE = (
    (0.0, np.pi / 2, 0.1273),
    (-0.612, 0.0, 0.0),
    (-0.5723, 0.0, 0.0),
    (0.0, np.pi / 2, 0.163941),
    (0.0, -np.pi / 2, 0.1157),
    (0.0, 0.0, 0.0922),
)


def ur10() -> Robot:
    """Return the arm; link i stands on the axis of joint i."""
    body = Inertia.from_centre_of_mass(5.0, [0.1, -0.05, 0.08], np.diag([0.06, 0.07, 0.05]))
    joints, a, alpha = [], 0.0, 0.0
    for i, (length, twist, offset) in enumerate(TABLE):
        turn = rotation_about([1.0, 0.0, 0.0], alpha)
        joints.append(
            Joint(f"joint{i + 1}", "revolute", i - 1, turn, turn @ [0.0, 0.0, offset] + [a, 0.0, 0.0], [0, 0, 1])
        )
        a, alpha = length, twist
    return Robot("ur10", tuple(Link(f"link{i + 1}", body) for i in range(6)), tuple(joints))


def motion() -> tuple[Array, Array, Array]:
    """Return q, dq, ddq (N, n) of a motion of five harmonics at 1 kHz."""
    generator = np.random.default_rng(0)
    pulsation = 2 * np.pi * 0.1 * np.arange(1, 6)
    size = generator.uniform(-0.5, 0.5, (6, 5))
    phase = np.arange(SAMPLES)[:, None, None] / 1000 * pulsation + generator.uniform(-np.pi, np.pi, (6, 5))
    return tuple(
        np.ascontiguousarray(np.sum(term, axis=-1))
        for term in (size * np.sin(phase), size * pulsation * np.cos(phase), -size * pulsation**2 * np.sin(phase))
    )


def pinocchio_regressor(oracle: pinocchio.Model, state: tuple[Array, ...], out: Array) -> None:
    """Write the regressor of every sample, in Pinocchio's order of columns."""
    data = oracle.createData()
    q, dq, ddq = state
    for k in range(len(q)):
        out[k] = pinocchio.computeJointTorqueRegressor(oracle, data, q[k], dq[k], ddq[k])


def pinocchio_torque(oracle: pinocchio.Model, state: tuple[Array, ...], out: Array) -> None:
    """Write the inverse dynamics of every sample."""
    data = oracle.createData()
    q, dq, ddq = state
    for k in range(len(q)):
        out[k] = pinocchio.rnea(oracle, data, q[k], dq[k], ddq[k])


def stream(columns: JointColumns, state: tuple[Array, ...], buffers: tuple[Array, ...]) -> None:
    """Evaluate chunk by chunk into the same buffers."""
    q, dq, ddq = state
    for start in range(0, len(q), CHUNK):
        part = slice(start, start + CHUNK)
        columns.evaluate(q[part], dq[part], ddq[part], out=buffers)


def halves(columns: JointColumns, state: tuple[Array, ...], buffers: list[tuple[Array, ...]]) -> None:
    """Stream on two threads."""
    middle = SAMPLES // CHUNK // 2 * CHUNK
    parts = [tuple(values[cut] for values in state) for cut in (slice(0, middle), slice(middle, None))]
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(stream, [columns] * 2, parts, buffers))


def pull(columns: JointColumns, state: tuple[Array, ...], weights: tuple[Array, ...]) -> None:
    """Differentiate a weighted sum of all entries, chunk by chunk."""
    q, dq, ddq = state
    for start in range(0, len(q), CHUNK):
        part = slice(start, start + CHUNK)
        columns.pullback(q[part], dq[part], ddq[part], weights)


def largest_difference(columns: JointColumns, state: tuple[Array, ...], theirs: Array) -> float:
    """Return how far the streamed entries are from Pinocchio's, relative to the largest."""
    order = np.argsort(to_pinocchio(np.arange(10)))
    rows = theirs.reshape(SAMPLES, 6, -1, 10)[..., order].reshape(SAMPLES, 6, -1)
    q, dq, ddq = state
    worst = 0.0
    for joint, (found, block) in enumerate(zip(columns.columns, columns.evaluate(q, dq, ddq), strict=True)):
        worst = max(worst, float(np.abs(rows[:, joint, columns.wanted[found]].T - block).max()))
    return worst / float(np.abs(rows).max())


def interleaved(rows: dict[str, Callable[[], object]]) -> dict[str, list[float]]:
    """Return the times of each row in ns per sample, one repeat of all rows after the other."""
    times: dict[str, list[float]] = {name: [] for name in rows}
    for _ in range(REPEATS):
        for name, call in rows.items():
            call()  # the row before has filled the caches with its own
            start = time.perf_counter()
            call()
            times[name].append((time.perf_counter() - start) / SAMPLES * 1e9)
    return times


def measure() -> dict[str, object]:
    """Run everything and return the figures."""
    robot, state = ur10(), motion()
    chain = robot.chain
    model = DynamicModel(robot, ())
    independent = base_parameters(model, inertial_only=True).independent
    start = time.perf_counter()
    columns = JointColumns(chain, independent)
    buffers = columns.buffers(CHUNK)
    with patch.dict(os.environ, {VARIABLE: "generated"}):
        columns.evaluate(*(values[:CHUNK] for values in state), out=buffers)
    first = time.perf_counter() - start
    oracle = as_pinocchio(robot, np.zeros((6, 6)))
    theirs, torque, theta = np.empty((SAMPLES, 6, 60)), np.empty((SAMPLES, 6)), model.nominal()
    assert theta is not None
    spare, weights = columns.buffers(CHUNK), tuple(np.ones_like(block) for block in buffers)

    def generic() -> None:
        with patch.dict(os.environ, {VARIABLE: "generic"}):
            stream(columns, state, buffers)

    loop, rnea = "pinocchio regressor, Python loop, stored", "pinocchio rnea, Python loop, stored"
    rows: dict[str, Callable[[], object]] = {
        loop: lambda: pinocchio_regressor(oracle, state, theirs),
        "base columns, generated, streamed": lambda: stream(columns, state, buffers),
        "base columns, generated, streamed, 2 threads": lambda: halves(columns, state, [buffers, spare]),
        "base columns, generic, streamed": generic,
        "all columns, generated, one new array": lambda: batched.torque_regressor(chain, *state),
        "derivative of the base columns, streamed": lambda: pull(columns, state, weights),
        rnea: lambda: pinocchio_torque(oracle, state, torque),
        "inverse dynamics, generated": lambda: batched.inverse_dynamics(chain, theta, *state),
    }
    with patch.dict(os.environ, {VARIABLE: "generated"}):
        times = interleaved(rows)
        difference = largest_difference(columns, state, theirs)
    medians = {name: statistics.median(values) for name, values in times.items()}
    peer = {name: rnea if "inverse" in name or name == rnea else loop for name in rows}
    return {
        "processor": platform.processor() or platform.machine(),
        "samples": SAMPLES,
        "repeats": REPEATS,
        "base columns": len(independent),
        "entries that move": sum(len(found) for found in columns.columns),
        "trace, compile and first chunk, s": first,
        "largest relative difference from pinocchio": difference,
        "rows": {
            name: {
                "median ns per sample": medians[name],
                "least ns per sample": min(times[name]),
                "times as fast as": peer[name],
                "ratio of medians": medians[peer[name]] / medians[name],
                "ratio of least": min(times[peer[name]]) / min(times[name]),
            }
            for name in rows
        },
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the torque regressor beside a Pinocchio loop.")
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks/regressor.json"), help="where the JSON goes")
    out = parser.parse_args().out
    found = measure()
    print(
        f"UR10, {SAMPLES} samples, {found['base columns']} base columns ({found['entries that move']} entries), "
        f"median of {REPEATS} interleaved repeats"
    )
    print(f"{'ns per sample':46s} {'median':>8s} {'ratio':>7s} {'least':>8s} {'ratio':>7s}")
    for name, row in found["rows"].items():
        median, least = row["median ns per sample"], row["least ns per sample"]
        print(f"{name:46s} {median:8.0f} {row['ratio of medians']:6.1f}x {least:8.0f} {row['ratio of least']:6.1f}x")
    print(f"trace, compile and first chunk: {found['trace, compile and first chunk, s']:.2f} s")
    difference = found["largest relative difference from pinocchio"]
    print(f"largest difference from pinocchio: {difference:.1e} of the largest entry")
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    print(f"written: {out}")


if __name__ == "__main__":
    main()
