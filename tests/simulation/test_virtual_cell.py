"""The virtual cell: other integrators, closed forms, conservation laws, and laws of control computed again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from small_arms import mimic_arm, two_link_arm, wave, with_friction

from dynident.errors import BadOption, SolverFailed, UnknownChoice
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, Joint
from dynident.model.kernels import batched
from dynident.model.robot import Link, Robot
from dynident.robot_files import read_robot
from dynident.simulation.cell import Cell
from dynident.simulation.cell_simulation import simulate_cell
from dynident.simulation.controllers import CONTROLLERS
from dynident.simulation.effects import Bristles, Effort, Elasticity, Encoder, Payload, Recorder, Ripple, Tilt, Warming
from dynident.simulation.truth import Truth

#: A controller that leaves the joints alone.
IDLE = CONTROLLERS.make("pd", {"stiffness": (0.0,), "damping": (0.0,), "feedforward": "none"})


def still(q):
    """Return a motion that stands at q."""
    q = np.atleast_1d(np.asarray(q, dtype=float))
    return FourierSeries(q, np.zeros((len(q), 1)), np.zeros((len(q), 1)), 1.0)


def rail(mass=2.0, gravity=0.0, rotor=0.5):
    """Return a mass on a vertical rail with a rotor."""
    joint = Joint("rail", "prismatic", -1, np.eye(3), np.zeros(3), np.array([0, 0, 1.0]), drive=Drive(1.0, rotor))
    body = Inertia.from_centre_of_mass(mass, [0, 0, 0], np.eye(3))
    return Robot("rail", (Link("mass", body),), (joint,), gravity=np.array([0, 0, -gravity]))


def go(model, theta, motion, duration=1.0, **cell):
    return simulate_cell(model, theta, motion, Cell(**cell), duration=duration, seed=3)


# --- the dynamics ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["generic-6r", "generic-scara", "coupled", "mimic"])
def test_inverse_dynamics_with_every_friction_part_give_the_torque(name):
    made = {"coupled": lambda: two_link_arm(coupling=np.array([[1.0, 0.0], [-0.5, 1.2]])), "mimic": mimic_arm}
    robot = made.get(name, lambda: read_robot(name))()
    parts = ("asymmetric", "viscous", "offset", "stribeck", "polynomial", "degressive", "load", "periodic")
    model = DynamicModel(robot, (*parts, "temperature", "rotor_inertia"))
    values = [1.5, 1.1, 0.9, 0.2, 0.8, 0.2, 0.1, 0.5, 0.05, 0.3, 0.1, 0.2, 0.1, -0.01, -0.004, 0.05]
    theta = with_friction(model, values)
    warming = Warming(start=(20.0,), end=(60.0,), time_constant=0.5)
    truth = go(model, theta, wave(robot.dof, size=0.1), warming=warming, lead_in=0.5).truth
    assert np.ptp(truth.temperature) > 30
    again = model.torque(Motion(truth.q, truth.dq, truth.ddq, temperature=truth.temperature), theta)
    np.testing.assert_allclose(again, truth.torque, atol=1e-9 * np.abs(truth.torque).max())


@pytest.mark.parametrize("springs", [False, True])
def test_a_free_arm_keeps_its_energy(springs):
    robot = two_link_arm()
    elastic = Elasticity((4e3, 2e3)) if springs else Elasticity()
    motion = FourierSeries(np.array([0.3, -0.4]), np.array([[0.2], [0.3]]), np.zeros((2, 1)), 4.0)
    kinds = {"controller": IDLE, "elasticity": elastic, "lead_in": 0.0, "recorder": Recorder(velocities=True)}
    run = simulate_cell(DynamicModel(robot), robot.nominal, motion, Cell(**kinds), duration=10.0)
    truth = run.truth
    mass = batched.mass_matrix(robot.chain, robot.nominal, truth.q)
    rotors = np.diagonal(robot.reflected_inertia)
    turn, place = batched.link_poses(robot.chain, truth.q)
    kinetic = 0.5 * np.einsum("si,sij,sj->s", truth.dq, mass, truth.dq)
    total = kinetic + sum(
        9.81 * (link.inertia.mass * place[:, i] + turn[:, i] @ link.inertia.first_moment)[:, 2]
        for i, link in enumerate(robot.links)
    )
    if springs:
        total += 0.5 * np.square(run.link_torque) @ (1 / np.array([4e3, 2e3])) + 0.5 * run.log.dq**2 @ rotors
    else:
        total += 0.5 * truth.dq**2 @ rotors
    assert kinetic.max() > 10
    assert np.ptp(total) < 1e-6 * kinetic.max()


def test_springs_bristles_ripple_and_friction_are_those_of_another_integrator():
    """Two masses, a spring, LuGre with stiction, cogging: a plain program under scipy's DOP853."""
    model = DynamicModel(rail(gravity=9.81), (Coulomb(0.0), "viscous", "stribeck"))
    fc, fv, fs = 3.0, 1.2, 0.6
    stiff, damped, rotor, mass = 900.0, 2.0, 0.5, 2.0
    cell = Cell(
        controller=IDLE,
        elasticity=Elasticity((stiff,), (damped,)),
        bristles=Bristles(2e-3, stiction=0.25, velocity=0.1),
        ripple=Ripple((0.7,), (30.0,), (0.4,)),
        recorder=Recorder(velocities=True),
        lead_in=0.0,
        integration_rate=20_000.0,
    )
    found = simulate_cell(model, with_friction(model, [fc, fv, fs]), still(0.1), cell, duration=1.5)
    s0 = (fc + fs) / 2e-3
    s1 = 2 * 0.3 * np.sqrt(s0 * (mass + rotor))

    def rate(_, state):
        q, dq, p, dp, z = state
        spring = stiff * (p - q) + damped * (dp - dq)
        level = (fc + fs * np.exp(-abs(dp) / 0.1)) * (1 + 0.25 * np.exp(-((dp / 0.1) ** 2)))
        slip = dp - s0 * abs(dp) * z / level
        lost = s0 * z + s1 * slip + fv * dp + 0.7 * np.sin(30.0 * p + 0.4)
        return [dq, spring / mass - 9.81, dp, (-lost - spring) / rotor, slip]

    time = np.arange(1500) / 1000
    want = solve_ivp(rate, (0, 1.5), [0.1, 0, 0.1, 0, 0], "DOP853", time, rtol=1e-10, atol=1e-12).y
    for got, expected in ((found.truth.q, want[0]), (found.truth.dq, want[1]), (found.log.q, want[2])):
        np.testing.assert_allclose(got[:, 0], expected, atol=2e-6 * np.abs(expected).max())
    np.testing.assert_allclose(found.log.dq[:, 0], want[3], atol=1e-4 * np.abs(want[3]).max())


@pytest.mark.parametrize(("level", "slides"), [(60.0, False), (15.0, True)])
def test_bristles_hold_a_mass_or_let_it_slide(level, slides):
    model = DynamicModel(rail(gravity=9.81), ("coulomb",))
    cell = Cell(controller=IDLE, bristles=Bristles(1e-3, damping=0.5), lead_in=0.0, integration_rate=8000.0)
    run = simulate_cell(model, with_friction(model, [level]), still(0.0), cell, duration=2.0)
    if slides:
        np.testing.assert_allclose(run.truth.ddq[-1], -(2 * 9.81 - level) / 2.5, rtol=1e-6)
        with pytest.raises(SolverFailed, match="a higher integration rate"):
            simulate_cell(model, run.theta, still(0.0), replace(cell, integration_rate=1000.0), duration=2.0)
    else:
        assert np.ptp(run.truth.q[-1000:]) < 1e-9
        assert -1e-3 < run.truth.q[-1, 0] < -1e-3 * 2 * 9.81 / level
        assert run.friction[-1, 0] == pytest.approx(-2 * 9.81)


def test_bristles_under_friction_that_falls_with_speed_are_integrated_finely_enough():
    model = DynamicModel(two_link_arm(), ("coulomb", "viscous", "stribeck"))
    theta = with_friction(model, [0.5, 0.5, 6.0])  # at speed bristles slip at a twelfth of the torque that they hold
    motion = FourierSeries(np.zeros(2), np.zeros((2, 1)), np.array([[0.6], [-0.6]]), 1.0)
    cell = Cell(bristles=Bristles(1e-2), lead_in=0.0)
    chosen = simulate_cell(model, theta, motion, cell, duration=0.3)
    finer = simulate_cell(
        model, theta, motion, replace(cell, integration_rate=4 * chosen.integration_rate), duration=0.3
    )
    np.testing.assert_allclose(chosen.truth.q, finer.truth.q, atol=1e-6)


@pytest.mark.parametrize("name", ["generic-6r", "generic-scara", "coupled"])
def test_mujoco_in_the_same_cell_agrees(name):
    """Other dynamics of the bodies under springs or bristles, friction, delay and noise: the same log."""
    pytest.importorskip("mujoco")
    robot = two_link_arm(coupling=np.array([[1.0, 0.0], [-0.5, 1.2]])) if name == "coupled" else read_robot(name)
    model = DynamicModel(robot, ("coulomb", "viscous", "load", "rotor_inertia"))
    theta = with_friction(model, [2.0, 3.0, 0.05, 0.1])
    own = Cell(
        controller=CONTROLLERS.make("pid", {"delay_s": 0.002, "current_hz": 200.0}),
        encoder=Encoder((1e-4,), (1e-5,)),
        payload=Payload(0.5, (0, 0.1, 0)),
        tilt=Tilt(0.1, -0.1),
        elasticity=Elasticity((2e4,), (10.0,)) if name == "coupled" else Elasticity(),
        bristles=Bristles() if name == "coupled" else Bristles(2e-3),
        lead_in=0.0,
    )
    runs = [
        simulate_cell(model, theta, wave(robot.dof, size=0.1), replace(own, plant=plant), duration=0.25)
        for plant in ("own", "mujoco")
    ]
    for signal in ("q", "dq", "ddq", "torque"):
        mine, theirs = (getattr(run.truth, signal) for run in runs)
        np.testing.assert_allclose(theirs, mine, atol=1e-8 * np.abs(mine).max())
    np.testing.assert_array_equal(runs[0].log.q, runs[1].log.q)


def test_a_payload_and_a_tilted_base_are_those_of_the_model():
    robot = two_link_arm()
    model = DynamicModel(robot)
    body = Inertia.from_centre_of_mass(1.5, [0.3, 0, 0.1], np.diag([0.01, 0.02, 0.03]))
    run = go(
        model,
        robot.nominal,
        wave(2),
        payload=Payload(1.5, (0.3, 0, 0.1), (0.01, 0.02, 0.03), "lower"),
        tilt=Tilt(0.1, 0.2),
    )
    theta = robot.nominal + np.r_[np.zeros(10), body.vector]
    np.testing.assert_allclose(run.theta, theta, atol=1e-15)
    assert np.linalg.norm(run.gravity) == pytest.approx(9.81)
    assert run.gravity[2] == pytest.approx(-9.81 * np.cos(0.1) * np.cos(0.2))
    tilted = DynamicModel(robot.with_gravity(run.gravity))
    again = tilted.torque(Motion(run.truth.q, run.truth.dq, run.truth.ddq), theta)
    np.testing.assert_allclose(again, run.truth.torque, atol=1e-9 * np.abs(again).max())
    with pytest.raises(UnknownChoice, match="no link called 'hand'"):
        go(model, robot.nominal, wave(2), payload=Payload(1.0, link="hand"))


def test_friction_fades_with_the_temperature():
    model = DynamicModel(two_link_arm(), ("coulomb", "viscous"))
    theta = with_friction(model, [2.0, 3.0])
    warm = Warming(end=(45.0,), time_constant=0.2, per_kelvin=-0.01)
    run = go(model, theta, wave(2), 2.0, warming=warm, lead_in=0.0)
    table = model.coefficient_table(theta)
    cold = np.einsum("sjk,jk->sj", model.friction_values(Motion(run.truth.q, run.truth.dq, run.truth.ddq)), table)
    share = 1 - 0.01 * (run.truth.temperature - 25.0)
    np.testing.assert_allclose(run.friction, share * cold, atol=1e-9)
    assert run.log.temperature is not None
    assert share.min() < 0.81


# --- control ---------------------------------------------------------------------------------------------------------


def controlled(part, robot, motion, **cell):
    """Return a run whose log has what the controller saw, and the gravity torque that was fed forward."""
    model = DynamicModel(robot)
    sensors = {"recorder": Recorder(part.rate, velocities=True), "encoder": Encoder((1e-4,), (1e-5,))}
    run = go(model, robot.nominal, motion, controller=part, lead_in=0.0, **{**sensors, **cell})
    rest = np.zeros_like(run.log.q_ref)
    return run, batched.inverse_dynamics(robot.chain, robot.nominal, run.log.q_ref, rest, rest)


def test_a_delayed_torque_through_a_lagging_current_loop_is_that_of_the_law():
    kp, kd = np.array([400.0, 150.0]), np.array([20.0, 8.0])
    part = CONTROLLERS.make(
        "pd", {"rate": 500.0, "stiffness": tuple(kp), "damping": tuple(kd), "delay_s": 0.004, "current_hz": 60.0}
    )
    run, gravity = controlled(part, two_link_arm(), wave(2))
    law = gravity + kp * (run.log.q_ref - run.log.q) + kd * (run.log.dq_ref - run.log.dq)
    command = np.concatenate([np.repeat(law[:1], 2, axis=0), law[:-2]])
    expected, now = [], command[0]
    for wanted in command:
        expected.append(now)
        now = wanted + (now - wanted) * np.exp(-2 * np.pi * 60.0 * 0.002)
    np.testing.assert_allclose(run.truth.torque, expected, atol=1e-9)


def test_velocities_from_differences_are_those_of_the_encoder_through_the_filter():
    kp, kd = (300.0,), (6.0,)
    part = CONTROLLERS.make("pd", {"stiffness": kp, "damping": kd})
    encoder = Encoder((1e-3,), velocity="difference", filter_hz=50.0)
    run, gravity = controlled(part, two_link_arm(), still([0.2, -0.1]), encoder=encoder, tilt=Tilt(0.0, 0.3))
    speed = np.diff(run.log.q, axis=0, prepend=run.log.q[:1]) / 1e-3
    felt, keep = [np.zeros(2)], np.exp(-2 * np.pi * 50.0 * 1e-3)
    for one in speed[1:]:
        felt.append(keep * felt[-1] + (1 - keep) * one)
    assert np.ptp(np.round(run.log.q / 1e-3), axis=0).max() > 3
    law = gravity + 300.0 * (run.log.q_ref - run.log.q) - 6.0 * np.array(felt)
    np.testing.assert_allclose(run.truth.torque, law, atol=1e-9)


def test_an_integral_brings_the_arm_to_its_place_and_rests_at_the_limit():
    robot = two_link_arm()
    light = CONTROLLERS.make("pid", {"integral_hz": 1.0})
    kinds = {"payload": Payload(2.0, (0.2, 0, 0)), "lead_in": 0.0}
    model = DynamicModel(robot)
    there = go(model, robot.nominal, still([0.2, 0.4]), 3.0, controller=light, **kinds)
    left = go(model, robot.nominal, still([0.2, 0.4]), 3.0, **kinds)
    assert np.abs(there.truth.q[-1] - [0.2, 0.4]).max() < 1e-6
    assert np.abs(left.truth.q[-1] - [0.2, 0.4]).min() > 1e-3
    run, gravity = controlled(replace(light, stiffness=(400.0,), damping=(20.0,)), robot, wave(2))
    error = run.log.q_ref - run.log.q
    law = gravity + 400.0 * error + 20.0 * (run.log.dq_ref - run.log.dq)
    law += 400.0 * 2 * np.pi * np.cumsum(error, axis=0) * 1e-3
    np.testing.assert_allclose(run.truth.torque, law, atol=1e-9)


def test_a_cascade_is_its_loops():
    part = CONTROLLERS.make("cascade", {"rate": 1000.0, "position_ticks": 4, "current_hz": None, "speed_hz": 8.0})
    robot = two_link_arm()
    run, gravity = controlled(part, robot, wave(2))
    first = wave(2).evaluate([0.0])[0]
    inertia = np.diagonal(batched.mass_matrix(robot.chain, robot.nominal, first)[0] + robot.reflected_inertia)
    ticks = np.arange(len(gravity)) // 4 * 4
    wanted = (0.25 * 2 * np.pi * 8 * (run.log.q_ref - run.log.q) + run.log.dq_ref)[ticks]
    error = wanted - run.log.dq
    law = gravity + 16 * np.pi * inertia * (error + 0.2 * 16 * np.pi * np.cumsum(error, axis=0) * 1e-3)
    np.testing.assert_allclose(run.truth.torque, law, atol=1e-9)


def test_computed_torque_is_the_inverse_dynamics_of_what_is_believed():
    robot = two_link_arm(coupling=np.array([[1.0, 0.0], [0.6, 1.0]]))
    model = DynamicModel(robot, ("coulomb", "viscous"))
    theta, belief = with_friction(model, [2.0, 3.0]), with_friction(model, [1.5, 2.5])
    belief[:20] *= 1.1
    part = CONTROLLERS.make("computed_torque", {"bandwidth_hz": 3.0, "feedforward": "model"})
    cell = Cell(part, Encoder(), recorder=Recorder(velocities=True), lead_in=0.0)
    run = simulate_cell(model, theta, wave(2), cell, duration=1.0, believed=belief)
    goal = wave(2).evaluate(run.log.time)
    w = 2 * np.pi * 3.0
    wanted = goal[2] + w**2 * (goal[0] - run.log.q) + 2 * w * (goal[1] - run.log.dq)
    bodies = batched.inverse_dynamics(robot.chain, belief[:20], run.log.q, run.log.dq, wanted)
    table = model.coefficient_table(belief)
    at_motors = np.einsum("sjk,jk->sj", model.friction_values(Motion(*goal)), table)
    law = bodies + wanted @ robot.reflected_inertia + at_motors @ np.asarray(robot.coupling)
    np.testing.assert_allclose(run.truth.torque, law, rtol=1e-9, atol=1e-9)
    right = simulate_cell(model, theta, wave(2), cell, duration=1.0)
    assert np.all(right.tracking_error() < 0.1 * run.tracking_error())


@pytest.mark.parametrize("name", CONTROLLERS.names())
def test_every_controller_tracks_with_sensors_that_are_not_perfect(name):
    robot = read_robot("generic-6r")
    model = DynamicModel(robot, ("coulomb", "viscous"))
    theta = with_friction(model, [2.0, 3.0])
    encoder = Encoder((2e-5,), (2e-6,), velocity="difference", filter_hz=150.0)
    part = CONTROLLERS.make(name, {"delay_s": 5e-4, "feedforward": "model"})
    run = go(model, theta, wave(6, size=0.15), 2.0, controller=part, encoder=encoder)
    assert np.all(run.tracking_error() < 5e-3)
    for option in CONTROLLERS.options(name):
        if option.kind.startswith("float"):
            with pytest.raises(BadOption, match=rf"controller\.{option.name} = -1"):
                CONTROLLERS.make(name, {option.name: -1.0})
    with pytest.raises(BadOption, match=r"controller\.feedforward = 'all' is not possible; choose one of"):
        CONTROLLERS.make(name, {"feedforward": "all"})


def test_a_loop_that_cannot_be_held_is_reported():
    robot = two_link_arm()
    wild = CONTROLLERS.make("pd", {"bandwidth_hz": 400.0})
    with pytest.raises(SolverFailed, match=r"the motion is lost at .* s; give a lower bandwidth"):
        go(DynamicModel(robot), robot.nominal, wave(2), 5.0, controller=wild)


# --- the log ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recorded():
    model = DynamicModel(two_link_arm(), ("coulomb", "viscous"))
    theta = with_friction(model, [2.0, 3.0])

    def make(**cell):
        return simulate_cell(model, theta, wave(2), Cell(lead_in=0.5, **cell), duration=4.0, seed=1)

    return make


def test_sensors_are_as_noisy_and_coarse_as_stated(recorded):
    run = recorded(encoder=Encoder((0.0,), (1e-4,)), effort=Effort((0.3, 0.1), held="after"))
    np.testing.assert_allclose(np.std(run.log.q - run.truth.q, axis=0), 1e-4, rtol=0.05)
    np.testing.assert_allclose(np.std(run.log.torque - run.truth.torque, axis=0), [0.3, 0.1], rtol=0.05)
    coarse = recorded(effort=Effort(resolution=(0.5,), held="after"), encoder=Encoder((1e-3,)))
    for values, step in ((coarse.log.torque, 0.5), (coarse.log.q, 1e-3)):
        np.testing.assert_allclose(values / step, np.round(values / step), atol=1e-9)
    assert 0.2 < np.abs(coarse.log.torque - coarse.truth.torque).max() <= 0.25 + 1e-9


def test_rows_jitter_and_drop_and_their_truth_with_them(recorded):
    plain = recorded()
    run = recorded(recorder=Recorder(jitter_s=2e-4, dropped=0.05))
    assert np.std(run.truth.time - run.log.time) == pytest.approx(2e-4, rel=0.05)
    assert 1 - run.log.samples / 4000 == pytest.approx(0.05, abs=0.01)
    assert run.truth.samples == run.log.samples == len(run.friction) == len(run.link_torque)
    rows = np.round(run.log.time * 1000).astype(int)
    moved = plain.truth.q[rows] + (run.truth.time - run.log.time)[:, None] * plain.truth.dq[rows]
    np.testing.assert_allclose(run.log.q, moved, atol=1e-5 * 1.1)
    stamped = recorded(recorder=Recorder(jitter_s=2e-4, stamps="true"))
    np.testing.assert_array_equal(stamped.log.time, stamped.truth.time)


def test_torques_lag_or_come_from_behind_the_gears(recorded):
    late = recorded(effort=Effort(delay_s=0.003, held="after"))
    np.testing.assert_allclose(late.log.torque[3:], late.truth.torque[:-3], atol=1e-9)
    link = recorded(effort=Effort(side="link", held="after"))
    bodies = batched.inverse_dynamics(
        two_link_arm().chain, two_link_arm().nominal, link.truth.q, link.truth.dq, link.truth.ddq
    )
    np.testing.assert_allclose(link.log.torque, bodies, atol=1e-9)


@pytest.mark.parametrize(("rate", "per_row"), [(1000.0, 1), (4000.0, 4)])
def test_a_held_torque_is_logged_as_the_mean_of_before_and_after_it_jumps(recorded, rate, per_row):
    controller = CONTROLLERS.make("pd", {"rate": rate})
    fine = recorded(controller=controller, recorder=Recorder(rate=rate)).truth.torque
    middle = 0.5 * (fine + np.vstack([fine[:1], fine[:-1]]))[::per_row]
    run = recorded(controller=controller)
    count = min(len(middle), run.log.samples)
    np.testing.assert_allclose(run.log.torque[1:count], middle[1:count], atol=1e-9)
    after = recorded(controller=controller, effort=Effort(held="after"))
    np.testing.assert_array_equal(after.log.torque, after.truth.torque)
    np.testing.assert_array_equal(after.truth.torque, run.truth.torque)


def test_a_sensor_behind_the_gear_feels_the_mean_of_both_accelerations():
    model = DynamicModel(two_link_arm(), ("coulomb", "viscous"))
    theta = with_friction(model, [2.0, 3.0])
    run = simulate_cell(model, theta, wave(2), Cell(lead_in=0.5, effort=Effort(side="link")), duration=2.0)
    truth, chain = run.truth, model.robot.chain
    jump = np.diff(np.asarray(truth.torque), axis=0)
    masses = batched.mass_matrix(chain, model.robot.nominal, truth.q[1:]) + model.robot.reflected_inertia
    before = truth.ddq[1:] - np.linalg.solve(masses, jump[..., None])[..., 0]
    mean = 0.5 * (truth.ddq[1:] + before)
    bodies = batched.inverse_dynamics(chain, model.robot.nominal, truth.q[1:], truth.dq[1:], mean)
    np.testing.assert_allclose(run.log.torque[1:], bodies, atol=1e-8)


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        (lambda: Cell(elasticity=Elasticity((1e4, 0.0))), "elbow has none beside elastic joints"),
        (lambda: Cell(encoder=Encoder(noise=(1.0, 2.0, 3.0))), r"encoder.noise = \[1.0, 2.0, 3.0\] is not possible"),
        (lambda: Cell(effort=Effort(noise=(-1.0,))), "effort.noise = .* give finite numbers, 0 or more"),
        (lambda: Cell(recorder=Recorder(rate=0.0)), "recorder.rate = 0.0 is not possible; give a number above 0"),
        (lambda: Cell(effort=Effort(side="hand")), "effort.side = 'hand' .* choose one of: motor, link"),
        (lambda: Cell(payload=Payload(1.0, (0.1, 0.0))), r"payload.centre = .* give three numbers"),
        (
            lambda: Cell(recorder=Recorder(dropped=0.95)),
            "recorder.dropped = 0.95 .* give a share of the rows, 0 to 0.9",
        ),
        (lambda: Truth(spread=1.5), "truth.spread = 1.5 .* give a share from 0 to 1, such as 0.2"),
        (lambda: Cell(plant="bullet"), "plant = 'bullet' is not possible; choose one of: own, mujoco"),
    ],
)
def test_what_no_cell_can_be_is_refused(cell, message):
    robot = two_link_arm()
    with pytest.raises(BadOption, match=message):
        go(DynamicModel(robot), robot.nominal, wave(2), **vars(cell()))


def test_a_sharp_sign_needs_bristles_and_springs_need_rotors():
    model = DynamicModel(two_link_arm(), (Coulomb(0.0),))
    with pytest.raises(BadOption, match=r"a sharp sign cannot be integrated; give it a width, .* or the cell bristles"):
        go(model, with_friction(model, [1.0]), wave(2))
    bare = rail(rotor=0.0)
    with pytest.raises(BadOption, match="the motor of rail has no inertia"):
        go(DynamicModel(bare), bare.nominal, still(0.0), elasticity=Elasticity((100.0,)))
