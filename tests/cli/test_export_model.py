"""dynident export ESTIMATE: found by its content, proved, told, and refused in one line."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_answers import documented

from dynident.cli.main import main
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.identification.files.estimate_file import read_estimate, write_estimate
from dynident.identification.identify import identify
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot

Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def estimate_text(spatial_3r: Robot, exact_log: Callable[..., Log], tmp_path_factory: pytest.TempPathFactory) -> str:
    model = DynamicModel(spatial_3r, ("coulomb", "viscous", "offset"))  # type: ignore[arg-type]
    theta = model.nominal()
    assert theta is not None
    theta = theta.copy()
    theta[model.inertial_count :] = 0.3
    place = tmp_path_factory.mktemp("estimate") / "estimate.json"
    write_estimate(identify(model, [exact_log(model, theta, noise=0.01)], "consistent"), place)
    return place.read_text(encoding="utf-8")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, estimate_text: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("estimate.json").write_text(estimate_text, encoding="utf-8")
    return tmp_path


def test_the_proof_and_what_is_left_out_are_shown(capsys: Capture) -> None:
    assert main(["export", "estimate.json", "--to", "urdf", "-o", "arm.urdf"]) == 0
    shown, said = capsys.readouterr()
    assert shown.startswith("spatial-3r to urdf: estimate of 'consistent', standard parameters: of the estimate\n")
    assert "largest difference of a torque on 1000 random states" in shown
    row = re.search(r"^dynident +with the file beside it: everything +(\S+) +(\S+)$", shown, re.MULTILINE)
    assert row and max(map(float, row.groups())) < 1e-12  # nothing at all, or rounding
    left = r"left out of arm.urdf, and in arm.urdf.dynident.json:\n  joint1: F0 = 0\.\d+ N m; "
    assert re.search(left + r"torque of the file off by \S+ N m \(rms\)\n", shown)
    assert said == "saved arm.urdf\nsaved arm.urdf.dynident.json\n"


def test_json_is_documented_and_below_a_millionth(capsys: Capture) -> None:
    assert main(["export", "estimate.json", "--to", "mjcf", "-o", "arm.xml", "--json"]) == 0
    shown, said = capsys.readouterr()
    data = json.loads(shown)
    assert said == "" and set(data) == {"schema", *documented("export model")}
    assert all(proof["relative"] < 1e-6 for proof in data["proofs"] if proof["states"])


def test_a_check_writes_nothing_and_no_proof_says_so(folder: Path, capsys: Capture) -> None:
    assert main(["export", "estimate.json", "--to", "csv", "-o", "p.csv", "--check", "--no-proof"]) == 0
    shown, said = capsys.readouterr()
    assert "not loaded again: nothing is proved" in shown and "would write p.csv" in said
    assert [file.name for file in folder.iterdir()] == ["estimate.json"]


def test_tables_hold_the_numbers_of_the_estimate(estimate_text: str) -> None:
    assert main(["export", "estimate.json", "--to", "csv", "-o", "p.csv", "--no-proof", "--quiet"]) == 0
    table = np.genfromtxt("p.csv", delimiter=",", skip_header=1, usecols=1)
    np.testing.assert_array_equal(table, json.loads(estimate_text)["beta"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--to", "urdx"], "no model exporter called 'urdx'"),
        (["--to", "urscript"], "--to = 'urscript' is not possible; it takes a plan"),
        (["--to", "urdf", "--speed", "50"], "--speed = 50.0 is not possible; estimate.json is an estimate"),
        (["--to", "urdf", "--description", "none.urdf"], "none.urdf: no such file"),
        (["--to", "urdf", "--option", "lump=maybe"], "lump = 'maybe' is not possible; write true or false"),
        (["--to", "json", "-o", "estimate.json"], "it is an input of this command"),
        (["--to", "json", "-o", "none/arm.json"], "there is no folder"),
        (["--to", "urdf", "--motion", "run.csv"], "--motion = 'run.csv' is not possible; it goes with --prove"),
        (["--to", "urdf", "--prove"], "name a log whose motion is to be followed: --motion LOG"),
        (["--to", "drake", "-o", "1.dmd.yaml"], "'1' cannot name a package"),
    ],
)
def test_errors_are_one_line(words: list[str], message: str, folder: Path, capsys: Capture) -> None:
    given = words if "-o" in words else [*words, "-o", "out.txt"]
    assert main(["export", "estimate.json", *given]) == 1
    shown, said = capsys.readouterr()
    assert shown == "" and said.startswith("error: ") and message in said and said.count("\n") == 1
    assert [file.name for file in folder.iterdir()] == ["estimate.json"]


def test_what_was_simulated_is_shown(exact_log: Callable[..., Log], capsys: Capture) -> None:
    estimate = read_estimate("estimate.json")
    write_log(exact_log(estimate.model, estimate.theta, samples=100), "run.csv")
    assert main(["export", "estimate.json", "--to", "json", "-o", "arm.json", "--prove", "--motion", "run.csv"]) == 0
    shown, _ = capsys.readouterr()
    assert "motion: 1.98 s of run.csv from 0 s on, low-pass filtered at 10 Hz" in shown
    assert re.search(r"^dynident +computed_torque +1 +1\.98 +\S+ +\S+ % +no$", shown, re.MULTILINE)
    assert "condition number of M(q) along the motion: median " in shown


def test_a_plan_takes_no_options_of_a_model(folder: Path, capsys: Capture) -> None:
    Path("plan.json").write_text('{"kind": "dynident plan"}', encoding="utf-8")
    assert main(["export", "plan.json", "--to", "csv", "-o", "x", "--description", "a.urdf"]) == 1
    assert "plan.json is a plan" in capsys.readouterr().err
