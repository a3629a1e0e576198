"""What every log check must do, alone: look, name, change nothing, and say the same again."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2]))  # faults are those of the benchmark

from benchmarks.faults.trials import Trial, virtual

from dynident.case.case import Case
from dynident.data.formats import ColumnMap
from dynident.data.preprocessing import default_preprocessing
from dynident.diagnosis.checks import CHECKS
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import SEVERITIES, Finding
from dynident.diagnosis.recording import read_recording
from dynident.diagnosis.repair import repair
from dynident.model.friction import FRICTION, default_friction
from dynident.model.robot import Robot

PARTS = CHECKS.names()


def subject_of(trial: Trial, folder: Path, name: str = "run") -> CheckedLog:
    raw = read_recording(trial.case, str(trial.written(folder, name)))
    return CheckedLog(trial.case, raw, repair(raw, trial.case.robot).recording)


def turned_over(trial: Trial) -> Trial:
    """Return the log with several faults at once: a sign, a spike, a saturated torque, a scale, rows out of order."""
    generator = np.random.default_rng(0)
    columns = copied(trial)
    columns["tau"][:, 0] *= -1.0
    columns["tau"][:, 1] = np.clip(columns["tau"][:, 1], -np.inf, np.quantile(columns["tau"][:, 1], 0.8))
    columns["q"][generator.integers(len(columns["t"])), 1] += 1.0
    columns["dq"][:, 1] *= 2.0
    columns["t"][100:110] = columns["t"][100:110][::-1]
    return Trial(trial.case, columns)


@pytest.fixture(scope="module")
def trial(planar_2r: Robot) -> Trial:
    joints = tuple(replace(joint, damping=2.0, friction=3.0) for joint in planar_2r.joints)
    robot = replace(planar_2r, joints=joints)
    friction = tuple(FRICTION.make(name) for name in default_friction())
    return virtual(Case(robot, friction, ColumnMap(joints=robot.joint_names), default_preprocessing()), rate=100.0)


def copied(trial: Trial) -> dict[str, np.ndarray]:
    return {key: values.copy() for key, values in trial.columns.items()}


def holed(trial: Trial) -> Trial:
    """Return the log with values that are no numbers."""
    columns = copied(trial)
    columns["tau"][50:60, 1] = np.nan
    columns["q"][70, 0] = np.inf
    return Trial(trial.case, columns)


def resting(trial: Trial) -> Trial:
    """Return a log in which nothing moves and no torque changes."""
    columns = copied(trial)
    for key in ("q", "tau"):
        columns[key][:] = columns[key][0]
    columns["dq"][:] = 0.0
    return Trial(trial.case, columns)


def mixed(trial: Trial) -> Trial:
    """Return the log with its joints in another order, named so by the case."""
    order = [1, 0]
    names = tuple(trial.case.robot.joint_names[k] for k in order)
    columns = {key: values if key == "t" else values[:, order] for key, values in trial.columns.items()}
    return Trial(replace(trial.case, columns=replace(trial.case.columns, joints=names)), columns)


#: Logs that a user may have.
KINDS: dict[str, Callable[[Trial], Trial]] = {
    "clean": lambda trial: trial,
    "faulty": turned_over,
    "faulty, joints mixed": lambda trial: mixed(turned_over(trial)),
    "no numbers": holed,
    "at rest": resting,
    "without velocities": lambda trial: trial.without("dq"),
    "twelve rows": lambda trial: trial.rows(np.arange(12)),
    "four rows": lambda trial: trial.rows(np.arange(4)),
}


@pytest.fixture(scope="module")
def subjects(trial: Trial, tmp_path_factory: pytest.TempPathFactory) -> dict[str, CheckedLog]:
    """Return a log of each kind; what the checks share is computed once."""
    folder = tmp_path_factory.mktemp("logs")
    return {name: subject_of(make(trial), folder, str(k)) for k, (name, make) in enumerate(KINDS.items())}


@pytest.fixture(params=PARTS)
def part(request: pytest.FixtureRequest) -> Check:
    return CHECKS.make(request.param)


def signals(subject: CheckedLog) -> list[np.ndarray]:
    logs = (subject.raw.log, subject.sound.log)
    return [np.array(values) for log in logs for values in (log.time, log.q, log.dq, log.torque) if values is not None]


def checked(findings: Sequence[Finding], robot: Robot) -> None:
    """Findings are whole sentences about joints that exist, with finite figures that go into JSON."""
    for finding in findings:
        assert finding.severity in SEVERITIES and finding.name and finding.evidence and finding.remedy
        assert not finding.joint or set(finding.joint.split(", ")) <= set(robot.joint_names)
        assert "\n" not in finding.line() and "nan" not in finding.line().lower().split()
        json.dumps(finding.figures(), allow_nan=False)
        assert finding.name not in finding.explains


def test_a_clean_log_has_no_error(part: Check, subjects: dict[str, CheckedLog]) -> None:
    assert part.stage in (0, 1, 2)
    assert not [one.line() for one in part.findings(subjects["clean"]) if one.severity == "error"]


def test_it_changes_nothing_and_says_the_same_again(part: Check, subjects: dict[str, CheckedLog]) -> None:
    subject = subjects["faulty"]
    before = signals(subject)
    first = tuple(part.findings(subject))
    assert tuple(part.findings(subject)) == first
    for value, kept in zip(signals(subject), before, strict=True):
        np.testing.assert_array_equal(value, kept)


@pytest.mark.parametrize("kind", KINDS)
def test_no_log_stops_it(part: Check, kind: str, subjects: dict[str, CheckedLog]) -> None:
    """Logs without signals, rows, motion or numbers; repaired signals hold finite values only."""
    assert np.all(np.isfinite(subjects[kind].sound.log.q))
    checked(part.findings(subjects[kind]), subjects[kind].case.robot)


def test_the_order_of_columns_in_the_file_does_not_matter(part: Check, subjects: dict[str, CheckedLog]) -> None:
    """Joints in another order in the file, named so by the case: the same is found of each."""
    plain, other = (part.findings(subjects[kind]) for kind in ("faulty", "faulty, joints mixed"))
    told = [{(one.severity, one.name, one.joint) for one in each} for each in (plain, other)]
    assert told[0] == told[1]


def test_the_faults_are_found_by_some_check(subjects: dict[str, CheckedLog]) -> None:
    """The faulty log of this battery is one: else what holds for it would say nothing."""
    found = [one.name for name in PARTS for one in CHECKS.make(name).findings(subjects["faulty"])]
    assert len(set(found)) >= 3, found
