"""A load within a log, or a change for good: told with its time, and not told of one load, friction or noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults.trials import Trial, virtual

from dynident.case.case import Case
from dynident.diagnosis.examination import examine, examine_logs
from dynident.diagnosis.finding import Finding
from dynident.model.inertia import Inertia

RATE = 200.0


@pytest.fixture(scope="module")
def runs(case: Case) -> tuple[Trial, Trial]:
    """The same motion without a tool and with one of 2 kg."""
    last = case.robot.links[-1]
    assert last.inertia is not None
    body = Inertia.from_centre_of_mass(2.0, np.array([0.05, 0.1, -0.1]), 0.002 * np.eye(3))
    robot = replace(case.robot, links=(*case.robot.links[:-1], replace(last, inertia=last.inertia + body)))
    return virtual(case, 1, RATE), replace(virtual(replace(case, robot=robot), 1, RATE), case=case)


def mixed(runs: tuple[Trial, Trial], *spells: tuple[float, float]) -> Trial:
    """Return a log that carries the tool in some spells, in s."""
    empty, loaded = runs
    t = empty.columns["t"]
    carries = np.any([(t >= start) & (t < end) for start, end in spells], axis=0)
    return empty.with_columns(tau=np.where(carries[:, None], loaded.columns["tau"], empty.columns["tau"]))


def changes(trial: Trial, folder: Path) -> list[Finding]:
    found = examine(trial.case, str(trial.written(folder))).findings
    return [one for one in found if one.name == "parameter change"]


@pytest.mark.parametrize("spells", [[(11.0, 20.0)], [(3.0, 7.0), (10.0, 13.0), (16.0, 19.0)]])
def test_a_load_that_comes_and_goes_is_an_error_with_its_time(
    spells: list[tuple[float, float]], runs: tuple[Trial, Trial], tmp_path: Path
) -> None:
    """Logs of picking and placing and of a tool change had no finding, and another log of the case was blamed."""
    trial = mixed(runs, *spells)
    (finding,) = changes(trial, tmp_path)
    assert finding.severity == "error" and finding.numbers["times"] > 10.0
    if len(spells) == 1:
        assert (finding.numbers["first"], finding.numbers["last"]) == pytest.approx(spells[0], abs=1.1)
        found = examine_logs(trial.case, [str(trial.written(tmp_path)), str(runs[0].written(tmp_path, "right"))])
        assert [one.sound for one in found] == [False, True]
        assert not any(one.name == "unlike other logs" for one in found[1].findings)


def test_one_load_all_along_and_other_friction_are_no_change(runs: tuple[Trial, Trial], tmp_path: Path) -> None:
    """What a load contradicts is told by other checks; friction that falls as an arm warms up is no other body."""
    empty, loaded = runs
    tau, t = empty.columns["tau"].copy(), empty.columns["t"]
    tau += 6.0 * np.tanh(empty.columns["dq"] / 0.01) * (t > 9.0)[:, None]
    for trial in (empty, loaded, empty.with_columns(tau=tau)):
        assert not changes(trial, tmp_path)


def test_files_of_either_part_are_right(runs: tuple[Trial, Trial], tmp_path: Path) -> None:
    """What the remedy asks for."""
    trial = mixed(runs, (11.0, 20.0))
    t = trial.columns["t"]
    for part in (t < 11.0, t >= 11.0):
        found = examine(trial.case, str(trial.rows(np.flatnonzero(part)).written(tmp_path)))
        assert not [one for one in found.findings if one.severity == "error"]
