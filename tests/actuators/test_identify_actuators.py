"""Actuators of known truth are found again, and what logs cannot tell is said."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.servo_arms import arm_log, drawn_arm
from servo_bench import PENDULUM, TRUE, parameters, virtual_logs

from dynident.actuators.drive_law import PRESETS, STATES, DriveLaw, preset
from dynident.actuators.estimate import JointActuator, read_actuators, write_actuators
from dynident.actuators.friction_choice import choose_friction
from dynident.actuators.identify import identify_actuators
from dynident.actuators.joint_fit import NO_LIMIT, JointData, JointFit, first_fit, fit_again
from dynident.actuators.joint_load import measured_loads, measured_motion, rigid_inertia
from dynident.actuators.linear_start import REST, start_rows
from dynident.actuators.output_error import ROUGH
from dynident.actuators.parameters import FRICTION_MODELS, PLACE, neutral
from dynident.actuators.rollout import record_of
from dynident.actuators.servo_log import ServoColumns, ServoLog, ServoSetup, with_slides
from dynident.actuators.verdict import Known
from dynident.actuators.virtual import ServoBench, virtual_log
from dynident.errors import EstimateFormatError, LogMismatch, NotConsistent, UnknownChoice
from dynident.exports.actuator_files import simulator_joint
from dynident.model.robot import Robot
from dynident.results.actuator_text import joint_warnings, parameter_table
from dynident.robot_files import read_robot

COLUMNS = ServoColumns(("joint1",))


def joint_of(robot: Robot, logs: list[ServoLog], law: DriveLaw | None = None) -> tuple[JointData, JointFit]:
    """Return the first joint in some logs and its first fit, of an STS3215 where no law is given."""
    law = law or preset("feetech_sts3215")
    motions, loads = [measured_motion(log) for log in logs], [measured_loads(robot, log)[0] for log in logs]
    parts = list(zip(logs, loads, motions, strict=True))
    records = tuple(record_of(log, 0, load, law) for log, load, _ in parts)
    rows = tuple(start_rows(log, 0, load, motion, law) for log, load, motion in parts)
    data = JointData("joint1", law, records, (), rows)
    return data, first_fit(data, "m1", ROUGH, lambda step: None)


def test_a_known_servo_is_found_again(robot: Robot, tmp_path: Path) -> None:
    """Gain, armature and friction within 3 %, delay within 1 ms; the file of the answer holds all of it."""
    logs = virtual_logs(robot, parameters())
    estimate = identify_actuators(robot, ServoSetup((preset("feetech_sts3215"),), COLUMNS, "m1"), logs[:3], logs[3:])
    joint = estimate.joint("joint1")
    for name in ("full_torque", "back_emf", "coulomb", "armature"):
        assert joint.value(name) == pytest.approx(TRUE[name], rel=0.03), name
    assert joint.value("viscous") == pytest.approx(TRUE["viscous"], abs=0.005)
    assert joint.value("delay") == pytest.approx(TRUE["delay"], abs=1e-3)
    assert np.isinf(joint.value("slew_limit"))
    labels = {one.name: one.label for one in joint.known}
    assert labels["full_torque"] == labels["armature"] == "identified"
    assert joint.mean_error(joint.test) < 2e-3
    assert any("kp 6" in remark and "extrapolation" in remark for remark in joint.remarks)
    write_actuators(estimate, tmp_path / "a.json")
    again = read_actuators(tmp_path / "a.json")
    assert np.array_equal(again.joints[0].parameters, joint.parameters) and again.joints[0].known == joint.known
    (tmp_path / "b.json").write_text("{}")
    with pytest.raises(EstimateFormatError, match="no estimate of actuators"):
        read_actuators(tmp_path / "b.json")


def test_roll_outs_that_do_not_follow_are_said_with_the_zero_that_fits(robot: Robot) -> None:
    """Positions that count from 2 rad beside the zero of the robot model; the true offset is 0.02 rad."""
    logs = [replace(log, q=log.q - 2.0, q_ref=log.q_ref - 2.0) for log in virtual_logs(robot, parameters())[:3]]
    joint = identify_actuators(robot, ServoSetup((preset("feetech_sts3215"),), COLUMNS, "m1"), logs).joints[0]
    (warning,) = joint_warnings(joint)
    found = re.search(r"^another zero: the weight fits about ([-.0-9]+) rad more", warning)
    assert found is not None and float(found[1]) == pytest.approx(2.02, abs=0.1)


@pytest.mark.parametrize(("beside", "is_told"), [(0.33, True), (0.0, False)])
def test_a_zero_beyond_what_an_angle_offset_makes_up_for_is_asked_for(
    beside: float, is_told: bool, robot: Robot
) -> None:
    """Roll-outs follow with other parameters; the true offset is 0.02 rad."""
    logs = [replace(log, q=log.q - beside, q_ref=log.q_ref - beside) for log in virtual_logs(robot, parameters())[:3]]
    joint = identify_actuators(robot, ServoSetup((preset("feetech_sts3215"),), COLUMNS, "m1"), logs).joints[0]
    assert any("state log: zero" in text for text in joint_warnings(joint)) == is_told


@pytest.mark.parametrize("stated", [9.81, 0.0])
def test_a_weight_of_the_robot_model_that_the_logs_do_not_show_is_said(stated: float, robot: Robot) -> None:
    """A joint without weight; with a robot model that knows it only a scale is asked for."""
    logs = virtual_logs(replace(robot, gravity=np.zeros(3)), parameters())[:2]
    model = replace(robot, gravity=np.array([0.0, 0.0, stated]))
    joint = identify_actuators(model, ServoSetup((preset("feetech_sts3215"),), COLUMNS, "m1"), logs).joints[0]
    told = joint_warnings(joint)
    assert any("no weight sets the scale" in text for text in told)
    assert any("hangs a weight of up to 1" in text for text in told) == (stated > 0.0)


def test_logs_that_saturate_throughout_and_times_in_ms_are_told(robot: Robot) -> None:
    """Gains of 2 and 6 are read as 2000 and 6000; by the gains as they are nothing of it is said."""
    logs = virtual_logs(robot, parameters())[:3]
    setup = ServoSetup((preset("feetech_sts3215"),), COLUMNS, "m1")
    with pytest.raises(LogMismatch, match=r"moves in 0 samples only \(logs of 0\.2.*unit of the time"):
        identify_actuators(robot, setup, [replace(log, time=1e3 * log.time) for log in logs])
    stated = [replace(log, kp=1e3 * log.kp) for log in logs]
    with pytest.raises(LogMismatch, match=r"samples of joint1 move without saturation; log slower .* lower kp"):
        identify_actuators(robot, setup, stated[:2])
    (warning,) = joint_warnings(identify_actuators(robot, setup, stated).joints[0])  # its last log has a free swing
    assert re.search(
        r"roll-outs miss \d+ % of the motion: by kp .* limit in \d+ % of it, by the torques it is", warning
    )
    assert not any(
        "roll-outs miss" in text for text in joint_warnings(identify_actuators(robot, setup, logs).joints[0])
    )


def test_saturation_between_the_gains_that_are_tried_first(robot: Robot) -> None:
    """A limit 10 % above the weight, in 6 % of quick moves: at the next power of two the weight would fall."""
    random, time = np.random.default_rng(3), np.arange(0.0, 14.0, 0.005)
    command, last, begin = np.zeros(len(time)), 0.0, 0.0
    while begin < time[-1]:
        seconds, hold, goal = random.uniform(0.3, 0.7), random.uniform(0.0, 0.5), random.uniform(-1.2, 1.2)
        share = np.clip((time - begin) / seconds, 0.0, 1.0)
        smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        command = np.where(time >= begin, last + (goal - last) * smooth, command)
        last, begin = goal, begin + seconds + hold
    true = parameters(full_torque=1.3, back_emf=0.1, viscous=0.01, armature=0.003, delay=0.02, angle_offset=0.0)
    bench = ServoBench(robot, preset("feetech_sts3215"), jitter_s=5e-4)
    log = virtual_log(bench, true, time, command, 36.0, np.ones(len(time), dtype=bool))
    setup = ServoSetup((preset("position_servo"),), COLUMNS, "m1")
    (joint,) = identify_actuators(robot, setup, [replace(log, kp=float("nan"))]).joints
    assert joint.has_torque and joint.value("full_torque") == pytest.approx(0.97 * 1.3, rel=5e-3)
    assert joint.stiffness(1.0) == pytest.approx(1.3 * 36.0 * 0.166, rel=0.01)
    assert not any("do not follow" in text for text in joint.remarks)


def test_a_log_that_is_unlike_the_others_is_named(robot: Robot) -> None:
    """A free swing whose column of the torque is lost; with the column nothing is said."""
    logs = virtual_logs(robot, parameters(), gains=(3.0, 6.0))[:5]
    setup = ServoSetup((preset("feetech_sts3215"),), COLUMNS, "m1")
    lost = [replace(log, enabled=np.ones_like(log.enabled)) for log in logs]
    told = joint_warnings(identify_actuators(robot, setup, lost).joints[0])
    assert any("do not follow 1 of 5 logs (virtual kp3 seed 2; up to" in text and "enabled" in text for text in told)
    assert not joint_warnings(identify_actuators(robot, setup, logs).joints[0])


def test_small_motions_count_and_held_joints_do_not(robot: Robot) -> None:
    """A log of a twentieth of the motion at a gain of its own; one of a held joint whose reading steps to and fro."""
    logs = virtual_logs(robot, parameters(), gains=(3.0, 6.0))
    time, count = logs[0].time, logs[0].samples
    command = 0.06 * np.sin(2 * np.pi * (0.3 + 0.12 * time) * time)
    bench = ServoBench(robot, preset("feetech_sts3215"))
    small = replace(virtual_log(bench, parameters(), time, command, 6.0, np.ones(count, dtype=bool)), name="small")
    steps = np.where(np.arange(count) // 100 % 2 == 0, 0.0, 2.0 * np.pi / 4096)[:, None]
    held = replace(small, name="held", q=steps, q_ref=np.zeros((count, 1)))
    setup = ServoSetup((preset("feetech_sts3215"),), COLUMNS, "m1")
    assert not joint_warnings(identify_actuators(robot, setup, [*logs, small, held]).joints[0])
    told = joint_warnings(identify_actuators(robot, setup, [*logs, replace(small, kp=3.0), held]).joints[0])
    assert any("do not follow 1 of 7 logs (small;" in text for text in told), told


def test_no_angle_offset_is_sought_where_no_weight_tells_it(robot: Robot) -> None:
    """The axis of the pendulum along gravity: the known inertia is no scale beside the armature, and both are said."""
    upright = robot.with_gravity([0.0, -9.81, 0.0])
    logs = virtual_logs(upright, parameters(angle_offset=0.0))
    setup = ServoSetup((preset("feetech_sts3215"),), COLUMNS, "m1")
    joint = identify_actuators(upright, setup, logs).joints[0]
    assert joint.value("angle_offset") == 0.0 and "angle_offset" not in {one.name for one in joint.known}
    inertia = 0.8 * 0.15**2 + 0.002
    per_inertia = joint.value("full_torque") / (inertia + joint.value("armature"))
    assert per_inertia == pytest.approx(TRUE["full_torque"] / (inertia + TRUE["armature"]), rel=0.01)
    labels = {one.name: one.label for one in joint.known}
    assert labels["full_torque"] == "not separable" and labels["delay"] == "identified"
    assert {labels[name] for name in ("armature", "coulomb", "viscous")} == {"known as a ratio"}
    damping = TRUE["viscous"] + TRUE["back_emf"]  # without a swing
    scale = TRUE["full_torque"] / joint.value("full_torque")
    for one in joint.known:
        if one.ratio is not None:  # with the torque held at its value; noise of the encoder's steps
            body = inertia if one.name == "armature" else 0.0
            truth = damping if one.name == "viscous" else TRUE[one.name]
            assert abs((truth + body) / scale - body - one.value) < 1.5 * one.ratio < 0.02 * (one.value + body)
    assert not any("offset" in warning for warning in joint_warnings(joint))


SLIDE = """<robot name="lift"><link name="base"/><link name="car"><inertial><mass value="2"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<joint name="lift" type="prismatic"><parent link="base"/><child link="car"/><axis xyz="0 0 1"/>
<limit lower="0" upper="0.3" effort="200" velocity="0.2"/></joint></robot>"""


def test_a_slide_that_is_slow_is_not_at_rest(tmp_path: Path) -> None:
    """Up to 18 mm/s over 60 mm, with an encoder of 5 micrometres: at such a speed a joint that turns rests."""
    (tmp_path / "lift.urdf").write_text(SLIDE)
    robot = read_robot(str(tmp_path / "lift.urdf"))
    true = parameters(full_torque=120.0, back_emf=0.0, viscous=400.0, coulomb=9.0, armature=8.0, angle_offset=0.0)
    law = preset("position_servo").stated({"error_gain": 60.0, "limit": 1.0, "kp": 1.0})
    bench, time, logs = ServoBench(robot, law, resolution=5e-6), np.arange(0.0, 8.0, 0.005), []
    for k, (size, rate) in enumerate(((0.03, 0.09), (0.01, 0.25), (0.003, 0.9))):
        command = 0.1 + size * np.sin(2.0 * np.pi * rate * time * (0.7 + 0.3 * time / 8.0))
        logs.append(virtual_log(bench, true, time, command, 1.0, seed=k))
    setup = ServoSetup((law,), ServoColumns(("lift",)), "m1")
    with pytest.raises(LogMismatch, match="lift moves in 0 samples only"):
        identify_actuators(robot, setup, logs)
    sized = with_slides(logs, [True])
    assert sized[0].sized(0, REST) < 2e-3
    joint = identify_actuators(robot, setup, sized).joints[0]
    assert joint.mean_error(joint.train) < 2e-5
    for name in ("full_torque", "coulomb", "viscous", "armature"):
        assert joint.value(name) == pytest.approx(true[PLACE[name]], rel=0.1), name


@pytest.mark.parametrize("stated", [(2.5, 0.25), (3.5, 0.2)], ids=["right", "wrong"])
@pytest.mark.parametrize("is_upright", [True, False], ids=["no weight", "weight"])
def test_a_stated_torque_is_the_scale_where_no_weight_is(
    robot: Robot, stated: tuple[float, float], is_upright: bool
) -> None:
    """Half widths contain that of the statement; beside a weight it is compared with what the logs say."""
    gravity = [0.0, -9.81, 0.0] if is_upright else [0.0, 0.0, -9.81]
    mine, law = robot.with_gravity(gravity), preset("feetech_sts3215").stated({"full_torque": stated})
    joint = identify_actuators(mine, ServoSetup((law,), COLUMNS, "m1"), virtual_logs(mine, parameters())[:3]).joints[0]
    is_right, told = stated[0] == 2.5, any("stated 3.5 +- 0.2" in text for text in joint_warnings(joint))
    assert told == (not is_right and not is_upright)
    assert joint.value("full_torque") == pytest.approx(stated[0] if is_upright else TRUE["full_torque"], rel=0.01)
    for one in joint.known:
        if one.name in TRUE and (is_right or not is_upright):
            truth = TRUE[one.name] + (TRUE["back_emf"] if is_upright and one.name == "viscous" else 0.0)
            assert abs(one.value - truth) < 1.2 * one.half_width, one
            wide = is_upright and one.name != "delay"
            assert (one.half_width > 0.05 * abs(one.value)) == wide or one.name == "angle_offset", one


@pytest.mark.parametrize("true_emf", [TRUE["back_emf"], 0.0], ids=["back-EMF", "viscous friction alone"])
def test_friction_that_grows_with_the_load_shows_back_emf_of_a_drive_that_is_never_off(
    robot: Robot, true_emf: float
) -> None:
    """Viscous friction takes nothing from the motor torque; where it is all of the damping that is known as a whole."""
    viscous = TRUE["viscous"] + TRUE["back_emf"] - true_emf
    true = parameters(back_emf=true_emf, viscous=viscous, load_motor=0.15, load_external=0.15)
    logs = [log for log in virtual_logs(robot, true) if log.enabled.all()]
    setup = ServoSetup((preset("feetech_sts3215"),), COLUMNS, "m3")
    joint = identify_actuators(robot, setup, logs).joints[0]
    for one in joint.known:
        truth, most = true[PLACE[one.name]], 1.3 * one.half_width
        assert abs(one.value - truth) <= most and (most < 0.04 * truth + 0.01 or one.label == "at its bound"), one
    labels, told = {one.name: one.label for one in joint.known}, joint_warnings(joint)
    assert labels["full_torque"] == labels["armature"] == labels["coulomb"] == "identified"
    assert (labels["back_emf"] == "identified") == (labels["viscous"] == "identified") == (not joint.combinations)
    assert (true_emf > 0.0) == (not joint.combinations)
    assert [text.startswith("damping is known only as a whole") for text in told] == [True] * len(joint.combinations)
    for one in joint.combinations:
        assert abs(one.value - 0.26) < 1.3 * one.half_width < 0.01


@pytest.mark.parametrize("known", [True, False], ids=["stated", "free"])
def test_the_damping_of_mit_mode_is_stated_or_found(robot: Robot, known: bool) -> None:
    """kp in N m/rad and kd in N m s/rad; without kd its torque would be taken for viscous friction."""
    law, kd = preset("mit"), 0.15
    true = parameters(full_torque=1.0, back_emf=0.0, damping_gain=kd)
    logs = virtual_logs(robot, true, law, gains=(2.0, 4.0))
    law = law.stated({"damping_gain": kd} if known else {"has_damping_gain": True})
    joint = identify_actuators(robot, ServoSetup((law,), COLUMNS, "m1"), logs).joints[0]
    assert joint.value("damping_gain") == pytest.approx(kd, rel=0.01)
    assert joint.value("viscous") == pytest.approx(TRUE["viscous"], rel=0.03)
    assert joint.value("full_torque") == pytest.approx(1.0, rel=0.01)
    assert ("damping_gain" in {one.name for one in joint.known}) != known


def test_a_slew_limit_of_the_drive_is_found(robot: Robot) -> None:
    logs = virtual_logs(robot, parameters(slew_limit=2.5), gains=(4.0,))
    setup = ServoSetup((preset("feetech_sts3215"),), COLUMNS, "m1")
    joint = identify_actuators(robot, setup, logs).joints[0]
    assert joint.value("slew_limit") == pytest.approx(2.5, rel=0.03)
    assert joint.value("full_torque") == pytest.approx(TRUE["full_torque"], rel=0.05)


@pytest.mark.parametrize("true", [2.5, np.inf], ids=["a limit", "none"])
def test_a_slew_limit_that_no_motion_reaches_is_none(robot: Robot, true: float) -> None:
    """From a limit that the motion feels and from one far out of its reach: kept where there is one, else left out."""
    data, fit = joint_of(robot, virtual_logs(robot, parameters(slew_limit=true), gains=(4.0,)))
    free = tuple(dict.fromkeys((*fit.free, "slew_limit")))
    for start in (2.0, 1.1 * NO_LIMIT * data.fastest):
        begun = fit.parameters.copy()
        begun[PLACE["slew_limit"]] = start
        found = fit_again(data, replace(fit, parameters=begun, free=free), 15)
        assert found.parameters[PLACE["slew_limit"]] == pytest.approx(true, rel=0.03)
        assert found.free == tuple(name for name in free if name != "slew_limit" or np.isfinite(true))


def test_a_log_that_holds_the_joint_has_no_error(robot: Robot) -> None:
    """Where the drive is off for a while it swings, and counts."""
    (chirp, _, drop), law = virtual_logs(robot, parameters(), gains=(4.0,)), preset("feetech_sts3215")
    load, still = measured_loads(robot, chirp)[0], np.full_like(chirp.q_ref, 0.4)
    held = [replace(chirp, name="held", q_ref=still), replace(drop, name="released", q_ref=still), chirp]
    assert [record_of(log, 0, load, law).is_held for log in held] == [True, False, False]
    setup = ServoSetup((law,), COLUMNS, "m1")
    estimate = identify_actuators(robot, setup, [chirp, drop], [held[0], drop])
    assert set(estimate.joints[0].test) == {drop.name}


def test_an_unknown_gain_without_saturation_is_not_separable(robot: Robot, tmp_path: Path) -> None:
    """Only the stiffness is known, and it is right; a swing of the free joint is missed, so damping is one sum."""
    logs = [log for log in virtual_logs(robot, parameters(), gains=(1.0, 1.5)) if log.enabled.all()]
    logs = [type(log)(**{**vars(log), "kp": float("nan")}) for log in logs[:1]]
    estimate = identify_actuators(robot, ServoSetup((preset("position_servo"),), COLUMNS, "m1"), logs)
    joint = estimate.joints[0]
    labels = {one.name: one.label for one in joint.known}
    assert labels["full_torque"] == "not separable"
    write_actuators(estimate, tmp_path / "a.json")
    assert read_actuators(tmp_path / "a.json").joints[0].combinations == joint.combinations
    known = {one.name: one for one in joint.combinations}
    for name, true in (("stiffness", 2.4 * 0.166), ("damping", 0.26)):
        assert known[name].value == pytest.approx(true, rel=0.05)
        assert abs(known[name].value - true) < known[name].half_width < 0.05 * true
    assert "saturates" in known["stiffness"].words
    assert known["damping"].value == pytest.approx(TRUE["viscous"] + TRUE["back_emf"], rel=0.05)
    assert "torque off" in known["damping"].words


@pytest.mark.parametrize("scale", [1.0, 100.0], ids=["kp of 2 and 6", "kp of 200 and 600"])
@pytest.mark.parametrize("saturates", [True, False])
def test_a_gain_in_any_unit_is_found_by_saturation(robot: Robot, scale: float, saturates: bool) -> None:
    """Nothing is known of the drive but kp: duty per rad, and torque at a duty that its limit counts as 1."""
    gains = (2.0, 6.0) if saturates else (1.0, 1.5)
    logs = [replace(log, kp=scale * log.kp) for log in virtual_logs(robot, parameters(), gains=gains)]
    joint = identify_actuators(robot, ServoSetup((preset("position_servo"),), COLUMNS, "m1"), logs).joints[0]
    known = {one.name: one for one in joint.known}
    assert joint.mean_error(joint.train) < 5e-4
    if saturates:
        assert known["full_torque"].value == pytest.approx(0.97 * TRUE["full_torque"], rel=2e-3)
        assert known["gain_ratio"].value == pytest.approx(0.166 / 0.97 / scale, rel=2e-3)
        limited = [one.enabled & (one.kp / scale * 0.166 * np.abs(one.q_ref - one.q) > 0.97) for one in logs]
        assert joint.saturated == pytest.approx(np.mean(limited), abs=0.01) and joint.saturated > 0.02
    else:
        assert known["full_torque"].label == "not separable" and "gain_ratio" not in known
        assert joint.combinations[0].value == pytest.approx(2.4 * 0.166 / scale, rel=5e-3)
        assert [row[3] for row in parameter_table(joint).rows][-1] == "N\N{MIDDLE DOT}m/rad per unit of kp"
    assert simulator_joint(joint, 4.0 * scale).stiffness == pytest.approx(2.4 * 0.166 * 4.0, rel=5e-3)


def test_a_linear_start_that_is_far_off_is_no_saturation(tmp_path: Path) -> None:
    """Joint 1 of an arm at 30 Hz: the start with a limited duty is nearer, the output error is not."""
    random = np.random.default_rng([11, 3, 12])
    arm = drawn_arm(random, 3, preset("feetech_sts3215"), tmp_path)
    time = np.arange(0.0, 6.0, 1.0 / 30.0)
    beats = 0.2 + 0.05 * np.arange(3) + 0.04 * time[:, None]
    commands = [size * np.sin(2 * np.pi * beats * time[:, None]) for size in (0.4, 0.24)]
    always = np.ones(len(time), dtype=bool)
    logs = [replace(arm_log(arm, time, command, 4.0, always), kp=1.0) for command in commands]
    _, fit = joint_of(arm.robot, logs, preset("position_servo").without_gain)
    assert fit.ratio == 1.0 and "gain_ratio" not in fit.free
    assert fit.parameters[PLACE["full_torque"]] == pytest.approx(4 * 0.166 * arm.true[0, 1], rel=0.02)


def test_frictions_are_compared_from_the_fit_where_the_linear_start_is_farther_off(robot: Robot) -> None:
    """From a linear start under other loads fits of simple friction may end beside the answer, and lose."""
    data, fit = joint_of(robot, virtual_logs(robot, parameters())[:3])
    wrong, off = [replace(one, target=-one.target, fixed={}) for one in data.rows], data.motion_seconds()[:, 1]
    begun = data.train, wrong, data.law, fit.scanned, off
    beside, there = choose_friction(*begun, neutral())[1], choose_friction(*begun, fit.parameters)
    assert there[0] == "m1" and there[1]["m1"] < 1e-3 < 5e-3 < beside["m1"]


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("load", [0.0, 0.15], ids=["m1", "m3"])
def test_friction_is_chosen_by_the_logs_in_which_the_joint_moves(robot: Robot, load: float) -> None:
    """Of a joint that rests while others move the error is 0, by any friction; nor does the only free swing count."""
    true = parameters(load_motor=load, load_external=load)
    moving = virtual_logs(robot, true, gains=(4.0,)) + virtual_logs(robot, true, gains=(4.0,), seed=1)[:2]
    still = np.zeros_like(moving[0].q)
    held = [replace(moving[0], name=f"held {k}", q=still, q_ref=still) for k in range(2)]
    setup = ServoSetup((preset("feetech_sts3215"),), COLUMNS, "auto")
    joint = identify_actuators(robot, setup, [*held, *moving]).joints[0]
    assert ("load_motor" in FRICTION_MODELS[joint.friction].free) == (load > 0.0) and joint.friction != "m2"
    assert 1e-4 < joint.folds[joint.friction] < 1e-3 and all(value > 1e-4 for value in joint.folds.values())


def test_a_robot_model_without_inertias_is_named(tmp_path: Path, robot: Robot) -> None:
    (tmp_path / "bare.urdf").write_text(
        '<robot name="bare"><link name="a"/><link name="b"/><joint name="joint1" type="revolute"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>'
    )
    logs = virtual_logs(robot, parameters(), gains=(4.0,))
    setup = ServoSetup((preset("feetech_sts3215"),), COLUMNS, "m1")
    with pytest.raises(NotConsistent, match=r"no inertias; .*add inertial elements to the links .*are ratios"):
        identify_actuators(read_robot(str(tmp_path / "bare.urdf")), setup, logs)
    tip = '<link name="tip"/><joint name="joint2" type="revolute"><parent link="arm"/><child link="tip"/>'
    tip += '<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>'
    (tmp_path / "part.urdf").write_text(PENDULUM.replace("</robot>", tip))
    with pytest.raises(NotConsistent, match=r"no inertia of tip; .*add inertial elements"):
        rigid_inertia(read_robot(str(tmp_path / "part.urdf")))
    (tmp_path / "light.urdf").write_text(PENDULUM.replace('mass value="0.8"', 'mass value="0"'))
    with pytest.raises(NotConsistent, match=r"no masses; .*add inertial elements"):
        identify_actuators(read_robot(str(tmp_path / "light.urdf")), setup, logs)


def test_every_preset_says_where_its_fields_are_known_from() -> None:
    assert len(PRESETS) >= 6
    for law in PRESETS.values():
        assert law.words and all(one.state in STATES for one in law.known.values())
        assert all(one.source for one in law.known.values() if one.state != "unknown")
    with pytest.raises(UnknownChoice, match="did you mean 'dynamixel_xl330'"):
        preset("dynamixel_xl33")


@pytest.mark.parametrize("name", ["delay", "armature"])
def test_a_parameter_that_no_servo_has_at_zero_is_a_warning_there(name: str) -> None:
    """Not so inside of its bounds, and not for friction, which may be zero; where the search stopped is shown as 0."""

    def warned(value: float, label: str, which: str = name) -> bool:
        known = (Known(which, value, np.inf, label),)
        joint = JointActuator(
            "j", preset("mit"), (), "m1", parameters(**{which: value}), known, (), parameters(), parameters(),
            {}, {}, {}, {}, 0.0,
        )  # fmt: skip
        shown = parameter_table(joint).rows[0][1]
        assert (shown == "0") == (label == "at its bound")
        return any("ended at its bound 0" in line and which in line for line in joint_warnings(joint))

    assert warned(1e-9, "at its bound")
    assert not warned(0.004, "identified")
    assert not warned(0.0, "at its bound", "coulomb")
