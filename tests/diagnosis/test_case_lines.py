"""The line of the case file that a finding about a sign or scale names: it is valid, and obeying it mends the log."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from benchmarks.faults import injections as put
from benchmarks.faults.trials import Trial, virtual

from dynident.case.case import Case, read_case
from dynident.data.formats import ColumnMap, Units
from dynident.data.preprocessing import default_preprocessing
from dynident.diagnosis.case_lines import with_case_line
from dynident.diagnosis.finding import Finding, Severity
from dynident.model.friction import FRICTION, default_friction
from dynident.model.joint import Drive
from dynident.model.robot import Robot


@pytest.fixture(scope="module")
def trial(case: Case) -> Trial:
    return virtual(case, rate=50.0)


@pytest.fixture(scope="module")
def er16_trial() -> Trial:
    return virtual(read_case("er16"))


def told_units(finding: Finding) -> dict[str, list[str]]:
    """Return the units that a remedy states, as YAML reads them."""
    found = re.search(r"log: units: (\{.*?\})", finding.remedy)
    assert found, finding.remedy
    return yaml.safe_load(found[1])


@pytest.mark.parametrize(("names", "joint"), [(("tau",), 0), (("tau",), 2), (("q", "dq"), 1)])
def test_a_sign_is_mended_by_the_line_that_is_named(
    trial: Trial, names: tuple[str, ...], joint: int, tmp_path: Path
) -> None:
    faulty = put.turned(trial, names, joint)
    errors = [one for one in faulty.examined(tmp_path).findings if one.severity == "error"]
    units = told_units(errors[0])
    assert set(units) == ({"torque"} if names == ("tau",) else {"position", "velocity"})
    assert all(word.startswith("-") == (k == joint) for words in units.values() for k, word in enumerate(words))
    mended = put.declared(faulty, **{key: tuple(words) for key, words in units.items()})
    assert not [one for one in mended.examined(tmp_path).findings if one.severity != "note"]


def test_a_scale_is_mended_by_the_line_that_is_named(er16_trial: Trial, tmp_path: Path) -> None:
    faulty = put.scaled(er16_trial, 1.5, 2)
    (error,) = [one for one in faulty.examined(tmp_path).findings if one.severity == "error"]
    words = told_units(error)["torque"]
    assert [word for k, word in enumerate(words) if k != 2] == ["N m"] * 5
    assert float(words[2].split()[0]) == pytest.approx(0.4, rel=0.05)
    mended = put.declared(faulty, torque=tuple(words)).examined(tmp_path)
    assert not [one for one in mended.findings if one.severity != "note"]


def test_a_vertical_slide_that_counts_the_other_way_is_told(scara: Robot, tmp_path: Path) -> None:
    """An offset takes its weight in, so that fits are as good; weight that is balanced, or lighter, is no fault."""
    friction = tuple(FRICTION.make(name) for name in default_friction())
    case = Case(scara, friction, ColumnMap(joints=scara.joint_names), default_preprocessing())
    right = virtual(case, rate=50.0)
    assert not [one for one in right.examined(tmp_path).findings if one.severity == "error"]
    weight = float(right.columns["tau"][:, 2].mean())
    assert weight == pytest.approx(1.6 * 9.81, rel=0.3)
    for share in (0.6, 1.3):  # a counterweight
        tau = right.columns["tau"].copy()
        tau[:, 2] -= share * weight
        assert not [one for one in right.with_columns(tau=tau).examined(tmp_path).findings if one.severity == "error"]
    drives = {scara.joint_names[2]: Drive(bias=1.7 * weight)}
    stated = replace(right, case=replace(case, robot=scara.with_drives(drives)))
    tau[:, 2] = right.columns["tau"][:, 2] - 1.7 * weight  # as the case says
    assert not [one for one in stated.with_columns(tau=tau).examined(tmp_path).findings if one.severity == "error"]
    unstated = right.with_columns(tau=tau).examined(tmp_path)
    (error,) = [one for one in unstated.findings if one.severity == "error"]
    told = float(error.remedy.partition("bias: ")[2].partition("}")[0])
    assert error.name == "axis sign" and told == pytest.approx(1.7 * weight, rel=0.1)
    drives = {scara.joint_names[2]: Drive(bias=-1.7 * weight)}  # stated the other way round: told to turn it
    turned = replace(right, case=replace(case, robot=scara.with_drives(drives))).with_columns(tau=tau)
    (error,) = [one for one in turned.examined(tmp_path).findings if one.severity == "error"]
    told = float(error.remedy.partition("bias: ")[2].partition("}")[0])
    assert error.name == "axis sign" and told == pytest.approx(1.7 * weight, rel=0.1)
    faulty = put.turned(right, ("q", "dq", "tau"), 2)
    (error,) = [one for one in faulty.examined(tmp_path).findings if one.severity == "error"]
    assert (error.name, error.joint) == ("axis sign", scara.joint_names[2])
    units = told_units(error)
    assert units["torque"] == ["N m", "N m", "-N", "N m"] and units["position"] == ["rad", "rad", "-m", "rad"]
    mended = put.declared(faulty, **{key: tuple(words) for key, words in units.items()})
    assert not [one for one in mended.examined(tmp_path).findings if one.severity != "note"]


def finding(name: str, joint: str, severity: Severity = "error", **numbers: float) -> Finding:
    return Finding(severity, name, joint, "evidence", "check the column", numbers)


def test_the_units_of_the_case_are_counted_anew(planar_2r: Robot) -> None:
    names = planar_2r.joint_names
    columns = ColumnMap(
        joints=names, q=("a", "b"), torque=("c", "d"), rated=(10.0, 20.0), units=Units(torque=("percent", "-permille"))
    )
    assert "torque: [percent, permille]" in with_case_line(finding("torque sign", names[1]), columns, planar_2r).remedy
    scaled = with_case_line(finding("torque scale", names[0], factor=0.5), columns, planar_2r).remedy
    assert "check the column; " in scaled and "torque: [0.5 percent, -permille]" in scaled
    one_turned = with_case_line(finding("position sign", names[1]), columns, planar_2r).remedy
    assert "position: [rad, -rad]" in one_turned and "velocity" not in one_turned  # no velocities are read


def test_zeros_turn_with_the_signs_and_motors_have_no_line(coupled_arm: Robot, planar_2r: Robot) -> None:
    names = planar_2r.joint_names
    columns = ColumnMap(joints=names, q=("a", "b"), torque=("c", "d"), zero=(0.3, -0.2))
    remedy = with_case_line(finding("position sign", names[1]), columns, planar_2r).remedy
    assert "position: [rad, -rad]}; log: zero: [0.3, 0.2]" in remedy
    assert "zero" not in with_case_line(finding("torque sign", names[1]), columns, planar_2r).remedy
    motors = ColumnMap(joints=coupled_arm.joint_names, q=("a", "b", "c"), torque=("d", "e", "f"), motor=("q", "torque"))
    for name in ("torque sign", "position sign"):
        one = finding(name, coupled_arm.joint_names[0])
        assert with_case_line(one, motors, coupled_arm) is one


def test_zeros_of_several_joints_stand_in_one_line(planar_2r: Robot) -> None:
    """Pasting the line of the second finding had undone that of the first."""
    names = planar_2r.joint_names
    columns = ColumnMap(joints=names, q=("a", "b"), torque=("c", "d"), zero=(0.3, -0.2))
    both = [finding("position zero", name, value=value) for name, value in zip(names, (-0.1, 0.05), strict=True)]
    for one in both:
        assert "log: zero: [0.2, -0.15]" in with_case_line(one, columns, planar_2r, both).remedy
    assert "log: zero: [0.2, -0.2]" in with_case_line(both[0], columns, planar_2r).remedy


def test_a_scale_of_positions_is_counted_from_the_stated_zero_or_by_the_gear(planar_2r: Robot) -> None:
    names = planar_2r.joint_names
    columns = ColumnMap(joints=names, q=("a", "b"), torque=("c", "d"), zero=(0.3, -0.2))
    one = finding("position scale", names[1], value=0.25)
    remedy = with_case_line(one, columns, planar_2r).remedy
    assert "(log: units: {position: [rad, 1.25 rad]})" in remedy and "zero" not in remedy
    geared = planar_2r.with_drives({names[1]: Drive(gear_ratio=-100.0)}, planar_2r.coupling)
    motors = with_case_line(one, replace(columns, motor=("q",)), geared).remedy
    assert f"(drives: {{{names[1]}: {{gear_ratio: -80}}}})" in motors


def test_units_are_stated_for_all_joints_of_a_kind_with_their_signs(scara: Robot, planar_2r: Robot) -> None:
    columns = ColumnMap(
        joints=scara.joint_names, q=tuple("abcd"), dq=tuple("efgh"), torque=(),
        units=Units(position=("rad", "-rad", "-m", "0.1 deg")),
    )  # fmt: skip
    names = scara.joint_names
    degrees = with_case_line(finding("positions in degrees", names[0]), columns, scara)
    assert degrees.remedy == "state the unit in the case file (log: units: {position: [deg, -deg, -m, deg]})"
    slides = with_case_line(finding("positions in millimetres", names[2]), columns, scara)
    assert "{position: [rad, -rad, -mm, 0.1 deg]}" in slides.remedy
    speeds = with_case_line(finding("velocity unit", names[2], ratio=1001.0), columns, scara)
    assert "{velocity: [rad/s, rad/s, mm/s, rad/s]}" in speeds.remedy
    plain = ColumnMap(joints=planar_2r.joint_names, q=("a", "b"), torque=("c", "d"))
    assert (
        "{velocity: deg/s}"
        in with_case_line(finding("velocity unit", planar_2r.joint_names[0], ratio=57.3), plain, planar_2r).remedy
    )


def test_a_slide_that_only_lowers_has_no_axis_sign(scara: Robot, tmp_path: Path) -> None:
    """Its friction is no other than a weight; nor does a slide of twelve metres count in millimetres."""
    friction = tuple(FRICTION.make(name) for name in default_friction())
    joints = tuple(replace(one, friction=25.0) if one.kind == "prismatic" else one for one in scara.joints)
    robot = replace(scara, joints=joints)
    case = Case(robot, friction, ColumnMap(joints=robot.joint_names), default_preprocessing())
    right = virtual(case, rate=50.0)
    t, q, tau = (right.columns[name].copy() for name in ("t", "q", "tau"))
    q[:, 2] = -0.02 * t + 1e-3 * np.sin(2.0 * t)
    tau[:, 2] = -25.0 + 1.6 * 9.81
    lowered = right.with_columns(q=q, tau=tau).without("dq").examined(tmp_path)
    assert "axis sign" not in [one.name for one in lowered.findings]
    q[:, 2] = 6.0 * np.sin(0.3 * t)
    assert "positions in millimetres" not in [
        one.name for one in right.with_columns(q=q).without("dq").examined(tmp_path).findings
    ]


def test_currents_have_their_gains_turned_and_doubts_have_no_line(planar_2r: Robot) -> None:
    names = planar_2r.joint_names
    columns = ColumnMap(joints=names, q=("a", "b"), torque=(), current=("c", "d"))
    one = finding("torque sign", names[0])
    assert with_case_line(one, columns, planar_2r) is one  # no gain to turn is stated
    drives = tuple(replace(joint, drive=replace(joint.drive, gain=11.1)) for joint in planar_2r.joints)
    robot = replace(planar_2r, joints=drives)
    assert f"drives: {{{names[0]}: {{gain: -11.1}}}}" in with_case_line(one, columns, robot).remedy
    for doubt in (
        finding("torque scale", names[0], "warning", factor=0.5),
        finding("torque scale", ", ".join(names), factor=0.5),
        finding("spikes", names[0]),
    ):
        assert with_case_line(doubt, columns, robot) is doubt


@pytest.mark.parametrize(("joint", "is_deg"), [(0, False), (4, False), (4, True)])
def test_the_unit_of_one_position_is_mended_by_the_line_that_is_named(
    er16_trial: Trial, joint: int, is_deg: bool, tmp_path: Path
) -> None:
    right = er16_trial.without("dq")
    units = ["rad"] * 6
    if is_deg:
        q = right.columns["q"].copy()
        q[:, joint] = np.rad2deg(q[:, joint])
        faulty = right.with_columns(q=q)
    else:
        units[joint] = "deg"
        faulty = put.declared(right, position=tuple(units))
    errors = [one for one in faulty.examined(tmp_path).findings if one.severity == "error"]
    assert errors[0].name in ("position unit", "positions in degrees")
    assert errors[0].joint == right.case.robot.joint_names[joint]
    units[joint] = "deg" if is_deg else "rad"
    assert told_units(errors[0]) == {"position": units if is_deg else "rad"}
    mended = put.declared(faulty, position=tuple(units)).examined(tmp_path)
    assert not [one for one in mended.findings if one.severity != "note"]
