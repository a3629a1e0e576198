"""Logs in which a locked joint stands elsewhere are refused wherever they are read with an estimate or its case."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from dynident import Estimate, identify, read_case, read_estimate, read_robot, validate, write_estimate, write_log
from dynident.api.applications import payload
from dynident.api.identify import Record
from dynident.cli.main import main
from dynident.diagnosis.examination import examine
from dynident.errors import LogMismatch
from scara_logs import recorded

CASE = """\
case: 2
robot: generic-scara
joints: [{joints}]
locked: {{{locked}}}
friction: [coulomb, viscous]
log: {{columns: {{dq: none, ddq: none}}}}
preprocessing: {{filter: {{butterworth: {{cutoff_hz: 8}}}}}}
estimator: wls
"""

Fitted = Callable[[str, float], tuple[Estimate, Path]]


@pytest.fixture
def fitted(tmp_path: Path) -> Fitted:
    """Return an estimate with one joint locked at 0.35, and a log in which that joint stands somewhere."""
    robot = read_robot("generic-scara")

    def made(name: str, at: float) -> tuple[Estimate, Path]:
        k, paths = robot.joint_names.index(name), []
        for file, position, seed in (("train.csv", 0.35, 1), ("run.csv", at, 2)):
            log = recorded(robot, seed, 1500)
            q = log.q.copy()
            q[:, k] = position
            paths.append(tmp_path / file)
            write_log(replace(log, q=q, dq=None, ddq=None), paths[-1])
        (tmp_path / "case.yaml").write_text(CASE.format(joints=", ".join(robot.joint_names), locked=f"{name}: 0.35"))
        case = read_case(tmp_path / "case.yaml")
        found = identify(case, [case.read("train.csv")], record=Record(checks=False))  # torques of an arm that moved it
        write_estimate(replace(found, columns=case.columns), tmp_path / "estimate.json")
        return read_estimate(tmp_path / "estimate.json"), paths[1]

    return made


def test_a_joint_that_carries_others_has_to_stand_where_it_was_locked(fitted: Fitted, tmp_path: Path) -> None:
    estimate, run = fitted("shoulder", 0.9)
    assert estimate.model.robot.held == {"shoulder": 0.35}
    words = r"shoulder is locked at 0\.35 but up to 0\.55 away; lock it at .*: \{shoulder: 0\.9\} .* elsewhere in each"
    for use in (lambda: validate(estimate, run), lambda: payload(estimate, [run])):
        with pytest.raises(LogMismatch, match=words):
            use()
    assert main(["predict", str(tmp_path / "estimate.json"), str(run), "-o", str(tmp_path / "torque.csv")]) == 1
    case = read_case(tmp_path / "case.yaml")
    finding = examine(case, str(run), estimate).findings[0]
    assert finding.severity == "error" and finding.label == "locked joint (shoulder)"
    elsewhere = tmp_path / "other.yaml"  # reads the log, and is of another robot
    elsewhere.write_text((tmp_path / "case.yaml").read_text().replace("0.35", "0.9"))
    with pytest.raises(LogMismatch, match=r"shoulder is locked at 0\.9, and at 0\.35 in the estimate"):
        validate(estimate, run, case=read_case(elsewhere))
    assert main(["check", str(elsewhere), str(run), "--against", str(tmp_path / "estimate.json")]) == 1


def test_a_joint_at_its_place_and_one_that_carries_nothing_are_no_reason(fitted: Fitted, tmp_path: Path) -> None:
    estimate, run = fitted("shoulder", 0.36)
    assert validate(estimate, run).samples > 0
    assert "locked joint" not in [each.name for each in examine(read_case(tmp_path / "case.yaml"), str(run)).findings]
    estimate, run = fitted("spindle", 0.9)  # as a gripper that has closed
    assert estimate.model.robot.held == {} and validate(estimate, run).samples > 0
