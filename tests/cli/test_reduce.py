"""reduce, merge and identify --from at the terminal."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_answers import refused

from dynident.api import case_logs
from dynident.case.case import read_case
from dynident.cli.main import main
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.identification.files.estimate_file import read_estimate
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.robot import Robot

Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, planar_2r: Robot, exact_log: Callable[..., Log]) -> Path:
    place = tmp_path_factory.mktemp("cell")
    (place / "arm.json").write_text(json.dumps(robot_to_dict(planar_2r)))
    theta = np.append(planar_2r.nominal, np.tile([0.5, 0.3, 0.1], 2))  # type: ignore[arg-type]
    for seed, name in enumerate(("a", "b", "test")):
        log = exact_log(read_case(place / "arm.json").model, theta, noise=0.1, seed=seed, samples=2400, rate=200.0)
        write_log(Log(log.joints, log.time, log.q, torque=log.torque), place / f"{name}.csv")
    how = "preprocessing: {filter: {butterworth: {cutoff_hz: 5}}, rate_hz: 200}"
    logs = "train: [a.csv, b.csv]\ntest: test.csv"
    (place / "case.yaml").write_text(f"case: 1\nrobot: arm.json\n{logs}\nestimator: wls\n{how}\n")
    return place


@pytest.fixture(autouse=True)
def inside(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.delenv("DYNIDENT_DATA", raising=False)


def test_reduce_merge_identify_is_identify(capsys: Capture, tmp_path: Path) -> None:
    for name in "ab":
        assert main(["reduce", "case.yaml", f"{name}.csv", "-o", str(tmp_path / f"{name}.tri"), "--json"]) == 0
        facts = json.loads(capsys.readouterr().out)
        assert facts["joints"] == ["joint1", "joint2"] and facts["logs"][0]["rows"] == 2400
    both = str(tmp_path / "both.tri")
    assert main(["merge", str(tmp_path / "a.tri"), str(tmp_path / "b.tri"), "-o", both]) == 0
    out, err = capsys.readouterr()
    assert "4,400 samples of 2 logs" in out and "2,400 rows, 2,200 used at 200 Hz" in out and f"saved {both}" in err
    saved = [str(tmp_path / "one.json"), str(tmp_path / "two.json")]
    page = tmp_path / "report.html"
    assert (
        main(["identify", "case.yaml", "--from", both, "-o", saved[0], "--report", str(page), "--quiet", "--full"]) == 0
    )
    assert "test data: total relative error" in capsys.readouterr().out and page.stat().st_size > 10_000
    assert main(["identify", "case.yaml", "-o", saved[1], "--quiet", "--cross-validate", "0", "--full"]) == 0
    one, two = map(read_estimate, saved)
    np.testing.assert_allclose(one.beta, two.beta, rtol=1e-8)
    assert one.train.total_relative_error == pytest.approx(two.train.total_relative_error, rel=1e-8)
    capsys.readouterr()
    assert main(["validate", saved[0], "test.csv", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["train"]["samples"] == 4400


def test_the_logs_of_the_case_are_reduced_and_nothing_is_left_beside_the_result(
    capsys: Capture, tmp_path: Path
) -> None:
    words = ["reduce", "case.yaml", "-o", str(tmp_path / "all.tri"), "--checkpoint", "0.000001"]
    assert main(words) == 0
    out, err = capsys.readouterr()
    assert "of 2 logs" in out and "next: dynident identify case.yaml --from" in err
    assert [file.name for file in tmp_path.iterdir()] == ["all.tri"]


def test_large_logs_are_reduced_as_a_stream_by_themselves(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(case_logs, "LARGE", 10_000)
    for estimator, streamed in (("wls", True), ("huber", False)):
        assert main(["identify", "case.yaml", "--estimator", estimator, "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["extras"].get("streamed", False) is streamed
    assert main(["identify", "case.yaml", "--estimator", "huber", "--cross-validate", "0"]) == 0
    assert "are read into memory: the estimator needs the samples" in capsys.readouterr().err


def test_the_first_minutes_of_a_stream_are_checked(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(case_logs, "LARGE", 10_000)
    words = ["identify", "--estimator", "wls", "--json"]
    assert main([*words, "case.yaml"]) == 0
    verdict = json.loads(capsys.readouterr().out)["verdict"]
    assert verdict["log_checks_made"] and not verdict["causes"]
    assert main([*words, "case.yaml", "--no-check"]) == 0
    assert not json.loads(capsys.readouterr().out)["verdict"]["log_checks_made"]
    for name in "ab":
        log = read_case("case.yaml").read(f"{name}.csv")
        turned = np.asarray(log.torque) * [1.0, -1.0]
        write_log(Log(log.joints, log.time, log.q, torque=turned), tmp_path / f"{name}.csv")
    case = Path("case.yaml").read_text().replace("arm.json", str(Path("arm.json").resolve()))
    (tmp_path / "case.yaml").write_text(case.replace("test: test.csv\n", ""))
    assert main([*words, str(tmp_path / "case.yaml")]) == 4
    (cause,) = json.loads(capsys.readouterr().out)["verdict"]["causes"]
    assert cause["name"] == "torque sign"


@pytest.mark.parametrize("split", ["first:0.6", "samples:300:1500,1600:2400"])
def test_a_case_that_splits_its_logs_has_the_training_parts_reduced(
    capsys: Capture, tmp_path: Path, split: str
) -> None:
    """With the options of reduce, which identify takes from the triangles; merged, with those of the first."""
    words, files = ["--split", split, "--friction", "coulomb", "viscous", "--cutoff", "4", "--rate", "all"], []
    for name in "ab":
        files.append(str(tmp_path / f"{name}.tri"))
        assert main(["reduce", "arm.json", f"{name}.csv", "-o", files[-1], "--checkpoint", "1e-6", *words]) == 0
        assert not list(tmp_path.glob("*.partial"))
    files.append(str(tmp_path / "both.tri"))
    assert main(["merge", *files[:2], "-o", files[-1]]) == 0
    saved = [str(tmp_path / "one.json"), str(tmp_path / "two.json")]
    wls = ["--estimator", "wls", "--quiet"]
    assert main(["identify", "arm.json", "--from", files[-1], "-o", saved[0], *wls]) == 0
    assert main(["identify", "arm.json", "a.csv", "b.csv", *words, "-o", saved[1], "--no-sensitivity", *wls]) == 0
    one, two = map(read_estimate, saved)
    np.testing.assert_allclose(one.beta, two.beta, rtol=1e-8)
    assert one.samples == two.samples
    part = "first 0.6 of the duration" if split.startswith("first") else "samples 300 to 1500 of 2400"
    assert part in one.provenance["logs"][0]["steps"] and one.provenance["logs"][0]["split"] == split
    capsys.readouterr()
    err = refused(capsys, "identify", "arm.json", "--from", files[-1], "--cutoff", "3")
    assert "another preprocessing (cutoff_hz 4.0, there 3.0" in err
    if split.startswith("samples"):
        too_far = ["--split", "samples:0:2000,2000:9000", "-o", files[0]]
        assert "2400 samples, the split ends at 9000" in refused(capsys, "reduce", "arm.json", "a.csv", *too_far)


def test_what_does_not_go_together_is_refused(capsys: Capture, tmp_path: Path) -> None:
    tri = str(tmp_path / "a.tri")
    assert main(["reduce", "case.yaml", "a.csv", "-o", tri, "--quiet"]) == 0
    capsys.readouterr()
    for words, text in (
        (["a.csv"], "LOG = "),
        (["--bootstrap", "50"], "--bootstrap = 50 is not possible; it needs the samples of logs"),
        (["--estimator", "huber"], "it needs the samples"),
        (["--friction", "coulomb"], "other than the case: another friction"),
        (["--rate", "50"], "other than the case: another preprocessing"),
        (["--test", "a.csv"], "a.csv: the same content as a.csv; test on logs that are not trained on"),
    ):
        assert text in refused(capsys, "identify", "case.yaml", *words, "--from", tri)
    assert "would be overwritten" in refused(capsys, "merge", tri, "-o", tri)
    assert "count twice" in refused(capsys, "merge", tri, tri, "-o", str(tmp_path / "b.tri"))
    assert "name a log" in refused(capsys, "reduce", "arm.json", "-o", tri)
    assert "give seconds" in refused(capsys, "reduce", "case.yaml", "-o", tri, "--checkpoint", "-1")
