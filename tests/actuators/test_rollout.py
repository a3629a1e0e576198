"""The compiled roll-out of a servo joint against an integrator that knows nothing of it, and finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from servo_bench import motions, parameters, virtual_logs

from dynident.actuators.drive_law import preset
from dynident.actuators.joint_load import measured_loads
from dynident.actuators.output_error import ServoProblem, log_weights
from dynident.actuators.parameters import FRICTION_MODELS, PARAMETERS, PLACE
from dynident.actuators.rollout import FIRST, NONE, STEP, JointRecord, record_of, rolled_out, start_of, started
from dynident.actuators.rollout_loop import START_Q, START_V
from dynident.actuators.verdict import known_parameters, spread_of
from dynident.actuators.virtual import ServoBench, virtual_log
from dynident.model.robot import Robot


@pytest.fixture(scope="module")
def records(robot: Robot) -> list[JointRecord]:
    law = preset("feetech_sts3215")
    logs = virtual_logs(robot, parameters(), gains=(4.0,))
    return [record_of(log, 0, measured_loads(robot, log)[0], law) for log in logs]


def test_smooth_roll_out_is_that_of_a_runge_kutta_integrator(records: list[JointRecord]) -> None:
    true = parameters(coulomb=0.0, delay=0.0)
    time, each = motions()
    record, law = records[0], preset("feetech_sts3215")
    stamps = record.samples[:, 0]
    command = each["chirp"][0]
    weight, inertia = 0.8 * 9.81 * 0.15, 0.8 * 0.15**2 + 0.002 + true[PLACE["armature"]]

    def slope(t: float, x: np.ndarray) -> list[float]:
        held = command[max(np.searchsorted(stamps, t, side="right") - 1, 0)]
        duty = np.clip(4.0 * law.error_gain * (held - x[0]), -law.limit, law.limit)
        drive = 2.4 * duty - (0.21 + 0.05) * x[1]
        return [x[1], (drive - weight * np.sin(x[0] + 0.02)) / inertia]

    found = solve_ivp(slope, (stamps[0], stamps[400]), record.start, "RK45", stamps[:401], max_step=5e-4, rtol=1e-7)
    part = rolled_out(record, true, longest=1e-3).q[:401]
    assert len(time) > 401
    assert np.max(np.abs(part - found.y[0])) < 5e-4 * np.ptp(found.y[0])


@pytest.mark.parametrize("slew", [np.inf, 1.5])
def test_the_error_falls_with_the_square_of_the_step(records: list[JointRecord], slew: float) -> None:
    """Without dry friction, and with a delay that is no multiple of the step."""
    true = parameters(coulomb=0.0, delay=0.00737, slew_limit=slew, damping_gain=0.01)
    fine = rolled_out(records[0], true, longest=1e-5).q
    coarse, half = (np.mean(np.abs(rolled_out(records[0], true, longest=step).q - fine)) for step in (1e-3, 5e-4))
    assert 3.0 < coarse / half < 5.0
    assert coarse < 1e-4 * np.ptp(fine)


#: Friction that depends on load and speed, beside Coulomb and viscous friction.
ALL_FRICTION = {
    "coulomb_stribeck": 0.04,
    "load_motor": 0.06,
    "load_external": 0.06,
    "load_motor_stribeck": 0.05,
    "load_external_stribeck": 0.05,
    "stribeck_velocity": 0.4,
    "stribeck_exponent": 1.4,
}


@pytest.mark.parametrize(
    ("more", "ratio", "most"),
    [({}, 8.0, 5e-7), ({"slew_limit": 1.5}, 12.0, 1e-7), (ALL_FRICTION, 6.0, 5e-7)],
    ids=["jumps", "slew", "friction"],
)
def test_the_error_falls_with_the_square_of_the_step_with_dry_friction(
    records: list[JointRecord], more: dict[str, float], ratio: float, most: float
) -> None:
    """Reversals, commands that jump from rest or into saturation within a step, friction by the speed in its middle."""
    true, errors = parameters(coulomb=0.05, delay=0.00737, **more), []
    fine = [rolled_out(one, true, longest=2e-5).q for one in records]
    for step in (1e-3, 2.5e-4):
        runs = [rolled_out(one, true, longest=step).q for one in records]
        errors.append(np.sqrt(np.mean((np.array(runs) - np.array(fine)) ** 2)))
    assert errors[0] / errors[1] > ratio  # 4 by the first order, 16 by the second
    assert errors[1] < most  # rad; 3e-5 where the whole step has the friction of its begin


@pytest.mark.parametrize("load", [0.0, 0.1, 0.2])
def test_a_jump_of_the_command_of_a_strong_drive_is_followed_to_a_fiftieth_of_a_step_of_the_encoder(
    robot: Robot, load: float
) -> None:
    """The joint creeps before the jump; with the friction of the mean torque it was off by up to a sixth of one."""
    strong = {"full_torque": 9.0, "back_emf": 1.0, "coulomb": 0.14, "armature": 0.0033, "delay": 0.00972}
    true, law = parameters(load_motor=load, load_external=load, **strong), preset("feetech_sts3215")
    for kp in (3.0, 6.0):
        log = virtual_logs(robot, true, gains=(kp,))[1]
        record = record_of(log, 0, measured_loads(robot, log)[0], law)
        error = rolled_out(record, true).q - rolled_out(record, true, longest=1e-5).q
        assert np.max(np.abs(error)) < 0.02 * law.resolution


def test_the_delay_has_an_exact_derivative_where_a_joint_jumps_from_rest(records: list[JointRecord]) -> None:
    at, runs = NONE.copy(), []
    at[PLACE["delay"]] = 0
    for delay in (0.00737, 0.00737 + 1e-7, 0.00737 - 1e-7):
        runs.append(rolled_out(records[1], parameters(coulomb=0.05, delay=delay, **ALL_FRICTION), at, 4e-3))
    difference = (runs[1].q - runs[2].q) / 2e-7
    assert np.max(np.abs(runs[0].slopes[:, 0] - difference)) < 1e-5 * np.max(np.abs(difference))


def test_commanded_velocities_and_added_duty_act_from_the_moment_of_the_command(records: list[JointRecord]) -> None:
    """Of second order in the step, with an exact derivative by the delay: changes within a step count by their time."""
    samples = records[0].samples.copy()
    samples[:, 2], samples[:, 3] = np.gradient(samples[:, 1], samples[:, 0]), 0.1 * np.sin(7.0 * samples[:, 0])
    record = replace(records[0], samples=samples)
    true = {"coulomb": 0.0, "delay": 0.00737, "damping_gain": 0.05}
    fine = rolled_out(record, parameters(**true), longest=1e-5).q
    coarse, half = (
        np.sqrt(np.mean((rolled_out(record, parameters(**true), longest=step).q - fine) ** 2)) for step in (2e-3, 1e-3)
    )
    assert coarse / half > 3.0 and half < 1e-5  # rad; 6.8e-4 where the whole step has the values of its begin
    at = NONE.copy()
    at[PLACE["delay"]] = 0
    delays = (0.00737, 0.00737 + 1e-7, 0.00737 - 1e-7)
    runs = [rolled_out(record, parameters(**{**true, "delay": delay}), at, 4e-3) for delay in delays]
    difference = (runs[1].q - runs[2].q) / 2e-7
    assert np.max(np.abs(runs[0].slopes[:, 0] - difference)) < 1e-5 * np.max(np.abs(difference))


def test_the_goal_moves_at_the_slew_limit_from_the_moment_of_the_command(records: list[JointRecord]) -> None:
    """A step of the command between two steps of the integration: the delay has an exact slope, no stairs."""
    errors = []
    for delay in np.linspace(0.010, 0.012, 9):
        true = parameters(coulomb=0.0, delay=float(delay), slew_limit=1.5)
        errors.append(rolled_out(records[1], true, longest=5e-3).q[150])
    steps = np.diff(errors)
    assert np.ptp(steps) < 0.05 * np.abs(steps).mean()


@pytest.mark.parametrize("place", range(len(PARAMETERS)), ids=[one.name for one in PARAMETERS])
def test_derivatives_are_those_of_finite_differences(records: list[JointRecord], place: int) -> None:
    true = parameters(
        coulomb_stribeck=0.02,
        load_motor=0.06,
        load_external=0.05,
        load_motor_stribeck=0.04,
        load_external_stribeck=0.03,
        load_motor_quadratic=0.02,
        load_external_quadratic=0.03,
        stribeck_velocity=0.4,
        stribeck_exponent=1.4,
        slew_limit=1.5,
        damping_gain=0.01,
    )
    record = records[0].part(0, 160)
    at = NONE.copy()
    at[[place, place - 1]] = 0, 1  # an other one beside it
    exact = rolled_out(record, true, at).slopes[:, 0]
    step = 1e-7 * max(abs(true[place]), 0.1 * PARAMETERS[place].scale)
    sides = []
    for sign in (1.0, -1.0):
        moved = true.copy()
        moved[place] += sign * step
        sides.append(rolled_out(record, moved).q)
    difference = (sides[0] - sides[1]) / (2.0 * step)
    assert np.max(np.abs(difference)) > 0
    assert np.max(np.abs(exact - difference)) < 1e-4 * np.max(np.abs(difference)) + 1e-6


def test_friction_holds_a_joint_where_it_can(records: list[JointRecord]) -> None:
    """A joint whose dry friction is above its weight stays where it is when the drive is off."""
    record = records[2]
    off = record.samples.copy()
    off[:, 4] = 0.0
    still = replace(record, samples=off, start=np.array([1.0, 0.0]))
    held = rolled_out(still, parameters(coulomb=1.3)).q
    falls = rolled_out(still, parameters(coulomb=0.5)).q
    assert np.ptp(held) == 0.0 and np.ptp(falls) > 0.3


def test_intervals_hold_where_a_joint_rests_between_two_readings(robot: Robot) -> None:
    """Errors of an encoder at rest repeat; the step of Gauss and Newton from the truth is the error they make."""
    true, ratios, law, step = parameters(coulomb=0.12), [], preset("feetech_sts3215"), 2.0 * np.pi / 4096
    logs = virtual_logs(robot, true, gains=(2.0, 5.0))
    records = [record_of(log, 0, measured_loads(robot, log)[0], law) for log in logs]
    free = ("full_torque", "back_emf", "viscous", "coulomb", "armature", "angle_offset", "delay")
    exact = [rolled_out(record, true, longest=STEP).q for record in records]
    for phase in np.linspace(0.0, 1.0, 12, endpoint=False):
        read = [step * (np.round(q / step + phase) - phase) for q in exact]
        kept = tuple(replace(record, q=q) for record, q in zip(records, read, strict=True))
        problem = ServoProblem(kept, free, FRICTION_MODELS["m1"]).finely
        errors, slopes = problem.errors(true)
        sizes = np.repeat(log_weights(problem, true), [len(error) for error in errors])  # as the fit weighs its logs
        moved = np.linalg.lstsq(sizes[:, None] * np.concatenate(slopes), -sizes * np.concatenate(errors))[0]
        known = known_parameters(problem, true, spread_of(problem, true))
        ratios.append(moved / [one.half_width for one in known])
    shares, sizes = np.mean(np.abs(ratios) <= 1.0, axis=0), 1.96 * np.sqrt(np.mean(np.square(ratios), axis=0))
    assert shares.mean() >= 0.93 and shares.min() >= 0.75, dict(zip(free, shares, strict=True))
    assert 0.8 < np.sqrt(np.mean(sizes**2)) < 1.2 and sizes.max() < 1.5, dict(zip(free, sizes, strict=True))


@pytest.mark.parametrize("place", [START_Q, START_V], ids=["position", "velocity"])
def test_derivatives_by_the_start_are_those_of_finite_differences(records: list[JointRecord], place: int) -> None:
    record, at = records[0].part(40, 200), NONE.copy()
    at[[place, PLACE["coulomb"]]] = 0, 1
    exact = rolled_out(record, parameters(), at).slopes[:, 0]
    step = 1e-7 * np.eye(2)[place - START_Q]
    sides = [rolled_out(replace(record, start=record.start + sign * step), parameters()).q for sign in (1.0, -1.0)]
    np.testing.assert_allclose(exact, (sides[0] - sides[1]) / 2e-7, atol=1e-4 * np.abs(exact).max())


def test_logs_that_hold_a_joint_leave_weight_to_those_that_move_it(robot: Robot) -> None:
    """Its reading does not change in three of four logs, so that their errors are 0."""
    bench, time = ServoBench(robot, preset("feetech_sts3215")), np.arange(0.0, 2.0, 0.005)
    logs = [virtual_log(bench, parameters(), time, size * np.sin(6.0 * time), 4.0) for size in (0.8, 0.0, 0.0, 0.0)]
    held = [record_of(log, 0, measured_loads(robot, log)[0], bench.law) for log in logs]
    weights = log_weights(ServoProblem(tuple(held), ("armature",), FRICTION_MODELS["m1"]), parameters())
    assert weights[0] > 0.05 * weights[1:].max()


@pytest.mark.parametrize("first", [100, 560], ids=["slow", "fast"])
def test_a_log_that_begins_in_motion_is_started_at_its_speed(records: list[JointRecord], first: int) -> None:
    """The commands before the first sample are not known; what they still do is over within the delay."""
    true = parameters()
    whole = rolled_out(records[0], true)
    part = records[0].part(first, len(whole.q))
    for samples, most in ((None, 0.05), (FIRST, 0.15)):
        found = started(part, true, samples)
        assert abs(found.start[1] - whole.dq[first]) < most, (found.start, whole.dq[first], part.says)
        assert np.mean(np.abs(rolled_out(found, true).q - part.q)) < 1e-3
    assert abs(whole.dq[first]) > 1.0


@pytest.mark.parametrize("rate", [50.0, 100.0, 200.0])
def test_a_joint_that_sags_from_rest_begins_at_rest(rate: float) -> None:
    """A held joint gives way to its weight from the first sample on, by 0.8 rad/s within 30 ms; another one moves."""
    time, step = np.arange(20) / rate, 2 * np.pi / 4096
    sags = 0.8 * (time - 0.03 * (1.0 - np.exp(-time / 0.03)))
    for q, speed, most in ((sags, 0.0, 0.0), (0.8 * time - 1.5 * time**2, 0.8, 0.25)):
        for phase in (0.0, 0.25, 0.5, 0.75):
            read = np.round(q / step + phase) * step
            found = start_of(time, read, np.ones(20, dtype=bool))[0, 1]
            assert abs(found - speed) <= most, (phase, found)


def test_what_a_model_lacks_does_not_move_the_start(records: list[JointRecord]) -> None:
    """The reads say within 2 mrad where the pendulum began; errors by friction are many times that."""
    found = started(records[0], parameters(coulomb=0.3, viscous=0.2))
    assert abs(found.start[0] - records[0].q[0]) < 2e-3 and abs(found.start[1]) < 0.2
