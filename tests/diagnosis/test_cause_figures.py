"""Figures of the causes that a search has found, and their intervals."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from benchmarks.faults import injections as put
from benchmarks.faults.figures import stated
from benchmarks.faults.trials import Trial, subject_of, virtual

from dynident.api.log_checks import check_logs
from dynident.arrays import Array
from dynident.case.case import Case, read_case
from dynident.data.formats import ColumnMap
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.diagnosis.causes.cause_columns import CauseRows
from dynident.diagnosis.causes.cause_figures import figured
from dynident.diagnosis.causes.cause_search import Blame, Cause, CauseSearch
from dynident.diagnosis.causes.model_error import ModelError
from dynident.diagnosis.causes.trend_findings import believed, trend_finding
from dynident.diagnosis.checks.residual_trends import ResidualTrends
from dynident.diagnosis.checks.torque_delay import TorqueDelay
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.presliding import Presliding
from dynident.model.friction.viscous import Viscous
from dynident.model.robot import Robot


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
        ("two clocks", lambda trial: put.two_clocks(trial, 1.01), 1.01, 1e-4),
        ("tilt", tilted, [0.0, 0.0, -9.81], 3e-3),
    ],
)
def test_figures_hold_far_from_where_their_columns_are_straight_lines(
    name: str, fault: Callable[[Trial], Trial], wanted: float | list[float], near: float, tmp_path: Path
) -> None:
    value, half = figure(fault(virtual(read_case("generic-6r"))), name, tmp_path)
    assert np.linalg.norm(value - np.atleast_1d(wanted)) < near and half < 15 * near


@pytest.mark.parametrize("ratio", [1.002, 0.998])
def test_the_line_of_the_case_puts_torques_of_another_clock_right(ratio: float, tmp_path: Path) -> None:
    """Neither the right log nor one whose friction falls as it warms up has two clocks."""
    right = virtual(read_case("generic-6r"))
    wrong = put.two_clocks(right, ratio)
    (found,) = [one for one in wrong.examined(tmp_path).findings if one.name == "two clocks"]
    line = re.search(r"log: torque_clock: (\S+), with preprocessing: delay_s: auto", found.remedy)
    assert line and found.severity == "warning" and abs(float(line[1]) - ratio) < 1e-4
    columns = replace(wrong.case.columns, torque_clock=float(line[1]))
    stated = replace(wrong, case=replace(wrong.case, columns=columns))
    for trial in (stated, right, put.warming(right, 0.05, np.random.default_rng(0))):
        assert not [one for one in trial.examined(tmp_path).findings if one.name == "two clocks"]


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
    assert wide.trends.delay[1] > 2 * narrow.trends.delay[1]
    (found,) = TorqueDelay().findings(wide)
    assert abs(found.numbers["delay_s"] - 3.0 * put.step_of(late)) < 1.96 * found.numbers["std_s"]


def test_presliding_is_no_delay(planar_2r: Robot, exact_motion: Callable[..., Motion], tmp_path: Path) -> None:
    """Where it is told as one it is one: a torque that is late beside friction without a memory."""
    parts, time = (Coulomb(0.01), Viscous(), Presliding(0.01)), np.arange(4000) / 200.0
    model, told = DynamicModel(planar_2r, parts), []
    assert planar_2r.nominal is not None
    for level, late in ((3.0, 0.0), (0.0, 0.02)):
        motion, behind = (exact_motion(2, time - lag, 0.5, seed=5) for lag in (0.0, late))
        values = [1.0, 1.0, level, 0.6, 0.5, level]
        torque = model.torque(model.with_states(behind, 1.0 / 200.0), np.append(planar_2r.nominal, values))
        torque += 0.01 * np.std(torque, axis=0) * np.random.default_rng(5).normal(size=torque.shape)
        log = Log(planar_2r.joint_names, time, motion.q, torque=torque)
        how = Preprocessing(Butterworth(cutoff_hz=5.0), delay_s=None)
        (found,) = check_logs(Case(planar_2r, parts[:2], ColumnMap(), how), [log])
        told.append([one["numbers"]["delay_s"] for one in found["findings"] if one["name"] == "torque delay"])
    assert told[0] == [] and told[1] == [pytest.approx(0.02, abs=1e-3)]


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
    told, _ = figured(search, blames, ModelError(4, [np.eye(count // 4)]), lambda causes, beta, values: [*causes])
    assert {blame.cause.name for blame in told} == {"spring", "counterbalance"}
    assert all(blame.size > 1.0 for blame in blames) and all(blame.size < 0.5 for blame in told)
    values = {blame.cause.name: blame.values[0] for blame in told}
    assert values["spring"] == pytest.approx(20.0, rel=0.05) and values["counterbalance"] == pytest.approx(
        -20.0, rel=0.05
    )


def test_a_rival_has_its_figure_about_the_bodies_beside_it() -> None:
    """Its columns are made again with the bodies of the fit in which it stands in the place of the likelier cause."""
    generator, count = np.random.default_rng(1), 400
    motion = generator.normal(size=count)
    near = motion + 1e-3 * generator.normal(size=count)
    target = motion + 0.05 * generator.normal(size=count)
    causes = [
        Cause(name, "", own[None, :, None], is_filtered=True) for name, own in (("tilt", motion), ("time scale", near))
    ]
    ones, masks = np.ones((count, 1)), np.ones((count, 1), bool)
    rows = CauseRows([ones], [np.arange(1)], 1, target[:, None], target[:, None], masks)
    search = CauseSearch(rows, causes)
    (blame,) = blames = search.blames()
    assert len(blame.rivals) == 1

    def doubled(causes: Sequence[Cause], beta: Array, values: Sequence[Array]) -> list[Cause]:
        rival = blame.rivals[0].cause
        return [replace(one, columns=2.0 * rival.columns) if one.name == rival.name else one for one in causes]

    for again, wanted in ((lambda causes, beta, values: [*causes], 1.0), (doubled, 0.5)):
        ((told,), _) = figured(search, blames, ModelError(4, [np.eye(count // 4)]), again)
        assert told.values[0] == pytest.approx(1.0, abs=0.02)
        assert told.rivals[0].values[0] == pytest.approx(wanted, abs=0.02)


def test_the_circle_of_a_wave_holds_both_of_its_coefficients() -> None:
    """Of two normal deviates 95 % lie within 2.448 of their means, of one within 1.960."""
    covariance = np.diag([0.01, 0.0025])
    cause = Cause("counterbalance", "elbow", np.ones((2, 4, 1)))
    sizes = np.ones(1)
    for freedom, radius in ((np.inf, 2.448), (10.0, np.sqrt(2 * 4.103))):  # tables of Fisher's distribution
        blame = Blame(cause, np.array([3.0, 4.0]), covariance, 9.0, 1.0, 0.9, 0.2, sizes, sizes, (), freedom)
        robot = SimpleNamespace(joint_names=("elbow",), coupling=np.eye(1))
        fit: Any = SimpleNamespace(model=SimpleNamespace(friction=(), robot=robot))  # no robot is needed for a wave
        told = trend_finding(blame, fit)
        numbers, wide = told.numbers, trend_finding(replace(blame, covariance=200.0 * covariance), fit)
        assert "add balancer" in told.remedy and wide.remedy.startswith("the log does not tell its size")
        assert believed(blame) is not None and believed(replace(blame, size=700.0)) is None
        assert numbers["value"] == pytest.approx(5.0) and numbers["half_width"] == pytest.approx(0.1 * radius, rel=1e-3)
