"""Servos of whole arms, all joints in motion at once, against an integrator of the whole arm by Pinocchio."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pinocchio", reason="the virtual arms need Pinocchio")

from benchmarks import servos
from benchmarks.servo_arms import VirtualArm, arm_log, arm_logs, drawn_arm
from servo_bench import parameters, virtual_logs

from dynident.actuators.arm_coupling import Arm
from dynident.actuators.arm_motion import arm_rolled_out, beyond_noise
from dynident.actuators.drive_law import preset
from dynident.actuators.estimate import ActuatorEstimate
from dynident.actuators.followed_log import followed
from dynident.actuators.identify import identify_actuators
from dynident.actuators.joint_fit import JointData, JointFit
from dynident.actuators.joint_load import divided, joint_loads, load_times, measured_loads, measured_motion, motion_at
from dynident.actuators.linear_start import LinearStart, start_rows
from dynident.actuators.parameters import PLACE, with_zero
from dynident.actuators.rollout import record_of, rolled_out
from dynident.actuators.servo_log import ServoColumns, ServoLog, ServoSetup
from dynident.actuators.torque_state import check_torque_state
from dynident.errors import LogMismatch
from dynident.model.robot import Robot
from dynident.results.actuator_report import errors_table, mean_lines

LAW = preset("feetech_sts3215")


@pytest.mark.parametrize("noise", [0.0, 2e-3], ids=["steps", "noise"])
def test_what_an_encoder_does_not_see_is_no_motion(robot: Robot, noise: float) -> None:
    """Errors of an encoder beside a right roll-out are left out, those of a model that lacks something are kept."""
    log = virtual_logs(robot, parameters(), gains=(2.0,))[0]
    record = record_of(log, 0, measured_loads(robot, log)[0], LAW)
    step, exact = 2 * np.pi / 4096, rolled_out(record, parameters()).q
    seen = exact + np.random.default_rng(0).normal(0.0, noise, exact.shape)
    record = replace(record, q=np.round(seen / step) * step)
    left = record.q - exact
    assert np.abs(beyond_noise(left, record)).max() < 0.15 * np.abs(left).max()
    lacks = left + 0.02 * np.sin(3.0 * log.time)
    np.testing.assert_allclose(beyond_noise(lacks, record), lacks, rtol=0.03)


@pytest.mark.parametrize(("steps", "is_motion"), [(0.45, False), (-0.45, False), (3.0, True)])
def test_a_joint_that_rests_is_anywhere_within_half_a_step(robot: Robot, steps: float, is_motion: bool) -> None:
    """Its readings repeat: they are off by one and the same part of a step, all of which is no motion."""
    log = virtual_logs(robot, parameters(), gains=(2.0,))[0]
    left = np.full(log.samples, steps * 2.0 * np.pi / 4096)
    found = beyond_noise(left, record_of(log, 0, measured_loads(robot, log)[0], LAW))
    np.testing.assert_allclose(found, left if is_motion else 0.0, rtol=0.03, atol=1e-12)


def test_parts_of_the_load_are_equal_and_no_longer_than_the_step() -> None:
    ends = divided(np.array([0.0, 0.01, 0.0205, 0.03]), 3e-3)
    np.testing.assert_allclose(ends[::4], [0.0, 0.01, 0.0205, 0.03])
    assert len(ends) == 13 and np.ptp(np.diff(ends)[4:8]) < 1e-12
    np.testing.assert_array_equal(divided(ends, 3e-3), ends)


@pytest.mark.parametrize(("joints", "seconds", "kp", "light"), [(6, 1.5, 8.0, 1.0), (3, 8.0, 15.0, 0.05)])
def test_a_whole_arm_let_go_moves_as_its_integrator_says(
    tmp_path: Path, joints: int, seconds: float, kp: float, light: float
) -> None:
    """Chirps of all joints, then all drives off; no measured position but the first has a part in it.

    Drives may be light beside the links.
    """
    arm = drawn_arm(np.random.default_rng([11, joints, 2]), joints, LAW, tmp_path)
    arm.true[:, PLACE["armature"]] *= light
    arm.true[:, [PLACE[name] for name in ("back_emf", "viscous", "coulomb")]] *= max(light, 0.3)
    time, phase = np.arange(0.0, seconds, 0.01), np.linspace(0.3, 0.4, joints)
    command = 0.5 * np.sin(2 * np.pi * (phase + 0.15 * time[:, None]) * time[:, None])
    log = arm_log(arm, time, command, kp, time < 0.67 * seconds, counts=2**30)
    blind = replace(log, q=np.repeat(log.q[:1], len(time), axis=0))
    start = np.stack([log.q[0], np.zeros(joints)])
    q = arm_rolled_out(arm.robot, blind, (LAW,) * joints, list(arm.true), start)
    assert np.abs(q - log.q).max() < 3e-4  # of 1 rad


def answer(arm: VirtualArm, logs: list[ServoLog]) -> ActuatorEstimate:
    setup = ServoSetup((LAW,) * arm.robot.dof, ServoColumns(arm.robot.joint_names), "m1")
    return identify_actuators(arm.robot, setup, logs)


def check(arm: VirtualArm, found: ActuatorEstimate) -> float:
    """Hold every parameter against the truth; return the share of the intervals that hold it."""
    holds = []
    for joint, true in zip(found.joints, arm.true, strict=True):
        known = {one.name: one for one in joint.known}
        assert known["full_torque"].label == "identified"
        for name, one in known.items():
            truth = true[PLACE[name]]
            if name == "viscous" and "back_emf" not in known:
                truth += true[PLACE["back_emf"]]
            error = abs(joint.value(name) - truth)
            holds.append(error <= one.half_width)
            if name == "delay":
                assert error < 1e-3, (joint.name, name)
            elif name != "angle_offset" and one.half_width < 0.03 * truth:
                assert error < 0.03 * truth, (joint.name, name, joint.value(name), truth)
    return float(np.mean(holds))


def test_an_arm_logged_at_30_hz_has_no_bias_and_its_roll_outs_follow(tmp_path: Path) -> None:
    """The load of a joint needs the accelerations of the others between samples, and the zeros of their encoders."""
    arm = drawn_arm(np.random.default_rng([11, 3, 1]), 3, LAW, tmp_path)
    logs = arm_logs(arm, 30.0, (8.0,))
    found = answer(arm, logs)
    assert check(arm, found) >= 0.85
    runs = followed(found, arm.robot, logs)
    for one in runs:
        assert one.error < 1.5e-3 and one.whole < 5e-3, (one.joint, one.log, one.error, one.whole)
    assert "whole arm" in [column.heading for column in errors_table(runs).columns]
    assert "the whole arm let go" in mean_lines(runs)[1]


def unfitted(arm: VirtualArm, logs: list[ServoLog]) -> Arm:
    """Return an arm whose fits are the truth, on its measured motion."""
    n, measured = arm.robot.dof, [measured_motion(log) for log in logs]
    ends = [load_times(log, n) for log in logs]
    motions = [motion_at(motion, between) for motion, between in zip(measured, ends, strict=True)]
    loads = [joint_loads(arm.robot, motion) for motion in motions]
    datas, fits = [], []
    for joint, own in enumerate(arm.true):
        parts = list(zip(logs, loads, measured, strict=True))
        records = tuple(record_of(log, joint, load[joint], LAW) for log, load, _ in parts)
        rows = tuple(start_rows(log, joint, load[joint], motion, LAW) for log, load, motion in parts)
        datas.append(JointData(arm.robot.joint_names[joint], LAW, records, (), rows))
        free = ("full_torque", "coulomb", "viscous", "armature", "angle_offset", "back_emf", "delay")
        free = free if joint else tuple(name for name in free if name != "angle_offset")
        begun = LinearStart(own, 0.0, 0.0, np.inf, 0, 0.0)
        fits.append(JointFit(1.0, "m1", {}, free, begun, own, own, own, free))
    used = [with_zero(own, 0.0) for own in arm.true]
    return Arm([arm.robot] * len(logs), measured, ends, motions, datas, fits, used)


def test_an_axis_that_points_the_other_way_is_no_inverted_torque_column(tmp_path: Path) -> None:
    """Both are driven where the robot model says that they are not; all torques of the bodies tell them apart."""
    arm = drawn_arm(np.random.default_rng([11, 6, 103]), 6, LAW, tmp_path)
    log = next(one for one in arm_logs(arm, 200.0, (8.0,)) if not one.enabled.all())
    check_torque_state(arm.robot, log)
    with pytest.raises(LogMismatch, match="the column of the torque is inverted"):
        check_torque_state(arm.robot, replace(log, enabled=~log.enabled))
    sides = np.where(np.arange(6) == 5, -1.0, 1.0)
    with pytest.raises(LogMismatch, match="turn over the axis of joint6 in the robot model"):
        check_torque_state(arm.robot, replace(log, q=sides * log.q, q_ref=sides * log.q_ref))


@pytest.mark.battery
@pytest.mark.parametrize(("rate", "seed"), [(30.0, 1), (100.0, 2), (200.0, 3)])
def test_six_joints_are_found_together(tmp_path: Path, rate: float, seed: int) -> None:
    arm = drawn_arm(np.random.default_rng([11, 6, seed]), 6, LAW, tmp_path)
    assert check(arm, answer(arm, arm_logs(arm, rate, (8.0, 16.0)))) >= 0.85


def test_turns_that_say_otherwise_than_small_changes_are_believed(tmp_path: Path) -> None:
    """Zeros of neighbours trade against each other: derivatives on the wrong side of 1 would send them away."""
    arm = drawn_arm(np.random.default_rng([11, 3, 1]), 3, LAW, tmp_path)
    begun = unfitted(arm, arm_logs(arm, 100.0, (8.0,), seconds=3.0))
    spreads = begun.spreads()
    plain = begun.coupled(spreads, is_whole=False)
    block = np.ix_(plain.zeros, plain.zeros)
    moved, found = np.array([0.0, 0.02, -0.02]), np.array([0.0, 0.018, -0.018])
    for kept, size in ((1.0, 1.0), (0.0, 1e-5)):  # a turn that is small beside the half widths says nothing
        seen = replace(begun, turns=[size * np.array([moved, found])]).coupled(spreads, is_whole=False)
        told = seen.coupling[block] @ moved[1:]
        expected = kept * found[1:] + (1.0 - kept) * plain.coupling[block] @ moved[1:]
        np.testing.assert_allclose(told, expected, atol=5e-4)
    after = replace(begun, used=list(arm.true)).since(begun)
    np.testing.assert_allclose(after.turns[0], [arm.true[:, PLACE["angle_offset"]], np.zeros(3)])


def test_a_joint_whose_first_search_ends_far_from_the_answer_is_sought_again(tmp_path: Path) -> None:
    """Its Coulomb friction was found half as large as it is, and called identified."""
    for joint in servos.one(83, 3, tmp_path)["joints"]:  # pyright: ignore
        assert joint["coulomb"]["value"] == pytest.approx(joint["coulomb"]["true"], rel=0.03)
        zero = joint.get("angle_offset")
        assert zero is None or abs(zero["value"] - zero["true"]) < 1e-3, zero


def test_what_is_asked_is_counted_where_half_widths_say_that_it_is_known() -> None:
    def row(value: float, half: float | None) -> dict[str, float | None]:
        return {"true": 1.0, "value": value, "half": half}

    rows = [row(1.02, 0.025), row(1.04, 0.01), row(1.5, 0.04), row(2.0, None)]
    delays = [{"true": 0.01, "value": value, "half": half} for value, half in ((0.0109, 1e-4), (0.03, 2e-3))]
    lines = [{"joints": [{"coulomb": one} for one in rows] + [{"delay": one} for one in delays]}]
    assert [line.split("within ")[1] for line in servos.within_asked(lines)] == [
        "3 %: 1 of 2 whose half width is below",
        "1 ms: 1 of 1 whose half width is below",
    ]


@pytest.mark.battery
@pytest.mark.parametrize(("seed", "most"), [(8, 0.005), (16, 0.02)])
def test_zeros_of_neighbours_that_trade_against_each_other_are_found(tmp_path: Path, seed: int, most: float) -> None:
    """Six joints at 30 Hz; small changes say that the zeros of 16 run away from where they agree, 0.1 to 0.3 rad.

    Those of 8 agree, and a last step by these changes would lead away. The logs of 16, with stiction, tell two of the
    zeros to 8 to 16 mrad (half widths).
    """
    for joint in servos.one(seed, 6, tmp_path)["joints"]:  # pyright: ignore
        zero = joint.get("angle_offset")
        assert zero is None or abs(zero["value"] - zero["true"]) < min(zero["half"], most), zero


@pytest.mark.battery
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_stiction_is_no_saturation(tmp_path: Path) -> None:
    """Nothing is known of the gain, no duty is near its limit, and friction m1 lacks the stiction of the drives.

    A slew limit that a joint is found with when it is sought again is none that the motions before are by.
    """
    random = np.random.default_rng([11, 3, 36])
    arm = drawn_arm(random, 3, servos.LAW, tmp_path)
    servos.add_stiction(random, arm.true)
    servos.add_slew_limits(random, arm.true)
    assert servos.gain_labels(arm.robot, servos.slow_logs(arm, 30.0)) == ["not separable"] * 3
