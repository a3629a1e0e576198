"""Rotor inertias that a case leaves out, and what looks like one: a joint's delay, a wrong axis of the robot model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults.injections import sprung
from benchmarks.faults.trials import Trial, subject_of, virtual

import dynident as di
from dynident.case.case import Case, read_case
from dynident.model.joint import rotation_about

ROTORS = np.array([0.8, 0.6, 0.3, 0.12, 0.08, 0.05])


@pytest.fixture(scope="module")
def six(tmp_path_factory: pytest.TempPathFactory) -> Case:
    path = tmp_path_factory.mktemp("case") / "case.yaml"
    path.write_text("case: 2\nrobot: generic-6r\nfriction: [coulomb, viscous, offset]\n")
    case = read_case(path)
    bare = {joint.name: replace(joint.drive, rotor_inertia=0.0) for joint in case.robot.active}
    return replace(case, robot=case.robot.with_drives(bare))


def with_rotors(trial: Trial, rotors: np.ndarray) -> Trial:
    """Return a log with rotors behind gears, by the derivative of its velocities."""
    ddq = np.gradient(trial.columns["dq"], trial.columns["t"], axis=0)
    return trial.with_columns(tau=trial.columns["tau"] + rotors * ddq)


@pytest.mark.parametrize("seed", [0, 1])
def test_rotors_that_a_case_leaves_out_are_named_with_their_inertia(seed: int, six: Case, tmp_path: Path) -> None:
    trial = with_rotors(virtual(six, seed), ROTORS)
    found = trial.examined(tmp_path).findings
    told = {one.joint: one for one in found if one.name == "rotor inertia"}
    names = six.robot.joint_names
    assert set(names[3:]) <= set(told) and not [one for one in found if one.severity == "error"]
    for name in names[3:]:
        assert abs(told[name].numbers["value"] - ROTORS[names.index(name)]) < told[name].numbers["half_width"] + 0.01
        assert "add rotor_inertia to friction:" in told[name].remedy
    assert not [one for one in found if one.name in ("spring", "counterbalance")]


@pytest.mark.parametrize("stated", [True, False])
def test_nothing_is_said_of_rotors_that_are_stated_or_not_there(stated: bool, six: Case, tmp_path: Path) -> None:
    case = replace(six, friction=(*six.friction, di.FRICTION.make("rotor_inertia"))) if stated else six
    trial = replace(with_rotors(virtual(six, 0), ROTORS * stated), case=case)
    assert "rotor inertia" not in [one.name for one in trial.examined(tmp_path).findings]


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("stated", [(0, 1, 2), pytest.param((1, 4), marks=pytest.mark.battery)])
def test_a_joint_whose_rotor_a_case_lacks_is_named_where_others_have_theirs(
    stated: tuple[int, ...], known: bool, six: Case, tmp_path: Path
) -> None:
    """Known inertias of drives, or those of a part of friction at some joints."""
    trial, names = with_rotors(virtual(six, 0), ROTORS), six.robot.joint_names
    if known:
        drives = {names[k]: replace(six.robot.active[k].drive, rotor_inertia=ROTORS[k], gear_ratio=1.0) for k in stated}
        case = replace(six, robot=six.robot.with_drives(drives))
    else:
        part = di.FRICTION.make("rotor_inertia", {"joints": [names[k] for k in stated]})
        case = replace(six, friction=(*six.friction, part))
    told = {one.joint: one for one in replace(trial, case=case).examined(tmp_path).findings if "rotor" in one.name}
    for k in range(3, 6):
        if k in stated:
            continue
        numbers = told[names[k]].numbers
        assert abs(numbers["value"] - ROTORS[k]) < numbers["half_width"] + 0.01
        assert f"add rotor_inertia: {{joints: [{names[k]}]}} to friction:" in told[names[k]].remedy
    assert not {names[k] for k in stated} & set(told)


def early(trial: Trial, joint: int, seconds: float) -> Trial:
    """Return a log in which the torque of a joint comes earlier than those of the others."""
    step = round(seconds / (trial.columns["t"][1] - trial.columns["t"][0]))
    tau = trial.columns["tau"].copy()
    tau[:, joint] = np.roll(tau[:, joint], -step)
    return trial.with_columns(tau=tau).rows(np.arange(abs(step), len(tau) - abs(step)))


@pytest.mark.parametrize("seconds", [0.06, -0.06])
@pytest.mark.parametrize("joint", [0, 2])
def test_a_torque_that_comes_early_is_a_delay_of_its_joint(
    joint: int, seconds: float, six: Case, tmp_path: Path
) -> None:
    """It passed for a rotor inertia: a lead of the acceleration's own torque. Viscous friction that leads as well is as
    much more of it, and made 66 ms of 60."""
    found = early(virtual(six, 0), joint, seconds).examined(tmp_path).findings
    (delay,) = [one for one in found if one.name == "torque delay"]
    assert delay.joint == six.robot.joint_names[joint]
    assert abs(delay.numbers["value"] + seconds) < delay.numbers["half_width"] < 0.002
    assert "rotor inertia" not in [one.name for one in found]


@pytest.mark.parametrize("seconds", [0.06, -0.06])
def test_a_torque_of_a_light_wrist_that_comes_early_is_no_rotor_inertia(
    seconds: float, six: Case, tmp_path: Path
) -> None:
    """Nearly all of it is friction, which then turns before or after the velocity does."""
    found = early(virtual(six, 0), 5, seconds).examined(tmp_path).findings
    assert "rotor inertia" not in [one.name for one in found]
    assert ("friction curve", six.robot.joint_names[5]) in [(one.name, one.joint) for one in found]


def with_axis_off(trial: Trial, place: int, degrees: float = 0.0, metres: float = 0.0) -> Trial:
    """Return a log with a robot model whose frame of a link is turned about its x axis, or displaced."""
    joints = list(trial.case.robot.joints)
    turn = rotation_about(np.array([1.0, 0.0, 0.0]), np.radians(degrees))
    shift = metres * np.array([2.0, 1.0, 0.0]) / np.sqrt(5.0)
    old = joints[place]
    joints[place] = replace(old, rotation=old.rotation @ turn, translation=old.translation + shift)
    return replace(trial, case=replace(trial.case, robot=replace(trial.case.robot, joints=tuple(joints))))


@pytest.mark.parametrize(
    ("place", "degrees"), [(1, 5.0), pytest.param(2, 15.0, marks=pytest.mark.battery), pytest.param(3, 5.0)]
)
def test_a_wrong_frame_of_the_robot_model_is_no_rotor_inertia(
    place: int, degrees: float, six: Case, tmp_path: Path
) -> None:
    found = with_axis_off(virtual(six, 0), place, degrees).examined(tmp_path).findings
    (frame,) = [one for one in found if one.name == "link frame"]
    names = six.robot.joint_names
    assert frame.severity == "warning" and frame.joint.split(", ")[0] == names[place]
    assert abs(frame.numbers[f"angle_deg {names[place]}"] - degrees) < 0.15 * degrees
    assert not [one for one in found if one.name in ("rotor inertia", "spring", "counterbalance", "inconsistent links")]


def test_rotors_stay_named_beside_a_wrong_frame(six: Case, tmp_path: Path) -> None:
    trial = with_axis_off(with_rotors(virtual(six, 0), ROTORS), 1, 5.0)
    found = trial.examined(tmp_path).findings
    told, names = {one.joint: one for one in found if one.name == "rotor inertia"}, six.robot.joint_names
    assert "link frame" in [one.name for one in found] and names[1] not in told
    assert abs(told[names[5]].numbers["value"] - ROTORS[5]) < told[names[5]].numbers["half_width"]


def test_a_displaced_axis_is_no_counterbalance(six: Case, tmp_path: Path) -> None:
    found = with_axis_off(virtual(six, 0), 1, metres=0.05).examined(tmp_path).findings
    (frame,) = [one for one in found if one.name == "link frame"]
    assert frame.joint == six.robot.joint_names[1]
    assert abs(frame.numbers[f"distance_m {frame.joint}"] - 0.05) < 0.01
    assert "counterbalance" not in [one.name for one in found]


def test_what_explains_as_well_as_a_cause_that_is_sure_beside_axes_stands_beside_them_as_well(
    six: Case, tmp_path: Path
) -> None:
    """Over a short way a spring is a counterbalance; of what an axis explains as well, nothing stands."""
    trends = subject_of(sprung(virtual(six, 0), 0.4, 3), tmp_path).trends
    assert trends is not None
    (spring,) = [blame for blame in trends.blames if blame.cause.name == "spring"]
    (other,) = [one for one in trends.causes if (one.name, one.joint) == ("counterbalance", spring.cause.joint)]
    for name, stands in (("counterbalance", True), ("turned axis", False)):
        trends.__dict__["_beside_frames"] = (
            replace(spring, cause=replace(other, name=name), rivals=(replace(spring, rivals=()),)),
        )
        assert trends.is_sure_beside_frames(spring.cause) == stands


def turntable(tmp_path: Path, factor: float, horizontal: bool = False) -> list[str]:
    """Return what is told of one joint with a rotor of ``factor`` less 1 times the inertia of its link.

    About a horizontal axis the link has weight as well, and all of its torque is ``factor`` times as large.
    """
    axis = "0 1 0" if horizontal else "0 0 1"
    (tmp_path / "one.urdf").write_text(
        f'''<robot name="one"><link name="base"/><link name="plate"><inertial><origin xyz="0.3 0 0"/><mass value="4"/>
        <inertia ixx="0.05" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="turn"
        type="revolute"><parent link="base"/><child link="plate"/><axis xyz="{axis}"/><limit lower="-3" upper="3"
        effort="500" velocity="5"/></joint></robot>'''
    )
    (tmp_path / "one.yaml").write_text("case: 2\nrobot: one.urdf\nfriction: [coulomb, viscous, offset]\n")
    t, noise = np.arange(4000) / 200, np.random.default_rng(0)
    q = 0.6 * np.sin(0.9 * t) + 0.5 * np.sin(2.3 * t + 1.0) + 0.2 * np.sin(4.1 * t + 2.0)
    dq, ddq = (np.gradient(np.gradient(q, t), t) if k else np.gradient(q, t) for k in range(2))
    tau = factor * (0.46 * ddq - 11.77 * horizontal * np.cos(q)) + 0.5 * np.tanh(dq / 0.01) + 0.2 * dq
    tau += 0.01 * tau.std() * noise.normal(size=len(t))
    trial = Trial(read_case(tmp_path / "one.yaml"), {"t": t, "q": q[:, None], "tau": tau[:, None]})
    return [one.name for one in trial.examined(tmp_path).findings if one.severity != "note"]


@pytest.mark.parametrize("factor", [3.0, 8.0])
def test_a_rotor_of_an_axis_without_weight_is_no_unit_of_its_torque(factor: float, tmp_path: Path) -> None:
    """A torque that is a thousand times too large is one, and so is one that holds a weight."""
    assert turntable(tmp_path, factor) == []
    assert turntable(tmp_path, 1000.0) == turntable(tmp_path, factor, horizontal=True) == ["torque unit"]
