"""Tables, ROS messages and bags, read back by their own libraries: the design, its derivatives, the approach."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from driven_plans import designed, plan_of

from dynident.data.formats import ColumnMap, read_log
from dynident.errors import BadOption, FileError, MissingDependency
from dynident.excitation.design.plan import sampled, write_plan, write_samples
from dynident.exports.motions import MOTION_EXPORTERS, Playback, export_motion
from dynident.files import sha256_of

POSTURE = np.array([0.5, -0.25, 0.0, 1.0, -1.0, 0.125])


def read_table(path: Path, joints: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times and q, dq, ddq (3, N, n) of a table."""
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    return rows[:, 0], rows[:, 1:].reshape(len(rows), 3, joints).transpose(1, 0, 2)


def read_message(message: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    stamps = [point["time_from_start"] for point in message["points"]]
    keys = ("positions", "velocities", "accelerations")
    signals = np.array([[point[key] for key in keys] for point in message["points"]])
    return np.array([s["sec"] + s["nanosec"] / 1e9 for s in stamps]), signals.transpose(1, 0, 2)


def loaded(path: Path) -> Any:
    """Return a YAML file, read by the fast loader where there is one."""
    return yaml.load(path.read_text("ascii"), getattr(yaml, "CSafeLoader", yaml.SafeLoader))


def check_derivatives(signals: np.ndarray, exact: np.ndarray, atol: float) -> None:
    """Compare dq and ddq with differences; at the very ends, where the jerk jumps, they are exactly 0."""
    np.testing.assert_allclose(signals[1:, 1:-2], exact[1:, 1:-2], atol=atol)
    assert not np.any(signals[1:, [0, -1]])


def check_approach(time: np.ndarray, signals: np.ndarray, posture: np.ndarray, first: np.ndarray) -> None:
    """An approach leads from the posture to the first one, from rest to rest, at a tenth of the limits (3, 20, 200)."""
    np.testing.assert_allclose(signals[0, 0], posture, atol=1e-8)
    np.testing.assert_allclose(signals[0, -1], first, atol=1e-8)
    assert not np.any(signals[1:, [0, -1]])
    assert np.all(np.abs(signals[1]) <= 0.3 + 1e-8) and np.all(np.abs(signals[2]) <= 2 + 1e-8)
    np.testing.assert_allclose(np.gradient(signals[0], time, axis=0)[5:-5], signals[1][5:-5], atol=2e-3)
    assert np.all(np.diff(signals[0], axis=0) * np.sign(first - posture) >= -1e-8)


# --- CSV -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("rate", "speed", "run_in"), [(250.0, 100.0, 0.0), (100.0, 30.0, 1.0), (37.0, 100.0, 0.0)])
@pytest.mark.parametrize("degrees", [False, True])
def test_a_table_is_the_design(rate: float, speed: float, run_in: float, degrees: bool, tmp_path: Path) -> None:
    plan = plan_of(4, sliding=[1], run_in=run_in)
    found = export_motion(
        plan,
        MOTION_EXPORTERS.make("csv", {"degrees": degrees}),
        tmp_path / "m.csv",
        playback=Playback(rate=rate, speed=speed, from_posture="start", repeats=2),
    )
    time, signals = read_table(tmp_path / "m.csv", 4)
    scale = np.where([True, False, True, True], 180 / np.pi if degrees else 1.0, 1.0)
    np.testing.assert_allclose(time, np.arange(found.points) / rate, atol=1e-10)
    exact = designed(plan, time, speed / 100, repeats=2)
    np.testing.assert_allclose(signals[0] / scale, exact[0], atol=1e-11)
    check_derivatives(signals / scale, exact, 2e-6 if run_in == 0 else 4e-3)
    facts = json.loads((tmp_path / "m.csv.json").read_text())
    assert facts["columns"]["q1"] == ("deg" if degrees else "rad") and facts["columns"]["ddq2"] == "m/s^2"
    assert facts["limits"]["velocity"] == pytest.approx((3 * scale).tolist())
    assert facts["rows"] == len(time) and facts["speed"] == speed / 100 and facts["approach"] is None
    assert found.duration == pytest.approx(plan.motion(2).duration * 100 / speed)


def test_the_table_is_that_of_excite_and_a_log_that_is_read(tmp_path: Path) -> None:
    plan = plan_of(2)
    write_samples(plan, tmp_path / "a.csv", 200.0)
    export_motion(plan, "csv", tmp_path / "b.csv", playback=Playback(rate=200.0, from_posture="start"))
    for a, b in zip(read_table(tmp_path / "a.csv", 2), read_table(tmp_path / "b.csv", 2), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-10)
    log = read_log(tmp_path / "b.csv", ColumnMap(joints=("joint1", "joint2"), torque=()))
    np.testing.assert_allclose(log.q, sampled(plan, 200.0)[1], atol=1e-10)


def test_the_side_car_names_the_plan_by_its_hash(tmp_path: Path) -> None:
    plan = plan_of(2, names=['a\n"', "é"])
    write_plan(plan, tmp_path / "plan.json")
    found = export_motion(plan, "csv", tmp_path / "m.csv", playback=Playback(from_posture=[0.1, 0.2]))
    facts = json.loads((tmp_path / "m.csv.json").read_text("utf-8"))
    assert facts["plan_sha256"] == found.plan_sha256 == sha256_of(tmp_path / "plan.json")
    assert [joint["name"] for joint in facts["joints"]] == ['a\n"', "é"]
    assert facts["approach"] == "m-approach.csv"
    time, signals = read_table(tmp_path / "m-approach.csv", 2)
    check_approach(time, signals, np.array([0.1, 0.2]), plan.motion().evaluate(0.0)[0][0])


@pytest.mark.parametrize("name", ["csv", "libfranka"])
def test_samples_alone_need_to_know_where_the_robot_stands(name: str, tmp_path: Path) -> None:
    with pytest.raises(BadOption, match=rf"from_posture is not given; {name} holds samples only: state"):
        export_motion(plan_of(7), name, tmp_path / "m.csv")


@pytest.mark.parametrize(
    ("posture", "message"),
    [
        ("home", "give a position for each joint, or 'start'"),
        ([0.0, 0.0], "give 6 finite positions"),
        ([0, 0, np.nan, 0, 0, 0], "give 6 finite positions"),
        ([0, 0, 2.5, 0, 0, 0], "joint3 may be -2 to 2, the plan's limits; bring the robot there first"),
    ],
)
def test_postures_that_cannot_be(posture: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises(BadOption, match=re.escape(message)):
        export_motion(plan_of(), "csv", tmp_path / "m.csv", playback=Playback(from_posture=posture))
    assert not list(tmp_path.iterdir())


# --- ROS 2 -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("rate", "speed"), [(100.0, 100.0), (30.0, 70.0)])
@pytest.mark.parametrize("goal", [False, True])
def test_a_message_is_the_design(rate: float, speed: float, goal: bool, tmp_path: Path) -> None:
    plan = plan_of(names=[f"ur_joint-{i}/x" for i in range(6)], run_in=1.0)
    found = export_motion(
        plan,
        MOTION_EXPORTERS.make("joint_trajectory", {"goal": goal}),
        tmp_path / "m.yaml",
        playback=Playback(rate=rate, speed=speed, from_posture=POSTURE),
    )
    messages = [loaded(tmp_path / name) for name in ("m-approach.yaml", "m.yaml")]
    approach, message = (data["trajectory"] if goal else data for data in messages)
    assert message["joint_names"] == list(plan.joints) and message["header"]["stamp"] == {"sec": 0, "nanosec": 0}
    assert all(type(value) is float for point in message["points"] for value in point["accelerations"])
    time, signals = read_message(message)
    assert np.all(np.diff(time) > 0) and len(time) == found.points
    exact = designed(plan, time, speed / 100)
    np.testing.assert_allclose(signals[0], exact[0], atol=2e-9)
    check_derivatives(signals, exact, 4e-3)
    check_approach(*read_message(approach), POSTURE, plan.motion().evaluate(0.0)[0][0])


def test_without_a_posture_the_approach_is_one_late_point(tmp_path: Path) -> None:
    plan = plan_of()
    found = export_motion(plan, "joint_trajectory", tmp_path / "m.yaml")
    (point,) = loaded(tmp_path / "m-approach.yaml")["points"]
    np.testing.assert_allclose(point["positions"], plan.motion().evaluate(0.0)[0][0], atol=1e-9)
    assert point["time_from_start"] == {"sec": 25, "nanosec": 0}  # 15 / 8 of 4 rad at 0.3 rad/s
    assert "one point" in found.notes[0] and found.files[0].endswith("m-approach.yaml")
    export_motion(plan, "joint_trajectory", tmp_path / "n.yaml", playback=Playback(from_posture="start"))
    assert not (tmp_path / "n-approach.yaml").exists()


@pytest.mark.parametrize("name", ["", "a b", "a'", "a]", "a\nb", "-a", "a: b", "é", "x" * 129])
@pytest.mark.parametrize("exporter", ["joint_trajectory", "ros2_bag"])
def test_names_that_no_ros_joint_has(exporter: str, name: str, tmp_path: Path) -> None:
    with pytest.raises(BadOption, match="ROS joints are named with letters"):
        export_motion(plan_of(2, names=["a", name]), exporter, tmp_path / "m")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bag_plays_the_approach_and_then_the_motion(storage: str, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    plan, store = plan_of(), get_typestore(Stores.ROS2_HUMBLE)
    found = export_motion(
        plan,
        MOTION_EXPORTERS.make("ros2_bag", {"storage": storage, "topic": "/arm/go"}),
        tmp_path / "bag",
        playback=Playback(from_posture=POSTURE, speed=50),
    )
    with Reader(tmp_path / "bag") as reader:
        messages = [(c.topic, t, store.deserialize_cdr(data, c.msgtype)) for c, t, data in reader.messages()]
    assert [topic for topic, _, _ in messages] == ["/arm/go", "/arm/go"]
    (_, zero, approach), (_, start, motion) = messages
    end = approach.points[-1].time_from_start  # type: ignore[attr-defined]
    assert zero == 0 and start == (end.sec + 2) * 10**9 + end.nanosec == round(found.figures.motion_starts_s * 1e9)
    read = [
        {
            "points": [
                {
                    "time_from_start": {"sec": p.time_from_start.sec, "nanosec": p.time_from_start.nanosec},
                    **{key: getattr(p, key) for key in ("positions", "velocities", "accelerations")},
                }
                for p in message.points  # type: ignore[attr-defined]
            ]
        }
        for message in (approach, motion)
    ]
    first = plan.motion().evaluate(0.0)[0][0]
    check_approach(*read_message(read[0]), POSTURE, first)
    time, signals = read_message(read[1])
    exact = designed(plan, time, 0.5)
    np.testing.assert_allclose(signals[0], exact[0], atol=1e-12)
    check_derivatives(signals, exact, 2e-6)
    assert motion.joint_names == list(plan.joints)  # type: ignore[attr-defined]
    assert {file.name for file in (tmp_path / "bag").iterdir()} == {Path(name).name for name in found.files}


def test_a_bag_takes_no_folder_that_holds_something_else(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    export_motion(plan_of(2), "ros2_bag", tmp_path / "bag")
    export_motion(plan_of(2), "ros2_bag", tmp_path / "bag")  # the same files again
    (tmp_path / "bag" / "mine.txt").write_text("x")
    with pytest.raises(FileError, match="there is something else already; choose a new folder"):
        export_motion(plan_of(2), "ros2_bag", tmp_path / "bag")
    (tmp_path / "file").write_text("x")
    with pytest.raises(FileError, match="there is something else already"):
        export_motion(plan_of(2), "ros2_bag", tmp_path / "file")
    with pytest.raises(FileError, match="there is no folder"):
        export_motion(plan_of(2), "ros2_bag", tmp_path / "none" / "bag")
    with pytest.raises(FileError, match="no name for a bag"):
        export_motion(plan_of(2), "ros2_bag", tmp_path / "my bag")


@pytest.mark.parametrize("asked", [{"storage": "zip"}, {"topic": "a b"}, {"topic": "/a\n"}, {"most_points": 10}])
def test_bags_that_cannot_be(asked: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(BadOption, match=next(iter(asked))):
        export_motion(plan_of(2), MOTION_EXPORTERS.make("ros2_bag", asked), tmp_path / "bag")


def test_a_missing_package_is_named_with_its_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("rosbags", "rosbags.rosbag2", "rosbags.typesys"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingDependency, match=re.escape("install it with: pip install 'dynident[ros]'")):
        export_motion(plan_of(2), "ros2_bag", tmp_path / "bag")


# --- libfranka -------------------------------------------------------------------------------------------------------


def test_a_franka_table_meets_the_conditions_of_the_robot(tmp_path: Path) -> None:
    plan = plan_of(7)
    found = export_motion(plan, "libfranka", tmp_path / "m.csv", playback=Playback(from_posture=np.zeros(7)))
    time, signals = read_table(tmp_path / "m.csv", 7)
    np.testing.assert_allclose(np.diff(time), 1e-3, atol=1e-9)
    exact = designed(plan, time)
    np.testing.assert_allclose(signals[0], exact[0], atol=1e-11)
    check_derivatives(signals, exact, 2e-6)
    commands = np.vstack([signals[0, :1]] * 3 + [signals[0]] + [signals[0, -1:]] * 3)
    for order, (name, bound) in enumerate([("velocity", 3), ("acceleration", 20), ("jerk", 200)], start=1):
        used = np.abs(np.diff(commands, order, axis=0)).max() * 1000.0**order / bound
        assert used < 1 and found.figures.used_by_differences[name] == pytest.approx(used, rel=1e-6)
    time, signals = read_table(tmp_path / "m-approach.csv", 7)
    check_approach(time, signals, np.zeros(7), exact[0, 0])


def test_what_libfranka_does_not_take(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    with pytest.raises(BadOption, match="it takes 7 turning joints, not 6"):
        export_motion(plan_of(6), "libfranka", path, playback=Playback(from_posture="start"))
    with pytest.raises(BadOption, match="one command each ms: 1000 Hz"):
        export_motion(plan_of(7), "libfranka", path, playback=Playback(from_posture="start", rate=500.0))
    with pytest.raises(FileError, match="no limit for the jerk of joint1; state it in the robot model"):
        export_motion(plan_of(7, jerk=np.inf), "libfranka", path, playback=Playback(from_posture="start"))
    assert not list(tmp_path.iterdir())
