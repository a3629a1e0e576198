"""dynident export: tables, files, units, and errors in one line."""

from __future__ import annotations

import json
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_answers import documented

from dynident.cli.main import main
from dynident.excitation.design.limits import MotionLimits, check_limits
from dynident.excitation.design.plan import Plan, write_plan
from dynident.excitation.trajectories.rest_fourier import RestFourier
from dynident.exports.models import MODEL_EXPORTERS
from dynident.exports.motions import MOTION_EXPORTERS

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Plan:
    """Return a plan of a turning and a sliding joint, which stands in plan.json of the working folder."""
    monkeypatch.chdir(tmp_path)
    trajectory = RestFourier.from_free(0.1 * np.random.default_rng(2).normal(size=(2, 5)), 4.0)
    ones, free = np.ones(2), np.full(2, np.inf)
    limits = MotionLimits(("a", "b"), (True, False), -ones, ones, 3 * ones, 20 * ones, free, free)
    draft = Plan("arm", trajectory, 0.0, "condition", {"condition": 1.0}, limits, (), 1001, {})
    made = replace(draft, rows=check_limits(draft.motion(), limits, draft.samples))
    write_plan(made, "plan.json")
    return made


def test_a_message_names_the_flag_that_is_missing(plan: Plan, capsys: Capture) -> None:
    assert main(["export", "plan.json", "--to", "csv", "-o", "m.csv"]) == 1
    assert capsys.readouterr().err.startswith("error: --from-posture is not given; csv holds samples only")


def test_a_target_has_the_name_that_people_ask_for(plan: Plan, capsys: Capture) -> None:
    assert main(["export", "plan.json", "--to", "ros", "-o", "m.yaml", "--check"]) == 0
    assert capsys.readouterr().out.startswith("arm to joint_trajectory: ")
    assert {MODEL_EXPORTERS.resolve(name) for name in ("mujoco", "gazebo", "c", "simulink")} == {
        "mjcf", "sdf", "c_header", "fmu"
    }  # fmt: skip
    assert all(part in MODEL_EXPORTERS.names() for part in MODEL_EXPORTERS.aliases.values())
    assert all(part in MOTION_EXPORTERS.names() for part in MOTION_EXPORTERS.aliases.values())


def test_tables_and_files(plan: Plan, capsys: Capture) -> None:
    words = ["export", "plan.json", "--to", "csv", "-o", "m.csv", "--rate", "50", "--repeats", "2", "--speed", "50"]
    assert main([*words, "--from-posture", "0.25,-0.5", "--option", "degrees=true"]) == 0
    shown, said = capsys.readouterr()
    assert shown.startswith("arm to csv: 16 s at 50 % speed, 801 points at 50 Hz\napproach: quintic of ")
    speeds = {row[0]: row for row in map(str.split, shown.splitlines()) if row[1:2] == ["velocity"]}
    full = {row.joint: row for row in plan.rows if row.quantity == "velocity"}
    assert float(speeds["a"][2]) == pytest.approx(full["a"].value / 2, rel=1e-3) and speeds["b"][4] == "m/s"
    assert "largest round-off of a position:" in shown
    assert said == "saved m-approach.csv\nsaved m.csv\nsaved m.csv.json\n"
    table = np.loadtxt("m.csv", delimiter=",", skiprows=1)
    exact = plan.motion(2).evaluate(table[:, 0] / 2)[0]
    np.testing.assert_allclose(table[:, 1:3], exact * [180 / np.pi, 1.0], atol=1e-9)


def test_units_are_those_of_the_posture(plan: Plan, capsys: Capture) -> None:
    words = ["export", "plan.json", "--to", "csv", "-o", "m.csv", "--units", "deg", "--quiet"]
    assert main([*words, "--from-posture=-30,0.5"]) == 0
    assert capsys.readouterr().err == ""
    first = np.loadtxt("m-approach.csv", delimiter=",", skiprows=1)[0]
    np.testing.assert_allclose(first[1:3], [-np.pi / 6, 0.5], rtol=1e-11)


def test_json_is_documented_and_true(plan: Plan, capsys: Capture) -> None:
    assert main(["export", "plan.json", "--to", "rapid", "-o", "m.mod", "--json"]) == 0
    shown, said = capsys.readouterr()
    data = json.loads(shown)
    assert said == "" and set(data) == {"schema", *documented("export")} and data["files"] == ["m.mod"]
    assert data["rows"][0] | {"value": 0, "time": 0, "used": 0} == {
        "joint": "a", "quantity": "position", "unit": "rad", "value": 0, "limit": data["rows"][0]["limit"],
        "time": 0, "used": 0,
    }  # fmt: skip
    assert [row["limit"] for row in data["rows"] if row["quantity"] == "jerk"] == [None, None]
    assert data["facts"]["deviation"]["a"] <= 0.2


def test_a_check_writes_nothing(plan: Plan, capsys: Capture) -> None:
    assert main(["export", "plan.json", "--to", "krl", "-o", "m.src", "--check"]) == 0
    shown, said = capsys.readouterr()
    assert "approach: a slow move of the controller (krl)" in shown and "note: the deviation" in shown
    assert said == "would write m.src\nwould write m.dat\n" and os.listdir() == ["plan.json"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--to", "csw"], "no exporter called 'csw'; choose one of: csv, joint_trajectory"),
        (["--to", "csv"], "csv holds samples only: state where the robot stands"),
        (["--to", "csv", "--from-posture", "home"], "--from-posture = 'home' is not possible; give numbers"),
        (["--to", "csv", "--from-posture", "1"], "--from-posture = '1' is not possible; give 2 numbers"),
        (["--to", "csv", "--from-posture", "0,5"], "b may be -1 to 1, the plan's limits"),
        (["--to", "csv", "--from-posture", "start", "-o", "plan.json"], "plan.json: it is an input of this command"),
        (["--to", "csv", "--from-posture", "start", "-o", "plan"], "plan.json: it is an input of this command"),
        (["--to", "csv", "--from-posture", "start", "--option", "degrees"], "write key=value"),
        (["--to", "csv", "--from-posture", "start", "--option", "degrees=2"], "write true or false"),
        (["--to", "csv", "--from-posture", "start", "--option", "radians=1"], "has the options: degrees"),
        (["--to", "rapid", "--speed", "120"], "speed = 120.0 is not possible; give 10 to 100 per cent"),
        (["--to", "rapid", "-o", "my robot.mod"], "my robot.mod: 'my robot' cannot name a program in RAPID"),
        (["--to", "urscript"], "it takes 6 turning joints, not 2"),
        (["--to", "rapid", "-o", "none/m.mod"], "none/m.mod: there is no folder 'none'"),
    ],
)
def test_errors_are_one_line(plan: Plan, words: list[str], message: str, capsys: Capture) -> None:
    before = Path("plan.json").read_bytes()
    assert main(["export", "plan.json", "-o", "m", *words]) == 1
    said = capsys.readouterr().err
    assert said.startswith("error: ") and message in said and said.count("\n") == 1
    assert os.listdir() == ["plan.json"] and Path("plan.json").read_bytes() == before


def test_a_plan_changed_by_hand_is_refused(plan: Plan, capsys: Capture) -> None:
    data = json.loads(Path("plan.json").read_text())
    data["limits"]["velocity"] = [0.001, 0.001]
    Path("plan.json").write_text(json.dumps(data))
    assert main(["export", "plan.json", "--to", "rapid", "-o", "m.mod"]) == 1
    assert "not written, because the velocity of" in capsys.readouterr().err


def test_the_list_has_all_exporters(capsys: Capture) -> None:
    assert main(["list", "motion_exporters"]) == 0
    shown = capsys.readouterr().out
    assert (
        all(f"\n  {name} " in shown for name in MOTION_EXPORTERS.names())
        and "lookahead (a number, default 0.1)" in shown
    )
    page = (Path(__file__).resolve().parents[2] / "docs/exports.md").read_text(encoding="utf-8")
    _, _, rest = page.partition("<!-- parts: motion_exporters -->")
    assert sorted(re.findall(r"^\| `(\w+)`", rest.partition("\n## ")[0], re.MULTILINE)) == list(
        MOTION_EXPORTERS.names()
    )
