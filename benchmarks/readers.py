"""Logs larger than memory: `dynident reduce` beside the bare reader of the format, in one run; memory of each.

A log of a 6-joint arm at 1 kHz is made on the fly. Each side runs in a process of its own, so that its peak memory is
its own. Before, on 200,000 rows, the estimate from the stream is compared with that from memory.
Run: python -m benchmarks.readers [ROWS of Parquet, 10 million unless stated]
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynident import DynamicModel, FourierSeries, Preprocessing, read_robot
from dynident.case.case import read_case
from dynident.data.preprocessing import FILTERS
from dynident.identification.identify import identify
from dynident.identification.streaming.estimate import identify_digest
from dynident.identification.streaming.reduction import reduce_logs
from dynident.model.friction import Motion

ROWS, OTHER_ROWS, CHECKED_ROWS, PART = 10_000_000, 200_000, 200_000, 1 << 17

CASE = """\
case: 2
robot: generic-6r
{columns}
preprocessing: {{filter: {{butterworth: {{cutoff_hz: 5}}}}, rate_hz: 200}}
"""
ROS = """\
log: {profile: joint_states}
"""

READERS = {
    "parquet": """
import sys, pyarrow.parquet as pq
for batch in pq.ParquetFile(sys.argv[1], buffer_size=1 << 20, pre_buffer=False).iter_batches(1 << 14):
    for name in batch.schema.names:
        batch.column(name).to_numpy(zero_copy_only=False)
""",
    "csv": """
import sys, numpy as np
from itertools import islice
with open(sys.argv[1]) as stream:
    next(stream)
    while lines := list(islice(stream, 1 << 14)):
        np.loadtxt(lines, delimiter=",")
""",
    "mcap": """
import sys
from pathlib import Path
from rosbags.highlevel import AnyReader
with AnyReader([Path(sys.argv[1])]) as reader:
    for connection, _, data in reader.messages():
        reader.deserialize(data, connection.msgtype)
""",
}


def parts(rows):
    """Yield time, positions and torques of a motion with noise, some at a time."""
    model = DynamicModel(read_robot("generic-6r"), ("coulomb", "viscous", "offset"))
    generator = np.random.default_rng(0)
    sine, cosine = 0.3 * generator.normal(size=(2, 6, 5))
    series = FourierSeries(np.zeros(6), sine, cosine, 25.0)
    theta = np.array(model.nominal())
    theta[model.inertial_count :] = np.tile([2.0, 1.0, 0.3], 6)
    for start in range(0, rows, PART):
        time_ = np.arange(start, min(rows, start + PART)) / 1000
        q, dq, ddq = series.evaluate(time_)
        torque = model.torque(Motion(q, dq, ddq), theta)
        noise = generator.normal(size=(2, *q.shape))
        yield time_, q + 1e-5 * noise[0], torque + 0.5 * noise[1]


def write_parquet(path, rows):
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = ["t", *(f"{word}{k}" for word in ("q", "tau") for k in range(1, 7))]
    schema = pa.schema([(name, pa.float64()) for name in names])
    with pq.ParquetWriter(path, schema) as writer:
        for time_, q, torque in parts(rows):
            writer.write_table(pa.table(dict(zip(names, [time_, *q.T, *torque.T], strict=True)), schema=schema))


def write_csv(path, rows):
    with path.open("w") as stream:
        stream.write(",".join(["t", *(f"{word}{k}" for word in ("q", "tau") for k in range(1, 7))]) + "\n")
        for block in parts(rows):
            np.savetxt(stream, np.column_stack(block), delimiter=",", fmt="%.9g")


def write_mcap(path, rows):
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind, types = "sensor_msgs/msg/JointState", store.types
    names = list(read_robot("generic-6r").joint_names)
    folder = path.with_suffix("")
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/joint_states", kind, typestore=store)
        for time_, q, torque in parts(rows):
            for k, stamp in enumerate((np.rint(time_ * 1e9).astype(int) + 10**18).tolist()):
                at = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
                header = types["std_msgs/msg/Header"](stamp=at, frame_id="")
                message = types[kind](header, names, q[k], np.empty(0), torque[k])
                writer.write(topic, stamp, store.serialize_cdr(message, kind))
    next(folder.glob("*.mcap")).rename(path)


def measured(words):
    """Return wall time and processor time in s, and peak memory in MB, of a process."""
    code = "import resource, subprocess, sys; r = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode; "
    code += "u = resource.getrusage(resource.RUSAGE_CHILDREN); "
    code += "print(u.ru_utime + u.ru_stime, u.ru_maxrss / 1024); sys.exit(r)"
    start = time.perf_counter()
    found = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True)
    processor, memory = map(float, found.stdout.split())
    return time.perf_counter() - start, processor, memory


def compared(folder):
    """Return how far the estimate from a stream is from that in memory, relative."""
    path = folder / "checked.parquet"
    write_parquet(path, CHECKED_ROWS)
    how = Preprocessing(FILTERS.make("butterworth", {"cutoff_hz": 5.0}), rate_hz=200.0, trim_s=0.5, standstill=0.02)
    case = replace(read_case("generic-6r"), preprocessing=how)
    ours = identify_digest(reduce_logs(case.stream_setup(), [path]), "wls").beta
    whole = identify(case.model, [case.read(path)], "wls", how).beta
    return float(np.linalg.norm(ours - whole) / np.linalg.norm(whole))


def main() -> None:
    rows = int(float(sys.argv[1])) if len(sys.argv) > 1 else ROWS
    result: dict[str, object] = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        result["stream_apart_from_memory"] = apart = compared(folder)
        for kind, write, count in (
            ("parquet", write_parquet, rows),
            ("csv", write_csv, OTHER_ROWS),
            ("mcap", write_mcap, OTHER_ROWS),
        ):
            path, case = folder / f"log.{kind}", folder / f"{kind}.yaml"
            case.write_text(CASE.format(columns=ROS if kind == "mcap" else ""))
            try:
                write(path, count)
            except ImportError as error:
                print(f"{kind}: left out, {error}")
                continue
            bare, bare_cpu, bare_memory = measured([sys.executable, "-c", READERS[kind], str(path)])
            words = ["reduce", str(case), str(path), "-o", str(folder / f"{kind}.tri"), "--quiet"]
            ours, cpu, memory = measured(
                [sys.executable, "-c", "from dynident.cli.main import entry_point; entry_point()", *words]
            )
            result[kind] = {
                "rows": count,
                "file_mb": round(path.stat().st_size / 2**20),
                "reader_s": round(bare, 2),
                "reduce_s": round(ours, 2),
                "ratio": round(ours / bare, 2),
                "reader_cpu_s": round(bare_cpu, 2),
                "reduce_cpu_s": round(cpu, 2),
                "reader_peak_mb": round(bare_memory),
                "reduce_peak_mb": round(memory),
            }
            path.unlink()
    print(json.dumps(result, indent=1))
    if not apart < 1e-9:
        raise SystemExit("the stream and the log in memory give other estimates")


if __name__ == "__main__":
    main()
