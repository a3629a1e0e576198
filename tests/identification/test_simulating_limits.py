"""Where estimators that simulate stop: options, robots that cannot be simulated, filters that lose their track."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.errors import BadOption, NotConsistent, SolverFailed
from dynident.identification.build_problem import build_problem
from dynident.identification.problem.problem import Problem
from dynident.identification.simulated import closed_loop as module
from dynident.identification.simulated import output_error
from dynident.identification.simulated.closed_loop import ClosedLoop, closed_loop
from dynident.identification.simulated.course import LoopOptions
from dynident.identification.simulated.estimators.clie import CLIE
from dynident.identification.simulated.estimators.didim import DIDIM
from dynident.identification.simulated.estimators.kalman import Kalman
from dynident.identification.simulated.iteration import Round, fixed_point
from dynident.identification.simulated.sensitivities import sensitivities
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.viscous import Viscous
from dynident.model.reduction import Reduced, least_squares
from dynident.model.robot import Robot


@pytest.mark.parametrize(
    ("part", "options", "words"),
    [
        (DIDIM, {"iterations": 0}, "iterations = 0 is not possible; give 1 or more"),
        (
            CLIE,
            {"tolerance": -1.0},
            "tolerance = -1.0 is not possible; give a share of a standard deviation, 0 or more",
        ),
        (Kalman, {"torque_noise": 0.0}, "torque_noise = 0.0 is not possible; give a standard deviation above 0"),
        (Kalman, {"position_noise": np.inf}, "position_noise = inf"),
        (Kalman, {"spread": -1.0}, "spread = -1.0"),
        (Kalman, {"slopes_hz": 0.0}, "slopes_hz = 0.0 is not possible; give a frequency in Hz above 0"),
        (Kalman, {"drift": -0.1}, "drift = -0.1 is not possible; give a standard deviation, 0 or more"),
        (Kalman, {"passes": 0}, "passes = 0 is not possible; give 1 or more"),
    ],
)
def test_options_that_cannot_be(part: Callable[..., object], options: dict[str, Any], words: str) -> None:
    with pytest.raises(BadOption, match=words):
        part(**options)


def swung(robot: Robot, friction: Array, rows: int = 400, rate: float = 200.0) -> tuple[DynamicModel, Problem, Array]:
    """Return model, problem and truth of a pendulum whose viscous friction (rows,) may change, with little noise."""
    model = DynamicModel(robot, (Viscous(),))
    theta = np.append(robot.nominal, 1.0)  # type: ignore[arg-type]
    phase = np.outer(np.arange(rows) / rate, [5.0, 11.0])
    q = np.sum(np.sin(phase) * [0.8, 0.2], axis=1, keepdims=True)
    dq = np.sum(np.cos(phase) * [4.0, 2.2], axis=1, keepdims=True)
    ddq = -np.sum(np.sin(phase) * [20.0, 24.2], axis=1, keepdims=True)
    generator = np.random.default_rng(0)
    torque = model.torque(Motion(q, dq, ddq), theta) + (friction[:, None] - 1.0) * dq
    torque = torque + 0.01 * generator.normal(size=q.shape)
    measured = q + 1e-6 * generator.normal(size=q.shape)
    log = Log(robot.joint_names, np.arange(rows) / rate, measured, dq, ddq, torque)
    problem = build_problem(model, [log], Preprocessing(AsGiven(), rest="keep"))
    return model, problem, problem.base.from_standard(theta)


def test_a_drift_lets_parameters_follow_a_change(pendulum: Robot) -> None:
    """Viscous friction falls from 1.0 to 0.4 half way; with a drift the last value is the later one."""
    _, problem, truth = swung(pendulum, np.where(np.arange(400) < 200, 1.0, 0.4))
    at = list(problem.base.names).index("Fv[joint1]")
    still = Kalman(torque_noise=0.02).solve(problem)
    moving = Kalman(torque_noise=0.02, drift=0.3).solve(problem)
    assert abs(moving.beta[at] - 0.4) < 0.1 < abs(still.beta[at] - 0.4)
    assert moving.degrees is None and moving.covariance is not None and still.degrees is not None
    assert abs(moving.beta[at] - 0.4) < 5 * np.sqrt(moving.covariance[at, at])
    course = np.array(moving.run.course)[:, at]
    times = np.array(moving.run.times)
    assert np.all(np.abs(course[(times > 0.6) & (times < 0.95)] - truth[at]) < 0.3)


def test_a_filter_that_loses_its_track_says_what_to_state(pendulum: Robot) -> None:
    _, problem, _ = swung(pendulum, np.ones(60), rows=60)
    with pytest.raises(
        SolverFailed, match=r"row \d+: the covariance is lost to rounding; state a greater position_noise"
    ):
        Kalman(spread=1e8).solve(problem)


@pytest.fixture
def loop(pendulum: Robot) -> tuple[ClosedLoop, Array]:
    _, problem, truth = swung(pendulum, np.ones(100), rows=100)
    options = CLIE(kp=(200.0,), kd=(10.0,), reference="measured")
    return closed_loop(problem, options, truth), truth


@pytest.mark.parametrize("held", [True, False])
def test_few_implicit_steps_find_what_explicit_ones_find(
    pendulum: Robot, held: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Motion, torque and their derivatives of a pendulum, its torque held between ticks or not."""
    _, problem, truth = swung(pendulum, np.ones(30), rows=30)
    known = {"kp": (200.0,), "kd": (10.0,), "control_hz": 200.0} if held else {"feedforward": "measured"}
    options = LoopOptions(reference="measured", **known)
    loop = closed_loop(problem, options, truth)
    ways = []
    for cost in (0.0, np.inf):
        monkeypatch.setattr(module, "IMPLICIT_COST", cost)
        assert all(one.implicit is (cost == 0.0) for one in loop.follow(loop.courses[0], 0.9 * truth))
        by = [sensitivities(loop, loop.courses[0], 0.9 * truth, of)[1] for of in ("q", "torque")]
        ways.append((loop.simulate(0.9 * truth)[0], *by))
    for few, many in zip(*ways, strict=True):
        np.testing.assert_allclose(few, many, atol=2e-4 * np.abs(many).max())


def test_a_robot_that_cannot_be_simulated_ends_no_iteration(loop: tuple[ClosedLoop, Array]) -> None:
    """Rounds that always end at a negative mass matrix are mixed with the start and never count as settled."""
    own, truth = loop
    with pytest.raises(NotConsistent):
        own.check(-truth)

    def step(simulated: tuple[Array, ...], beta: Array) -> Round:
        return Round(-truth, np.ones(1), 1.0, np.eye(len(truth)))

    words = "not positive definite along the motion; filter the log, check kp, kd and q_ref, or use --estimator"
    with pytest.raises(SolverFailed, match=words):
        fixed_point(own, truth, step, 3, 1e-3, "didim")


def test_a_step_to_no_robot_goes_to_the_best_possible_one(loop: tuple[ClosedLoop, Array]) -> None:
    own, truth = loop
    size = len(truth)
    reduced = Reduced(np.eye(size), -2.0 * truth, 0.0, 100)  # the free step ends at -truth
    step, free = output_error.consistent_step(own, truth, reduced, least_squares(reduced))
    own.check(truth + step)
    assert not free and np.linalg.norm(step + 2.0 * truth) > 0.1 * np.linalg.norm(truth)
    reduced = replace(reduced, z=0.1 * truth)
    step, free = output_error.consistent_step(own, truth, reduced, least_squares(reduced))
    np.testing.assert_allclose(step, 0.1 * truth)
    assert free


def test_steps_that_lower_nothing_are_refused(loop: tuple[ClosedLoop, Array], monkeypatch: pytest.MonkeyPatch) -> None:
    own, truth = loop
    monkeypatch.setattr(output_error.OutputErrorTask, "at", lambda task, beta: own.check(-truth))
    with pytest.raises(SolverFailed, match=r"no part of a step lowers the error .*; start nearer: filter the log"):
        output_error.output_error(own, 1.1 * truth, "torque", 5, 1e-3, "clie")
