"""Log checks of recorded logs, as their cases read them and below a low cut-off; skipped without the logs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from benchmarks.faults import injections as put
from benchmarks.faults.trials import LEARNED, REAL, recorded, subject_of

from dynident.api.log_checks import check_logs
from dynident.case.case import read_case
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.diagnosis.examination import examine, examine_recordings
from dynident.diagnosis.recording import recording_of
from dynident.model.friction import FRICTION
from real_data import real

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("name", "folder"),
    [
        ("panda", "panda_gaz2019"),
        ("lwr4", "kuka_lwr4_flobaroid"),
        ("tx40", "staubli_tx40_figaroh"),
        ("tiago", "tiago_figaroh"),
        ("ur10e", "ur10e_mamedov"),
    ],
)
def test_no_recorded_log_has_an_error(name: str, folder: str, monkeypatch: pytest.MonkeyPatch) -> None:
    real(folder, monkeypatch)
    case = read_case(ROOT / "examples" / "cases" / f"{name}.yaml")
    for log in (*case.train, *case.test):
        assert [one.line() for one in examine(case, log).findings if one.severity == "error"] == []


def test_a_joint_whose_friction_the_model_lacks_makes_no_other_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    """The torso of a TIAGo leaves a third of its torque; bodies of its own mend that joint, and nothing else."""
    real("tiago_figaroh", monkeypatch)
    case = read_case(ROOT / "examples" / "cases" / "tiago.yaml")
    case = replace(case, preprocessing=replace(case.preprocessing, trim_s=1.2, delay_s=None))
    assert case.split is not None
    part = case.split.apply(case.read(case.train[0]))[0]
    (found,) = examine_recordings(case, [recording_of(case, part)])
    assert [one.line() for one in found.findings if one.severity == "error"] == []


def test_a_delay_is_told_beside_the_friction_of_a_real_arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Friction that turns early and a spring make it 1.2 ms too long where nothing else may explain the torques.

    Which causes stand beside it moves it by a deviation: 16.4 ms with a counterbalance, 15.0 with a spring of joint_4.
    """
    real("staubli_tx40_figaroh", monkeypatch)
    whole = recorded("tx40")
    late = put.delayed(whole.rows(np.arange(int(LEARNED * len(whole.columns["t"])))), 80.0)
    delay = subject_of(late, tmp_path).delay
    assert delay is not None and delay.applied
    assert abs(delay.seconds - 80.0 * put.step_of(late)) < 1.96 * delay.std < 2e-3


def test_a_turned_sign_is_told_and_no_scale_that_leaves_its_joint_unexplained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = pd.read_csv(real("panda_gaz2019/exciting_traj_1.csv", monkeypatch))
    table["tau4"] *= -1.0
    table.to_csv(tmp_path / "turned.csv", index=False)
    case = read_case(ROOT / "examples" / "cases" / "panda.yaml")
    grave = [one for one in examine(case, str(tmp_path / "turned.csv")).findings if one.severity == "error"]
    assert [(one.name, one.joint) for one in grave] == [("torque sign", "joint4")]


def test_a_lean_that_passes_for_a_delay_is_a_lean_and_a_delay_a_delay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In 14 s with the robot's torques alone, a lean of 2 degrees passes for a delay of 16 ms."""
    real(REAL["panda"], monkeypatch)
    whole = recorded("panda")
    log = whole.rows(np.arange(int(LEARNED * len(whole.columns["t"]))))
    leaning = subject_of(put.tilted(log, 2.1, np.random.default_rng(1)), tmp_path)
    assert leaning.trends is not None and leaning.delay is not None and leaning.delay.applied == 0.0
    (lean,) = [blame for blame in leaning.trends.blames if blame.cause.name == "tilt"]
    assert 1.7 < np.degrees(np.linalg.norm(lean.values)) < 2.5
    late = subject_of(put.delayed(log, 10.0), tmp_path)
    assert late.delay is not None and abs(late.delay.applied - 10.0 * put.step_of(log)) < 4e-3


@pytest.mark.battery
@pytest.mark.parametrize("run", [1, 2, 3])
def test_a_wrist_torque_that_follows_its_position_is_no_other_order(run: int, monkeypatch: pytest.MonkeyPatch) -> None:
    log = f"kuka_lwr4_flobaroid/measurements_{run}.csv"
    real(log, monkeypatch)
    case = read_case(ROOT / "examples" / "cases" / "lwr4.yaml")
    friction = (FRICTION.make("coulomb", {"width": 0.01}), FRICTION.make("rotor_inertia"))
    how = replace(case.preprocessing, filter=Butterworth(2.0), trim_s=1.2)
    case = replace(case, friction=friction, preprocessing=how)
    assert examine(case, log).sound


def test_a_zero_that_moved_between_two_logs_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parameters of the log alone take the shift in, those of the other logs do not; as recorded all are alike."""
    real("ur10e_mamedov", monkeypatch)
    case = read_case(ROOT / "examples" / "cases" / "ur10e.yaml")
    logs = [case.read(case.find(name)) for name in case.train[:3]]
    *_, together = check_logs(case, logs)
    assert together["path"] == "all 3 logs"
    moved = logs[0].q + 0.2 * np.eye(6)[1]
    first, *rest, together = check_logs(case, [replace(logs[0], q=moved), *logs[1:]])
    assert together["path"].startswith("2 of 3 logs (ident_20_02_05")
    told = [(one["severity"], one["joint"]) for one in first["findings"] if one["name"] == "unlike other logs"]
    assert told == [("warning", "shoulder_lift_joint")]
    assert not any(one["name"] == "unlike other logs" for each in rest for one in each["findings"])


@pytest.mark.battery
@pytest.mark.parametrize("joint", range(1, 7))
def test_joints_at_rest_are_told_once(joint: int, monkeypatch: pytest.MonkeyPatch) -> None:
    log = f"ur10e_mamedov/jointwise_20_01_22_joint_{joint}.csv"
    real(log, monkeypatch)
    found = examine(read_case(ROOT / "examples" / "cases" / "ur10e.yaml"), log).findings
    grave = {one.name for one in found if one.severity != "note"} - {"spikes"}  # of the current
    assert grave == ({"poor excitation"} if joint == 6 else {"joint never moved"})
    assert not any("values of q" in one.evidence for one in found)
