"""The simulated closed loop against the virtual robot, and its derivatives against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.errors import BadOption, LogMismatch, NotConsistent
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.identification.build_problem import build_problem
from dynident.identification.simulated import closed_loop as module
from dynident.identification.simulated.closed_loop import closed_loop, possible_beta
from dynident.identification.simulated.course import LoopOptions, smoothed
from dynident.identification.simulated.estimators.iv import IV
from dynident.identification.simulated.sensitivities import sensitivities
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.asymmetric import Asymmetric
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.degressive import Degressive
from dynident.model.friction.load import Load
from dynident.model.friction.periodic import Periodic
from dynident.model.friction.stribeck import Stribeck
from dynident.model.friction.temperature import Temperature
from dynident.model.friction.viscous import Viscous
from dynident.simulation.controllers.pd import Pd
from dynident.simulation.virtual_robot import Noise, Timing, simulate

KP, KD = (500.0, 100.0), (40.0, 8.0)
KNOWN = LoopOptions(kp=KP, kd=KD, control_hz=500.0)
HOW = Preprocessing(Butterworth(15.0, positions_hz=60.0), rest="keep")


def wave(joints, period=2.0, seed=1):
    sine, cosine = 0.2 * np.random.default_rng(seed).normal(size=(2, joints, 3))
    return FourierSeries(np.zeros(joints), sine, cosine, period)


def followed(robot, width, **timing):
    """Return a problem, its truth and the true motion of a two-link arm under a stated controller."""
    model = DynamicModel(robot, (Coulomb(width), Viscous()))
    theta = np.append(robot.nominal, np.tile([1.0, 0.5], 2))
    controller = Pd(rate=500.0, stiffness=KP, damping=KD, feedforward="none")
    run = simulate(model, theta, wave(2), timing=Timing(rate=250.0, **timing), controller=controller, noise=Noise())
    problem = build_problem(model, [run.log], HOW)
    return problem, problem.base.from_standard(theta), run


def check_slopes(loop, beta, those, near, of_torque=None):
    """Compare derivatives by those parameters with differences of the discrete simulation; return its rows."""
    rows, by_q = sensitivities(loop, loop.courses[0], beta, "q")
    np.testing.assert_array_equal(rows, loop.simulate(beta)[0])
    signals = [(0, by_q, near, 1e-9)]
    if of_torque is not None:
        signals.append((3, sensitivities(loop, loop.courses[0], beta, "torque")[1], *of_torque))
    for k in those:
        step = np.zeros_like(beta)
        step[k] = 1e-6 * max(1.0, abs(beta[k]))
        rise = (loop.simulate(beta + step)[0] - loop.simulate(beta - step)[0]) / (2 * step[k])
        for signal, slopes, share, floor in signals:
            np.testing.assert_allclose(slopes[:, :, k], rise[:, signal], atol=share * np.abs(slopes).max() + floor)
    return rows


@pytest.fixture(scope="module")
def cell(planar_2r):
    return followed(planar_2r, 0.1, lead_in=1.0, integration_rate=4000.0)


def test_the_true_robot_moves_as_the_virtual_one(cell):
    problem, truth, run = cell
    loop = closed_loop(problem, KNOWN, truth)
    rows = loop.simulate(truth)[0]
    late = run.truth.time > 0.8  # the first state is only estimated
    for k, signal in enumerate((run.truth.q, run.truth.dq, run.truth.ddq, run.truth.torque)):
        np.testing.assert_allclose(rows[late, k], signal[late], atol=5e-5 * np.abs(signal).max())
    facts = loop.run((), (), simulations=1)
    assert facts.reference == "commanded positions" and facts.controller == "as stated"
    settled = loop.settled(truth)[0]
    assert 0 < np.count_nonzero(~settled[:, 0]) < len(settled) / 2 and settled[-1].all()


def test_a_virtual_controller_holds_the_robot_on_the_measured_motion(cell):
    problem, truth, _ = cell
    loop = closed_loop(problem, LoopOptions(), truth)
    log = problem.logs[0].log
    for beta in (truth, 1.1 * truth):  # whatever the parameters
        rows = loop.simulate(beta)[0]
        np.testing.assert_allclose(rows[:, 0], log.q, atol=1e-5)
        np.testing.assert_allclose(rows[:, 1], log.dq, atol=5e-4)


@pytest.mark.parametrize(
    "options",
    [
        KNOWN,
        replace(KNOWN, control_hz=None, feedforward="gravity"),
        LoopOptions(feedforward="computed", bandwidth_hz=3.0),
        LoopOptions(feedforward="measured"),
    ],
    ids=["held", "gravity", "computed", "measured"],
)
def test_sensitivities_are_those_of_the_discrete_simulation(cell, options):
    problem, truth, _ = cell
    beta = truth * np.linspace(0.9, 1.1, len(truth))  # not where feedforward makes the derivative vanish
    loop = closed_loop(problem, options, truth)
    check_slopes(loop, beta, range(0, len(beta), 3), 1e-6, (2e-6, 0.0))


@pytest.mark.parametrize("cost", [np.inf, 0.0], ids=["explicit", "implicit"])
def test_sensitivities_are_exact_with_every_friction_of_the_motion(planar_2r, cost, monkeypatch):
    """Signs of two levels, friction that fades or bends over speed, and torque that repeats with position."""
    parts = (Asymmetric(0.1), Degressive(width=0.1), Stribeck(0.3, width=0.1), Periodic(11.0))
    model = DynamicModel(planar_2r, parts)
    theta = np.append(planar_2r.nominal, np.tile(np.linspace(0.3, 0.8, 8), 2))
    controller = Pd(rate=500.0, stiffness=KP, damping=KD, feedforward="none")
    run = simulate(model, theta, wave(2), timing=Timing(rate=250.0, duration=0.4, lead_in=1.0), controller=controller)
    problem = build_problem(model, [run.log], HOW)
    truth = problem.base.from_standard(theta)
    beta = truth * np.linspace(0.9, 1.1, len(truth))
    monkeypatch.setattr(module, "IMPLICIT_COST", cost)
    loop = closed_loop(problem, LoopOptions(feedforward="measured"), truth)
    check_slopes(loop, beta, range(len(beta)), 1e-5)


@pytest.fixture(scope="module")
def loaded(planar_2r):
    """Return a problem, its truth and other parameters: coupled drives whose friction grows with load and warmth."""
    robot = planar_2r.with_drives({}, [[1.0, 0.0], [0.4, 1.0]])
    model = DynamicModel(robot, (Coulomb(0.1), Viscous(), Load(0.1), Temperature(20.0, 0.1)))
    theta = np.append(robot.nominal, np.tile([0.8, 0.5, 0.2, -0.01, -0.02], 2))
    controller = Pd(rate=500.0, stiffness=KP, damping=KD, feedforward="none")
    run = simulate(model, theta, wave(2), timing=Timing(rate=250.0, duration=0.4, lead_in=1.0), controller=controller)
    warmth = np.linspace([20.0, 30.0], [45.0, 33.0], len(run.log.time))
    problem = build_problem(model, [replace(run.log, temperature=warmth)], HOW)
    truth = problem.base.from_standard(theta)
    return problem, truth, truth * np.linspace(0.9, 1.1, len(truth))


@pytest.mark.parametrize("cost", [np.inf, 0.0], ids=["explicit", "implicit"])
@pytest.mark.parametrize("fed", ["measured", "computed"])
def test_friction_of_load_and_temperature_is_simulated_with_exact_sensitivities(loaded, cost, fed, monkeypatch):
    problem, truth, beta = loaded
    monkeypatch.setattr(module, "IMPLICIT_COST", cost)
    loop = closed_loop(problem, LoopOptions(feedforward=fed, bandwidth_hz=3.0, control_hz=500.0), truth)
    (course,), rows = loop.courses, check_slopes(loop, beta, range(0, len(beta), 2), 1e-5)
    motion = Motion(rows[:, 0], rows[:, 1], rows[:, 2], temperature=course.log.log.temperature)
    torque = problem.model.torque(motion, problem.base.to_standard(beta))
    np.testing.assert_allclose(rows[:, 3], torque, atol=1e-9 * np.abs(torque).max())  # inverse dynamics of the rows


@pytest.fixture
def stiff(planar_2r):
    """Return a problem and its truth whose friction turns its sign within 0.02 rad/s."""
    return followed(planar_2r, 0.02, duration=0.6, lead_in=0.2)[:2]


@pytest.mark.parametrize(
    "options",
    [
        pytest.param(KNOWN, id="held", marks=pytest.mark.battery),
        pytest.param(LoopOptions(feedforward="measured"), id="continuous"),
    ],
)
def test_implicit_steps_find_what_small_explicit_ones_find(stiff, options, monkeypatch):
    problem, truth = stiff
    loop = closed_loop(problem, options, truth)
    (course,) = loop.courses
    monkeypatch.setattr(module, "IMPLICIT_COST", 0.0)
    implicit = list(loop.follow(course, truth))
    assert all(segment.implicit for segment in implicit)
    monkeypatch.setattr(module, "IMPLICIT_COST", np.inf)
    monkeypatch.setattr(module, "STABLE", 0.3)
    explicit = list(loop.follow(course, truth))
    assert not any(segment.implicit for segment in explicit)
    found, expected = (np.concatenate([segment.out for segment in way]) for way in (implicit, explicit))
    for k, tolerance in enumerate((1e-6, 1e-4, 2e-2, 1e-4)):
        np.testing.assert_allclose(found[:, k], expected[:, k], atol=tolerance * np.abs(expected[:, k]).max())


@pytest.mark.parametrize("options", [KNOWN, LoopOptions(feedforward="measured")], ids=["held", "continuous"])
def test_derivatives_of_implicit_steps_are_exact(stiff, options, monkeypatch):
    problem, truth = stiff
    monkeypatch.setattr(module, "IMPLICIT_COST", 0.0)
    beta = truth * np.linspace(0.9, 1.1, len(truth))
    loop = closed_loop(problem, options, truth)
    assert next(iter(loop.follow(loop.courses[0], beta))).implicit
    check_slopes(loop, beta, range(0, len(beta), 3), 1e-5, (1e-4, 1e-6))


@pytest.fixture(params=[1e-3])
def light(planar_2r, scaled, request):
    """Return a closed loop and its truth with a light last link, whose friction decays within a small step."""
    robot = replace(planar_2r, links=(planar_2r.links[0], scaled(planar_2r, request.param, 1.0).links[1]))
    model = DynamicModel(robot, (Coulomb(0.1), Viscous()))
    theta = np.append(robot.nominal, [1.0, 0.5, 0.5, 0.2])
    run = simulate(model, theta, wave(2), timing=Timing(rate=250.0, duration=0.4), noise=Noise())
    problem = build_problem(model, [run.log], HOW)
    beta = problem.base.from_standard(theta)
    return closed_loop(problem, LoopOptions(feedforward="measured", reference="measured"), beta), beta


def test_a_stiff_robot_is_integrated_by_implicit_steps(light):
    """Explicit steps would follow the decay of the friction of its last link."""
    loop, beta = light
    segments = list(loop.follow(loop.courses[0], beta, tangent=False))
    assert all(segment.implicit and segment.counts[0] <= 10 for segment in segments)
    assert all(np.all(np.isfinite(segment.out)) for segment in segments)


@pytest.mark.parametrize("light", [1e-2], indirect=True)
def test_explicit_steps_near_the_bound_of_stability_find_what_small_ones_find(light, monkeypatch):
    loop, beta = light
    monkeypatch.setattr(module, "IMPLICIT_COST", np.inf)
    found = list(loop.follow(loop.courses[0], beta, tangent=False))
    monkeypatch.setattr(module, "STABLE", 0.21)
    small = list(loop.follow(loop.courses[0], beta, tangent=False))
    assert small[0].counts[0] > 9 * found[0].counts[0]
    found, small = (np.concatenate([segment.out for segment in way]) for way in (found, small))
    for k, tolerance in enumerate((1e-8, 1e-6, 5e-4, 1e-6)):
        np.testing.assert_allclose(found[:, k], small[:, k], atol=tolerance * np.abs(small[:, k]).max())


def test_smoothing_passes_parabolas_and_halves_the_cut_off():
    time = np.arange(400.0)
    parabola = np.stack([1 + 0.1 * time, time**2], axis=1)
    np.testing.assert_allclose(smoothed(parabola, 0.05), parabola, rtol=1e-6, atol=1e-4)
    for frequency, gain in ((0.05, 0.5), (0.2, 0.0)):
        tone = np.sin(2 * np.pi * frequency * time)[:, None]
        inside = slice(100, 300)
        assert np.std(smoothed(tone, 0.05)[inside]) / np.std(tone[inside]) == pytest.approx(gain, abs=2e-3)


def test_a_reference_that_is_followed_exactly_is_not_integrated(cell):
    """What integration finds, the reference says; and no mass matrix is asked for."""
    problem, truth, _ = cell
    loop = closed_loop(problem, LoopOptions(feedforward="computed"), truth)
    (course,) = loop.courses
    assert loop.is_exact(course) and not closed_loop(problem, KNOWN, truth).is_exact(course)
    integrated = np.concatenate([segment.out for segment in loop.follow(course, truth, tangent=False)])
    np.testing.assert_allclose(loop.along(course, truth), integrated, atol=3e-4 * np.abs(integrated).max())
    loop.check(-truth)


def test_what_cannot_be_simulated_is_mixed_with_what_can(cell):
    problem, truth, _ = cell
    loop = closed_loop(problem, LoopOptions(feedforward="measured"), truth)
    same, own = possible_beta(loop, truth, truth)
    assert own and same is not None
    with pytest.raises(NotConsistent):
        loop.check(-truth)
    mixed, own = possible_beta(loop, -truth, truth)
    assert not own
    loop.check(mixed)


def test_bad_options_say_what_to_do(cell):
    problem, truth, _ = cell
    with pytest.raises(BadOption, match="kd is not given; state it with kp"):
        IV(kp=(1.0, 2.0))
    with pytest.raises(BadOption, match=r"kp = .* is not possible; give numbers, 0 or more"):
        IV(kp=(1.0, -2.0), kd=(1.0, 1.0))
    with pytest.raises(BadOption, match="one number for each of the 2 joints"):
        closed_loop(problem, LoopOptions(kp=(1.0,), kd=(1.0,)), truth)
    with pytest.raises(BadOption, match=r"control_hz = 340\.7 .* simple multiple"):
        closed_loop(problem, replace(KNOWN, control_hz=340.7), truth).simulate(truth)
    blind = replace(problem, logs=tuple(replace(log, log=replace(log.log, q_ref=None)) for log in problem.logs))
    with pytest.raises(LogMismatch, match="controller gains but no commanded positions"):
        closed_loop(blind, KNOWN, truth)
    with pytest.raises(LogMismatch, match="no commanded positions; map q_ref"):
        closed_loop(blind, LoopOptions(reference="commanded"), truth)
