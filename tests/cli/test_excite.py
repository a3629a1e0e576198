"""dynident excite: tables, files, and errors in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dynident.cli.main import main
from dynident.experiment.plan import read_plan

URDF = """<robot name="arm2">
  <link name="stand"/>
  <link name="upper"><inertial><origin xyz="0.18 0 0.02"/><mass value="7"/>
    <inertia ixx="0.03" ixy="0" ixz="0" iyy="0.12" iyz="0" izz="0.12"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0.12 0 0"/><mass value="3"/>
    <inertia ixx="0.008" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="stand"/><child link="upper"/><origin xyz="0 0 0.3"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="3" effort="{effort}"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0.05"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="4" effort="100"/></joint>
</robot>
"""

QUICK = ["--starts", "1", "--harmonics", "3", "--period", "6"]


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(URDF.format(effort=200))
    return "arm.urdf"


def test_tables_plan_and_samples(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["excite", robot, *QUICK, "-o", "plan.json", "--csv", "plan.csv", "--rate", "200", "--repeats", "2"]
    assert main(command) == 0
    shown, said = capsys.readouterr()
    lines = [line.split() for line in shown.splitlines()]
    assert shown.startswith("arm2: 2 joints, 14 base parameters, 6 s, 3 harmonics, criterion d_optimal\n")
    assert "starts and ends at rest; noise: 1 % of the effort limits; torque limits: nominal model" in shown
    assert [row[0] for row in lines if row and row[-1] in ("larger", "smaller")] == [
        "a_optimal",
        "condition",
        "d_optimal",
        "e_optimal",
        "unit_condition",
    ]
    speeds = {row[0]: row for row in lines if row[1:2] == ["velocity"]}
    assert speeds["shoulder"][3:5] == ["2.85", "rad/s"] and float(speeds["elbow"][5]) <= 100.0
    assert "start 1 of 1" in said and "saved plan.json" in said and "saved plan.csv: 2401 rows at 200 Hz, 12 s" in said
    plan = read_plan("plan.json")
    table = np.loadtxt("plan.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(table[:, 1:3], plan.motion(2).evaluate(table[:, 0])[0], atol=1e-10)


def test_json_is_the_plan(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["excite", robot, *QUICK, "--json", "-o", "plan.json", "--criterion", "condition"]) == 0
    shown, said = capsys.readouterr()
    assert json.loads(shown) == json.loads(Path("plan.json").read_text())
    assert said == ""


def test_model_margins_and_trajectory_are_those_asked_for(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["excite", robot, *QUICK, "--friction", "viscous", "--trajectory", "fourier", "--margin", "0.5"]
    assert main([*command, "--quiet", "--seed", "3"]) == 0
    shown, said = capsys.readouterr()
    assert "10 base parameters" in shown and "run-in and run-out of" in shown and said == ""
    assert " 1.5 " in shown  # half of the shoulder's 3 rad/s


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--criterion", "dopt"], "no criterion called 'dopt'; choose one of: a_optimal, condition"),
        (["--margin", "1"], "margin = 1.0 is not possible; give a share from 0 to less than 1"),
        (["--starts", "0"], "starts = 0 is not possible; give 1 or more"),
        (["--csv", "plan.csv", "--rate", "0"], "rate = 0.0 is not possible; give samples a second"),
        (["-o", "no-folder/plan.json"], "no-folder/plan.json: there is no folder 'no-folder'"),
    ],
)
def test_errors_are_one_line(robot: str, words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["excite", robot, *QUICK, "--quiet", *words]) == 1
    shown, said = capsys.readouterr()
    assert shown == "" and said.startswith("error: ") and message in said and said.count("\n") == 1


def test_a_robot_without_speed_limits_is_refused(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(robot).write_text(URDF.format(effort=200).replace('velocity="4" ', ""))
    assert main(["excite", robot, "--quiet"]) == 1
    assert "elbow" in capsys.readouterr().err
