"""dynident excite: tables, files, and errors in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command_answers import documented

from dynident.case.case import read_case
from dynident.cli.main import main
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.excitation.design.plan import read_plan
from dynident.identification.files.estimate_file import read_estimate
from dynident.simulation.virtual_robot import Noise, simulate
from two_joint_arm import URDF

QUICK = ["--starts", "1", "--harmonics", "3", "--period", "6"]


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(URDF)
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
        "bayesian_d",
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
    assert json.loads(shown) == {"schema": 2, **json.loads(Path("plan.json").read_text())}
    assert said == ""
    data = json.loads(Path("plan.json").read_text())
    inner = {"check": data.pop("check"), "settings": data.pop("settings")}
    inner["settings.outlook"] = inner["settings"].pop("outlook")
    assert documented("excite") == {*data, *(f"{name}.{key}" for name, part in inner.items() for key in part)}


def test_model_margins_and_trajectory_are_those_asked_for(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["excite", robot, *QUICK, "--friction", "viscous", "--trajectory", "fourier", "--margin", "0.5"]
    assert main([*command, "--quiet", "--seed", "3"]) == 0
    shown, said = capsys.readouterr()
    assert "10 base parameters" in shown and "run-in and run-out of" in shown and said == ""
    assert " 1.5 " in shown  # half of the shoulder's 3 rad/s


CASE = """case: 1
robot: arm.urdf
friction: [coulomb, viscous]
workspace:
  floor: 0.0
  joint_radius: 0.05
  tool: {offset: [0.3, 0, 0]}
  tool_speed: 1.5
"""


def first_run() -> None:
    """Write the robot's log of a first plan, and its estimate."""
    assert main(["excite", "arm.urdf", *QUICK, "--friction", "coulomb", "viscous", "-o", "first.json", "--quiet"]) == 0
    model = read_case("case.yaml").model
    theta = model.nominal()
    assert theta is not None
    run = simulate(model, theta, read_plan("first.json").trajectory, noise=Noise(torque=0.3), seed=0).log
    write_log(Log(run.joints, run.time, run.q, torque=run.torque), "run.csv")
    assert main(["identify", "case.yaml", "run.csv", "--estimator", "wls", "-o", "estimate.json", "--quiet"]) == 0


@pytest.mark.battery
def test_what_to_record_next(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("case.yaml").write_text(CASE)
    first_run()
    capsys.readouterr()
    command = ["excite", "case.yaml", *QUICK, "--seed", "1", "--quiet", "-o"]
    known = ["--model", "estimate.json", "--torque-margin", "0.1", "--earlier", "estimate.json"]
    assert main([*command, "next.json", *known, "--repeats", "2"]) == 0
    shown = capsys.readouterr().out
    assert "noise: residuals of estimate.json; torque limits: estimate.json, 2 sigmas free" in shown
    # two periods of 6 s, at the samples a second that the estimate's noise is of
    rows = 12 * float(str(read_estimate("estimate.json").train.filter["rate_hz"]))
    assert f"Expected from {rows:.0f} independent samples of each joint, " in shown
    assert "known before: estimate.json." in shown
    speed = next(line.split() for line in shown.splitlines() if line.split()[1:3] == ["tool", "speed"])
    assert speed[4] == "1.5" and float(speed[6]) <= 100.0
    assert "clearance: at least 0.05 m: " in shown and " | floor" in shown and "not checked: floor" not in shown
    estimate, outlook = read_estimate("estimate.json"), read_plan("next.json").settings["outlook"]
    before = [item["std_before"] for item in outlook["parameters"]]
    np.testing.assert_allclose(before, estimate.std, rtol=1e-6)
    assert all(item["std_after"] < item["std_before"] for item in outlook["parameters"])
    assert main([*command, "logs.json", "--earlier-logs", "run.csv", "--criterion", "bayesian_d"]) == 0
    shown = capsys.readouterr().out
    assert "noise: residuals of run.csv" in shown and "known before: run.csv; nominal model within 50 %" in shown
    same = [item["std_before"] for item in read_plan("logs.json").settings["outlook"]["parameters"]]
    # The nominal model is known as well; a correlation factor per joint here, the colour of each score in the estimate.
    share = np.array(same) / np.array(before)
    assert np.median(share) < 1.1 and np.all(share < 2.0)
    assert main([*command, "other.json", "--friction", "viscous", "--earlier", "estimate.json"]) == 1
    assert "an estimate of other base parameters" in capsys.readouterr().err
    assert main([*command, "one.json", "--noise-from", "estimate.json"]) == 0
    assert "noise: residuals of estimate.json; torque limits: nominal" in capsys.readouterr().out
    assert main([*command, "estimate.json", "--noise-from", "estimate.json"]) == 1
    assert "it is an input of this command" in capsys.readouterr().err


def test_logs_that_leave_parameters_open_are_a_prior(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("case.yaml").write_text(CASE)
    time = np.arange(2000) / 200.0
    q = np.stack([0.5 * np.sin(time), np.zeros_like(time)], axis=1)  # the elbow stands still
    torque = np.stack([3.0 * np.cos(time), np.full_like(time, 2.0)], axis=1)
    torque += np.random.default_rng(0).normal(0.0, 0.1, torque.shape)
    write_log(Log(("shoulder", "elbow"), time, q, torque=torque), "run.csv")
    command = ["excite", "case.yaml", *QUICK, "--earlier-logs", "run.csv", "--quiet", "--json"]
    assert main(command) == 1
    assert "elbow never moved in them, so its noise is not known; give --noise" in capsys.readouterr().err
    assert main([*command, "--noise", "0.1"]) == 0
    outlook = json.loads(capsys.readouterr().out)["settings"]["outlook"]
    before = {item["name"]: item["std_before"] for item in outlook["parameters"]}
    assert None in before.values() and before["Fv[shoulder]"] is not None
    assert all(item["std_after"] is not None for item in outlook["parameters"])


def test_friction_that_needs_a_log_is_left_out_and_named(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("case.yaml").write_text(CASE.replace("[coulomb, viscous]", "[coulomb, viscous, load]"))
    assert main(["excite", "case.yaml", *QUICK, "--json", "-o", "plan.json"]) == 0
    shown = capsys.readouterr()
    assert json.loads(shown.out)["settings"]["friction"] == ["coulomb", "viscous"] and shown.err == ""
    assert main(["excite", "case.yaml", *QUICK]) == 0
    assert "designed without load: its torque is known from a log only" in capsys.readouterr().err


def test_a_search_is_kept_and_goes_on(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["excite", robot, *QUICK, "-o", "plan.json", "--resume"]
    assert main(command) == 0
    assert "start 1 of 1: d_optimal " in capsys.readouterr().err
    first = Path("plan.json").read_text()
    assert list(json.loads(Path("plan.json.search.json").read_text())["starts"]) == ["1"]
    assert main(command) == 0
    assert "start 1 of 1" not in capsys.readouterr().err  # nothing was left to search
    again, before = json.loads(Path("plan.json").read_text()), json.loads(first)
    assert again["trajectory"] == before["trajectory"] and again["values"] == before["values"]
    assert main([*command, "--period", "7"]) == 1
    assert (
        "plan.json.search.json: these starts are of another problem; different: trajectory" in capsys.readouterr().err
    )


def test_a_spline_and_what_nobody_has_looked_at(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["excite", robot, *QUICK, "--trajectory", "bspline", "--quiet"]) == 0
    shown = capsys.readouterr().out
    assert "starts and ends at rest" in shown
    assert "not checked: floor, obstacles, the robot itself (the case has no workspace)" in shown
    assert "not bounded, as no limit is stated: acceleration, jerk, torque rate of some joint" in shown


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--criterion", "dopt"], "no criterion called 'dopt'; choose one of: a_optimal, bayesian_d"),
        (["--margin", "1"], "margin = 1.0 is not possible; give a share from 0 to less than 1"),
        (["--starts", "0"], "starts = 0 is not possible; give 1 or more"),
        (["--csv", "plan.csv", "--rate", "0"], "--rate = 0.0 is not possible; give samples a second"),
        (["--csv", "plan.csv", "--repeats", "0"], "--repeats = 0 is not possible; give 1 or more"),
        (["--jobs", "0"], "jobs = 0 is not possible; give 1 or more"),
        (["--resume"], "--resume is empty; name a file, or give the plan's with -o"),
        (["--sigmas", "2"], "--sigmas = 2.0 is not possible; it needs --model"),
        (
            ["--noise", "1", "2", "3"],
            "noise = [1.0, 2.0, 3.0] is not possible; give one number above 0, or one for each",
        ),
        (
            ["--noise", "1", "--noise-from", "a.json"],
            "--noise-from = 'a.json' is not possible; it stands beside --noise",
        ),
        (["--earlier", "a.json"], "a.json: there is no such file"),
        (["-o", "no-folder/plan.json"], "no-folder/plan.json: there is no folder 'no-folder'"),
    ],
)
def test_errors_are_one_line(robot: str, words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["excite", robot, *QUICK, "--quiet", *words]) == 1
    shown, said = capsys.readouterr()
    assert shown == "" and said.startswith("error: ") and message in said and said.count("\n") == 1


def test_a_robot_without_speed_limits_is_refused(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(robot).write_text(URDF.replace('velocity="4" ', ""))
    assert main(["excite", robot, "--quiet"]) == 1
    assert "elbow" in capsys.readouterr().err


@pytest.mark.parametrize("period", ["0", "-3", "nan"])
def test_a_period_that_is_none(robot: str, period: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["excite", robot, "--period", period]) == 1
    assert "--period" in (said := capsys.readouterr().err) and "give the period in s, above 0" in said


def test_a_plan_is_no_robot(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("old.json").write_text('{"kind": "dynident plan"}')
    assert main(["excite", "old.json", "-o", "plan.json"]) == 1
    assert "old.json: it is a plan; give the case or robot to design for" in capsys.readouterr().err
    assert not Path("plan.json").exists()
