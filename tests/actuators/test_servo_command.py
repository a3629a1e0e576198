"""'dynident identify' of a case with servos: the path of a user, on a virtual servo and on real logs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from servo_bench import CASE_OF_LOGS, PENDULUM, fill

from dynident.api.actuators import logs_of_servos
from dynident.case.case import read_case
from dynident.cli.main import main
from dynident.model.robot import Robot
from real_data import real

ROOT = Path(__file__).parents[2]

CASE = f"{CASE_OF_LOGS}train: [chirp_kp4.csv, drop_kp4.csv]\n"


@pytest.fixture
def folder(tmp_path: Path, robot: Robot, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    fill(tmp_path, robot, PENDULUM, CASE)
    return tmp_path


def test_from_logs_to_actuators_by_the_command_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "case.yaml", "--test", "steps_kp4.csv", "-o", "a.json"]) == 0
    answer = capsys.readouterr().out
    assert "actuators of 1 joint" in answer and "full torque" in answer and "identified" in answer
    assert max(map(len, answer.splitlines())) <= 160
    saved = json.loads(Path("a.json").read_text())
    assert saved["joints"]["joint1"]["parameters"]["armature"]["value"] == pytest.approx(0.012, rel=0.05)
    assert saved["joints"]["joint1"]["test_error_rad"].keys() == {"steps_kp4.csv"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--estimator", "ols"], "--estimator"),
        (["chirp_kp4.csv", "--test", "chirp_kp4.csv"], "the same content"),
        (["--friction", "coulomb"], "friction"),
    ],
)
def test_what_does_not_go_with_servos_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    assert main(["identify", "case.yaml", *words]) == 1
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("feetech_sts3215", "feetech_sts3251", "did you mean 'feetech_sts3215'"),
        ("friction: m1", "friction: m9", "choose one of: auto, m1"),
        ("enabled:", "enable:", "did you mean 'enabled'"),
        ("'kp{}'", "'gain{}'", "no position gain"),
        ("q_ref1", "q_goal", "no column of the command"),
        ("friction: m1", "full_torque: [2.9, 3.1]", "half width below it"),
        ("friction: m1", "damping_gain: fre", "servo.damping_gain"),
        ("train:", "drives: {joint1: {rotor_inertia: 0.01}}\ntrain:", "no effect beside servo"),
    ],
)
def test_a_fault_of_the_section_is_named(
    folder: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, said: str
) -> None:
    Path("case.yaml").write_text(CASE.replace(old, new))
    assert main(["identify", "case.yaml"]) == 1
    assert said in capsys.readouterr().err


@pytest.mark.battery
@pytest.mark.parametrize(("friction", "linear", "refined"), [("m1", 58.0, 54.5), ("m3", 43.0, 36.0)])
def test_errors_of_real_servos(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, friction: str, linear: float, refined: float
) -> None:
    """Split A of the XL330 logs: kp 100, 400, 800 to learn from, kp 200 to test on; mean absolute error in mrad."""
    logs = real("dynamixel_xl330_bam", monkeypatch)
    monkeypatch.chdir(tmp_path)
    case = CASE.replace("pendulum.urdf", str(logs / "urdf" / "pendulum_m0490_l100.urdf"))
    case = case.replace("feetech_sts3215", "dynamixel_xl330").replace("m1", friction)
    Path("case.yaml").write_text(case[: case.index("train:")])
    names = [str(path) for kp in (100, 400, 800) for path in sorted((logs / "logs").glob(f"*_kp{kp}.csv"))]
    tests = [str(path) for path in sorted((logs / "logs").glob("*_kp200.csv"))]
    assert len(names) == 12 and len(tests) == 4
    assert main(["identify", "case.yaml", *names, "--test", *tests, "-o", "a.json", "--quiet"]) == 0
    joint = json.loads(Path("a.json").read_text())["joints"]["joint1"]
    for key, most in (("linear_error_rad", linear), ("test_error_rad", refined)):
        assert 1e3 * sum(joint[key].values()) / 4 < most


def test_a_known_torque_and_damping_are_read(folder: Path) -> None:
    text = CASE.replace(
        "friction: m1", "full_torque: [2.9, 0.3], damping_gain: 0.2, joints: {joint1: {full_torque: [2, 0]}}"
    )
    Path("case.yaml").write_text(text)
    servo = read_case("case.yaml").servo
    assert servo is not None and servo.laws[0].full_torque == (2.0, 0.0) and servo.laws[0].damping_gain == 0.2


def test_logs_of_the_command_line_are_those_of_the_report(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A case without logs: the report follows what was tested on."""
    Path("case.yaml").write_text(CASE[: CASE.index("train:")])
    words = ["identify", "case.yaml", "chirp_kp4.csv", "--test", "drop_kp4.csv", "-o", "a.json", "--quiet"]
    assert main(words) == 0
    capsys.readouterr()
    assert main(["report", "a.json", "-o", "a.html", "--json"]) == 0
    assert [run["log"] for run in json.loads(capsys.readouterr().out)["roll_outs"]] == ["drop_kp4.csv"]
    for logs in ([], ["steps_kp4.csv"]):  # options may stand before the logs
        assert main(["validate", "a.json", "--json", "--quiet", *logs]) == 0
        followed = [run["log"] for run in json.loads(capsys.readouterr().out)["roll_outs"]]
        assert followed == (logs or ["drop_kp4.csv"])


def test_init_asks_which_counts_they_are(folder: Path) -> None:
    """Counts of 32 bits, negative ones as two's complement, in columns named as the registers are."""
    table = np.loadtxt("drop_kp4.csv", delimiter=",", skiprows=1)
    table[:, 1:3] = np.round(table[:, 1:3] / (2 * np.pi) * 4096) % 2**32
    header = "t,present_position,goal_position,torque_enable"
    np.savetxt("raw.csv", table, "%.9g", ",", header=header, comments="")
    assert main(["init", "pendulum.urdf", "raw.csv", "-o", "raw.yaml"]) == 0
    text = Path("raw.yaml").read_text()
    assert "counts: ask" in text and "position: ask" not in text and "enabled: torque_enable" in text
    assert "q: [present_position]" in text and "q_ref: [goal_position]" in text


def test_json_of_bam_is_a_log_as_any_other(folder: Path) -> None:
    """A draft of one file, and a folder with a file of other JSON beside the logs; the logs state gain and torque."""
    Path("bam").mkdir()
    Path("bam/plan.json").write_text('{"kp": 4}')
    for name in ("chirp", "drop"):
        entries = [
            {"timestamp": t, "position": q, "goal_position": goal, "torque_enable": bool(on)}
            for t, q, goal, on in np.loadtxt(f"{name}_kp4.csv", delimiter=",", skiprows=1).tolist()
        ]
        Path(f"bam/{name}.json").write_text(json.dumps({"kp": 4, "entries": entries}))
    assert main(["init", "pendulum.urdf", "bam/drop.json", "-o", "drafted.yaml"]) == 0
    text = Path("drafted.yaml").read_text()
    assert "kp: kp" in text and "enabled: torque_enable" in text
    Path("short.yaml").write_text("case: 2\nrobot: pendulum.urdf\nservo: {law: feetech_sts3215}\ntrain: bam\n")
    (drafted,), _ = logs_of_servos(read_case("drafted.yaml"))
    logs, _ = logs_of_servos(read_case("short.yaml"))
    assert [Path(log.name).name for log in logs] == ["chirp.json", "drop.json"]
    for name in ("time", "q", "q_ref", "enabled", "kp"):
        assert np.array_equal(getattr(drafted, name), getattr(logs[1], name)), name
    assert logs[1].kp == 4 and not logs[1].enabled.all()


def test_init_drafts_the_case_of_such_logs(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The draft is usable as it is: gain from the names of the logs, column of the torque state by its name."""
    logs = ["chirp_kp4.csv", "steps_kp4.csv", "drop_kp4.csv"]
    assert main(["init", "pendulum.urdf", *logs, "-o", "drafted.yaml"]) == 0
    text = Path("drafted.yaml").read_text()
    assert "kp: 'kp{}'" in text and "enabled: torque_enable" in text and "law: position_servo" in text
    assert "torque: none" in text and "estimator" not in text and "from commands and positions" in text
    Path("drafted.yaml").write_text(text.replace("position_servo", "feetech_sts3215", 1).replace("auto ", "m1 ", 1))
    assert main(["identify", "drafted.yaml", "-o", "a.json", "--quiet"]) == 0
    saved = json.loads(Path("a.json").read_text())["joints"]["joint1"]
    assert saved["parameters"]["armature"]["value"] == pytest.approx(0.012, rel=0.05)
    assert saved["test_error_rad"].keys() == {"drop_kp4.csv"}


@pytest.mark.parametrize(
    ("names", "kp"),
    [(("ep4", "ep5"), "unknown"), (("run_p4", "run_p5"), "'p{}'"), (("a_gain4", "b_gain5"), "'gain{}'")],
)
def test_init_takes_no_number_of_an_episode_for_a_gain(folder: Path, names: tuple[str, str], kp: str) -> None:
    for name, log in zip(names, ("chirp_kp4.csv", "steps_kp4.csv"), strict=True):
        Path(log).rename(f"{name}.csv")
    assert main(["init", "pendulum.urdf", *(f"{name}.csv" for name in names), "-o", "drafted.yaml"]) == 0
    assert f"\n  kp: {kp} " in Path("drafted.yaml").read_text()


def test_init_drafts_the_case_of_a_log_of_one_pose(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A drive that sags under the weight: the draft is that of a servo, and the pose is named."""
    time = np.arange(0.0, 3.0, 0.01)
    table = np.column_stack([time, np.full(300, 0.28), np.full(300, 0.3), np.ones(300)])
    np.savetxt("pose_kp4.csv", table, "%.6g", ",", header="t,q1,q_ref1,torque_enable", comments="")
    assert main(["init", "pendulum.urdf", "pose_kp4.csv", "-o", "drafted.yaml"]) == 0
    text = Path("drafted.yaml").read_text()
    assert "servo:" in text and "estimator" not in text
    Path("drafted.yaml").write_text(text.replace("position: ask", "position: rad"))
    capsys.readouterr()
    assert main(["check", "drafted.yaml"]) == 1
    assert "joint1 stands in one pose throughout; log a motion" in capsys.readouterr().err


@pytest.mark.parametrize("size", [1.0, 57.3], ids=["positions", "another unit"])
def test_init_drafts_the_case_of_an_arm_whose_joints_move_one_at_a_time(folder: Path, size: float) -> None:
    """Commands of the joints that are held do not move; commands in another unit than the positions are none."""
    time = np.arange(0.0, 4.0, 0.01)
    q_ref, q = np.zeros((400, 5)), np.tile(0.01 * np.sin(5.0 * time)[:, None], 5)
    q_ref[:, 2], q[:, 2] = 0.6 * np.sin(4.0 * time), 0.5 * np.sin(4.0 * time - 0.4)
    table = np.column_stack([time, q, size * q_ref, np.ones((400, 5))])
    header = ",".join(["t", *(f"{name}{k}" for name in ("q", "q_ref", "on") for k in range(1, 6))])
    np.savetxt("elbow.csv", table, "%.6g", ",", header=header, comments="")
    arm = str(ROOT / "examples" / "servo_arm" / "arm.urdf")
    assert main(["init", arm, "elbow.csv", "-o", "arm.yaml"]) == 0
    text = Path("arm.yaml").read_text()
    assert ("servo:" in text) == (size == 1.0)
    assert ("enabled: [on1, on2, on3, on4, on5]   # 1 where" in text) == (size == 1.0)


def test_init_takes_no_torque_state_for_torques_where_a_servo_log_has_no_commands(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = np.loadtxt("drop_kp4.csv", delimiter=",", skiprows=1)
    np.savetxt("bare.csv", table[:, [0, 1, 3]], "%.9g", ",", header="t,q1,torque_enable", comments="")
    assert main(["init", "pendulum.urdf", "bare.csv", "-o", "bare.yaml"]) == 0
    assert "or the commanded positions of position servos" in capsys.readouterr().err
    assert "are torque_enable the measured" not in Path("bare.yaml").read_text()


def test_init_asks_for_the_time_of_a_servo_log_that_has_none(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = np.loadtxt("chirp_kp4.csv", delimiter=",", skiprows=1)
    np.savetxt("bare.csv", table[:, 1:3], "%.9g", ",", header="q1,q_ref1", comments="")
    assert main(["init", "pendulum.urdf", "bare.csv", "-o", "bare.yaml"]) == 0
    text = Path("bare.yaml").read_text()
    assert "servo:" in text and "time: ask" in text and "counts" not in text
    assert "draft again with --rate" in "".join(capsys.readouterr())
    assert main(["init", "pendulum.urdf", "bare.csv", "--rate", "200", "-o", "rated.yaml"]) == 0
    train, _ = logs_of_servos(read_case("rated.yaml"))
    assert train[0].time[200] == pytest.approx(1.0)
