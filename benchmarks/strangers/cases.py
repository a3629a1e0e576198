"""The strangers: an arm, its drives and motions, the layout of its logs, and the answers that no log can give."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.strangers import arms
from benchmarks.strangers.plant import Body, Drives, Run

Array = Any
DEG = 180 / np.pi

TRUE = ("coulomb: {width: 0.004}", "viscous", "rotor_inertia")


@dataclass(frozen=True)
class Stranger:
    """A robot that nobody has seen.

    Attributes:
        bodies: Its joints and links.
        drives: What moves it.
        rate: Samples a second.
        seconds: Length of the logs to learn from; that to test on has two thirds of it.
        first: Lowest frequency of its motion in Hz, of five harmonics.
        share: Share of the largest speeds that it reaches.
        noise: Deviation of the torques, as a share of the largest.
        write: Writes a log of a run and returns its name.
        learn: Number of logs to learn from.
        options: Options of init.
        answers: Lines of the draft by their beginnings, and what stands in their place.
        friction: Friction that is there.
        gravity: In the frame of the base.
    """

    bodies: Sequence[Body]
    drives: Drives
    rate: float
    seconds: float
    first: float
    share: float
    noise: float
    write: Callable[[Path, str, Sequence[Body], Run, np.random.Generator], str]
    learn: int = 1
    options: Sequence[str] = ()
    answers: Mapping[str, str] = field(default_factory=dict)
    friction: Sequence[str] = TRUE
    gravity: Sequence[float] = (0, 0, -9.81)

    def reach(self) -> tuple[Array, Array]:
        """Return half the way that each joint goes, and about what position."""
        low, high = np.array([body.limits for body in self.bodies]).T
        return np.minimum(0.4 * (high - low), 1.4), np.where(high - low > 6, 0.3, (low + high) / 2)


def table(
    path: Path, header: str, columns: Sequence[Array], sep: str = ",", mark: str = ".", form: str = "%.7g"
) -> str:
    rows = np.column_stack(columns)
    body = "\n".join(sep.join([f"{row[0]:.9g}", *(form % value for value in row[1:])]) for row in rows) + "\n"
    path.write_text(header + "\n" + (body if mark == "." else body.replace(".", mark)))
    return path.name


def names(words: Sequence[str], count: int, first: int = 1, form: str = "{word}{k}") -> list[str]:
    return [form.format(word=word, k=k) for word in words for k in range(first, first + count)]


def sunrise(folder: Path, name: str, bodies: Sequence[Body], run: Run, noise: np.random.Generator) -> str:
    words = ("MeasuredJointPosition_A", "MeasuredTorque_A", "ExternalTorque_A", "CommandedJointPosition_A")
    outer = noise.normal(0, 0.3, run.q.shape)
    header = " ".join(["timestamp_ms", *names(words, 7)])
    return table(
        folder / f"{name}.txt",
        header,
        [np.round(run.time * 1e3) + 1.7e6, run.q, run.at_sensors, outer, run.wanted],
        " ",
    )


GAINS = (11.2, 11.2, 11.2, 8.5, 8.5, 8.5)


def rtde(folder: Path, name: str, bodies: Sequence[Body], run: Run, noise: np.random.Generator) -> str:
    words = ("target_q_", "target_current_", "target_moment_", "actual_q_", "actual_qd_", "actual_current_")
    current = run.at_motors / np.array(GAINS)
    values = [run.time + 1234.5, run.wanted, 0.95 * current, run.at_sensors, np.round(run.q, 5), run.dq, current]
    return table(folder / f"{name}.csv", " ".join(["timestamp", *names(words, 6, 0)]), values, " ")


def viewer(folder: Path, name: str, bodies: Sequence[Body], run: Run, noise: np.random.Generator) -> str:
    units = (("position", "deg"), ("speed", "deg/s"), ("torque", "Nm"))
    header = ";".join(["Time [s]", *(f"J{k} {word} [{unit}]" for word, unit in units for k in range(1, 7))])
    return table(folder / f"{name}.csv", header, [run.time, run.q * DEG, run.dq * DEG, run.at_motors], ";", ",")


def matlab(folder: Path, name: str, bodies: Sequence[Body], run: Run, noise: np.random.Generator) -> str:
    import scipy.io

    data = {"time": run.time, "jointPos": run.q.T, "jointPosCmd": run.wanted.T, "jointTorque": run.at_motors.T}
    scipy.io.savemat(folder / f"{name}.mat", {"data": data})
    return f"{name}.mat"


def feedback(folder: Path, name: str, bodies: Sequence[Body], run: Run, noise: np.random.Generator) -> str:
    words = ("position", "velocity", "torque", "current_motor")
    header = ",".join(["time", *(f"actuators_{k}_{word}" for k in range(7) for word in words)])
    late = run.time + noise.uniform(0, 0.0015, len(run.time))
    each = (np.mod(run.q * DEG, 360.0), run.dq * DEG, run.at_motors, run.at_motors / 9)
    return table(folder / f"{name}.csv", header, [late, *(value[:, k] for k in range(7) for value in each)])


RATED = (30.0, 20.0, 100.0, 2.0)


def permille(folder: Path, name: str, bodies: Sequence[Body], run: Run, noise: np.random.Generator) -> str:
    scale = np.array([DEG, DEG, 1e3, DEG])
    header = ";".join(["t_us", *names(("ActPos", "ActVel", "ActTrq_permille"), 4)])
    torque = np.round(run.at_motors / np.array(RATED) * 1000)
    return table(folder / f"{name}.csv", header, [run.time * 1e6, run.q * scale, run.dq * scale, torque], ";")


def episode(folder: Path, name: str, bodies: Sequence[Body], run: Run, noise: np.random.Generator) -> str:
    import pyarrow
    import pyarrow.parquet

    state, load = np.round(run.q * DEG * 4096 / 360) * 360 / 4096, np.round(run.at_motors / 1.9 * 1000) / 10
    lists = {"action": run.wanted * DEG, "observation.state": state, "observation.load": load}
    columns = {key: list(value.astype(np.float32)) for key, value in lists.items()}
    columns |= {"timestamp": run.time.astype(np.float32), "frame_index": np.arange(len(run.time))}
    pyarrow.parquet.write_table(pyarrow.table(columns), folder / f"{name}.parquet")
    return f"{name}.parquet"


def recording(folder: Path, name: str, bodies: Sequence[Body], run: Run, noise: np.random.Generator) -> str:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store, kind = get_typestore(Stores.ROS2_HUMBLE), "sensor_msgs/msg/JointState"
    state, head, stamp = (store.types[t] for t in (kind, "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
    order = [3, 0, 1, 2, 4, 5]
    with Writer(folder / name, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = [writer.add_connection(t, kind, typestore=store) for t in ("/ufactory/joint_states", "/joint_states")]
        for k, time in enumerate(run.time):
            ns = int((1.7e9 + time) * 1e9)
            header = head(stamp=stamp(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="")
            parts = [value[k][order] for value in (run.q, run.dq, run.at_motors)]
            full = state(header, [bodies[j].joint for j in order], *parts)
            writer.write(topics[0], ns + int(noise.uniform(0, 2e6)), store.serialize_cdr(full, kind))
            if k % 15 == 0:
                bare = state(header, [body.joint for body in bodies], run.q[k], np.array([]), np.array([]))
                writer.write(topics[1], ns, store.serialize_cdr(bare, kind))
    return name


def coupled(motor: int, joint: int) -> Array:
    matrix = np.eye(6)
    matrix[motor, joint] = 1.0
    return matrix


def stated(matrix: Array) -> dict[str, str]:
    rows = ", ".join(f"[{', '.join(f'{value:g}' for value in row)}]" for row in matrix)
    return {"# coupling:": f"coupling: [{rows}]", "  units:": "  side: {torque: motor}\n  units:"}


PARALLEL, WRIST = coupled(2, 1), coupled(5, 4)

STRANGERS: Mapping[str, Stranger] = {
    "iiwa": Stranger(
        arms.iiwa(), Drives((0.6, 0.8, 0.5, 0.5, 0.3, 0.15, 0.1), (5, 5, 3, 3, 1.6, 0.6, 0.6), (9, 9, 5, 5, 3, 1, 1)),
        250, 15, 0.1, 0.7, 0.001, sunrise, 2,
        answers={"  - rotor_inertia": ""}, friction=("coulomb: {width: 0.004}", "offset"),
    ),
    "ur5e": Stranger(
        arms.ur5e(), Drives((1.1, 1.1, 0.9, 0.12, 0.12, 0.12), (5, 6, 4, 1.2, 1.1, 0.9), (8, 8, 6, 1.5, 1.4, 1.2),
                            load=0.04, bend=(4, 5, 3, 0.8, 0.8, 0.7)), 500, 20, 0.05, 0.8, 0.004, rtde,
        answers={f"@actual_current_{k}": f"    gain: {gain}" for k, gain in enumerate(GAINS)},
        friction=("coulomb: {width: 0.004}", "viscous", "rotor_inertia", "degressive", "load"),
    ),
    "irb": Stranger(
        arms.irb(), Drives((30, 40, 18, 2, 1, 0.5), (60, 70, 40, 12, 8, 5), (40, 50, 25, 8, 5, 3),
                           break_away=(15, 20, 10, 2, 1, 1), coupling=PARALLEL), 250, 20, 0.1, 0.6, 0.004, viewer,
        answers=stated(PARALLEL),
    ),
    "tx2": Stranger(
        arms.tx2(), Drives((1.3, 1.2, 0.5, 0.12, 0.06, 0.03), (12, 10, 6, 3, 2, 1.2), (10, 9, 5, 2, 1.4, 0.8),
                           coupling=WRIST), 1000, 15, 0.1, 0.35, 0.006, matlab, answers=stated(WRIST),
    ),
    "gen3": Stranger(
        arms.gen3(), Drives((0.35,) * 4 + (0.12,) * 3, (1.2,) * 4 + (0.3,) * 3, (2,) * 4 + (0.45,) * 3),
        100, 40, 0.05, 0.8, 0.005, feedback,
    ),
    "scara": Stranger(
        arms.scara(), Drives((0.25, 0.12, 8, 0.01), (3, 2, 15, 0.3), (2, 1.2, 40, 0.05)), 1000, 8, 0.25, 0.6, 0.005,
        permille, 2, answers={
            "    position: ask": "    position: [deg, deg, mm, deg]", "    torque: ask": "    torque: permille",
            "    bias: ask": "    bias: 0", "  rated: ask": f"  rated: {list(RATED)}",
        },
    ),
    "so100": Stranger(
        arms.so100(), Drives(0.004, 0.06, 0.08), 30, 60, 0.1, 0.5, 0.008, episode, answers={
            "servo:": "friction:\n  - coulomb: {width: 0.01, choose: width}", "  law:": "  - viscous",
            "  kp:": "  - offset", "  # enabled": "  - rotor_inertia", "  friction: auto": "",
            "    torque: none": '    torque: "observation.load{}"',
            "    position: ask": "    position: deg\n    torque: percent",
            "  units:": "  rated: [1.9, 1.9, 1.9, 1.9, 1.9]\n  units:",
        },
    ),
    "xarm": Stranger(
        arms.xarm(), Drives((0.5, 0.5, 0.4, 0.2, 0.15, 0.1), (2, 2, 1.3, 1.3, 1.3, 0.8), (3, 3, 2, 2, 2, 1.2)),
        150, 24, 1 / 12, 0.6, 0.006, recording,
        options=("--format", "rosbag", "--format-option", "topics=/ufactory/joint_states"),
        answers={"# gravity:": "gravity: [9.81, 0, 0]"}, gravity=(9.81, 0, 0),
    ),
}  # fmt: skip
