"""Accuracy on real logs, by the case files in examples/cases; skipped where the logs are missing."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from dynident.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("DYNIDENT_DATA") or ROOT.parent / "shared" / "data")


def identified(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *options: str
) -> dict[str, Any]:
    folder = {"panda": "panda_gaz2019", "tx40": "staubli_tx40_figaroh", "ur10e": "ur10e_mamedov"}[name]
    if not (DATA / folder).is_dir():
        pytest.skip(f"no folder {folder} under DYNIDENT_DATA or ../shared/data")
    monkeypatch.setenv("DYNIDENT_DATA", str(DATA))
    assert main(["identify", str(ROOT / "examples" / "cases" / f"{name}.yaml"), "--json", *options]) == 0
    return json.loads(capsys.readouterr().out)


def test_panda_unconstrained_and_consistent_on_the_held_out_third(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    free = identified("panda", monkeypatch, capsys, "--estimator", "wls")
    found = identified("panda", monkeypatch, capsys)
    assert free["test"]["total_relative_error"] <= 0.0105
    assert found["test"]["total_relative_error"] <= 1.10 * free["test"]["total_relative_error"]
    assert found["physically_consistent"] is True
    assert found["inertial_base_parameters"] == 43
    assert found["filter"]["cutoff_hz"] == 4


def test_panda_on_all_data(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    text = (ROOT / "examples" / "cases" / "panda.yaml").read_text(encoding="utf-8")
    whole = tmp_path / "panda.yaml"
    whole.write_text("".join(line for line in text.splitlines(True) if not line.startswith("split")), encoding="utf-8")
    if not (DATA / "panda_gaz2019").is_dir():
        pytest.skip("no folder panda_gaz2019 under DYNIDENT_DATA or ../shared/data")
    monkeypatch.setenv("DYNIDENT_DATA", str(DATA))
    errors = {}
    for estimator in ("wls", "consistent"):
        assert main(["identify", str(whole), "--json", "--estimator", estimator]) == 0
        errors[estimator] = json.loads(capsys.readouterr().out)["train"]["total_relative_error"]
    assert errors["wls"] <= 0.0095
    assert errors["consistent"] <= 1.10 * errors["wls"]


def test_tx40_per_joint_on_all_held_out_rows(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = identified("tx40", monkeypatch, capsys)
    bounds = (4.1, 5.1, 1.5, 0.62, 1.25, 1.25)
    errors = [joint["rmse_unfiltered"] for joint in found["test"]["joints"]]
    assert all(error <= bound for error, bound in zip(errors, bounds, strict=True)), errors
    assert found["physically_consistent"] is True
    assert [joint["rows"] for joint in found["test"]["joints"]] == [1575] * 6


def test_ur10e_from_currents_on_two_held_out_runs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = identified("ur10e", monkeypatch, capsys)
    assert found["test"]["total_relative_error"] <= 0.043
    assert found["physically_consistent"] is True
    assert found["inertial_base_parameters"] == 36
    assert found["base_parameters"] == 58
