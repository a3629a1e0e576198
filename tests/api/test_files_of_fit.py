"""Files of a fit that are looked for where the estimate and its case lie, not from the working folder only."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dynident.actuators.estimate import ActuatorEstimate
from dynident.api.applications import logs_of_fit
from dynident.api.estimate_output import file_of_fit
from dynident.api.validate import validate
from dynident.case.case import read_case
from dynident.cli.main import main
from dynident.cli.origin import origin_of
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.errors import LogMismatch
from dynident.identification.files.estimate_file import read_estimate
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.robot import Robot


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory, planar_2r: Robot, exact_log: Callable[..., Log]) -> Path:
    """A folder with two estimates of one case, made inside it: one beside its log, one in a folder of results."""
    place = tmp_path_factory.mktemp("fitted") / "arm"
    (place / "results").mkdir(parents=True)
    (place / "arm.json").write_text(json.dumps(robot_to_dict(planar_2r)))
    how = "preprocessing: {filter: {butterworth: {cutoff_hz: 8}}, rate_hz: 50}\ntrain: run0.csv\ntest: run1.csv"
    (place / "case.yaml").write_text(f"case: 2\nrobot: arm.json\nestimator: wls\nfriction: [viscous]\n{how}\n")
    model = read_case(place / "case.yaml").model
    assert planar_2r.nominal is not None
    for k in range(2):
        log = exact_log(model, np.append(planar_2r.nominal, [0.5, 0.5]), noise=0.3, seed=k, samples=1000, rate=100.0)
        write_log(Log(log.joints, log.time, log.q, torque=log.torque), place / f"run{k}.csv")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        for output in ("est.json", "results/est.json"):
            words = ["identify", "case.yaml", "-o", output, "--quiet", "--cross-validate", "0"]
            patch.setattr("sys.argv", ["dynident", *words])
            assert main(words) == 0
    return place


@pytest.mark.parametrize("name", ["est.json", "results/est.json"])
def test_logs_of_an_estimate_are_found_from_any_folder(
    name: str, fitted: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for folder in (fitted, fitted.parent, fitted / "results", tmp_path):
        monkeypatch.chdir(folder)
        estimate = read_estimate(fitted / name)
        (log,) = logs_of_fit(estimate)
        assert Path(log).resolve() == fitted / "run0.csv"
        origin = origin_of(estimate)
        assert [one.name for one in origin.held_out] and not origin.why_not
        assert validate(estimate).total_relative_error < 0.2
    capsys.readouterr()
    code = main(["track", str(fitted / name), str(fitted / "run1.csv"), "--memory", "3", "--json"])
    told = capsys.readouterr()
    assert code in (0, 1) and told.out, told.err
    assert json.loads(told.out)["clean"]


def test_a_log_with_another_content_is_not_that_of_the_fit(
    fitted: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    moved = tmp_path / "moved"
    shutil.copytree(fitted, moved)
    monkeypatch.chdir(tmp_path)
    shutil.copy(fitted / "run1.csv", tmp_path / "run0.csv")  # of that name, another log
    estimate = read_estimate(moved / "est.json")
    assert [Path(log).resolve() for log in logs_of_fit(estimate)] == [moved / "run0.csv"]
    shutil.copy(fitted / "run1.csv", moved / "run0.csv")
    with pytest.raises(LogMismatch, match="not there as it was, nor where the estimate or its case lies"):
        logs_of_fit(estimate)
    assert "cannot be read again" in origin_of(estimate).why_not


def test_files_of_servos_are_found_alike(fitted: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    facts = {"path": "run0.csv"}
    assert file_of_fit(ActuatorEstimate("arm", (), {}, None, str(fitted / "est.json")), facts)
    assert not file_of_fit(ActuatorEstimate("arm", (), {}), facts)
