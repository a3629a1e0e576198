"""Figures of the causes that a search has found, and their intervals."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults import injections as put
from benchmarks.faults.figures import stated
from benchmarks.faults.trials import Trial, subject_of, virtual

from dynident.case.case import read_case
from dynident.diagnosis.causes.cause_columns import CauseRows
from dynident.diagnosis.causes.cause_figures import figured
from dynident.diagnosis.causes.cause_search import Cause, CauseSearch
from dynident.diagnosis.causes.model_error import ModelError
from dynident.diagnosis.checks.residual_trends import ResidualTrends
from dynident.diagnosis.checks.torque_delay import TorqueDelay


def figure(trial: Trial, name: str, folder: Path) -> tuple[np.ndarray, float]:
    """Return the figure of the cause of a name, and half of its interval."""
    (found,) = [one for one in ResidualTrends().findings(subject_of(trial, folder)) if one.name == name]
    told = stated(found, trial)
    assert told is not None
    return np.atleast_1d(told.value), told.half


def tilted(trial: Trial) -> Trial:
    return put.tilted(trial, 1.8, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("name", "fault", "wanted", "near"),
    [
        ("time scale", lambda trial: put.timed(trial, 1.1), 1.1, 2.5e-3),
        ("tilt", tilted, [0.0, 0.0, -9.81], 3e-3),
    ],
)
def test_figures_hold_far_from_where_their_columns_are_straight_lines(
    name: str, fault: Callable[[Trial], Trial], wanted: float | list[float], near: float, tmp_path: Path
) -> None:
    value, half = figure(fault(virtual(read_case("generic-6r"))), name, tmp_path)
    assert np.linalg.norm(value - np.atleast_1d(wanted)) < near and half < 15 * near


def bent(trial: Trial) -> Trial:
    q, tau = trial.columns["q"], trial.columns["tau"]
    return trial.with_columns(tau=tau + 0.03 * tau.std(axis=0) * np.sin(3 * q))


def test_a_bend_that_no_model_has_widens_the_interval_of_a_lean(tmp_path: Path) -> None:
    right = virtual(read_case("generic-6r"))
    (_, narrow), (_, wide) = (figure(tilted(trial), "tilt", tmp_path) for trial in (right, bent(right)))
    assert wide > 2 * narrow


def test_a_bend_that_no_model_has_widens_the_interval_of_a_delay(tmp_path: Path) -> None:
    late = put.delayed(virtual(read_case("generic-6r")), 3.0)
    narrow, wide = (subject_of(trial, tmp_path) for trial in (late, bent(late)))
    assert narrow.trends is not None and wide.trends is not None
    assert wide.trends.delay_std > 2 * narrow.trends.delay_std
    (found,) = TorqueDelay().findings(wide)
    assert abs(found.numbers["delay_s"] - 3.0 * put.step_of(late)) < 1.96 * found.numbers["std_s"]


def test_a_spring_and_a_counterbalance_that_cancel_have_the_size_of_their_sum() -> None:
    """20 (q - sin q) has a hundredth of the torque, each of the two alone more than all of it."""
    generator, count = np.random.default_rng(0), 800
    q = generator.uniform(-1.0, 1.0, count)
    target = 20.0 * (q - np.sin(q)) + 0.01 * generator.normal(size=count)
    columns = {"spring": q[None, :, None], "counterbalance": np.stack([np.sin(q), np.cos(q)])[:, :, None]}
    causes = [Cause(name, "elbow", own, is_filtered=True) for name, own in columns.items()]
    measured, masks = target + 5.0 * np.cos(9.0 * q), np.ones((count, 1), bool)
    rows = CauseRows([np.ones((count, 1))], [np.arange(1)], 1, target[:, None], measured[:, None], masks)
    search = CauseSearch(rows, causes)
    blames = search.blames()
    told = figured(search, blames, ModelError(4, [np.eye(count // 4)]), lambda cause, beta: cause)
    assert {blame.cause.name for blame in told} == {"spring", "counterbalance"}
    assert all(blame.size > 1.0 for blame in blames) and all(blame.size < 0.5 for blame in told)
    values = {blame.cause.name: blame.values[0] for blame in told}
    assert values["spring"] == pytest.approx(20.0, rel=0.05) and values["counterbalance"] == pytest.approx(
        -20.0, rel=0.05
    )
