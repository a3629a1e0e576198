"""The whole fault matrix, and the clean logs of the real robots: long, run by ``make test-all``."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2]))

from benchmarks.faults.matrix import alarms, outcomes
from benchmarks.faults.trials import robots

from dynident.case.case import read_case
from dynident.diagnosis.examination import examine

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("DYNIDENT_DATA") or ROOT.parent / "shared" / "data")

#: Share that must be named: nearly all where the robot model is exact and the noise white. What the Panda's own
#: description and friction hide is told in docs/log-checks.md.
SHARES = {"er16": 0.96, "generic-7r": 0.94, "panda": 0.88}

LOGS = {
    "panda": "panda_gaz2019/exciting_traj_1.csv",
    "tx40": "staubli_tx40_figaroh/trajectory.csv",
    "lwr4": "kuka_lwr4_flobaroid/measurements_1.csv",
    "ur10e": "ur10e_mamedov/ident_20_01_31_unload.csv",
    "tiago": "tiago_figaroh/trajectory.csv",
}


@pytest.mark.battery
@pytest.mark.parametrize("robot", SHARES)
def test_faults_are_named_from_the_smallest_that_matters(
    robot: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if robot == "panda" and not (DATA / LOGS[robot]).is_file():
        pytest.skip(f"no {LOGS[robot]} under DYNIDENT_DATA or ../shared/data")
    monkeypatch.setenv("DYNIDENT_DATA", str(DATA))
    ((trial, held),) = robots([robot]).values()
    counts = alarms(trial, held, tmp_path)
    assert counts["error"] == 0 and counts["warning"] <= 1
    found = list(outcomes(trial, held, tmp_path))
    missed = [(one.kind, one.strength, one.said) for one in found if not one.named]
    assert len({one.kind for one in found}) >= 25
    assert len(missed) <= (1 - SHARES[robot]) * len(found), missed


@pytest.mark.battery
@pytest.mark.parametrize("robot", LOGS)
def test_a_clean_real_log_gives_no_error_and_at_most_one_warning(robot: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if not (DATA / LOGS[robot]).is_file():
        pytest.skip(f"no {LOGS[robot]} under DYNIDENT_DATA or ../shared/data")
    monkeypatch.setenv("DYNIDENT_DATA", str(DATA))
    found = examine(read_case(ROOT / "examples" / "cases" / f"{robot}.yaml"), LOGS[robot])
    assert found.sound and not found.left_out
    assert sum(finding.severity == "warning" for finding in found.findings) <= 1, found.findings
