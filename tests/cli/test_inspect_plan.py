"""dynident inspect plan.json and dynident report --plan: tables, JSON, pages, exit codes."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_answers import documented

from dynident.case.case import read_case
from dynident.cli.main import main
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.excitation.design.plan import read_plan
from dynident.simulation.virtual_robot import Noise, simulate
from two_joint_arm import URDF

Capture = pytest.CaptureFixture[str]

CASE = """case: 1
robot: arm.urdf
friction: [coulomb, viscous]
workspace:
  floor: -0.05
  joint_radius: 0.05
  tool: {offset: [0.3, 0, 0], radius: 0.02}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a robot, its case, a plan that was designed for it, a log and an estimate."""
    folder = tmp_path_factory.mktemp("made")
    before = Path.cwd()
    os.chdir(folder)
    try:
        Path("arm.urdf").write_text(URDF)
        Path("case.yaml").write_text(CASE)
        words = ["--starts", "1", "--harmonics", "3", "--period", "6", "--jobs", "1", "--quiet"]
        assert main(["excite", "case.yaml", *words, "-o", "plan.json"]) == 0
        model = read_case("case.yaml").model
        theta = model.nominal()
        assert theta is not None
        run = simulate(model, theta, read_plan("plan.json").trajectory, noise=Noise(torque=0.3), seed=0).log
        write_log(Log(run.joints, run.time, run.q, torque=run.torque), "run.csv")
        assert main(["identify", "case.yaml", "run.csv", "--estimator", "wls", "-o", "estimate.json", "--quiet"]) == 0
    finally:
        os.chdir(before)
    return folder


@pytest.fixture
def here(made: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Return a copy of the folder, the working directory of the test."""
    for file in made.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    monkeypatch.chdir(tmp_path)
    return tmp_path


def changed(**values: Any) -> None:
    """Write the plan with other numbers of its trajectory or check as other.json."""
    data = json.loads(Path("plan.json").read_text())
    for key, value in values.items():
        data["trajectory"][key] = value
    Path("other.json").write_text(json.dumps(data))


def keys_of(value: Any, path: str = "") -> Iterator[str]:
    """Yield the key path of everything in plain data; ``[]`` stands for each item of a list."""
    if isinstance(value, dict) and path != "settings":
        for key, inner in value.items():
            yield from keys_of(inner, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        inside = [key for item in value for key in keys_of(item, f"{path}[]")]
        yield from inside or [f"{path}[]"]
    else:
        yield path


def test_the_plan_alone(here: Path, capsys: Capture) -> None:
    assert main(["inspect", "plan.json"]) == 0
    shown, said = capsys.readouterr()
    assert said == "" and re.search(r"^robot +arm2, 2 joints$", shown, re.MULTILINE)
    assert "rest_fourier, 3 harmonics, period 6 s, starts and ends at rest; 6 s from rest to rest" in shown
    assert "Every bound is kept" in shown and "does not agree" not in shown
    checked = {tuple(line.split()[:2]): line.split()[-1] for line in shown.splitlines() if line.startswith("elbow ")}
    assert checked["elbow", "velocity"] == "again" and checked["elbow", "torque"] == "file"
    assert "as the file states, not computed again: torque, clearance" in shown
    assert re.search(r"^ *1 +(upper|fore) \| floor ", shown, re.MULTILINE)


def test_with_its_case_everything_is_computed_again_and_agrees(here: Path, capsys: Capture) -> None:
    assert main(["inspect", "plan.json", "--case", "case.yaml", "--json"]) == 0
    shown, said = capsys.readouterr()
    data = json.loads(shown)
    assert said == "" and data["kept"] and data["findings"] == []
    assert all(row["again"] for row in data["rows"]) and {"clearance", "torque"} <= {
        r["quantity"] for r in data["rows"]
    }
    stated = {(row.joint, row.quantity): row for row in read_plan("plan.json").rows}
    for row in data["rows"]:
        assert row["value"] == pytest.approx(stated[row["joint"], row["quantity"]].value, rel=1e-6, abs=1e-9)
    for entry in data["values"]:
        assert entry["again"] == pytest.approx(entry["file"], rel=1e-6), entry["name"]


def test_the_json_is_documented(here: Path, capsys: Capture) -> None:
    assert main(["inspect", "plan.json", "--json"]) == 0
    found = {key.removesuffix("[]") for key in keys_of(json.loads(capsys.readouterr().out))}
    assert documented("plan") == found - {"schema"}


def test_the_torques_may_be_those_of_an_estimate(here: Path, capsys: Capture) -> None:
    command = ["inspect", "plan.json", "--case", "case.yaml", "--model", "estimate.json"]
    assert main(command) == 0
    margin = capsys.readouterr().out
    assert "torques: computed again with estimate.json, 2 sigmas free" in margin
    assert main([*command, "--sigmas", "0"]) == 0
    assert "torques: computed again with estimate.json\n" in capsys.readouterr().out


def test_a_motion_changed_by_hand_is_shown_and_refused(here: Path, capsys: Capture) -> None:
    sine = np.array(json.loads(Path("plan.json").read_text())["trajectory"]["sine"])
    changed(sine=(3.0 * sine).tolist())
    assert main(["inspect", "other.json", "--html", "other.html"]) == 1
    shown, said = capsys.readouterr()
    assert "does not agree with the file: velocity of elbow: " in shown and "Do not drive it." in shown
    assert said.splitlines()[-1].startswith("error: other.json: the ") and "design the motion again" in said
    assert 'class="broken"' in Path("other.html").read_text()


def test_pages(here: Path, capsys: Capture) -> None:
    assert main(["inspect", "plan.json", "--html", "plan.html", "--json"]) == 0
    json.loads(capsys.readouterr().out)
    assert "needs the robot" in Path("plan.html").read_text()
    assert main(["inspect", "plan.json", "--html", "plan.html"]) == 0
    assert "without the path of the tool, which needs the robot: give it with --case" in capsys.readouterr().err
    assert main(["inspect", "plan.json", "--html", "plan.html", "--case", "case.yaml"]) == 0
    said = capsys.readouterr().err
    assert said == "wrote plan.html\n" and "Path of the tool" in Path("plan.html").read_text()
    words = ["report", "estimate.json", "--plan", "plan.json", "-o", "report.html", "--quiet"]
    assert main(words) == 0
    assert "needs the robot" not in Path("report.html").read_text()  # that of the estimate draws the path
    assert main([*words, "--case", "case.yaml"]) == 0
    assert 'id="excitation"' in Path("report.html").read_text() and capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["plan.json", "--friction", "viscous"], "a plan knows the friction it was designed with; leave it out"),
        (["plan.json", "--model", "estimate.json"], "--model = 'estimate.json' is not possible; it needs --case"),
        (["plan.json", "--sigmas", "1"], "--sigmas = 1.0 is not possible; it needs --case"),
        (["plan.json", "--case", "case.yaml", "--sigmas", "1"], "it needs --model"),
        (["plan.json", "--case", "generic-6r"], "those of the plan are shoulder, elbow; give the case or robot"),
        (["plan.json", "--html", "plan.json"], "plan.json: it is an input of this command"),
        (["plan.json", "--case", "case.yaml", "--html", "arm.urdf"], "arm.urdf: it is an input of this command"),
        (["plan.json", "--html", "none/plan.html"], "none/plan.html: there is no folder 'none'"),
        (["case.yaml", "--html", "plan.html"], "--html = 'plan.html' is not possible; it goes with a plan"),
        (["no.json", "--case", "case.yaml"], "no.json: no such file"),
    ],
)
def test_errors_are_one_line(here: Path, words: list[str], message: str, capsys: Capture) -> None:
    assert main(["inspect", *words]) == 1
    said = capsys.readouterr().err
    assert said.startswith("error: ") and message in said and said.count("\n") == 1


def test_errors_of_the_report(here: Path, capsys: Capture) -> None:
    for words, message in (
        (["--case", "case.yaml"], "it goes with --plan"),
        (["--plan", "plan.json", "-o", "plan.json"], "it is an input of this command"),
        (["--plan", "estimate.json"], "estimate.json: no plan"),
    ):
        assert main(["report", "estimate.json", *words]) == 1
        assert message in capsys.readouterr().err
