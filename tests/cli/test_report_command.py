"""``dynident report``: it tests on what the fit has kept apart, examines the logs, and writes figures as files."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.cli.main import main
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.offset import Offset
from dynident.model.friction.viscous import Viscous
from dynident.model.robot import Robot

Capture = pytest.CaptureFixture[str]

CASE = "case: 1\nrobot: arm.json\ntrain: run.csv\nsplit: first:0.7\nestimator: wls\n"


FAST = ("--cross-validate", "0", "--no-sensitivity", "--quiet", "--no-check")


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory, planar_2r: Robot, exact_log: Callable[..., Log]) -> Path:
    """A folder with a robot, a case that splits its log, another log, and an estimate from the case."""
    place = tmp_path_factory.mktemp("cell")
    (place / "arm.json").write_text(json.dumps(robot_to_dict(planar_2r)))
    model = DynamicModel(planar_2r, (Coulomb(), Viscous(), Offset()))
    assert planar_2r.nominal is not None
    theta = np.append(planar_2r.nominal, np.tile([0.5, 0.3, 0.1], 2))
    for name, seed in (("run", 0), ("other", 1)):
        log = exact_log(model, theta, noise=0.1, seed=seed, samples=1000, rate=200.0)
        write_log(Log(log.joints, log.time, log.q, torque=log.torque), place / f"{name}.csv")
    (place / "case.yaml").write_text(CASE)
    words = ["identify", "case.yaml", "-o", "e.json", *FAST]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        patch.delenv("DYNIDENT_DATA", raising=False)
        patch.setattr("sys.argv", ["dynident", *words])
        assert main(words) == 0
    return place


@pytest.fixture(autouse=True)
def folder(cell: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the folder; the work is done inside it."""
    place = tmp_path / "here"
    shutil.copytree(cell, place)
    monkeypatch.chdir(place)
    monkeypatch.delenv("DYNIDENT_DATA", raising=False)
    return place


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """Run a command as typed: the command line stands in the provenance."""

    def typed(*words: str) -> int:
        monkeypatch.setattr("sys.argv", ["dynident", *words])
        return main(words)

    return typed


def reported(capsys: Capture, run: Callable[..., int], *words: str) -> dict[str, Any]:
    capsys.readouterr()
    assert run("report", "e.json", *words, "--json") == 0
    return json.loads(capsys.readouterr().out)


def test_rows_that_the_fit_kept_apart_are_tested_on_and_the_logs_examined(
    capsys: Capture, run: Callable[..., int], folder: Path
) -> None:
    found = reported(capsys, run, "--figures", "figures")
    assert found["tests"][0]["logs"] == ["run.csv"] and 0 < found["tests"][0]["relative_error"] < 0.2
    assert found["why_no_test"] == "" and "log_quality" in found["sections"]
    assert all((folder / name).stat().st_size > 500 for name in found["figures"])
    assert str(Path("figures", "torque-joint1.svg")) in found["figures"]
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "test error of the torque" in page and "all after the first 0.7 of the duration" in page
    quiet = reported(capsys, run, "--no-log-quality")
    assert "log_quality" not in quiet["sections"] and quiet["figures"] == []


def test_options_of_the_command_line_are_repeated_too(capsys: Capture, run: Callable[..., int]) -> None:
    assert run("identify", "arm.json", "run.csv", "--test", "other.csv", "-o", "e.json", *FAST) == 0
    assert reported(capsys, run, "--no-log-quality")["tests"][0]["logs"] == ["other.csv"]
    given = reported(capsys, run, "--test", "other.csv", "--split", "first:0.5", "--no-log-quality")
    assert given["tests"][0]["logs"] == ["other.csv"]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda folder: (folder / "run.csv").unlink(), "cannot be read again"),
        (
            lambda folder: (folder / "case.yaml").write_text(CASE.replace("0.7", "0.5")),
            "case.yaml has another content now",
        ),
        (
            lambda folder: (folder / "run.csv").write_text((folder / "other.csv").read_text()),
            "a log of the fit has another",
        ),
    ],
)
def test_what_is_no_longer_the_same_is_not_believed(
    capsys: Capture, run: Callable[..., int], folder: Path, change: Callable[[Path], object], why: str
) -> None:
    change(folder)
    found = reported(capsys, run)
    assert why in found["why_no_test"] and found["tests"] == [] and "log_quality" not in found["sections"]
    assert "test on it with --test LOG --split first:0.7" in (folder / "report.html").read_text(encoding="utf-8")


def test_an_estimate_of_another_command_is_reported_without_a_test(
    capsys: Capture, run: Callable[..., int], folder: Path
) -> None:
    text = (folder / "e.json").read_text()
    for command in ("dynident demo", "dynident identify --no-such-option", "'"):
        data = json.loads(text)
        data["provenance"]["command"] = command
        (folder / "e.json").write_text(json.dumps(data))
        assert "provenance" in reported(capsys, run)["why_no_test"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--format", "pdf"], "it goes with --figures DIR"),
        (["--figures", "new", "--format", "jpg"], "svg, pdf, png"),
        (["--split", "first:0.5"], "it goes with --test LOG"),
        (["--figures", "run.csv", "--no-log-quality"], "run.csv"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    capsys: Capture, run: Callable[..., int], folder: Path, words: list[str], said: str
) -> None:
    capsys.readouterr()
    before = (folder / "run.csv").read_bytes()
    assert run("report", "e.json", *words, "--quiet") == 1
    assert said in capsys.readouterr().err
    assert (folder / "run.csv").read_bytes() == before and not (folder / "new").exists()


def test_what_was_simulated_stands_in_the_report(capsys: Capture) -> None:
    assert main(["report", "e.json", "-o", "plain.html", "--no-log-quality", "--quiet"]) == 0
    assert "Simulation along the motion of a log" not in Path("plain.html").read_text(encoding="utf-8")
    assert main(["report", "e.json", "-o", "r.html", "--no-log-quality", "--quiet", "--prove"]) == 0
    page = Path("r.html").read_text(encoding="utf-8")
    assert "Simulation along the motion of a log" in page and "condition number of M(q) along the motion" in page
    assert main(["report", "e.json", "--motion", "run.csv"]) == 1
    assert "it goes with --prove" in capsys.readouterr().err
