"""The momentum observer against finite differences, thresholds, and a stream against a log."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.signal

from bare_estimates import bare_estimate
from dynident import DynamicModel, Estimate, FourierSeries, Log, Robot, identify
from dynident.applications.compensation import (
    computed_torque,
    feed_forward,
    friction_torque,
    gravity_torque,
    mass_matrices,
    parameters_of,
)
from dynident.applications.monitor import MomentumObserver, MonitorState, calibrated, run_monitor, step, watch
from dynident.applications.monitor.band import Tail, fitted_band, lagged, shrunk, tail_of
from dynident.applications.monitor.momentum_observer import Equations
from dynident.applications.monitor.signals import residuals_of, signals_of
from dynident.applications.standstill import end_states
from dynident.data.formats import ColumnMap, write_log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.errors import BadOption, LogMismatch
from dynident.model.friction import FRICTION, Motion
from dynident.model.friction.balancer import Balancer
from dynident.model.friction.spring import Spring

GIVEN = Preprocessing(AsGiven(), rest="keep")


def run_of(robot: Robot, seed: int, seconds: float = 12.0, rate: float = 100.0, noise: float = 0.2) -> Log:
    model = DynamicModel(
        robot, tuple(FRICTION.make(name) for name in ("coulomb", "viscous", "offset", "rotor_inertia"))
    )
    generator = np.random.default_rng(seed)
    time = np.arange(int(seconds * rate)) / rate
    sine, cosine = 0.3 * generator.normal(size=(2, robot.dof, 5))
    q, dq, ddq = FourierSeries(np.zeros(robot.dof), sine, cosine, 6.0).evaluate(time)
    assert robot.nominal is not None
    theta = np.concatenate([robot.nominal, np.tile([2.0, 3.0, 0.4, 0.3], robot.dof)])
    torque = model.torque(Motion(q, dq, ddq), theta) + noise * generator.normal(size=q.shape)
    return Log(robot.joint_names, time, q, dq, ddq, torque)


@pytest.fixture(scope="module")
def estimate(robot: Robot) -> Estimate:
    friction = tuple(FRICTION.make(name) for name in ("coulomb", "viscous", "offset", "rotor_inertia"))
    return identify(DynamicModel(robot, friction), [run_of(robot, 1)], "wls", GIVEN)


def test_compensation_adds_up_to_the_model(estimate: Estimate) -> None:
    model, theta = estimate.model, parameters_of(estimate)
    motion = model.random_motion(7, seed=3)
    whole = feed_forward(model, theta, motion.q, motion.dq, motion.ddq)
    np.testing.assert_allclose(whole, model.torque(motion, theta), rtol=1e-12)
    masses, rest = mass_matrices(model, theta, motion.q), np.zeros_like(motion.dq)
    inertial = np.einsum("sij,sj->si", masses, motion.ddq)
    turning = feed_forward(model, theta, motion.q, motion.dq, rest) - gravity_torque(model, theta, motion.q)
    turning -= friction_torque(model, theta, motion.q, motion.dq)
    parts = inertial + turning + gravity_torque(model, theta, motion.q)
    np.testing.assert_allclose(parts + friction_torque(model, theta, motion.q, motion.dq), whole, rtol=1e-9, atol=1e-9)
    planned = (motion.q, motion.dq, motion.ddq)
    there = computed_torque(model, theta, planned, motion.q, motion.dq, 100.0, 20.0)
    np.testing.assert_allclose(there, whole, rtol=1e-12, atol=1e-12)


def test_compensation_of_one_state_and_refusals(estimate: Estimate) -> None:
    model, theta, q = estimate.model, parameters_of(estimate), np.linspace(0.1, 0.6, 6)
    assert gravity_torque(model, theta, q).shape == (6,) and mass_matrices(model, theta, q).shape == (6, 6)
    half = friction_torque(model, theta, q, q, share=0.5)
    np.testing.assert_allclose(2 * half, friction_torque(model, theta, q, q))
    sides = [friction_torque(model, theta, q, sign * q, offset=False) for sign in (1, -1)]
    np.testing.assert_allclose(sides[0], -sides[1])
    with pytest.raises(BadOption, match="each of the 6 joints"):
        gravity_torque(model, theta, q[:5])
    with pytest.raises(BadOption, match="share of the friction"):
        friction_torque(model, theta, q, q, share=1.5)


def test_springs_are_held_whole_and_are_no_share_of_the_friction(planar_2r: Robot) -> None:
    first, second = planar_2r.joint_names
    springs = (Spring(rest=0.3, joints=(first,)), Balancer(dead_center=-1.0, joints=(second,)))
    model = DynamicModel(planar_2r, ("coulomb", "viscous", *springs))  # type: ignore[arg-type]
    nominal, generator = model.nominal(), np.random.default_rng(0)
    assert nominal is not None
    theta = np.where(np.arange(len(nominal)) < model.inertial_count, nominal, generator.uniform(1.0, 9.0, len(nominal)))
    q, dq = generator.normal(size=(2, 5, 2))
    still = model.torque(Motion(q, 0.0 * q, 0.0 * q), theta)
    np.testing.assert_allclose(gravity_torque(model, theta, q), still, rtol=1e-12)
    half = friction_torque(model, theta, q, dq, share=0.5)
    drift = model.torque(Motion(q, dq, 0.0 * q), theta)
    plain = replace(model, friction=model.friction[:2])
    bare = [p.symbol not in ("Ks", "Kb", "Fb") for p in model.parameters]
    np.testing.assert_allclose(half, 0.5 * friction_torque(plain, theta[bare], q, dq), rtol=1e-12)
    there = computed_torque(model, theta, (q, dq, 0.0 * q), q, dq, 100.0, 20.0)
    np.testing.assert_allclose(there, drift, rtol=1e-12)


def test_the_drift_is_that_of_hamiltons_equations(estimate: Estimate) -> None:
    """g + friction - C' dq = friction - d/dq (dq' M dq / 2 - potential), by central differences of M and gravity."""
    observer, motion = MomentumObserver(estimate), estimate.model.random_motion(3, seed=5)
    model, theta = estimate.model, observer.theta
    for q, dq in zip(motion.q, motion.dq, strict=True):
        slope = np.empty(6)
        for j in range(6):
            ends = [mass_matrices(model, theta, q + sign * 1e-6 * np.eye(6)[j]) for sign in (1, -1)]
            slope[j] = 0.5 * dq @ (ends[0] - ends[1]) @ dq / 2e-6
        expected = gravity_torque(model, theta, q) + friction_torque(model, theta, q, dq) - slope
        np.testing.assert_allclose(observer.drift(q[None], dq[None])[0], expected, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(
            observer.momentum(q[None], dq[None])[0], mass_matrices(model, theta, q) @ dq, rtol=1e-9
        )


def test_a_contact_is_seen_as_it_is_and_a_stream_says_what_a_log_does(robot: Robot, estimate: Estimate) -> None:
    observer = MomentumObserver(estimate)
    clean = [signals_of(estimate, run_of(robot, seed)) for seed in (2, 3, 4)]
    monitor = calibrated(observer, clean, 1.0 / 3600.0)
    log = run_of(robot, 5)
    assert not run_monitor(monitor, log).alarms and not run_monitor(monitor, log).mostly_above
    assert robot.joint_names[1] in run_monitor(monitor, replace(log, torque=-np.asarray(log.torque))).mostly_above
    threshold = monitor.thresholds(signals_of(estimate, log))[:, 2]
    torque = np.array(log.torque)
    torque[600:, 2] -= 5.0 * threshold[600:]
    found = run_monitor(monitor, replace(log, torque=torque))
    first = found.alarms[0]
    assert {alarm.joint for alarm in found.alarms} == {robot.joint_names[2]}
    assert 0 <= first.start - log.time[600] <= 0.02
    assert first.peak == pytest.approx(5.0 * first.threshold, rel=0.5)
    state, started, residual = MonitorState(), [], np.zeros(6)
    for k in range(580, 640):
        state, reading = step(monitor, state, float(log.time[k]), log.q[k], np.asarray(log.dq)[k], torque[k])
        residual = reading.residual
        started += [(reading.time, name) for name in reading.alarms]
        if k > 610:
            np.testing.assert_allclose(reading.threshold, found.threshold[k], rtol=1e-9)
    np.testing.assert_allclose(residual, found.residual[639], atol=1e-2)  # what was before 580 is forgotten
    assert started == [(first.start, first.joint)]


@pytest.mark.parametrize(("delay", "speeds"), [(0.0, False), (0.013, True), (-0.02, True), (0.004, False)])
def test_lines_of_text_say_what_the_log_does(
    robot: Robot, estimate: Estimate, delay: float, speeds: bool, tmp_path: Path
) -> None:
    """Rows as they come against the whole log: differences for velocities, and a delay of the torque either way."""
    log = replace(run_of(robot, 6, seconds=3.0), ddq=None)
    log = log if speeds else replace(log, dq=None)
    late = replace(
        estimate, preprocessing=replace(estimate.preprocessing, delay_s=delay), columns=ColumnMap(joints=log.joints)
    )
    monitor = calibrated(MomentumObserver(late), [signals_of(late, run_of(robot, seed)) for seed in range(2, 8)], 0.01)
    write_log(log, tmp_path / "run.csv")
    found = list(watch(monitor, (tmp_path / "run.csv").read_text().splitlines()))
    signals = signals_of(late, log)
    np.testing.assert_allclose([one.time for one in found], signals.time, atol=1e-12)
    residual = residuals_of(monitor.observer, signals)
    np.testing.assert_allclose([one.residual for one in found], residual, atol=1e-6 * np.abs(residual).max())


@pytest.mark.parametrize(("delay", "speeds"), [(0.013, False), (-0.004, True)])
@pytest.mark.parametrize("push", [0.0, 5.0])
def test_gaps_ring_no_alarm_and_a_contact_behind_one_does(
    robot: Robot, estimate: Estimate, delay: float, speeds: bool, push: float, tmp_path: Path
) -> None:
    """Of 18 gaps of 0.1 to 0.7 s, in which the drives turn: a straight line over each would be a contact.

    The contact begins in the last gap but two, and a stream of a tenth of the rate is followed as well.
    """
    late = replace(estimate, preprocessing=replace(estimate.preprocessing, delay_s=delay))
    late = replace(late, columns=ColumnMap(joints=robot.joint_names))
    clean, whole = (
        [replace(log, ddq=None, dq=log.dq if speeds else None) for log in own]
        for own in ([run_of(robot, seed) for seed in range(2, 8)], [run_of(robot, 9, seconds=24.0)])
    )
    monitor = calibrated(MomentumObserver(late), [signals_of(late, log) for log in clean], 1.0 / 3600.0)
    keep, generator = np.ones(whole[0].samples, dtype=bool), np.random.default_rng(5)
    starts = np.linspace(100, 2250, 18).astype(int)
    for start in starts:
        keep[start : start + generator.integers(10, 70)] = False
    torque = np.array(whole[0].torque)
    torque[starts[-3] + 5 :, 2] -= push * float(np.median(monitor.thresholds(signals_of(late, clean[0]))[:, 2]))
    log = replace(whole[0], torque=torque).rows(keep, "samples were lost")
    behind = float(log.time[np.searchsorted(log.time, whole[0].time[starts[-3]])])
    found = run_monitor(monitor, log)
    write_log(log, tmp_path / "gaps.csv")
    lines = (tmp_path / "gaps.csv").read_text().splitlines()
    stream = list(watch(monitor, lines))
    rung = [(one.joint, one.start) for one in found.alarms]
    live = [(name, one.time) for one in stream for name in one.alarms]
    assert found.gaps == 18 and sum(one.is_new for one in stream) == 19
    for each in (rung, live):
        assert {name for name, _ in each} == ({robot.joint_names[2]} if push else set())
        assert all(behind <= time for _, time in each)
        assert not push or min(time for _, time in each) < behind + 0.1
    slow = list(watch(monitor, [lines[0], *lines[1:-400:10]]))
    assert sum(one.is_new for one in slow) <= 19 < len(slow) / 5


def test_a_monitor_and_feed_forward_remember_as_the_model_does(robot: Robot) -> None:
    """Along a clean run the residual is that of the sampling alone; one that has slipped errs after each reversal."""
    model = DynamicModel(robot, tuple(FRICTION.make(name) for name in ("viscous", "presliding")))
    assert robot.nominal is not None
    theta = np.concatenate([robot.nominal, np.tile([3.0, 8.0], robot.dof)])
    own, rate = bare_estimate(model, theta), 250.0
    time = np.arange(1500) / rate
    turn = 1.0 + 0.2 * np.arange(robot.dof)
    angle = time[:, None] * turn
    q, dq, ddq = 0.3 * np.sin(angle), 0.3 * turn * np.cos(angle), -0.3 * turn**2 * np.sin(angle)
    motion = model.with_states(Motion(q, dq, ddq), 1.0 / rate)
    torque = model.torque(motion, theta)
    np.testing.assert_allclose(feed_forward(model, theta, q, dq, ddq, step=1.0 / rate), torque, rtol=1e-12, atol=1e-12)
    with_friction = gravity_torque(model, theta, q) + friction_torque(model, theta, q, dq, step=1.0 / rate)
    apart = with_friction - gravity_torque(model, theta, q) - friction_torque(model, theta, q, dq)
    np.testing.assert_allclose(torque - feed_forward(model, theta, q, dq, ddq), apart, atol=1e-9)
    assert np.abs(apart).max() > 4.0
    observer, log = MomentumObserver(own), Log(robot.joint_names, time, q, dq, ddq, torque)
    signals = signals_of(own, log)
    residual = residuals_of(observer, signals)
    assert observer.known_from(q) > 0 and np.abs(residual).max() < 0.4
    noise = np.random.default_rng(0).normal(size=(4, *q.shape))
    monitor = calibrated(observer, [replace(signals, torque=torque + one) for one in noise], 0.1)
    state, found = MonitorState(), []
    for k in range(len(time)):
        state, reading = step(monitor, state, float(signals.time[k]), q[k], dq[k], torque[k])
        found.append(reading.residual)
    np.testing.assert_allclose(found, residual, atol=1e-9)


def test_rates_set_thresholds(robot: Robot, estimate: Estimate) -> None:
    observer = MomentumObserver(estimate)
    clean = [signals_of(estimate, run_of(robot, seed)) for seed in (2, 3, 4)]
    often, seldom = (calibrated(observer, clean, rate / 3600.0) for rate in (600.0, 1.0))
    assert np.all(np.asarray(often.factors) < np.asarray(seldom.factors))
    with pytest.raises(BadOption, match="false alarms a second"):
        calibrated(observer, clean, -1.0)
    with pytest.raises(BadOption, match="choose a rate below"):
        calibrated(observer, clean, 1e3)
    with pytest.raises(LogMismatch, match="no clean run"):
        calibrated(observer, [], 1.0)
    with pytest.raises(LogMismatch, match="send samples in order"):
        step(often, MonitorState(time=1.0), 0.5, *[np.zeros(6)] * 3)
    with pytest.raises(LogMismatch, match="no finite number"):
        step(often, MonitorState(), 0.0, np.full(6, np.nan), np.zeros(6), np.zeros(6))


def test_the_tail_of_a_known_process() -> None:
    """Normal noise that changes slowly rises above u as often as Rice 1945 says: exp(-u^2 / 2) as often as above 0."""
    noise = np.random.default_rng(0).normal(size=2_000_000)
    signal = np.asarray(scipy.signal.lfilter([1.0], np.poly([0.9, 0.9, 0.8]), noise))
    signal /= signal.std()
    tail = tail_of([np.abs(signal)], [1.0], 10.0, "joint")
    turns = 2 * np.mean((signal[1:] > 0) & (signal[:-1] <= 0))
    for size in (3.0, 4.0):
        assert tail.threshold(turns * np.exp(-0.5 * size**2)) == pytest.approx(size, rel=0.02)
    with pytest.raises(LogMismatch, match="too few"):
        tail_of([np.abs(signal[:40])], [1.0], 1.0, "joint")


def test_a_few_peaks_do_not_make_a_tail_heavy_and_many_do() -> None:
    few = [Tail(2.0, 1.0, 1.0, shape, 100.0) for shape in (-0.1, 0.1, 0.05, -0.05)]
    assert all(abs(tail.shape) < 0.05 and 0.02 < tail.shape_std < 0.12 for tail in shrunk(few))
    many = [Tail(2.0, 1.0, 1.0, shape, 1e5) for shape in (0.3, 0.25, 0.2, 0.35)]
    found = shrunk(many)
    np.testing.assert_allclose([tail.shape for tail in found], [0.3, 0.25, 0.2, 0.35], rtol=1e-3)
    before, after = ([tail.scale / (1 - tail.shape) for tail in tails] for tails in (many, found))
    np.testing.assert_allclose(after, before)


@pytest.mark.parametrize("rate", [100.0, 500.0])
def test_rare_alarms_of_short_clean_runs_come_at_the_chosen_rate(rate: float) -> None:
    """Normal noise as the observer leaves it, clean for 80 s, watched for 4 h: one alarm an hour and joint.

    Peaks taken for one within five time constants had given 15 in 4 h at 100 Hz, and 58 at 500 Hz.
    """
    keep, joints, counts, ranges = np.exp(-50.0 / rate), 6, [], []
    noise = np.random.default_rng(3)

    def signal(seconds: float) -> np.ndarray:
        white = np.sqrt(1.0 - keep**2) * noise.normal(size=(int(seconds * rate), joints))
        return np.abs(scipy.signal.lfilter([1.0], [1.0, -keep], white, axis=0))

    watched = signal(4 * 3600.0)
    for _ in range(5):
        clean = signal(80.0)
        tails = shrunk([tail_of([one], [1.0 / rate], 1.0 / 50.0, "joint") for one in clean.T])
        for tail, one in zip(tails, watched.T, strict=True):
            size = tail.threshold(1.0 / 3600.0)
            assert tail.rates(size).mean() == pytest.approx(1.0 / 3600.0, rel=1e-3)
            times = np.flatnonzero(one > size)
            counts.append(np.sum(np.diff(times, prepend=-np.inf) > 0.1 * rate))
            ranges.append(4 * 3600.0 * np.quantile(tail.rates(size), [0.05, 0.95]))
    assert 0.1 * 4.0 < np.mean(counts) < 1.5 * 4.0, counts
    held = [
        low - 2.0 * np.sqrt(low) <= k <= high + 2.0 * np.sqrt(high)
        for k, (low, high) in zip(counts, ranges, strict=True)
    ]
    assert np.mean(held) >= 0.9


def test_the_generated_equations_are_the_generic_ones(estimate: Estimate, monkeypatch: pytest.MonkeyPatch) -> None:
    motion = estimate.model.random_motion(11, seed=3)
    fast = Equations(estimate).at(motion.q, motion.dq)
    one = Equations(estimate).at(motion.q[:1], motion.dq[:1])
    monkeypatch.setenv("DYNIDENT_KERNEL", "generic")
    slow = Equations(estimate).at(motion.q, motion.dq)
    for name in ("mass", "momentum", "friction", "columns", "drift"):
        tolerance = 1e-5 if name == "drift" else 1e-10  # of central differences
        np.testing.assert_allclose(getattr(fast, name), getattr(slow, name), rtol=tolerance, atol=tolerance)
        np.testing.assert_allclose(getattr(one, name)[0], getattr(fast, name)[0], rtol=1e-12, atol=1e-12)
    torque = fast.columns @ estimate.beta + estimate.model.known_torque(Motion(motion.q, motion.dq, 0 * motion.q))
    whole = estimate.model.torque(Motion(motion.q, motion.dq, 0 * motion.q), parameters_of(estimate))
    np.testing.assert_allclose(torque, whole, rtol=1e-9, atol=1e-9)


def test_load_friction_and_temperatures_are_those_of_the_model(robot: Robot) -> None:
    model = DynamicModel(robot, tuple(FRICTION.make(name) for name in ("load", "temperature", "viscous")))
    nominal = np.asarray(robot.nominal)
    theta = np.r_[nominal, np.full(len(model.parameters) - len(nominal), 0.3)]
    estimate = bare_estimate(model, theta)
    motion, warm = model.random_motion(5, seed=3), np.full((5, 6), 31.0)
    terms = Equations(estimate).at(motion.q, motion.dq, warm)
    expected = friction_torque(model, theta, motion.q, motion.dq, warm)
    np.testing.assert_allclose(terms.friction, expected, rtol=1e-9, atol=1e-9)


def test_the_band_finds_which_noise_it_is() -> None:
    """A residual of constant noise and of noise that grows with a shape of the state has the variance of both."""
    generator, keep = np.random.default_rng(0), 0.6
    moments = np.zeros((20_000, 1, 8))
    moments[:, 0, 0] = 1.0
    moments[:, 0, 3] = 2.0 * (1 + np.sin(np.arange(20_000) / 300.0))
    variance = lagged(0.5 * moments[:, 0, 0] + 3.0 * moments[:, 0, 3], keep)
    residual = (np.sqrt(variance) * generator.normal(size=20_000))[:, None]
    residual[::500] *= 30.0  # what is rare is left to the tail
    band = fitted_band([residual], [moments], [keep], np.ones(1))
    assert np.asarray(band.weights)[0, [0, 3]] == pytest.approx([0.5, 3.0], rel=0.08)
    assert not np.asarray(band.weights)[0, [1, 2, 4, 5, 6, 7]].any()


def test_false_alarms_come_at_the_chosen_rate(robot: Robot, estimate: Estimate) -> None:
    """Noise of velocities enters by the inertia, which changes with the posture: the band follows it."""
    observer, generator = MomentumObserver(estimate), np.random.default_rng(7)

    def noisy(seed: int) -> Log:
        log = run_of(robot, seed, 30.0)
        return replace(log, dq=np.asarray(log.dq) + 3e-3 * generator.normal(size=log.q.shape))

    clean = [signals_of(estimate, noisy(seed)) for seed in range(20, 30)]
    monitor = calibrated(observer, clean, 1.0 / 14.0)
    tests = [run_monitor(monitor, noisy(seed)) for seed in range(40, 54)]
    counts = np.sum([[joint["alarms"] for joint in one.figures()["joints"]] for one in tests], axis=0)
    assert 0.7 * 30 <= counts.mean() <= 1.4 * 30, counts
    assert np.all((counts >= 0.4 * 30) & (counts <= 1.9 * 30)), counts


@pytest.mark.parametrize("push", [0.0, 6.0])
def test_the_state_of_presliding_at_the_start_is_no_contact(robot: Robot, push: float) -> None:
    """A clean log begins with all drives held the other way; a push comes once they have moved on."""
    model = DynamicModel(robot, tuple(FRICTION.make(name) for name in ("viscous", "presliding")))
    ends = end_states(model)
    assert robot.nominal is not None and ends is not None
    theta = np.concatenate([robot.nominal, np.tile([3.0, 8.0], robot.dof)])
    rate, noise = 250.0, np.random.default_rng(1).normal(size=(5, 1500, robot.dof))
    time = np.arange(1500) / rate
    turn = 1.0 + 0.2 * np.arange(robot.dof)
    angle = time[:, None] * turn
    q, dq, ddq = 0.3 * (1.0 - np.cos(angle)), 0.3 * turn * np.sin(angle), 0.3 * turn**2 * np.cos(angle)
    torque = model.torque(model.with_states(Motion(q, dq, ddq), 1.0 / rate, ends[0]), theta)
    torque[700:] += push
    observer = MomentumObserver(bare_estimate(model, theta))
    log = Log(robot.joint_names, time, q, dq, ddq, torque + noise[0])
    signals = signals_of(bare_estimate(model, theta), log)
    known = model.torque(model.with_states(Motion(q, dq, ddq), 1.0 / rate), theta)
    monitor = calibrated(observer, [replace(signals, torque=known + one) for one in noise[1:]], 1.0 / 3600.0)
    found = run_monitor(monitor, log)
    assert not [alarm for alarm in found.alarms if alarm.start < 1.0]
    assert {alarm.joint for alarm in found.alarms if alarm.end > 2.9} == (set(robot.joint_names) if push else set())
    assert np.all(np.max(np.abs(found.residual) - (found.threshold - found.held), axis=0) > 1.0)  # of it there are some
    assert np.all(found.held[:5].max(axis=0) > 0.5) and np.all(found.held[600:650] < 0.01)
    state = MonitorState()
    for k in range(120):
        state, reading = step(monitor, state, float(signals.time[k]), signals.q[k], signals.dq[k], signals.torque[k])
        np.testing.assert_allclose(reading.held, found.held[k], atol=1e-6)


@pytest.mark.parametrize("gap", [(500, 900), (730, 790), (700, 703)])
def test_a_stream_goes_on_after_a_gap_in_which_the_drives_turned(robot: Robot, gap: tuple[int, int]) -> None:
    """In 1.6 or 0.24 s without samples they turn: presliding may be anywhere then. In 16 ms none does; a push is told.

    What lasts for minutes, as the warmth of drives, goes on.
    """
    model = DynamicModel(robot, tuple(FRICTION.make(name) for name in ("viscous", "presliding", "warm_up")))
    assert robot.nominal is not None
    theta, rate = np.concatenate([robot.nominal, np.tile([3.0, 8.0, 0.0, -0.5], robot.dof)]), 250.0
    time, noise = np.arange(1500) / rate, 0.3 * np.random.default_rng(1).normal(size=(5, 1500, robot.dof))
    sizes, speed = np.linspace(0.3, 0.24, robot.dof), 1.03
    q, dq = np.outer(1.0 - np.cos(speed * time), sizes), np.outer(np.sin(speed * time), speed * sizes)
    motion = model.with_states(Motion(q, dq, np.outer(np.cos(speed * time), speed**2 * sizes)), 1.0 / rate)
    torque, estimate = model.torque(motion, theta), bare_estimate(model, theta)
    signals = signals_of(estimate, Log(robot.joint_names, time, q, dq, motion.ddq, torque))
    clean = [replace(signals, torque=torque + one) for one in noise[1:]]
    monitor = calibrated(MomentumObserver(estimate), clean, 1.0 / 3600.0)
    torque = torque + 0.7 * noise[0] + 6.0 * (time >= 4.8)[:, None]
    state, held, alarms = MonitorState(), np.zeros((1500, robot.dof)), list[int]()
    for k in (*range(gap[0]), *range(gap[1], 1500)):
        state, reading = step(monitor, state, float(time[k]), signals.q[k], signals.dq[k], torque[k])
        held[k], alarms = reading.held, alarms + [k] * bool(reading.alarms)
        if state.ends is not None:
            assert state.friction is not None and np.all(state.friction[:, 1] > 1e-4 * (k >= gap[1]) - 1e-12)
            assert all(np.array_equal(end[:, 1], state.friction[:, 1]) for end in state.ends)
    assert alarms and 1200 <= min(alarms) < 1210
    assert np.all(held[gap[1] :].max(axis=0) > 5.0) == (gap[1] - gap[0] > 10) and np.all(held[1200:] < 0.01)
    assert state.ends is None


@pytest.mark.parametrize("push", [0.9, 4.0])
def test_what_static_friction_holds_at_rest_is_no_contact(robot: Robot, push: float) -> None:
    """A log stands still in its last 3 s, the drives against their load; clean runs never stand.

    Static friction takes 0.9 of its level at breakaway; four times that is more than it can hold.
    """
    friction = tuple(FRICTION.make(name) for name in ("coulomb", "viscous", "offset", "rotor_inertia"))
    how = replace(GIVEN, standstill=0.02)
    estimate = identify(DynamicModel(robot, friction), [run_of(robot, 1)], "wls", how)
    observer = MomentumObserver(estimate)
    monitor = calibrated(observer, [signals_of(estimate, run_of(robot, seed)) for seed in (2, 3, 4)], 1.0 / 3600.0)
    log, stand = run_of(robot, 5), 900
    q, dq, torque = (np.array(one) for one in (log.q, log.dq, log.torque))
    q[stand:], dq[stand:] = q[stand], 0.0
    noise = 0.2 * np.random.default_rng(0).normal(size=torque[stand:].shape)
    held = push * 2.0  # of the Coulomb friction of each drive
    torque[stand:] = gravity_torque(estimate.model, observer.theta, q[stand]) + 0.4 + held + noise
    found = run_monitor(monitor, replace(log, q=q, dq=dq, torque=torque))
    stood = {alarm.joint for alarm in found.alarms if alarm.end > log.time[stand + 50]}
    np.testing.assert_allclose(found.held.max(axis=0), 2.0, rtol=0.1)
    if push < 1.0:
        assert not stood
        without = found.threshold - found.held  # would tell a contact
        assert np.all(np.any(np.abs(found.residual[stand:]) > without[stand:], axis=0))
        assert np.all(np.abs(found.residual[-100:]).mean(axis=0) > 0.8 * held)
    else:
        assert stood == set(robot.joint_names)
    state, readings = MonitorState(), []
    for k in range(stand - 20, stand + 60):
        state, reading = step(monitor, state, float(log.time[k]), q[k], dq[k], torque[k])
        readings.append(reading)
    np.testing.assert_allclose(readings[-1].held, found.held[stand + 59], rtol=1e-3)
    np.testing.assert_allclose(readings[-1].threshold, found.threshold[stand + 59], rtol=0.02)
