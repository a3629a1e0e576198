"""The virtual robot: closed forms, a plain Python simulation, conservation of energy, and what it refuses."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from small_arms import body, two_link_arm, wave, with_friction

from dynident.data.log import torque_from_current
from dynident.errors import BadOption, NotConsistent, SolverFailed, UnknownChoice
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.excitation.trajectories.quintic import Quintic
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Friction, Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.joint import Drive, Joint, JointLimits
from dynident.model.kernels import batched
from dynident.model.robot import Link, Robot
from dynident.robot_files import read_robot
from dynident.simulation.controllers.pd import Pd
from dynident.simulation.virtual_robot import Noise, Timing, simulate
from dynident.studies.er16_article import BETA_1, LOCKED, PERIOD
from presliding import Presliding

FOUR = ("coulomb", "viscous", "offset", "rotor_inertia")


def slider(mass=2.0):
    """Return a mass on a vertical rail."""
    joint = Joint("rail", "prismatic", -1, np.eye(3), np.zeros(3), np.array([0.0, 0.0, 1.0]))
    return Robot("slider", (Link("mass", body(mass, [0, 0, 0], [1, 1, 1])),), (joint,))


def er16():
    """Return the article's robot, joints 4-6 locked."""
    return read_robot("er16").locked(LOCKED)


def free_motion(model, theta, q, dq, duration, feedforward="none"):
    """Return the true motion from a state (2, n) without feedback, under the torque that is fed forward."""
    path = FourierSeries(np.array(q), np.array(dq)[:, None] * 100.0 / (2 * np.pi), np.zeros((len(q), 1)), 100.0)
    idle = Pd(stiffness=(0.0,), damping=(0.0,), feedforward=feedforward)
    run = simulate(model, theta, path, controller=idle, timing=Timing(duration=duration, lead_in=0.0))
    np.testing.assert_allclose([run.truth.q[0], run.truth.dq[0]], [q, dq], atol=1e-12)
    return run.truth


def test_a_pendulum_swings_in_its_small_angle_period():
    """T = 2 pi sqrt(I / (m g c)); an amplitude a lengthens it by a^2 / 16."""
    joint = Joint("pivot", "revolute", -1, np.eye(3), np.zeros(3), np.array([0.0, 1.0, 0.0]), drive=Drive(10.0, 1e-3))
    robot = Robot("pendulum", (Link("rod", body(1.5, [0, 0, -0.4], [0.02, 0.03, 0.01])),), (joint,))
    amplitude = 1e-3
    motion = free_motion(DynamicModel(robot), robot.nominal, [amplitude], [0.0], duration=10.0)
    inertia = 0.03 + 1.5 * 0.4**2 + 10.0**2 * 1e-3
    period = 2 * np.pi * np.sqrt(inertia / (1.5 * 9.81 * 0.4)) * (1 + amplitude**2 / 16)
    np.testing.assert_allclose(
        motion.q[:, 0], amplitude * np.cos(2 * np.pi / period * motion.time), atol=1e-9 * amplitude * 10
    )


def test_a_mass_falls_and_friction_slows_it_as_the_closed_forms_say():
    robot, t = slider(), np.arange(2000) / 1000
    fall = free_motion(DynamicModel(robot), robot.nominal, [1.0], [0.5], duration=2.0)
    np.testing.assert_allclose(fall.q[:, 0], 1 + 0.5 * t - 9.81 / 2 * t**2, atol=1e-12)
    model = DynamicModel(robot, ("viscous", "offset"))
    damped = free_motion(model, with_friction(model, [3.0, 0.7]), [0.0], [2.0], duration=2.0, feedforward="gravity")
    final = -0.7 / 3.0
    np.testing.assert_allclose(damped.dq[:, 0], final + (2 - final) * np.exp(-3 / 2 * t), atol=1e-12)
    dry = DynamicModel(robot, (Coulomb(0.01), "rotor_inertia"))
    sliding = free_motion(dry, with_friction(dry, [4.0, 1.0]), [0.0], [2.0], duration=1.4, feedforward="gravity")
    np.testing.assert_allclose(sliding.dq[:, 0], 2 - 4 / 3 * t[:1400], atol=1e-12)  # far above the width
    stopped = free_motion(dry, with_friction(dry, [4.0, 1.0]), [0.0], [2.0], duration=3.0, feedforward="gravity")
    assert abs(stopped.dq[-1, 0]) < 1e-6


@dataclass(frozen=True)
class Plain:
    """The same closed loop as a plain Python program over mass matrix and inverse dynamics."""

    robot: Robot
    fc: float
    fv: float
    f0: float
    ia: float
    width: float

    def acceleration(self, q, dq, tau):
        coupling = np.asarray(self.robot.coupling)
        speed = coupling @ dq
        loss = coupling.T @ (self.fc * np.tanh(speed / self.width) + self.fv * speed + self.f0)
        rotor = self.robot.reflected_inertia + self.ia * coupling.T @ coupling
        chain, theta = self.robot.chain, self.robot.nominal
        bias = batched.inverse_dynamics(chain, theta, [q], [dq], [np.zeros(len(q))])[0]
        return np.linalg.solve(batched.mass_matrix(chain, theta, [q])[0] + rotor, tau - loss - bias)

    def run(self, motion, kp, kd, step, every, rows, resolution):
        q, dq, _ = (values[0] for values in motion.evaluate(0.0))
        found = []
        for k in range(rows):
            if k % every == 0:
                goal, speed, _ = (values[0] for values in motion.evaluate(k * step))
                feed = batched.inverse_dynamics(self.robot.chain, self.robot.nominal, [goal], [0 * goal], [0 * goal])[0]
                seen = np.floor(q / resolution + 0.5) * resolution
                tau = feed + kp * (goal - seen) + kd * (speed - dq)
            a = self.acceleration(q, dq, tau)
            found.append([q, dq, a, tau])
            slopes = [(dq, a)]
            for share in (step / 2, step / 2, step):
                v, b = slopes[-1]
                slopes.append((dq + share * b, self.acceleration(q + share * v, dq + share * b, tau)))
            q = q + step / 6 * (slopes[0][0] + 2 * slopes[1][0] + 2 * slopes[2][0] + slopes[3][0])
            dq = dq + step / 6 * (slopes[0][1] + 2 * slopes[1][1] + 2 * slopes[2][1] + slopes[3][1])
        return np.array(found)


def test_the_compiled_loop_is_the_plain_loop():
    """A coupled arm with all friction parts, a controller at 250 Hz, encoders of 1e-4 rad, rows at 500 Hz."""
    robot = two_link_arm(coupling=np.array([[1.0, 0.0], [0.6, 1.0]]))
    model = DynamicModel(robot, (Coulomb(0.05), "viscous", "offset", "rotor_inertia"))
    motion = wave(2)
    kp, kd = np.array([400.0, 150.0]), np.array([20.0, 8.0])
    expected = Plain(robot, 0.8, 1.1, -0.3, 0.07, 0.05).run(motion, kp, kd, 1e-3, 4, 1500, 1e-4)
    run = simulate(
        model,
        with_friction(model, [0.8, 1.1, -0.3, 0.07]),
        motion,
        timing=Timing(duration=1.5, rate=500.0, lead_in=0.0, integration_rate=1000.0),
        controller=Pd(rate=250.0, stiffness=tuple(kp), damping=tuple(kd)),
        noise=Noise(resolution=1e-4),
    )
    truth = run.truth
    for got, want in zip((truth.q, truth.dq, truth.ddq, truth.torque), np.moveaxis(expected[::2], 1, 0), strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-9, atol=1e-9)


def test_the_articles_robot_follows_its_excitation():
    robot = er16()
    model = DynamicModel(robot, ("coulomb", "viscous"))
    series = FourierSeries.from_table(BETA_1, PERIOD)
    run = simulate(model, model.nominal(), series)
    assert run.log.samples == 25_000
    assert run.log.time[0] == 0.0
    assert run.log.time[-1] == 24.999
    error = np.degrees(run.truth.q - series.evaluate(run.truth.time)[0])
    assert np.all(np.sqrt(np.mean(error**2, axis=0)) < 0.1)
    assert np.all(np.abs(error) < 0.2)
    assert run.saturated == 0


def test_the_run_in_brings_the_arm_to_the_speed_of_the_start():
    robot = er16()
    model = DynamicModel(robot)
    series = FourierSeries.from_table(BETA_1, PERIOD)
    q, dq, _ = (values[0] for values in series.evaluate(0.0))
    led = simulate(model, robot.nominal, series, timing=Timing(duration=0.5)).truth
    np.testing.assert_allclose(led.dq[0], dq, atol=0.02)
    np.testing.assert_allclose(led.q[0], q, atol=0.005)
    put = simulate(model, robot.nominal, series, timing=Timing(duration=0.5, lead_in=0.0)).truth
    np.testing.assert_allclose(put.q[0], q, rtol=1e-14)
    np.testing.assert_allclose(put.dq[0], dq, rtol=1e-14)
    odd = simulate(
        model, robot.nominal, series, timing=Timing(duration=0.5, lead_in=0.3337)
    ).truth  # no whole number of ticks
    np.testing.assert_allclose(odd.dq[0], dq, atol=0.2)


FOUR_SECONDS = Timing(duration=4.0, lead_in=0.5)


def run_of_two(timing=FOUR_SECONDS, **options):
    model = DynamicModel(two_link_arm(), FOUR)
    theta = with_friction(model, [0.5, 0.4, 0.1, 0.02])
    return simulate(model, theta, wave(2), timing=timing, **options)


def test_the_same_seed_gives_the_same_log_and_another_seed_another():
    noise = Noise(position=1e-4, velocity=1e-3, torque=0.2)
    first, again, other = (run_of_two(noise=noise, seed=seed).log for seed in (1, 1, 2))
    for name, values in first.signals().items():
        assert values.tobytes() == again.signals()[name].tobytes()
        assert np.array_equal(values, other.signals()[name]) == name.endswith("_ref")  # commands have no noise
    louder = run_of_two(noise=replace(noise, torque=5.0), seed=1).log
    np.testing.assert_array_equal(louder.q, first.q)
    np.testing.assert_array_equal(louder.dq, first.dq)


def test_noise_has_the_deviation_asked_for_and_stays_out_of_the_truth():
    noise = Noise(position=(1e-4, 2e-4), velocity=1e-3, torque=(0.2, 0.1))
    run = run_of_two(noise=noise)
    for seen, true, deviation in (
        (run.log.q, run.truth.q, (1e-4, 2e-4)),
        (run.log.dq, run.truth.dq, (1e-3, 1e-3)),
        (run.log.torque, run.truth.torque, (0.2, 0.1)),
    ):
        error = seen - true
        np.testing.assert_allclose(error.std(axis=0), deviation, rtol=0.06)  # 4000 samples: 1.1 % each
        assert np.all(np.abs(error.mean(axis=0)) < 5 * np.array(deviation) / np.sqrt(4000))
    silent = run_of_two()
    assert silent.log.dq is None
    np.testing.assert_array_equal(silent.log.q, silent.truth.q)
    np.testing.assert_array_equal(silent.log.torque, silent.truth.torque)


@pytest.mark.parametrize("coupling", [None, np.array([[1.0, 0.0], [-0.5, 1.2]])])
def test_currents_are_the_motor_torques_by_their_gains(coupling):
    robot = two_link_arm(coupling=coupling)
    model = DynamicModel(robot)
    gains = {"shoulder": 12.0, "elbow": -8.0}
    run = simulate(model, robot.nominal, wave(2), timing=Timing(duration=0.5), gains=gains)
    assert run.log.torque is None
    back = torque_from_current(run.log, gains, np.asarray(robot.coupling))
    np.testing.assert_allclose(back.torque, run.truth.torque, atol=1e-10)
    if coupling is None:
        np.testing.assert_allclose(run.log.current, run.truth.torque / [12.0, -8.0], atol=1e-12)


def test_torques_stop_at_the_effort_limits():
    base = two_link_arm()
    limited = replace(
        base,
        joints=tuple(replace(j, limits=JointLimits(effort=e)) for j, e in zip(base.joints, (9.0, 30.0), strict=True)),
    )
    run = simulate(DynamicModel(limited), limited.nominal, wave(2), timing=Timing(duration=2.0))
    assert run.saturated > 0
    assert np.max(np.abs(run.truth.torque[:, 0])) == 9.0
    assert np.max(np.abs(run.truth.torque[:, 1])) < 30.0


def test_the_integration_keeps_up_with_narrow_friction():
    """A narrow sign is integrated with more steps, chosen so that twice as many change nothing that matters."""
    robot = two_link_arm()
    model = DynamicModel(robot, (Coulomb(1e-3),))
    theta = with_friction(model, [2.0])
    chosen = simulate(model, theta, wave(2), timing=Timing(duration=1.0))
    rate = float(chosen.log.source.steps[0].split(" Hz integration")[0].split()[-1])
    assert rate > 1000
    assert rate % 1000 == 0
    finer = simulate(model, theta, wave(2), timing=Timing(duration=1.0, integration_rate=4 * rate))
    np.testing.assert_allclose(chosen.truth.q, finer.truth.q, atol=1e-6)


def test_rows_and_controls_may_have_different_rates():
    run = run_of_two(Timing(4.0, rate=400.0, lead_in=0.5), controller=Pd(rate=600.0))
    assert run.log.samples == 1600
    assert "1200 Hz integration" in run.log.source.steps[0]


@dataclass(frozen=True)
class Jolted(Friction):
    """A torque that no simulation can solve for the acceleration."""

    coefficients = (replace(Coulomb.coefficients[0], symbol="F3"),)

    def terms(self, at):
        return (at.ddq**3,)


def test_every_friction_part_at_once_is_that_of_inverse_dynamics():
    """Parts with states too: the torque of the model along the truth."""
    parts = [
        *(FRICTION.make(name) for name in FRICTION.names() if name != "coulomb"),
        Presliding(fine=0.05, coarse=0.5),
    ]
    model = DynamicModel(two_link_arm(), tuple(parts))
    values = np.random.default_rng(0).uniform(0.05, 0.2, model.coefficients_per_joint)
    theta = with_friction(model, values)
    run = simulate(
        model, theta, wave(2), timing=Timing(duration=1.0, rate=2000.0, integration_rate=2000.0, lead_in=0.0)
    )
    true, fixed = run.truth, run.log
    assert fixed.temperature is not None and np.ptp(fixed.temperature) == 0.0
    moved = model.with_states(Motion(true.q, true.dq, true.ddq, temperature=fixed.temperature), 1.0 / 2000.0)
    assert moved.state is not None and np.ptp(moved.state, axis=0).min() > 0.0
    np.testing.assert_allclose(model.torque(moved, theta), true.torque, atol=1e-9 * np.abs(true.torque).max())


def refused(change):
    """Return the message of the error that a changed call raises."""
    robot = two_link_arm()
    model = DynamicModel(robot, change.pop("friction", ()))
    theta = change.pop("theta", None)
    theta = with_friction(model, np.ones(model.coefficients_per_joint)) if theta is None else theta
    motion = change.pop("trajectory", wave(2))
    with pytest.raises((BadOption, UnknownChoice, NotConsistent)) as caught:
        simulate(model, theta, motion, **{"timing": Timing(duration=0.5), **change})
    return str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"friction": (Coulomb(0.0),)},
            "width = 0.0 is not possible; a sharp sign cannot be integrated; give it a width, such as 0.01 rad/s, "
            "or the cell bristles",
        ),
        (
            {"friction": (Jolted(),)},
            "friction = 'test_virtual_robot' is not possible; "
            "a torque that depends on the acceleration cannot be simulated; leave the part out",
        ),
        ({"theta": np.ones(3)}, "theta = 'of shape (3,)' is not possible; the model has 20 parameters"),
        (
            {"theta": np.r_[np.ones(13), np.nan, np.ones(6)]},
            "theta = 'Iyy of lower not finite' is not possible; give finite numbers",
        ),
        ({"trajectory": wave(3)}, "trajectory = 'for 3 joints' is not possible; the robot has 2"),
        (
            {"trajectory": Quintic(np.zeros((3, 2)), np.zeros((3, 2)), 1.0), "timing": Timing(duration=2.0)},
            "duration = 2.0 is not possible; the trajectory ends after 1 s and has no period",
        ),
        ({"timing": Timing(duration=-1.0)}, "duration = -1.0 is not possible; give seconds, above 0"),
        ({"timing": Timing(0.5, rate=1.0)}, "duration = 0.5 is not possible; give seconds for 2 to 1e+08 rows at 1 Hz"),
        ({"timing": Timing(0.5, lead_in=-1.0)}, "lead_in = -1.0 is not possible; give seconds, 0 or more"),
        ({"timing": Timing(0.5, lead_in=1e12)}, "lead_in = 1000000000000.0 is not possible; give 1000 s or less"),
        (
            {"timing": Timing(0.5, rate=300.0, integration_rate=4000.0)},
            "integration_rate = 4000.0 is not possible; give a multiple of 3000 Hz, which 300 and 1000 Hz divide",
        ),
        (
            {"timing": Timing(0.5, rate=999.999), "controller": Pd(rate=1000.1)},
            "rate = 999.999 is not possible; the log's and the controller's 1000.1 Hz fit no common step; "
            "choose another rate",
        ),
        (
            {"controller": Pd(stiffness=(1.0, 2.0, 3.0))},
            "controller.stiffness = [1.0, 2.0, 3.0] is not possible; give one number, or one for each of the 2 joints",
        ),
        ({"noise": Noise(position=-1.0)}, "encoder.noise = (-1.0,) is not possible; give finite numbers, 0 or more"),
        (
            {"noise": Noise(resolution=np.nan)},
            "encoder.resolution = (nan,) is not possible; give finite numbers, 0 or more",
        ),
        ({"gains": {"shoulder": 1.0}}, "gains['elbow'] is not given; give each joint's drive gain in N m/A, not 0"),
        (
            {"gains": {"sholder": 1.0}},
            "no joint called 'sholder'; choose one of: shoulder, elbow; did you mean 'shoulder'?",
        ),
    ],
)
def test_what_cannot_be_simulated_is_refused_with_the_remedy(change, message):
    assert refused(dict(change)) == message


def test_friction_too_narrow_for_the_steps_is_refused_with_what_it_needs():
    """The fastest decay is that of the lightest direction of M at the stiffest motion: Fc / (width m)."""
    robot = two_link_arm()
    masses = batched.mass_matrix(robot.chain, robot.nominal, wave(2).evaluate(np.linspace(0, 0.5, 2000))[0])
    lightest = np.min(np.linalg.eigvalsh(masses + robot.reflected_inertia))
    message = refused({"friction": (Coulomb(1e-3),), "timing": Timing(0.5, lead_in=0.0, integration_rate=1000.0)})
    found = re.fullmatch(
        r"integration_rate = 1000.0 is not possible; the friction needs (\S+) Hz or more; "
        r"give that, or a greater Coulomb width",
        message,
    )
    assert float(found[1]) == pytest.approx(1 / (1e-3 * lightest), rel=0.01)
    assert re.fullmatch(
        r"width = 'of Coulomb friction' is not possible; friction turns within \S+ s there; "
        r"give the Coulomb part a greater width",
        refused({"friction": (Coulomb(1e-9),)}),
    )


def test_an_impossible_body_is_refused():
    model = DynamicModel(two_link_arm())
    theta = model.robot.nominal.copy()
    theta[13] = -5.0  # Iyy of the lower link: the axis it swings about
    message = refused({"theta": theta})
    assert message.startswith("robot 'two-link' is not physically consistent: its mass matrix has the eigenvalue -")
    assert message.endswith("; simulate physically consistent parameters")


def test_a_motion_that_explodes_is_reported():
    robot = slider()
    model = DynamicModel(robot, ("viscous",))
    with pytest.raises(SolverFailed, match=r"the motion is lost at 0\.2\d+ s"):
        free_motion(model, with_friction(model, [-200.0]), [0.0], [1.0], duration=10.0)
