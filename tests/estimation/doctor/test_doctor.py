"""The doctor on clean logs, on logs with injected faults, and the mends that it calls safe."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from dynident.estimation.doctor import CHECKS, examine, examine_recording
from dynident.estimation.doctor._mending import mend, sortable, wraps
from dynident.estimation.doctor._recording import read_recording
from dynident.estimation.doctor.base import SEVERITIES
from dynident.estimation.doctor.resolution import steps_of
from dynident.estimation.doctor.saturation import flat_share
from dynident.experiment.case_file.case import DEFAULT_FRICTION, Case, default_preprocessing
from dynident.experiment.formats import ColumnMap
from dynident.model.friction import FRICTION
from dynident.model.robot import Robot


def injections() -> ModuleType:
    """Return benchmarks/faults.py, which tests every kind at three strengths on full-size arms."""
    path = Path(__file__).parents[3] / "benchmarks" / "faults.py"
    spec = importlib.util.spec_from_file_location("fault_injections", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["fault_injections"] = module
    spec.loader.exec_module(module)
    return module


faults = injections()
faults.RATE = 100.0  # half the rows of the benchmark


@pytest.fixture(scope="module")
def case(spatial_3r: Robot) -> Case:
    joints = tuple(replace(joint, damping=2.0, friction=3.0) for joint in spatial_3r.joints)
    robot = replace(spatial_3r, joints=joints)
    friction = tuple(FRICTION.make(name) for name in DEFAULT_FRICTION)
    return Case(robot, friction, ColumnMap(joints=robot.joint_names), default_preprocessing())


@pytest.fixture(scope="module")
def columns(case: Case) -> dict[str, np.ndarray]:
    return faults.clean(case)


def said(case: Case, path: Path) -> dict[str, str]:
    return {finding.name: finding.joint for finding in examine(case, str(path)).findings}


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_clean_log_has_neither_errors_nor_warnings(case: Case, seed: int, tmp_path: Path) -> None:
    faults.write(faults.clean(case, seed), tmp_path / "run.csv")
    found = examine(case, str(tmp_path / "run.csv"))
    assert found.sound and not found.left_out
    assert not [finding for finding in found.findings if finding.severity != "note"]
    assert found.mended is not None and found.mended.mends == ()


@pytest.mark.parametrize("fault", faults.FAULTS, ids=lambda fault: fault.name)
def test_a_fault_is_named(case: Case, columns: dict[str, np.ndarray], fault, tmp_path: Path) -> None:
    named, names = faults.tried(case, fault, fault.strengths[1], columns, tmp_path)
    assert named, names


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_the_joint_whose_torque_is_turned_is_named(case: Case, columns, joint: int, tmp_path: Path) -> None:
    faults.write(faults.turned(columns, ("tau",), joint), tmp_path / "run.csv")
    assert said(case, tmp_path / "run.csv") == {"torque sign": case.robot.joint_names[joint]}


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_a_wrong_gravity_is_named_with_the_right_one(case: Case, columns, kind: int, tmp_path: Path) -> None:
    _, wrong = faults.mounted(case)[kind]
    faults.write(columns, tmp_path / "run.csv")
    finding = examine(wrong, str(tmp_path / "run.csv")).findings[0]
    assert finding.name == "mounting"
    assert "[0, 0, -9.81]" in finding.remedy


@pytest.mark.parametrize("seconds", [0.012, 0.03])
def test_the_delay_is_right_to_a_fraction_of_a_sample(case: Case, columns, seconds: float, tmp_path: Path) -> None:
    faults.write(faults.delayed(columns, seconds, np.random.default_rng(0)), tmp_path / "run.csv")
    found = {finding.name: finding for finding in examine(case, str(tmp_path / "run.csv")).findings}
    assert found["torque delay"].numbers["delay_s"] == pytest.approx(seconds, abs=0.3 / faults.RATE)


def test_degrees_explain_what_follows_from_them(case: Case, columns, tmp_path: Path) -> None:
    faults.write({**columns, "q": np.rad2deg(columns["q"])}, tmp_path / "run.csv")
    found = examine(case, str(tmp_path / "run.csv"))
    assert [finding.name for finding in found.findings] == ["positions in degrees"]
    assert "units: {position: " in found.findings[0].remedy
    assert found.left_out


def test_the_line_of_a_fault_is_that_of_the_file(case: Case, columns, tmp_path: Path) -> None:
    broken = {**columns, "tau": columns["tau"].copy()}
    broken["tau"][40, 1] = np.nan
    faults.write(broken, tmp_path / "run.csv")
    (finding,) = examine(case, str(tmp_path / "run.csv")).findings
    assert finding.severity == "error" and "line 42" in finding.evidence


def test_a_file_that_is_no_table_is_a_finding(case: Case, tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("t,q1\n0,one\n", encoding="utf-8")
    found = examine(case, str(tmp_path / "run.csv"))
    assert not found.sound and [finding.name for finding in found.findings] == ["unreadable"]


def test_mends_give_the_clean_log_back(case: Case, columns, tmp_path: Path) -> None:
    generator = np.random.default_rng(3)
    broken = faults.disorder(faults.duplicates(columns, 0.01, generator), 0.002, generator)
    first = broken["q"][:, 0]
    broken["q"][:, 0] = np.where(first > np.median(first), first - 2 * np.pi, first)
    faults.write(broken, tmp_path / "broken.csv")
    faults.write(columns, tmp_path / "clean.csv")
    clean = read_recording(case, str(tmp_path / "clean.csv")).log
    mended = mend(read_recording(case, str(tmp_path / "broken.csv")), case.robot)
    log = mended.recording.log
    assert len(mended.mends) >= 3
    assert np.array_equal(log.time, clean.time)
    assert np.array_equal(log.torque, clean.torque)
    turns = (log.q - clean.q) / (2 * np.pi)
    assert np.allclose(turns, np.round(turns).mean(axis=0), atol=1e-8)


def test_what_is_not_safe_is_not_mended(case: Case, columns, tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    for broken in (faults.lost(columns, 0.2, generator), faults.restart(columns, 0.5, generator)):
        faults.write(broken, tmp_path / "run.csv")
        recording = read_recording(case, str(tmp_path / "run.csv"))
        assert mend(recording, case.robot).recording.log.samples == recording.log.samples
        assert not examine_recording(case, recording).sound


def test_sorting_is_for_rows_out_of_order_only() -> None:
    time = np.arange(1000) / 100.0
    swapped = time.copy()
    swapped[[10, 11]] = swapped[[11, 10]]
    assert sortable(swapped)
    assert not sortable(np.concatenate([time, time + 0.001]))


def test_a_joint_that_turns_fast_does_not_wrap(case: Case, columns, tmp_path: Path) -> None:
    faults.write(columns, tmp_path / "run.csv")
    assert wraps(read_recording(case, str(tmp_path / "run.csv")).log, case.robot) == {}


def test_flat_tops_and_levels() -> None:
    time = np.linspace(0, 10, 2001)
    wave = np.sin(time)
    assert flat_share(wave) == 0.0
    assert flat_share(np.minimum(wave, 0.9)) == pytest.approx(np.mean(wave >= 0.9))
    assert steps_of(np.round(wave * 10) / 10) == pytest.approx(20, abs=1)
    assert steps_of(wave) == np.inf
    assert steps_of(np.zeros(50)) == 0.0


def test_every_check_says_what_it_looks_at() -> None:
    assert len(CHECKS.names()) >= 12
    assert all(CHECKS.get(name).stage in (0, 1, 2) and CHECKS.summary(name) for name in CHECKS.names())
    assert SEVERITIES == ("error", "warning", "note")
