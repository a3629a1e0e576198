"""Noise in the regressor: least squares is biased, the test says so, and estimators that simulate are not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import central_differences
from dynident.errors import BadOption, SolverFailed
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators.ols import OLS
from dynident.identification.estimators.wls import WLS
from dynident.identification.fit import fit
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.residuals.instruments import instruments
from dynident.identification.simulated.closed_loop import closed_loop, simulated_logs
from dynident.identification.simulated.course import LoopOptions
from dynident.identification.simulated.estimators.clie import CLIE
from dynident.identification.simulated.estimators.cloe import CLOE
from dynident.identification.simulated.estimators.didim import DIDIM
from dynident.identification.simulated.estimators.iv import IV
from dynident.identification.simulated.estimators.kalman import Kalman
from dynident.identification.simulated.iteration import after_changes, started
from dynident.identification.simulated.joint_filter import position_noise
from dynident.identification.uncertainty.exogeneity import durbin_wu_hausman
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.degressive import Degressive
from dynident.model.friction.load import Load
from dynident.model.friction.temperature import Temperature
from dynident.model.friction.viscous import Viscous
from dynident.simulation.controllers.pd import Pd
from dynident.simulation.virtual_robot import Noise, Timing, simulate
from presliding import Presliding

KP, KD = (500.0, 100.0), (40.0, 8.0)
KNOWN = {"kp": KP, "kd": KD, "control_hz": 2000.0}
RUNS = 10


def unfiltered(log):
    """Return a log with velocities and accelerations by plain central differences."""
    dq = central_differences(log.q, log.rate)
    return replace(log, dq=dq, ddq=central_differences(dq, log.rate))


@pytest.fixture(scope="module")
def cell(planar_2r):
    """Return problems of one motion with encoder noise of different seeds, unfiltered, and their truth."""
    model = DynamicModel(planar_2r, (Coulomb(0.2), Viscous()))
    theta = np.append(planar_2r.nominal, np.tile([1.0, 0.5], 2))
    sine, cosine = 0.25 * np.random.default_rng(1).normal(size=(2, 2, 3))
    path = FourierSeries(np.zeros(2), sine, cosine, 3.0)
    controller = Pd(rate=2000.0, stiffness=KP, damping=KD, feedforward="none")
    noise = Noise(position=2e-4, torque=0.05)
    problems = []
    for seed in range(RUNS):
        run = simulate(
            model, theta, path, timing=Timing(rate=250.0, lead_in=1.0), controller=controller, noise=noise, seed=seed
        )
        problems.append(build_problem(model, [unfiltered(run.log)], Preprocessing(AsGiven(), rest="keep", trim_s=0.1)))
    return problems, problems[0].base.from_standard(theta)


def in_deviations(problems, truth, part):
    """Return bias over Monte Carlo deviation, largest over the parameters, and the stated over the true deviation."""
    found = [part.solve(problem) for problem in problems]
    errors = np.array([solution.beta - truth for solution in found])
    spread = errors.std(axis=0, ddof=1)
    bias = np.abs(errors.mean(axis=0)) / spread
    stated = [np.full(len(truth), np.nan) if s.covariance is None else np.sqrt(np.diag(s.covariance)) for s in found]
    return bias, np.mean(stated, axis=0) / spread


def test_encoder_noise_biases_least_squares_and_not_the_others(cell):
    problems, truth = cell
    plain, _ = in_deviations(problems, truth, OLS())
    assert plain.max() > 5
    # 3.5 standard errors of a mean of RUNS; noise within the smooth sign of friction is not the instruments' to remove
    for part, limit in ((IV(), 2.0), (IV(**KNOWN), 2.0), (DIDIM(**KNOWN), 3.5 / np.sqrt(RUNS))):
        bias, stated = in_deviations(problems, truth, part)
        assert bias.max() < limit < 0.5 * plain.max(), part
        assert np.median(bias) < 0.6, part
        assert 0.4 < np.median(stated) < 2.0, part


def test_output_errors_find_the_truth(cell):
    problems, truth = cell
    for part in (CLIE(**KNOWN), CLOE(**KNOWN)):
        solution = part.solve(problems[0])
        assert solution.covariance is not None
        assert np.all(np.abs(solution.beta - truth) < 5 * np.sqrt(np.diag(solution.covariance))), part
        assert solution.run.trace[-1] == pytest.approx(1.0, abs=0.05)
        assert solution.run.simulations >= 2 * solution.run.iterations


def test_the_bias_is_detected(cell):
    problems, _ = cell
    found = []
    for problem in problems[:4]:
        loop, start = started(problem, IV(), as_instruments=True)
        made = instruments(problem, simulated_logs(loop, loop.simulate(start)))
        found.append(durbin_wu_hausman(made))
    assert all(test.is_biased(0.01) for test in found)
    assert all(test.degrees == len(test.difference) for test in found)
    assert all(test.p_values.min() < 0.01 for test in found)


def test_no_bias_is_no_alarm(planar_2r, exact_log, exact_motion):
    """With noise of the torque alone the p-values are spread as chance spreads them."""
    model = DynamicModel(planar_2r, (Viscous(),))
    theta = np.append(planar_2r.nominal, [0.5, 0.5])
    values = []
    for seed in range(40):
        log = exact_log(model, theta, noise=0.2, seed=seed, samples=200)
        problem = build_problem(model, [log], Preprocessing(AsGiven(), rest="keep"))
        other = exact_motion(2, log.time, 0.9, seed=11)
        noise = np.random.default_rng(seed + 99).normal(size=other.q.shape) * 0.3
        logs = [replace(problem.logs[0], log=replace(log, q=other.q, dq=other.dq, ddq=other.ddq + noise))]
        values.append(durbin_wu_hausman(instruments(problem, logs)).p_value)
    assert 0.25 < np.mean(values) < 0.75
    assert np.mean(np.array(values) < 0.01) < 0.1
    with pytest.raises(SolverFailed, match="the instruments are the regressor itself"):
        durbin_wu_hausman(instruments(problem, problem.logs))


def test_instruments_solve_the_dense_equations(cell):
    problems, truth = cell
    problem = problems[0]
    loop = closed_loop(problem, IV(), truth, instruments=True)
    logs = simulated_logs(loop, loop.simulate(truth))
    made = instruments(problem, logs)
    weights = np.array([0.7, 3.0])
    regressor = RegressorStream(problem.model, problem.base)
    size = problem.base.count
    left, right = np.zeros((size, size)), np.zeros(size)
    rows = zip(regressor.columns, regressor.rows(logs[0]), regressor.rows(problem.logs[0]), weights, strict=True)
    for columns, ours, theirs, weight in rows:
        left[np.ix_(columns, columns)] += weight**2 * ours[:-1] @ theirs[:-1].T
        right[columns] += weight**2 * ours[:-1] @ theirs[-1]
    np.testing.assert_allclose(made.solve(weights), np.linalg.solve(left, right), rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(made.influence(weights) @ left, np.eye(size), atol=1e-7)


def test_an_iteration_that_does_not_settle_says_so(cell):
    problems, _ = cell
    with pytest.raises(SolverFailed, match=r"after 1 rounds a parameter still moves by .*give more iterations"):
        DIDIM(iterations=1, **KNOWN).solve(problems[0])
    with pytest.raises(SolverFailed, match=r"after 1 steps a parameter still moves by"):
        CLIE(iterations=1, **KNOWN).solve(problems[0])
    with pytest.raises(SolverFailed, match=r"the motion is lost at .* check kp and kd"):
        DIDIM(**{**KNOWN, "kd": (0.0, 0.0), "kp": (5.0, 1.0), "control_hz": 25.0}).solve(problems[0])


@pytest.mark.parametrize(
    ("changes", "advice"),
    [
        ([0.8], "give more iterations, or a tolerance above 0.01"),
        ([0.8, 0.4, 0.2], r"give more iterations \(about 8\), or"),
        ([0.2, 0.4, 0.8], r"its changes do not fall \(0.2, 0.4, 0.8\), .* check kp, kd and q_ref"),
        ([3.0, 0.21, 0.2, 0.21], "more iterations are of no use"),
    ],
)
def test_the_advice_follows_the_changes(changes, advice):
    assert re.search(advice, after_changes(changes, 0.01))


@pytest.mark.parametrize("part", [Degressive(), Load()], ids=["degressive", "load"])
def test_a_robot_that_is_not_integrated_may_have_any_friction(planar_2r, part):
    """A virtual controller holds the simulated robot on the measured motion: least squares, whatever the friction.

    The output error of positions integrates it, and finds the same.
    """
    model = DynamicModel(planar_2r, (Coulomb(0.1), part))
    theta = np.append(planar_2r.nominal, np.tile([1.0, 0.3], 2))
    time = np.arange(500) / 250.0
    sine, cosine = 0.25 * np.random.default_rng(1).normal(size=(2, 2, 3))
    motion = Motion(*FourierSeries(np.zeros(2), sine, cosine, 2.0).evaluate(time))
    torque = model.torque(motion, theta) + 0.05 * np.random.default_rng(2).normal(size=motion.q.shape)
    log = Log(planar_2r.joint_names, time, motion.q, motion.dq, motion.ddq, torque)
    problem = build_problem(model, [log], Preprocessing(AsGiven(), rest="keep"))
    expected = WLS().solve(problem).beta
    for method in (DIDIM(), CLIE()):
        np.testing.assert_allclose(method.solve(problem).beta, expected, rtol=1e-4, atol=1e-4)
    assert np.all(np.isfinite(IV().solve(problem).beta))
    np.testing.assert_allclose(CLOE().solve(problem).beta, expected, rtol=0.05, atol=0.05)


@pytest.mark.parametrize("part", [Load(0.2), Temperature(5.0, 0.2)], ids=["load", "temperature"])
def test_friction_of_load_or_temperature_is_found_under_a_stated_controller(planar_2r, part):
    model = DynamicModel(planar_2r, (Coulomb(0.2), Viscous(), part))
    own = [0.3] if len(part.coefficients) == 1 else [-0.02, -0.01]
    theta = np.append(planar_2r.nominal, np.tile([1.0, 0.5, *own], 2))
    sine, cosine = 0.25 * np.random.default_rng(1).normal(size=(2, 2, 3))
    controller = Pd(rate=2000.0, stiffness=KP, damping=KD, feedforward="none")
    noise = Noise(position=2e-5, torque=0.05)
    path = FourierSeries(np.zeros(2), sine, cosine, 2.0)
    run = simulate(model, theta, path, timing=Timing(rate=250.0, lead_in=1.0), controller=controller, noise=noise)
    log = unfiltered(run.log)
    if part.needs == ("temperature",):  # the drives are at 25 degrees: friction and its change are one column
        model = DynamicModel(planar_2r, (Temperature(24.0, 0.2),))
        theta = np.append(planar_2r.nominal, np.tile([1.0 - 20 * 0.02, 0.5 - 20 * 0.01], 2))
    problem = build_problem(model, [log], Preprocessing(AsGiven(), rest="keep"))
    truth = problem.base.from_standard(theta)
    for method in (DIDIM(**KNOWN), CLIE(**KNOWN), CLOE(**KNOWN), Kalman(passes=1)):
        solution = fit(problem, method)
        assert solution.covariance is not None
        off = np.abs(solution.beta - truth) / np.sqrt(np.diag(solution.covariance))
        assert off.max() < 5, method


def test_friction_with_a_state_is_simulated_and_refused_where_its_derivative_is_asked_for(planar_2r):
    model = DynamicModel(planar_2r, (Viscous(), Presliding()))
    theta = np.append(planar_2r.nominal, np.tile([0.5, 0.4, 1.0], 2))
    sine, cosine = 0.25 * np.random.default_rng(1).normal(size=(2, 2, 3))
    controller = Pd(rate=2000.0, stiffness=KP, damping=KD, feedforward="none")
    path, noise = FourierSeries(np.zeros(2), sine, cosine, 2.0), Noise(position=2e-5, torque=0.05)
    run = simulate(model, theta, path, timing=Timing(rate=250.0, lead_in=1.0), controller=controller, noise=noise)
    problem = build_problem(model, [unfiltered(run.log)], Preprocessing(AsGiven(), rest="keep"))
    truth = problem.base.from_standard(theta)
    for method in (DIDIM(**KNOWN), IV(**KNOWN)):
        solution = method.solve(problem)
        assert solution.covariance is not None
        assert np.all(np.abs(solution.beta - truth) < 5 * np.sqrt(np.diag(solution.covariance))), method
    for method, who in ((CLOE(**KNOWN), "an output error"), (Kalman(passes=1), "the Kalman filter")):
        with pytest.raises(
            BadOption, match=f"{who} has no derivative of its state; use didim or iv, or leave the part"
        ):
            method.solve(problem)


def test_the_kalman_filter_finds_the_truth_and_knows_its_error(planar_2r):
    model = DynamicModel(planar_2r, (Coulomb(0.2), Viscous()))
    theta = np.append(planar_2r.nominal, np.tile([1.0, 0.5], 2))
    sine, cosine = 0.25 * np.random.default_rng(1).normal(size=(2, 2, 3))
    controller = Pd(rate=2000.0, stiffness=KP, damping=KD, feedforward="none")
    noise = Noise(position=2e-5, torque=0.05)
    path = FourierSeries(np.zeros(2), sine, cosine, 2.0)
    run = simulate(model, theta, path, timing=Timing(rate=250.0, lead_in=1.0), controller=controller, noise=noise)
    problem = build_problem(model, [unfiltered(run.log)], Preprocessing(AsGiven(), rest="keep"))
    truth = problem.base.from_standard(theta)
    solution = Kalman(passes=1).solve(problem)
    assert solution.covariance is not None
    assert np.all(np.abs(solution.beta - truth) < 5 * np.sqrt(np.diag(solution.covariance)))
    plain = OLS().solve(problem).beta
    assert np.linalg.norm(solution.beta - truth) < 0.5 * np.linalg.norm(plain - truth)
    assert 0.1 < solution.run.innovation < 3 and len(solution.run.course) > 10


def test_position_noise_is_seen_beside_the_motion():
    time = np.arange(2000) / 500
    noise = np.random.default_rng(0).normal(size=(2000, 1)) * 1e-4
    assert position_noise(np.sin(6 * time)[:, None] + noise)[0] == pytest.approx(1e-4, rel=0.1)


def test_a_loop_without_gains_states_so(cell):
    problems, _ = cell
    run = IV().solve(problems[0]).run
    assert run.reference == "commanded positions" and run.controller == "virtual, 8 Hz"
    assert LoopOptions().reference_hz is None and IV().reference_hz == 5.0
