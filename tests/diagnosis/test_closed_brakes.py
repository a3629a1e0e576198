"""Pauses with closed brakes: torques that read zero while gravity asks for more."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults.trials import RATE, Trial, subject_of, virtual

from dynident.applications.monitor.momentum_observer import MomentumObserver
from dynident.applications.monitor.signals import signals_of
from dynident.case.case import read_case
from dynident.data.log import Log
from dynident.data.preprocessing import FILTERS, default_preprocessing, preprocess
from dynident.diagnosis.checks.closed_brakes import ClosedBrakes
from dynident.diagnosis.finding import spells_in_words

PAUSE = 3.0


def paused(trial: Trial, held: float) -> Trial:
    """Return a log that begins with a pause in which drives read so many times the torque of its first sample."""
    rows, generator = int(PAUSE * RATE), np.random.default_rng(0)
    columns = {name: np.concatenate([np.repeat(one[:1], rows, axis=0), one]) for name, one in trial.columns.items()}
    size = trial.columns["tau"].std(axis=0)
    columns["dq"][:rows] = 0.0
    columns["tau"][:rows] = held * columns["tau"][:rows] + 0.01 * size * generator.normal(size=(rows, len(size)))
    return replace(trial, columns={**columns, "t": np.arange(len(columns["q"])) / RATE})


@pytest.fixture(scope="module")
def trial() -> Trial:
    case = read_case("generic-6r")
    arm = case.robot.locked({name: 0.4 for name in case.robot.joint_names[3:]})
    return virtual(replace(case, robot=arm, columns=replace(case.columns, joints=arm.joint_names)), 1, RATE)


def log_of(trial: Trial) -> Log:
    columns = trial.columns
    return Log(trial.case.robot.joint_names, columns["t"], columns["q"], torque=columns["tau"])


def test_samples_with_closed_brakes_are_left_out_and_those_of_held_arms_are_not(trial: Trial) -> None:
    how = replace(default_preprocessing(), filter=FILTERS.make("butterworth", {"cutoff_hz": 5.0}))
    braked, held = (preprocess(log_of(paused(trial, share)), how) for share in (0.0, 1.0))
    ((start, end),) = braked.log.source.braked
    assert start == 0.0 and end == pytest.approx(PAUSE, abs=0.05)
    assert braked.kept.time[0] > PAUSE and held.kept.time[0] < PAUSE
    assert not held.log.source.braked and not preprocess(log_of(trial), how).log.source.braked


def test_the_monitor_does_not_watch_closed_brakes(trial: Trial, tmp_path: Path) -> None:
    estimate = trial.estimate(tmp_path)
    observer = MomentumObserver(estimate, gain=20.0)
    (braked,), (held,) = (
        signals_of(estimate, log_of(paused(trial, share))).stretches(observer) for share in (0.0, 1.0)
    )
    assert braked.time[0] == pytest.approx(PAUSE, abs=0.1) and held.time[0] < 0.1


@pytest.mark.parametrize(("held", "falls", "is_told"), [(0.0, True, True), (1.0, True, False), (0.0, False, False)])
def test_closed_brakes_are_told_where_the_arm_weighs(
    trial: Trial, held: float, falls: bool, is_told: bool, tmp_path: Path
) -> None:
    robot = trial.case.robot if falls else trial.case.robot.with_gravity(np.zeros(3))
    own = paused(replace(trial, case=replace(trial.case, robot=robot)), held)
    found = ClosedBrakes().findings(subject_of(own, tmp_path))
    assert bool(found) is is_told
    if is_told:
        assert "with closed brakes (0 to 2.9" in found[0].evidence
        assert found[0].numbers["share"] == pytest.approx(PAUSE / own.columns["t"][-1], rel=0.03)


def test_spells_of_clocks_that_count_from_1970_are_told_apart() -> None:
    assert spells_in_words([(1.7, 3.05)], 5) == "1.7 to 3.05 s"
    assert spells_in_words([(1764550032.66, 1764550033.66)], 5) == "1764550032.7 to 1764550033.7 s"
