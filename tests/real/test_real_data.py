"""Accuracy on real logs, by the case files in examples/cases; skipped where the logs are missing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from dynident.cli.main import main
from real_data import DATA, real

ROOT = Path(__file__).resolve().parents[2]

#: Without the diagnostics that no test below reads: the estimate and its errors are the same.
QUICK = ("--cross-validate", "0", "--no-sensitivity")

FOLDERS = {
    "panda": "panda_gaz2019",
    "tx40": "staubli_tx40_figaroh",
    "ur10e": "ur10e_mamedov",
    "lwr4": "kuka_lwr4_flobaroid",
    "tiago": "tiago_figaroh",
}


def identified(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *options: str
) -> dict[str, Any]:
    real(FOLDERS[name], monkeypatch)
    assert main(["identify", str(ROOT / "examples" / "cases" / f"{name}.yaml"), *options, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_panda_unconstrained_and_consistent_on_the_held_out_third(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    free = identified("panda", monkeypatch, capsys, "--estimator", "wls", "--no-check", *QUICK)
    found = identified("panda", monkeypatch, capsys, *QUICK)
    assert free["test"]["total_relative_error"] <= 0.0085
    assert found["test"]["total_relative_error"] <= 0.0100
    (delay,) = found["extras"]["delays"]
    assert 0.001 < delay["applied"] < 0.005
    assert found["test"]["total_relative_error"] <= 1.10 * free["test"]["total_relative_error"]
    assert found["physically_consistent"] is True
    assert found["inertial_base_parameters"] == 43
    assert found["filter"]["cutoff_hz"] == 4


@pytest.mark.battery
def test_panda_on_all_data(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    real(FOLDERS["panda"], monkeypatch)
    text = (ROOT / "examples" / "cases" / "panda.yaml").read_text(encoding="utf-8")
    whole = tmp_path / "panda.yaml"
    whole.write_text("".join(line for line in text.splitlines(True) if not line.startswith("split")), encoding="utf-8")
    errors = {}
    for estimator in ("wls", "consistent"):
        assert main(["identify", str(whole), "--json", "--estimator", estimator]) == 0
        errors[estimator] = json.loads(capsys.readouterr().out)["train"]["total_relative_error"]
    assert errors["wls"] <= 0.0095
    assert errors["consistent"] <= 1.10 * errors["wls"]


def test_tx40_per_joint_on_all_held_out_rows(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = identified("tx40", monkeypatch, capsys, *QUICK)
    bounds = (4.1, 5.1, 1.5, 0.62, 1.25, 1.25)
    errors = [joint["rmse_unfiltered"] for joint in found["test"]["joints"]]
    assert all(error <= bound for error, bound in zip(errors, bounds, strict=True)), errors
    assert found["physically_consistent"] is True
    assert [joint["samples"] for joint in found["test"]["joints"]] == [1575] * 6


@pytest.mark.battery
def test_ur10e_from_currents_on_two_held_out_runs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = identified("ur10e", monkeypatch, capsys)
    assert found["test"]["total_relative_error"] <= 0.027
    assert all(0.008 < delay["applied"] < 0.016 for delay in found["extras"]["delays"])
    assert found["physically_consistent"] is True
    assert found["inertial_base_parameters"] == 36
    assert found["base_parameters"] == 70


@pytest.mark.battery
@pytest.mark.parametrize(
    ("train", "test", "bound"), [((2, 3), 1, 0.026), ((1, 3), 2, 0.0246), ((1, 2), 3, 0.049)], ids=["1", "2", "3"]
)
def test_lwr4_from_two_runs_to_the_third(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], train: tuple[int, ...], test: int, bound: float
) -> None:
    """The last one is twice as fast as both it learns from."""
    files = [str(DATA / FOLDERS["lwr4"] / f"measurements_{k}.csv") for k in (*train, test)]
    found = identified("lwr4", monkeypatch, capsys, *files[:2], "--test", files[2])
    assert found["test"]["total_relative_error"] <= bound
    assert found["physically_consistent"] is True


@pytest.mark.battery
def test_tiago_with_the_weight_that_its_log_leaves_out(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    free = identified("tiago", monkeypatch, capsys, "--estimator", "wls")
    found = identified("tiago", monkeypatch, capsys)
    assert found["test"]["total_relative_error"] <= min(0.061, free["test"]["total_relative_error"])
    masses = {p["name"]: p["value"] for p in found["standard_parameters"] if p["name"].startswith("m[")}
    assert 8.0 < sum(masses.values()) < 25.0  # 18.9 kg in the robot model; without the bias 0.1 kg are left
