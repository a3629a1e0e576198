"""LeRobot data sets: episodes of a file are logs of their own, degrees and shares of a calibrated range are angles."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from servo_bench import PENDULUM, parameters, virtual_logs

from dynident.actuators.lerobot_calibration import read_calibration
from dynident.actuators.servo_log import ServoLog
from dynident.api.actuators import logs_of_servos
from dynident.case.case import read_case
from dynident.cli.main import main
from dynident.errors import DescriptionError, FileError, LogMismatch
from dynident.model.robot import Robot

pa = pytest.importorskip("pyarrow", reason="Parquet needs the package pyarrow (extra parquet)")
pq = pytest.importorskip("pyarrow.parquet", reason="Parquet needs the package pyarrow (extra parquet)")

#: Counts of the motor's range, and the same as the file of LeRobot has it.
LOW, HIGH = 900, 3300
CALIBRATION = {"joint1": {"id": 1, "drive_mode": 0, "homing_offset": 12, "range_min": LOW, "range_max": HIGH}}

CASE = """case: 2
robot: pendulum.urdf
servo: {law: feetech_sts3215, kp: 4, friction: m1%s}
log: {profile: lerobot, columns: {torque: none}%s}
train: set.parquet
split: first:0.67
"""


@pytest.fixture
def logs(robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[ServoLog]:
    """Three logs of the virtual pendulum; the robot model and a calibration lie in the folder."""
    monkeypatch.chdir(tmp_path)
    Path("pendulum.urdf").write_text(PENDULUM)
    Path("follower.json").write_text(json.dumps(CALIBRATION))
    return [virtual_logs(robot, parameters(), gains=(4.0,), seed=seed)[seed % 2] for seed in range(3)]


def write_set(logs: list[ServoLog], factor: float) -> None:
    """Write logs as the episodes of one file of a data set, positions times a factor."""
    rows = {
        name: np.concatenate([getattr(log, signal)[:, 0] * factor for log in logs]).astype(np.float32)
        for name, signal in (("action", "q_ref"), ("observation.state", "q"))
    }
    columns = {
        name: pa.array([[value] for value in values.tolist()], pa.list_(pa.float32())) for name, values in rows.items()
    }
    columns["timestamp"] = pa.array(np.concatenate([log.time - log.time[0] for log in logs]))
    columns["episode_index"] = pa.array(np.repeat(np.arange(7, 7 + len(logs)), [log.samples for log in logs]))
    pq.write_table(pa.table(columns), "set.parquet")


@pytest.mark.parametrize(
    ("factor", "servo", "log"),
    [
        (180.0 / np.pi, "", ", units: {position: deg}"),
        (200.0 / ((HIGH - LOW) * 2.0 * np.pi / 4096), ", calibration: follower.json", ""),
    ],
    ids=["degrees", "shares"],
)
def test_episodes_are_logs(logs: list[ServoLog], factor: float, servo: str, log: str) -> None:
    write_set(logs, factor)
    Path("case.yaml").write_text(CASE % (servo, log))
    train, test = logs_of_servos(read_case("case.yaml"))
    assert [one.name for one in (*train, *test)] == [f"set.parquet episode {k}" for k in (7, 8, 9)]
    assert len(train) == 2
    for known, found in zip(logs, (*train, *test), strict=True):
        np.testing.assert_allclose(found.q, known.q, atol=2e-7)
        np.testing.assert_allclose(found.q_ref, known.q_ref, atol=2e-7)
        np.testing.assert_allclose(found.time, known.time - known.time[0])


XACRO = 'xmlns:xacro="http://ros.org/wiki/xacro"'


def test_from_a_draft_to_actuators(logs: list[ServoLog], capsys: pytest.CaptureFixture[str]) -> None:
    write_set(logs, 180.0 / np.pi)
    assert main(["init", "pendulum.urdf", "set.parquet", "-o", "case.yaml"]) == 0
    text = Path("case.yaml").read_text()
    assert "3 episodes, each a log of its own" in text and "torque: none" in text and "split: first:0.67" in text
    assert "runs back" not in text and "runs back" not in capsys.readouterr().out
    for old, new in (("position_servo", "feetech_sts3215"), ("kp: unknown", "kp: 4"), ("auto ", "m1 ")):
        text = text.replace(old, new, 1)
    if find_spec("xacro") is not None:  # a robot with arguments: the file of its provenance is not its name
        urdf = Path("pendulum.urdf").read_text().replace("<robot", f"<robot {XACRO}", 1)
        Path("arm.xacro").write_text(urdf.replace(">", '><xacro:arg name="size" default="1"/>', 1))
        text = text.replace("robot: pendulum.urdf", "robot: {file: arm.xacro, arguments: {size: 1}}")
        assert "arm.xacro" in text
    Path("case.yaml").write_text(text.replace("position: ask", "position: deg", 1))
    assert main(["identify", "case.yaml", "-o", "a.json", "--quiet"]) == 0
    joint = json.loads(Path("a.json").read_text())["joints"]["joint1"]
    assert joint["parameters"]["armature"]["value"] == pytest.approx(0.012, rel=0.05)
    assert joint["test_error_rad"].keys() == {"set.parquet episode 9"}
    assert joint["test_error_rad"]["set.parquet episode 9"] < 2e-3
    capsys.readouterr()  # a split of the case is none of the logs that are named
    assert main(["validate", "a.json", "set.parquet", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["roll_outs"]
    assert [one["trained_on"] for one in told] == [True, True, False]


def test_what_is_wrong_is_named(logs: list[ServoLog], capsys: pytest.CaptureFixture[str]) -> None:
    write_set(logs, 57.29578)
    Path("case.yaml").write_text(CASE % (", calibration: follower.json, counts: feetech", ""))
    with pytest.raises(DescriptionError, match="counts and calibration"):
        read_case("case.yaml")
    Path("two.json").write_text(json.dumps({"a": CALIBRATION["joint1"], "gripper": CALIBRATION["joint1"]}))
    Path("case.yaml").write_text(CASE % (", calibration: two.json", ""))
    with pytest.raises(DescriptionError, match=r"no motor for joint1: it has a, gripper, and the log joint1"):
        read_case("case.yaml")
    Path("case.yaml").write_text(CASE % (", calibration: follower.json", ", units: {position: deg}"))
    with pytest.raises(DescriptionError, match="a unit of positions beside shares"):
        read_case("case.yaml")
    write_set([replace(logs[0], q=6.0 * logs[0].q)], 57.29578)
    Path("case.yaml").write_text(CASE.replace("split: first:0.67", "") % (", calibration: follower.json", ""))
    assert main(["identify", "case.yaml"]) == 1
    assert "shares of a range end at 100" in capsys.readouterr().err
    write_set(logs, 57.29578)
    Path("case.yaml").write_text(CASE % ("", ", units: {position: rad}"))
    assert main(["identify", "case.yaml"]) == 1
    assert "counts, degrees, or shares of a range" in capsys.readouterr().err


def test_episodes_without_motion_are_left_out(logs: list[ServoLog], capsys: pytest.CaptureFixture[str]) -> None:
    still = replace(logs[0], q=0.0 * logs[0].q, q_ref=0.0 * logs[0].q_ref)
    short = replace(logs[1], time=logs[1].time[:3], q=logs[1].q[:3], q_ref=logs[1].q_ref[:3])
    write_set([still, logs[0], short, logs[1]], 180.0 / np.pi)
    Path("case.yaml").write_text(CASE % ("", ", units: {position: deg}"))
    assert main(["identify", "case.yaml", "-o", "a.json", "--quiet"]) == 0
    told = capsys.readouterr().out
    assert "warning: set.parquet episode 7 is left out: joint1 stands in one pose" in told
    assert "warning: set.parquet episode 9 is left out: only 3 samples" in told
    write_set([still], 180.0 / np.pi)
    assert main(["identify", "case.yaml"]) == 1
    assert "stands in one pose" in capsys.readouterr().err


def test_files_by_a_pattern_and_recordings_in_a_row(logs: list[ServoLog]) -> None:
    for k, log in enumerate(logs):
        write_set([log], 180.0 / np.pi)
        Path("set.parquet").rename(f"episode_{k}.parquet")
    case = (CASE % ("", ", units: {position: deg}")).replace("set.parquet", "episode_*.parquet")
    Path("case.yaml").write_text(case)
    train, test = logs_of_servos(read_case("case.yaml"))
    assert [one.name for one in (*train, *test)] == [f"episode_{k}.parquet" for k in range(3)]
    Path("case.yaml").write_text(case.replace("episode_*", "episode_1"))
    with pytest.raises(DescriptionError, match="1 log: with servo it divides whole logs"):
        logs_of_servos(read_case("case.yaml"))
    chunk = Path("whole/data/chunk-000")
    for folder in (chunk, Path("whole/meta")):
        folder.mkdir(parents=True)
    Path("whole/meta/info.json").write_text("{}")
    for k in range(3):
        Path(f"episode_{k}.parquet").rename(chunk / f"episode_{k}.parquet")
    Path("case.yaml").write_text(case.replace("episode_*.parquet", "whole"))  # the folder of the data set
    assert [Path(one.name).name for part in logs_of_servos(read_case("case.yaml")) for one in part] == [
        f"episode_{k}.parquet" for k in range(3)
    ]
    write_set(logs, 180.0 / np.pi)
    Path("case.yaml").write_text(case.replace("episode_*", "row"))
    table = pq.read_table("set.parquet").drop_columns(["episode_index"])
    pq.write_table(table, "row.parquet")
    with pytest.raises(LogMismatch, match=r"time runs back at 2 places, the first after sample 1200"):
        logs_of_servos(read_case("case.yaml"))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[1]", "no calibration"),
        ('{"a": {"range_min": 5, "range_max": 5}}', "a: range_min 5 is not below"),
        ("{", "no cal"),
        ('{"a": {"range_min": 0, "range_max": 5000}}', "0 to range_max 5000 is more than a turn"),
    ],
)
def test_a_file_that_is_no_calibration(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "c.json").write_text(text)
    with pytest.raises(FileError, match=told):
        read_calibration(tmp_path / "c.json")


def test_a_gripper_is_a_share_beside_degrees(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """LeRobot records it from 0 to 100 there too; a calibration without a gripper has no place beside degrees."""
    monkeypatch.chdir(tmp_path)
    link = '<link name="{1}"><inertial><mass value="0.1"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" \
izz="1e-4"/></inertial></link><joint name="{0}" type="revolute"><parent link="{2}"/><child link="{1}"/>\
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="5" velocity="9"/></joint>'
    links = link.format("elbow", "a", "base") + link.format("gripper", "b", "a")
    Path("pendulum.urdf").write_text(f'<robot name="r"><link name="base"/>{links}</robot>')
    t = np.arange(60) / 30.0
    q = np.column_stack([t, 40.0 * np.sin(t), 50.0 + 45.0 * np.sin(t), 41.0 * np.sin(t), 50.0 + 40.0 * np.sin(t)])
    np.savetxt("set.csv", q, "%.9g", ",", header="t,q1,q2,q_ref1,q_ref2", comments="")
    own = "{time: t, q: [q1, q2], q_ref: [q_ref1, q_ref2], torque: none}, units: {position: deg}"
    case = CASE.replace("{profile: lerobot, columns: {torque: none}%s}", f"{{columns: {own}}}")
    case = case.replace("set.parquet\nsplit: first:0.67", "set.csv")
    Path("case.yaml").write_text(case % ", calibration: two.json")
    Path("two.json").write_text(json.dumps({"elbow": CALIBRATION["joint1"], "gripper": CALIBRATION["joint1"]}))
    (log,) = logs_of_servos(read_case("case.yaml"))[0]
    travel = (HIGH - LOW) * 2.0 * np.pi / 4096
    np.testing.assert_allclose(log.q, np.column_stack([np.deg2rad(q[:, 1]), (q[:, 2] - 50) / 100 * travel]), atol=1e-8)
    Path("two.json").write_text(json.dumps({"a": CALIBRATION["joint1"], "b": CALIBRATION["joint1"]}))
    with pytest.raises(DescriptionError, match="beside degrees a gripper alone"):
        read_case("case.yaml")


def test_the_share_of_the_gripper_counts_from_its_closed_end(tmp_path: Path) -> None:
    """By the counts: LeRobot's shares are linear from range_min to range_max."""
    (tmp_path / "c.json").write_text(json.dumps({**CALIBRATION, "gripper": CALIBRATION["joint1"]}))
    joint, gripper = read_calibration(tmp_path / "c.json")
    counts = np.array([LOW, 1500, HIGH])
    angle = (counts - (LOW + HIGH) / 2) * 2 * np.pi / 4096
    share = (counts - LOW) / (HIGH - LOW)
    np.testing.assert_allclose(joint.radians(200 * share - 100), angle, atol=1e-12)
    np.testing.assert_allclose(gripper.radians(100 * share), angle, atol=1e-12)
