"""The whole fault matrix, and the clean logs of the real robots: long, run by ``make test-all``."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2]))

from benchmarks.faults import injections as put
from benchmarks.faults.bound import Z95, log_tells, sureness
from benchmarks.faults.figures import CleanLog
from benchmarks.faults.matrix import alarms, outcomes
from benchmarks.faults.trials import robots, subject_of, virtual

from dynident.case.case import read_case
from dynident.diagnosis.examination import examine
from real_data import real

ROOT = Path(__file__).resolve().parents[2]

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
    if robot == "panda":
        real(LOGS[robot], monkeypatch)
    ((trial, held),) = robots([robot]).values()
    counts = alarms(trial, held, tmp_path)
    assert counts["error"] == 0 and counts["warning"] <= 1
    found = list(outcomes(trial, held, tmp_path))
    missed = [(one.kind, one.strength, one.said) for one in found if not one.named]
    assert len({one.kind for one in found}) >= 25
    assert len(missed) <= (1 - SHARES[robot]) * len(found), missed


def test_what_a_log_tells_of_a_fault_at_most_grows_with_the_fault_and_bounds_what_is_told(tmp_path: Path) -> None:
    case = read_case("generic-scara")
    trial, earlier = virtual(case), virtual(case, seed=1).estimate(tmp_path)
    clean = CleanLog(trial, subject_of(trial, tmp_path), ())
    faults = [put.sprung(trial, share, 1) for share in (0.01, 0.02)]
    faults += [put.tilted(trial, angle, np.random.default_rng(0)) for angle in (0.5, 1.0)]
    sure = [sureness(fault, clean, earlier, tmp_path) for fault in faults]
    assert sure[1] == pytest.approx(2 * sure[0], rel=1e-6) and sure[3] == pytest.approx(2 * sure[2], rel=1e-3)
    (spring,) = [one for one in faults[1].examined(tmp_path, earlier).findings if one.name == "spring"]
    assert 0.9 * Z95 / sure[1] < spring.numbers["half_width"] / spring.numbers["value"] < 4 * Z95 / sure[1]
    assert sureness(put.timed(trial, 1.1), clean, earlier, tmp_path) == np.inf  # its torque is that of the log


def test_no_log_is_asked_for_more_than_it_tells_and_none_is_why_a_figure_is_false(tmp_path: Path) -> None:
    trial = virtual(read_case("generic-scara"))
    clean = CleanLog(trial, subject_of(trial, tmp_path), ())
    told = {
        (grade, sure): log_tells(grade, sure, clean) for grade in ("wide", "", "false") for sure in (2.0, 10.0, 30.0)
    }
    silent = {("wide", 2.0), ("wide", 10.0), ("", 2.0)}
    assert {key for key, tells in told.items() if not tells} == silent


@pytest.mark.battery
@pytest.mark.parametrize("robot", LOGS)
def test_a_clean_real_log_gives_no_error_and_at_most_one_warning(robot: str, monkeypatch: pytest.MonkeyPatch) -> None:
    real(LOGS[robot], monkeypatch)
    found = examine(read_case(ROOT / "examples" / "cases" / f"{robot}.yaml"), LOGS[robot])
    assert found.sound and not found.left_out
    assert sum(finding.severity == "warning" for finding in found.findings) <= 1, found.findings
