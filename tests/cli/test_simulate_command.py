"""dynident simulate: a log as the case reads it, the truth beside it, settings, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_answers import documented

from dynident.case.case import read_case
from dynident.cli.main import main
from dynident.excitation.design.limits import MotionLimits
from dynident.excitation.design.plan import Plan, write_plan
from dynident.excitation.trajectories.rest_fourier import RestFourier
from dynident.identification.files.estimate_file import read_estimate
from dynident.studies.comparison.truth import read_truth
from two_joint_arm import URDF

Capture = pytest.CaptureFixture[str]

#: The arm with a wrist that is locked.
WITH_WRIST = URDF.replace(
    "</robot>",
    """<link name="hand"><inertial><origin xyz="0.02 0 0"/><mass value="1"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.002"/></inertial></link>
  <joint name="wrist" type="revolute"><parent link="fore"/><child link="hand"/><origin xyz="0.3 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="4" effort="50"/></joint></robot>""",
)

CASE = """case: 1
robot: arm.urdf
locked: {wrist: 0.5}
friction: [coulomb, viscous]
drives:
  shoulder: {gear_ratio: 100, gain: 12}
  elbow: {gear_ratio: -80, gain: 9}
  wrist: {gear_ratio: 50, gain: 3}
cell:
  encoder: {noise: 1e-6}
  effort: {held: after}
  truth: {friction: {Fc: [2, 1], Fv: 3}}
"""

#: How logs may look: what is added to the case, and the names of their files.
LOOKS = {
    "plain.csv": "",
    "plain.npz": "",
    "plain.parquet": "",
    "plain.mat": "",
    "units.csv": """log:
  columns: {time: stamp, q: "pos_{joint}", torque: "load_{}", q_ref: "want_{}"}
  units: {time: ms, position: deg, torque: percent}
  rated: [150, 80, 20]
  zero: [0.1, -0.2, 0]
  decimal: ","
""",
    "currents.csv": """joints: [shoulder, elbow]
log:
  columns: {q: "q{}", current: "amps_{}"}
  units: {current: mA}
  side: {q: motor}
""",
    "states.mcap": "log: {profile: joint_states}\n",
    "states.db3": "log: {profile: joint_states}\n",
    "states.bag": "log: {profile: joint_states}\n",
    "open.mcap": "",
    "open.db3": "log: {units: {position: deg}}\n",
    "open.bag": "",
    "topics.mcap": """log:
  columns: {q: "/arm:{joint}.position", torque: "/arm:{joint}.effort", q_ref: "/want:{joint}.points[0].positions"}
  format: {rosbag: {topics: [/arm, /want]}}
""",
}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with a robot, its case and a plan for its two free joints, the working directory."""
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(WITH_WRIST)
    Path("case.yaml").write_text(CASE)
    robot = read_case("case.yaml").robot
    limits = _limits(robot)
    generator = np.random.default_rng(0)
    free = RestFourier.free_map(3)
    trajectory = RestFourier.from_table([free @ generator.uniform(-0.2, 0.2, free.shape[1]) for _ in range(2)], 4.0)
    write_plan(Plan("arm2", trajectory, 0.0, "condition", {}, limits, (), 200, {}), "plan.json")
    return tmp_path


def _limits(robot: Any) -> MotionLimits:
    wide = np.full(robot.dof, 1e3)
    bounds = {name: wide for name in ("upper", "velocity", "acceleration", "jerk", "torque", "torque_rate")}
    return MotionLimits(robot.joint_names, (True,) * robot.dof, lower=-wide, **bounds)


@pytest.mark.parametrize("look", LOOKS)
def test_the_case_reads_the_log_back_as_it_was_simulated(here: Path, look: str) -> None:
    if look.endswith((".mcap", ".db3", ".bag")):
        pytest.importorskip("rosbags")
    Path("case.yaml").write_text(CASE + LOOKS[look])
    assert main(["simulate", "case.yaml", "plan.json", "-o", look, "--quiet"]) == 0
    log = read_case("case.yaml").read(look)
    truth = np.load(Path(look).with_suffix(".truth.npz"))
    np.testing.assert_allclose(log.time, truth["t"], atol=1e-12)
    np.testing.assert_allclose(log.q, truth["q"], atol=1e-5)
    assert log.torque is not None
    np.testing.assert_allclose(log.torque, truth["tau"], atol=1e-9)
    assert log.joints == ("shoulder", "elbow")
    if look == "topics.mcap":
        assert log.q_ref is not None and 0 < np.abs(log.q_ref - truth["q"]).max() < 0.1


def test_identify_finds_the_truth_beside_the_log(here: Path, capsys: Capture) -> None:
    assert (
        main(["simulate", "case.yaml", "plan.json", "-o", "run.csv", "--repeats", "2", "--set", "truth.spread=0.2"])
        == 0
    )
    shown = capsys.readouterr()
    assert "8000 samples over 7.999 s" in shown.out
    assert "saved run.csv, run.truth.json, run.truth.npz" in shown.err
    assert main(["identify", "case.yaml", "run.csv", "-o", "e.json", "--json", "--quiet"]) == 0
    found = json.loads(capsys.readouterr().out)
    truth = json.loads(Path("run.truth.json").read_text())
    values = {f"{one['symbol']}[{one['owner']}]": one["value"] for one in truth["parameters"]}
    assert values["Fc[shoulder]"] == 2.0
    friction = {one["name"]: one["value"] for one in found["parameters"] if one["name"] in values}
    assert {"Fc[shoulder]", "Fv[elbow]"} <= set(friction)
    for name, value in friction.items():
        assert value == pytest.approx(values[name], rel=0.03, abs=0.02), name


def test_the_intervals_of_identify_hold_the_truth(here: Path) -> None:
    settings = ["effort.held=mean", "effort.noise=0.5", "encoder.noise=1e-6"]
    words = [word for setting in settings for word in ("--set", setting)]
    assert main(["simulate", "case.yaml", "plan.json", "-o", "run.csv", "--repeats", "5", *words, "--quiet"]) == 0
    assert main(["identify", "case.yaml", "run.csv", "-o", "e.json", "--estimator", "wls", "--quiet"]) == 0
    estimate = read_estimate("e.json")
    stated = json.loads(Path("run.truth.json").read_text())["parameters"]
    truth = estimate.base.from_standard(np.array([one["value"] for one in stated]))
    assert np.mean(np.abs(estimate.beta - truth) <= estimate.half_widths(0.95)) >= 0.9
    assert np.sqrt(np.mean(((estimate.beta - truth) / estimate.std) ** 2)) < 1.5


def test_the_truth_beside_a_log_is_what_methods_are_compared_with(here: Path, capsys: Capture) -> None:
    settings = ["--set", "truth.friction.Fc=2,1", "--set", "truth.spread=0.3", "--set", "payload.mass=0.4"]
    assert main(["simulate", "case.yaml", "plan.json", "-o", "run.csv", "--quiet", *settings]) == 0
    truth = json.loads(Path("run.truth.json").read_text())
    model = read_case("case.yaml").model
    assert read_truth("run.truth.json", model).tolist() == [each["value"] for each in truth["parameters"]]
    words = ["compare", "case.yaml", "run.csv", "--estimators", "wls", "--json", "--truth"]
    capsys.readouterr()
    assert main([*words, "run.truth.json"]) == 0
    assert json.loads(capsys.readouterr().out)["methods"][0]["parameter_error"] < 0.02
    for change, said in (
        ({"format": 99}, "bad.json: a truth of version 99; this dynident reads versions up to 1; update dynident"),
        ({"robot": "other"}, "robot: of 'other', the case has 'arm2'; give the .truth.json"),
        ({"parameters": [{"symbol": "m"}]}, "parameters: not all have symbol, owner and value"),
        ({"parameters": truth["parameters"][1:]}, "bad.json: no parameter Ixx[upper]; give one made with the same"),
    ):
        Path("bad.json").write_text(json.dumps({**truth, **change}))
        assert main([*words, "bad.json"]) == 1
        assert said in capsys.readouterr().err


def test_settings_change_the_cell(here: Path, capsys: Capture) -> None:
    Path("cell.yaml").write_text("controller: pid\nrecorder: {rate: 200}\n")
    words = ["--cell", "cell.yaml", "--set", "controller.integral_hz=2", "--set", "effort.noise=0.3,0.1", "--json"]
    assert main(["simulate", "case.yaml", "plan.json", "-o", "run.csv", *words, "--seed", "4"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts.pop("schema") == 2
    inner = {f"parameters[].{key}" for key in facts["parameters"][0]}
    assert documented("simulate") == {*(key for key in facts if key != "parameters"), *inner}
    assert facts["samples"] == 800
    assert facts["cell"]["controller"]["pid"]["integral_hz"] == 2.0
    assert facts["cell"]["effort"]["noise"] == [0.3, 0.1]
    assert facts["cell"]["encoder"]["noise"] == [0.0]  # the file stands in the place of the case's section
    assert facts == json.loads(Path("run.truth.json").read_text())
    first = Path("run.csv").read_bytes()
    assert main(["simulate", "case.yaml", "plan.json", "-o", "run.csv", *words, "--seed", "4"]) == 0
    assert Path("run.csv").read_bytes() == first


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--set", "encoder.nois=1"], "unknown key 'nois'; known keys: resolution, noise"),
        (["--set", "encoder"], "--set = 'encoder' is not possible; write KEY=VALUE"),
        (["--set", "controller=fuzzy"], "no controller called 'fuzzy'"),
        (["--set", "recorder.dropped=2"], "recorder.dropped = 2.0 is not possible; give a share of the rows"),
        (["--set", "truth.friction.Fz=2"], "the friction of the case has Fc, Fv"),
        (["-o", "run.doc"], "--output = 'run.doc' is not possible; end the name in one of: .csv"),
        (["-o", "plan.json"], "plan.json"),
        (["--seed", "-1"], "--seed = -1 is not possible; give 0 or more"),
        (["--set", "truth.parameters=none.json"], "there is no such file"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(here: Path, capsys: Capture, words: list[str], message: str) -> None:
    before = sorted(Path().iterdir())
    assert main(["simulate", "case.yaml", "plan.json", "-o", "run.csv", *words]) == 1
    shown = capsys.readouterr()
    assert message in shown.err, shown.err
    assert shown.err.count("\n") == 1
    assert sorted(Path().iterdir()) == before


def test_identify_reads_a_recording_of_ros_with_the_case_that_simulated_it(here: Path, capsys: Capture) -> None:
    """The case names no columns; effort of a recording by anything else is not taken for a torque."""
    pytest.importorskip("rosbags")
    words = ["simulate", "case.yaml", "plan.json", "--quiet", "--repeats", "2", "-o"]
    wls = ["--estimator", "wls", "--cutoff", "10", "--no-sensitivity", "--cross-validate", "0", "--json"]
    found = []
    for name in ("run.mcap", "run.csv"):
        assert main([*words, name]) == 0
        capsys.readouterr()
        assert main(["identify", "case.yaml", name, *wls]) == 0
        found.append([one["value"] for one in json.loads(capsys.readouterr().out)["parameters"]])
    np.testing.assert_allclose(*found, rtol=1e-6)
    assert main(["reduce", "case.yaml", "run.mcap", "--cutoff", "10", "--split", "first:0.67", "-o", "run.tri"]) == 0
    log = read_case("case.yaml").read("run.mcap")
    assert "joints by name" in log.source.steps[0]
    Path("run.mcap").write_bytes(Path("run.mcap").read_bytes().replace(b"dynident simulate", b"another simulator"))
    assert main(["identify", "case.yaml", "run.mcap", *wls]) == 1
    assert "no column 'q1'" in capsys.readouterr().err


@pytest.mark.parametrize("look", ["units.csv", "plain.csv"])
def test_a_recording_of_ros_has_joints_by_name(here: Path, capsys: Capture, look: str) -> None:
    pytest.importorskip("rosbags")
    Path("case.yaml").write_text(CASE + LOOKS[look])
    code = main(["simulate", "case.yaml", "plan.json", "-o", "run.mcap", "--quiet"])
    if look == "units.csv":  # columns such as pos_elbow have no place in a message
        assert code == 1 and "'pos_shoulder' in a recording of ROS" in capsys.readouterr().err
        assert not Path("run.mcap").exists() and not Path("run.truth.json").exists()
        return
    assert code == 0
    Path("case.yaml").write_text(CASE + LOOKS["states.mcap"])
    log = read_case("case.yaml").read("run.mcap")
    assert log.torque is not None
    np.testing.assert_allclose(log.torque, np.load("run.truth.npz")["tau"], atol=1e-9)


def test_a_plan_for_other_joints_is_refused(here: Path, capsys: Capture) -> None:
    Path("case.yaml").write_text(CASE.replace("locked: {wrist: 0.5}\n", ""))
    assert main(["simulate", "case.yaml", "plan.json", "-o", "run.csv"]) == 1
    assert "the robot of the case has shoulder, elbow, wrist; design the plan" in capsys.readouterr().err
