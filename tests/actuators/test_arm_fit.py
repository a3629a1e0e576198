"""Servos of whole arms, all joints in motion at once, against an integrator of the whole arm by Pinocchio."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pinocchio", reason="the virtual arms need Pinocchio")

from benchmarks.servo_arms import VirtualArm, arm_logs, drawn_arm

from dynident.actuators.drive_law import preset
from dynident.actuators.estimate import ActuatorEstimate
from dynident.actuators.followed_log import followed
from dynident.actuators.identify import identify_actuators
from dynident.actuators.parameters import PLACE
from dynident.actuators.servo_log import ServoColumns, ServoLog, ServoSetup

LAW = preset("feetech_sts3215")


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
    assert check(arm, found) >= 0.8
    for one in followed(found, arm.robot, logs):
        assert one.error < 1.5e-3, (one.joint, one.log, one.error)


@pytest.mark.battery
@pytest.mark.parametrize(("rate", "seed"), [(30.0, 1), (100.0, 2), (200.0, 3)])
def test_six_joints_are_found_together(tmp_path: Path, rate: float, seed: int) -> None:
    arm = drawn_arm(np.random.default_rng([11, 6, seed]), 6, LAW, tmp_path)
    assert (
        check(arm, answer(arm, arm_logs(arm, rate, (8.0, 16.0)))) >= 0.7
    )  # intervals of arms are too narrow: docs/servos.md
