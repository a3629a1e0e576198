"""The problem against the dense observation matrix; filters on both sides; the logs that are refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from arm_models import model_of, theta_of
from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, preprocess
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.errors import LogMismatch, PoorExcitation
from dynident.identification.build_problem import build_problem
from dynident.identification.problem import regressor_stream as observing
from dynident.identification.problem import thinned_rows
from dynident.identification.problem.problem import Problem, check_rank, counting_rows, make_problem, rest_speeds
from dynident.identification.problem.regressor_stream import RegressorStream, motion_of, target_torque
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Motion
from dynident.model.joint import Drive, JointLimits
from dynident.model.reduction import Reduced, least_squares
from dynident.model.robot import Robot

ARMS = ("pendulum", "planar_2r", "spatial_3r", "sliding_arm", "scara", "mimic_arm", "coupled_arm")
GIVEN = Preprocessing(AsGiven(), rest="keep")
FILTERED = Preprocessing(Butterworth(cutoff_hz=4.0), rate_hz=25.0, trim_s=0.5, rest="keep")

MakeLog = Callable[..., Log]


def dense(model: DynamicModel, problem: Problem) -> tuple[Array, Array]:
    """Return W, shape (N, n, b), and tau straight from the regressor, with both sides filtered sample by sample."""
    blocks, targets = [], []
    for prepared in problem.logs:
        motion = motion_of(prepared.log)
        full = model.regressor(motion)[:, :, problem.base.independent]
        smooth = prepared.smooth(full.reshape(len(full), -1).T).T.reshape(full.shape)
        known = prepared.smooth(model.known_torque(motion).T).T
        blocks.append(smooth[prepared.keep])
        targets.append((np.asarray(prepared.log.torque) - known)[prepared.keep])
    return np.concatenate(blocks), np.concatenate(targets)


@pytest.mark.parametrize("how", [GIVEN, FILTERED], ids=["as given", "filtered"])
@pytest.mark.parametrize("arm", ARMS)
def test_triangles_and_rows_are_the_dense_matrix(
    arm: str, how: Preprocessing, request: pytest.FixtureRequest, exact_log: MakeLog
) -> None:
    model = model_of(request.getfixturevalue(arm), "coulomb", "viscous", "offset", "rotor_inertia")
    log = exact_log(model, theta_of(model), noise=0.1)
    problem = build_problem(model, [log], how)
    matrix, torque = dense(model, problem)
    beta = np.random.default_rng(1).normal(size=problem.base.count)
    error = torque - matrix @ beta
    np.testing.assert_allclose(problem.residual_squares(beta), np.sum(error**2, axis=0), rtol=1e-8)
    np.testing.assert_array_equal(problem.counts, len(error))
    rows = problem.rows
    for joint in range(model.robot.dof):
        own = rows.joint == joint
        np.testing.assert_array_equal(rows.samples[own], np.arange(len(error)))
        np.testing.assert_allclose(rows.matrix[own], matrix[:, joint], atol=1e-8 * np.abs(matrix).max())
        np.testing.assert_allclose(rows.torque[own], torque[:, joint], atol=1e-8)
    weights = np.linspace(1, 2, model.robot.dof)
    reduced = problem.reduced(weights)
    assert reduced.residual_square(beta) == pytest.approx(float(np.sum((weights * error) ** 2)))
    assert problem.reduced().residual_square(beta) == pytest.approx(float(np.sum(error**2)))


def test_prediction_is_the_torque_of_the_model(coupled_arm: Robot, exact_log: MakeLog) -> None:
    model = model_of(coupled_arm, "coulomb", "viscous")
    theta = theta_of(model)
    log = exact_log(model, theta, samples=2500)  # more than one chunk
    base = base_parameters(model)
    predicted = RegressorStream(model, base).predict(log, base.from_standard(theta))
    np.testing.assert_allclose(predicted, np.asarray(log.torque), atol=1e-9)


def test_several_logs_add_up(planar_2r: Robot, exact_log: MakeLog) -> None:
    model = model_of(planar_2r, "viscous")
    theta = theta_of(model)
    logs = [exact_log(model, theta, noise=0.1, seed=k, samples=n, size=s) for k, n, s in ((0, 300, 1.0), (1, 200, 0.6))]
    both, first, second = (build_problem(model, part, GIVEN) for part in (logs, logs[:1], logs[1:]))
    beta = np.arange(both.base.count, dtype=float)
    expected = first.residual_squares(beta) + second.residual_squares(beta)
    np.testing.assert_allclose(both.residual_squares(beta), expected)
    np.testing.assert_array_equal(both.counts, [500, 500])
    assert both.samples == 500
    np.testing.assert_array_equal(both.rows.samples[both.rows.joint == 0], np.arange(500))


def test_filtering_in_segments_is_filtering_at_once(
    spatial_3r: Robot, exact_log: MakeLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = model_of(spatial_3r, "coulomb", "viscous", "offset")
    log = exact_log(model, theta_of(model), noise=0.1, samples=3000)
    how = Preprocessing(Butterworth(cutoff_hz=8.0), trim_s=0.5, rest="keep")
    whole = build_problem(model, [log], how)
    monkeypatch.setattr(thinned_rows, "SEGMENT", 257)
    parts = build_problem(model, [log], how)
    size = np.abs(whole.rows.matrix).max()
    np.testing.assert_allclose(parts.rows.matrix, whole.rows.matrix, atol=1e-8 * size)
    np.testing.assert_array_equal(parts.rows.torque, whole.rows.torque)
    np.testing.assert_array_equal(parts.counts, whole.counts)


@pytest.mark.parametrize("filter", [AsGiven(), Butterworth(cutoff_hz=8.0)], ids=["plain", "filtered"])
def test_the_number_of_threads_changes_no_bit(
    planar_2r: Robot, exact_log: MakeLog, monkeypatch: pytest.MonkeyPatch, filter: Any
) -> None:
    model = DynamicModel(planar_2r, (FRICTION.make("viscous"),))
    assert planar_2r.nominal is not None
    log = exact_log(model, np.append(planar_2r.nominal, [0.5, 0.3]), noise=0.1, samples=5000)
    prepared = preprocess(log, Preprocessing(filter))
    monkeypatch.setattr(observing, "PART", 1500)
    monkeypatch.setattr(thinned_rows, "SEGMENT", 1000)
    regressor, found = RegressorStream(model, base_parameters(model)), []
    mask = np.ones((len(prepared.keep), 2), bool)
    for threads in (1, 3):
        monkeypatch.setattr(observing, "threads_that_pay", lambda most, threads=threads: threads)
        found.append(regressor.triangles(prepared, mask))
    rows = regressor.rows(prepared)
    for one, other, whole in zip(*found, rows, strict=True):
        np.testing.assert_array_equal(one.factor, other.factor)
        np.testing.assert_allclose(one.factor.T @ one.factor, whole @ whole.T, rtol=1e-11, atol=1e-9)


def test_the_known_rotor_torque_is_filtered_like_the_measured_one(pendulum: Robot) -> None:
    """Above the cut-off the two sides would otherwise differ by all that the filter takes away."""
    robot = pendulum.with_drives({"joint1": Drive(100.0, 2e-5)})
    model = model_of(robot, "viscous")
    theta = theta_of(model)
    time = np.arange(4000) / 500
    pulsation, height = 2 * np.pi * np.array([0.5, 3.1, 4.7]), np.array([0.5, 0.1, 0.05])
    phase = np.outer(time, pulsation)
    motion = Motion(
        np.sin(phase) @ height[:, None],
        np.cos(phase) @ (pulsation * height)[:, None],
        -np.sin(phase) @ (pulsation**2 * height)[:, None],
    )
    log = Log(robot.joint_names, time, motion.q, torque=model.torque(motion, theta))
    how = Preprocessing(Butterworth(cutoff_hz=4.0, positions_hz=80.0), trim_s=1.0)
    problem = build_problem(model, [log], how)
    error = problem.joint_deviations(problem.base.from_standard(theta))
    assert error[0] < 2e-3 * np.std(problem.rows.torque)
    prepared = problem.logs[0]
    known = 0.2 * np.asarray(prepared.log.ddq)
    expected = np.asarray(prepared.log.torque) - prepared.smooth(known.T).T
    np.testing.assert_allclose(target_torque(model, prepared), expected, atol=1e-12)


def test_joint_deviations_share_the_degrees_of_freedom(planar_2r: Robot, exact_log: MakeLog) -> None:
    model = model_of(planar_2r, "viscous")
    theta = theta_of(model)
    problem = build_problem(model, [exact_log(model, theta, noise=np.array([0.5, 0.1]), samples=2000)], GIVEN)
    beta = problem.base.from_standard(theta)
    free = 2000 * (1 - problem.base.count / 4000)
    np.testing.assert_allclose(problem.joint_deviations(beta), np.sqrt(problem.residual_squares(beta) / free))
    np.testing.assert_allclose(problem.joint_deviations(beta), [0.5, 0.1], rtol=0.1)


def test_deviations_of_exact_data_are_small_and_never_zero(planar_2r: Robot, exact_log: MakeLog) -> None:
    model = model_of(planar_2r, "viscous")
    theta = theta_of(model)
    problem = build_problem(model, [exact_log(model, theta)], GIVEN)
    found = problem.joint_deviations(problem.base.from_standard(theta))
    size = np.array([np.sqrt(t.torque_square / t.rows) for t in problem.triangles])
    np.testing.assert_allclose(found, 1e-6 * size)


def resting_log(model: DynamicModel, exact_log: MakeLog, joint: int) -> Log:
    """Return a log of which one joint stands still in the middle third."""
    log = exact_log(model, theta_of(model), noise=0.01, samples=600)
    q, dq, ddq = (np.array(signal) for signal in (log.q, log.dq, log.ddq))
    q[200:400, joint], dq[200:400, joint], ddq[200:400, joint] = q[200, joint], 0.0, 0.0
    return replace(log, q=q, dq=dq, ddq=ddq)


def test_rows_at_rest_are_left_out_of_the_joint_that_rests(planar_2r: Robot, exact_log: MakeLog) -> None:
    model = model_of(planar_2r, "viscous")
    log = resting_log(model, exact_log, 1)
    how = Preprocessing(AsGiven(), standstill=0.01)
    mask = counting_rows(model, preprocess(log, how))
    assert mask[:, 0].all() and not mask[200:400, 1].any() and mask[:200, 1].all() and mask[400:, 1].all()
    problem = build_problem(model, [log], how)
    np.testing.assert_array_equal(problem.counts, [600, 400])
    assert len(problem.rows.torque) == 1000
    beta = np.ones(problem.base.count)
    rows = problem.rows
    error = rows.torque - rows.matrix @ beta
    squares = [np.sum(error[rows.joint == j] ** 2) for j in (0, 1)]
    np.testing.assert_allclose(problem.residual_squares(beta), squares)
    kept = build_problem(model, [log], replace(how, rest="keep"))
    np.testing.assert_array_equal(kept.counts, [600, 600])


@pytest.mark.parametrize(
    ("lower", "upper", "speed"),
    [(0.0, 0.35, 0.007), (0.002, 0.042, 0.0008), (-1.0, 4.0, 0.02), (0.0, np.inf, 0.005), (0.1, 0.1, 0.005)],
)
def test_a_slide_rests_below_a_share_of_its_travel(scara: Robot, lower: float, upper: float, speed: float) -> None:
    limits = {"joint3": JointLimits(lower=lower, upper=upper)}
    joints = tuple(replace(j, limits=limits.get(j.name, j.limits)) for j in scara.joints)
    robot = replace(scara, joints=joints)
    slides = [joint.kind == "prismatic" for joint in robot.active]
    assert sum(slides) == 1
    assert rest_speeds(robot, 0.02) == pytest.approx(np.where(slides, speed, 0.02))


def test_a_resting_motor_rests_all_joints_that_it_moves(coupled_arm: Robot, exact_log: MakeLog) -> None:
    """Motor 3 turns with 0.7 dq2 + dq3: where it stands, joints 2 and 3 have unknown static friction, joint 1 not."""
    model = model_of(coupled_arm, "viscous")
    log = resting_log(model, exact_log, 2)
    dq, q = np.array(log.dq), np.array(log.q)
    dq[200:400, 2] = -0.7 * dq[200:400, 1]
    mask = counting_rows(model, preprocess(replace(log, dq=dq, q=q), Preprocessing(AsGiven(), standstill=0.01)))
    np.testing.assert_array_equal(mask.all(axis=0), [True, False, False])
    assert not mask[200:400, 1:].any()


@pytest.fixture
def posed(planar_2r: Robot, exact_log: MakeLog) -> Callable[..., Any]:
    """Pose the problem of the planar arm with some signals of its log changed."""
    model = model_of(planar_2r, "coulomb", "viscous")
    log = exact_log(model, theta_of(model), noise=0.1)

    def make(**changes: object) -> Problem:
        return build_problem(model, [replace(log, **changes)], GIVEN)  # type: ignore[arg-type]

    make.log = log  # type: ignore[attr-defined]
    return make


def test_a_joint_that_never_moves_is_named(posed: Any) -> None:
    still = np.array(posed.log.q)
    still[:, 1] = 0.3
    with pytest.raises(LogMismatch) as caught:
        posed(q=still, dq=0 * posed.log.dq, ddq=0 * posed.log.ddq)
    assert str(caught.value) == (
        "simulated log: joint2 never moved (range 0 rad or m); "
        "lock it in the case file (locked: {joint2: 0}) or record a motion of all joints"
    )


def test_a_torque_that_never_changes_is_named(posed: Any) -> None:
    dead = np.array(posed.log.torque)
    dead[:, 1] = 4.2
    with pytest.raises(LogMismatch) as caught:
        posed(torque=dead)
    assert str(caught.value) == (
        "simulated log: joint2 moves but its torque is 4.2 N m throughout; "
        "map the right column, or leave the joint out (locked:)"
    )


def test_missing_signals_are_named(posed: Any, planar_2r: Robot) -> None:
    with pytest.raises(LogMismatch, match="no torques; map torque columns, or currents with drive gains"):
        posed(torque=None)
    with pytest.raises(LogMismatch, match="no dq and no ddq; name their columns"):
        posed(dq=None, ddq=None)
    with pytest.raises(LogMismatch, match="no velocities and accelerations; preprocess the log first"):
        motion_of(Log(("joint1",), np.arange(3.0), np.zeros((3, 1))))


@pytest.mark.parametrize("signal", ["q", "dq", "ddq", "torque"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_no_numbers_are_named(posed: Any, signal: str, value: float) -> None:
    values = np.array(getattr(posed.log, signal))
    values[41, 1] = value
    with pytest.raises(LogMismatch) as caught:
        posed(**{signal: values})
    assert str(caught.value) == (
        f"simulated log: {signal} of joint2 is {value:g} at sample 42; repair the recording or leave these samples out"
    )


def test_a_poor_motion_names_what_it_leaves_open(planar_2r: Robot, exact_log: MakeLog) -> None:
    """Both joints in step at one frequency and tiny size, without friction: few of the six are determined."""
    model = model_of(planar_2r, "viscous", "offset")
    time = np.arange(200) / 50
    swing = np.column_stack([0.1 * time, 0.2 * time])  # constant speeds: viscous friction looks like an offset
    log = Log(
        model.robot.joint_names, time, swing, np.full((200, 2), [0.1, 0.2]), np.zeros((200, 2)),
        model.torque(Motion(swing, np.full((200, 2), [0.1, 0.2]), np.zeros((200, 2))), theta_of(model)),
    )  # fmt: skip
    with pytest.raises(PoorExcitation) as caught:
        build_problem(model, [log], GIVEN)
    message = str(caught.value)
    assert message.startswith(f"the log determines {caught.value.determined} of 10 base parameters (undetermined: ")
    assert caught.value.determined < 10 and caught.value.wanted == 10
    assert message.endswith("; record a motion that moves all joints fast and far at once, or drop friction terms")


@pytest.mark.parametrize(("left", "is_enough"), [(1e-10, False), (1e-8, True)])
def test_columns_as_alike_as_rounding_are_named(planar_2r: Robot, left: float, is_enough: bool) -> None:
    base = base_parameters(model_of(planar_2r, "viscous"))
    upper = np.eye(base.count)
    upper[:2, 1] = 1.0, left
    reduced = Reduced(upper, np.ones(base.count), 1.0, 100)
    assert least_squares(reduced).condition_number > 1e7
    if is_enough:
        check_rank(reduced, base)
        return
    with pytest.raises(PoorExcitation) as caught:
        check_rank(reduced, base)
    assert all(name in str(caught.value) for name in base.names[:2])


def test_reduction_needs_no_rows_of_its_own(planar_2r: Robot, exact_log: MakeLog) -> None:
    """The rows are computed only when an estimator asks for them."""
    model = model_of(planar_2r, "viscous")
    base = base_parameters(model)
    problem = make_problem(model, base, [preprocess(exact_log(model, theta_of(model)), GIVEN)])
    problem.reduced()
    assert "rows" not in vars(problem)
    assert problem.rows is problem.rows
