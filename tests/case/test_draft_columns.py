"""What names of columns say, which columns belong together, and which profile a header fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.case.draft.column_groups import groups_of
from dynident.case.draft.column_words import WORDS, Meaning, meaning_of, split_unit, tokens_of
from dynident.case.draft.joint_choice import without_positions
from dynident.case.draft.profile_fit import equally_good, fitting_profiles
from dynident.case.draft.signal_choice import choose_signals
from dynident.case.draft.signal_units import position_factors, position_unit
from dynident.case.draft.time_columns import time_columns, time_unit, unit_of_time
from dynident.case.draft.yaml_words import plain, quoted
from dynident.case.questions import MARK, check_answered, questions_in
from dynident.data.profiles import PROFILES
from dynident.errors import DescriptionError
from dynident.robot_files import read_robot
from dynident.robot_files.strict_yaml import load_yaml

UR = tuple(f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"))
PANDA = tuple(f"panda_joint{k}" for k in range(1, 8))


def meaning(name: str) -> Meaning:
    base, unit = split_unit(name)
    words = tokens_of(base)
    return meaning_of([w for w in words if not w.isdigit()], unit, at_end=not words[-1].isdigit())


@pytest.mark.parametrize(
    ("name", "signal", "kind", "side", "unit"),
    [
        ("q1", "q", "", "", ""),
        ("actual_qd_0", "dq", "measured", "", ""),
        ("q_d[3]", "q", "commanded", "", ""),
        ("dq_d[3]", "dq", "commanded", "", ""),
        ("tau_J_d[3]", "torque", "commanded", "", ""),
        ("tau_ext_hat_filtered[0]", "torque", "model", "", ""),
        ("target_moment_0", "torque", "commanded", "", ""),
        ("actual_current_as_torque_0", "torque", "measured", "", ""),
        ("current_position_3", "q", "", "", ""),
        ("torque_current_2", "current", "", "", ""),
        ("taum4", "torque", "", "motor", ""),
        ("motor_position_2", "q", "", "motor", ""),
        ("Joint 2 Velocity [deg/s]", "dq", "", "", "deg/s"),
        ("Torque 1 (Nm)", "torque", "", "", "N m"),
        ("i2_mA", "current", "", "", "mA"),
        ("q1_rad", "q", "", "", "rad"),
        ("MACur.A1", "current", "", "", ""),
        ("joint_temperatures_0", "temperature", "", "", ""),
        ("position_error_1", "", "", "", ""),
        ("tcp_pos_1", "", "", "", ""),
        ("ddq1", "ddq", "", "", ""),
        ("speed_scaling", "dq", "", "", ""),
        ("theta3_dot", "dq", "", "", ""),
        ("q_dot_1", "dq", "", "", ""),
        ("q1_ddot", "ddq", "", "", ""),
        ("joint_tor_0", "torque", "", "", ""),
        ("τ0", "torque", "", "", ""),
        ("qDes2", "q", "commanded", "", ""),
        ("GRP[1]J2 Disturbance Torque(Nm)", "torque", "model", "", "N m"),
        ("tau_slave_interaction_1", "torque", "model", "", ""),
        ("tau2_mNm", "torque", "", "", "mN m"),
        ("angle 2 in deg", "q", "", "", "deg"),
        ("right_arm_joint_2_eff", "torque", "", "", ""),
        ("Istposition A1 [deg]", "q", "measured", "", "deg"),
        ("Istposition A1 [Grad]", "q", "measured", "", "deg"),
        ("Motorstrom A1 [%]", "current", "", "motor", "percent"),
        ("Gelenkmoment 2", "torque", "", "", ""),
        ("Achsgeschwindigkeit_3", "dq", "", "", ""),
        ("actuator_force4", "torque", "", "", ""),
        ("qfrc_actuator2", "torque", "", "", ""),
        ("contact_force_2", "torque", "model", "", ""),
        ("Zeitstempel [ms]", "time", "", "", "ms"),
        ("EgmTime_ms", "", "", "", "ms"),
        ("J1_motor_torque_pct", "torque", "", "motor", "percent"),
        ("Sollwinkel 3", "q", "commanded", "", ""),
        ("IstGeschwindigkeit_2", "dq", "measured", "", ""),
        ("blue3", "", "", "", ""),
        ("J1(deg)", "q", "", "", "deg"),
        ("T2 (Nm)", "torque", "", "", "N m"),
        ("J3 act [A]", "current", "measured", "", "A"),
        ("wind 1 (deg)", "", "", "", "deg"),
        ("phi_mot1", "q", "", "motor", ""),
        ("Couple axe 3 (Nm)", "torque", "", "", "N m"),
        ("关节力矩1", "torque", "", "", ""),
        ("Axis1_deg", "q", "", "", "deg"),
        ("axis_2_nm", "torque", "", "", "N m"),
        ("Current1_%", "current", "", "", "percent"),
        ("Drive 2 %", "", "", "", "percent"),
        ("Winkel 3°", "q", "", "", "deg"),
    ],
)
def test_names_say(name: str, signal: str, kind: str, side: str, unit: str) -> None:
    found = meaning(name)
    assert (found.signal, found.kind, found.side, found.unit) == (signal, kind, side, unit)


@pytest.mark.parametrize("container", ["logsout.", "meas.", "rt/", "run_7.arm."])
def test_what_contains_all_columns_is_no_word_of_theirs(container: str) -> None:
    header = [f"{container}{name}" for name in ("time", "q1", "q2", "tau1", "tau2")]
    assert time_columns(header) == [header[0]]
    q, torque = groups_of(header, ("a", "b"))
    assert (q.names, torque.names) == (tuple(header[1:3]), tuple(header[3:]))
    assert (q.meaning.signal, torque.meaning.signal, q.meaning.strange) == ("q", "torque", ())
    told = [group.meaning.kind for group in groups_of([f"target.{name}" for name in ("q1", "q2", "tau1")], ("a", "b"))]
    assert told and set(told) == {"commanded"}  # a word that is known still counts


@pytest.mark.parametrize("signal", WORDS)
def test_every_word_of_the_field_is_known(signal: str) -> None:
    for word in WORDS[signal]:
        assert meaning_of([word]).signal == signal


@given(st.lists(st.text(max_size=12), max_size=30), st.lists(st.text(min_size=1, max_size=8), max_size=6, unique=True))
def test_any_header_is_survived(header: list[str], joints: list[str]) -> None:
    groups = groups_of(header, joints)
    for group in groups:
        assert set(group.names) <= set(header) and len(set(group.names)) == group.count
    choice = choose_signals(groups, len(joints))
    assert all(group in groups for group in choice.groups.values())
    assert set(time_columns(header)) <= set(header)
    fitting_profiles(header, joints)


@given(st.text(max_size=40))
def test_any_name_is_written_so_that_yaml_reads_it_back(name: str) -> None:
    text = f"key: {quoted(name)}   {MARK} {plain(name)}\n"
    if all(sign.isprintable() for sign in name) or name.isascii():
        assert load_yaml("x", text.encode("utf-8", "surrogatepass"))[0] == {"key": name}
    assert len(text.splitlines()) == 1


def test_the_side_of_an_arm_may_be_missing_or_stand_behind() -> None:
    """Of Baxter, as ``s0`` and ``s0_left``, columns had been grouped by their numbers, two joints at a time."""
    left, right = ([f"{side}_{own}" for own in ("s0", "s1", "e0", "w0")] for side in ("left", "right"))
    for header in ([f"pos_{name[5:]}" for name in left], [f"position/{name[5:]}_left" for name in left]):
        group, *_ = groups_of(header, left)
        assert group.named and group.names == tuple(header)
    behind = [f"position/{name[5:]}_left" for name in left]
    group, *_ = groups_of(behind, [*right, *left])
    assert group.named and sorted(group.columns) == [4, 5, 6, 7]
    assert not any(group.named for group in groups_of([f"pos_{name[5:]}" for name in left], [*right, *left]))
    assert not any(group.named for group in groups_of(["imu_acc_x", "imu_acc_y"], ["gantry_x", "gantry_y"]))


def test_joints_of_similar_names_are_kept_apart() -> None:
    joints = tuple(f"joint_{k}" for k in range(1, 12))
    header = [f"joint_{k}_pos" for k in range(11, 0, -1)]
    (group, *_) = groups_of(header, joints)
    assert group.named and group.names == tuple(f"joint_{k}_pos" for k in range(1, 12))
    assert group.pattern == "{joint}_pos"


def test_the_number_that_runs_is_that_of_the_joint() -> None:
    header = ["t", *(f"robot2_q_{k}" for k in range(6)), *(f"arm1.tau{k}.f2" for k in range(1, 7)), "q9x"]
    patterns = [group.pattern for group in groups_of(header, UR)]
    assert patterns == ["robot2_q_{0}", "arm1.tau{}.f2"]


def test_columns_whose_units_differ_belong_together() -> None:
    header = ["Position A1 [deg]", "Position A2 [mm]", "Position A3 [deg]", "A1 [deg]", "A1 [Nm]", "A2 [mm]", "A2 [N]"]
    (group, *others) = groups_of(header, ())
    assert group.names == tuple(header[:3]) and group.units == ("deg", "mm", "deg") and not others
    (one, two) = groups_of(["q1 [deg]", "q2 [deg]", "q1 [rad]", "q2 [rad]"], ())
    assert (one.pattern, one.meaning.unit, one.units) == ("q{} [deg]", "deg", ())
    assert (two.pattern, two.meaning.unit, two.units) == ("q{} [rad]", "rad", ())


def test_words_that_are_not_known_are_kept() -> None:
    assert meaning("tau_b_3").strange == ("b",) and meaning("qIn_2").strange == ("in",)
    assert meaning("field.position0").strange == () == meaning("actuators[2].torque").strange


def test_times() -> None:
    assert time_columns(["%time", "field.header.seq", "field.header.stamp"])[0] == "field.header.stamp"
    assert time_columns(["x", "receive_time", "Time [ms]", "t"]) == ["Time [ms]", "t"]
    assert unit_of_time("Time [ms]") == "ms" and unit_of_time("time_us") == "us" and unit_of_time("t") == ""
    assert time_unit(0.002, "").text == "s" and time_unit(0.002, "").certain
    for step, unit in ((5.0, "ms"), (2000.0, "us"), (4e6, "ns")):
        assert time_unit(step, "").text == unit and not time_unit(step, "").certain
        assert time_unit(step, unit).certain and not time_unit(step, "s").certain


def test_profiles_are_found_from_their_columns() -> None:
    headers = {
        "ur_rtde": ["timestamp", *(f"{w}_{k}" for w in ("actual_q", "actual_current", "target_q") for k in range(6))],
        "franka": ["time", *(f"state.{w}[{k}]" for w in ("q", "dq", "tau_J") for k in range(7))],
        "lerobot": ["timestamp", *(f"observation.state{k}" for k in range(1, 7)), "episode_index"],
        "joint_states": ["t", *(f"{j}.{w}" for j in PANDA for w in ("position", "effort"))],
    }
    for name, header in headers.items():
        joints = PANDA if name in ("franka", "joint_states") else UR
        fits = fitting_profiles(header, joints)
        assert [fit.name for fit in equally_good(fits)] == [name]
        assert fits[0].joints == joints and f"of {len(header)} columns" in fits[0].why()
        lacking = [column for column in header if "effort" not in column and "current" not in column]
        lacking = [column for column in lacking if "tau_J" not in column]
        assert len(fitting_profiles(lacking, joints)) == (name == "lerobot")
    assert {fit.name for fit in fitting_profiles(["t", "q1"], UR)} == set()
    assert set(headers) | {"ur_ros2"} == set(PROFILES.names())


def test_two_profiles_that_fit_equally() -> None:
    header = ["t", *(f"{joint}.{word}" for joint in UR for word in ("position", "velocity", "effort"))]
    assert [fit.name for fit in equally_good(fitting_profiles(header, UR))] == ["ur_ros2", "joint_states"]


def test_questions_of_a_file() -> None:
    text = (
        "a: 1   # ask: is it?\n# b: ask   # ask: or this?\nc: {d: ask}   # ask: what d is.\ne: 'ask'\nf: ask   # ask: f"
    )
    assert [(q.line, q.text, q.needed) for q in questions_in(text)] == [
        (1, "is it?", False),
        (2, "or this?", False),
        (3, "what d is.", True),
        (5, "f", True),
    ]
    with pytest.raises(DescriptionError) as caught:
        check_answered("case.yaml", text.encode())
    assert str(caught.value) == (
        "case.yaml: line 3 asks for what d is; write the answer in place of the word 'ask'; line 5 asks as well"
    )
    check_answered("case.yaml", text.replace("ask}", "2}").replace("f: ask", "f: 1").encode())


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({}, {}),
        ({"elbow_joint_pos": "elbw_joint_pos"}, {"elbow_joint": "(perhaps 'elbw_joint_pos')"}),
        ({"elbow_joint_pos": "aux"}, {"elbow_joint": "the log has elbow_joint_tau and no positions of elbow_joint"}),
        ({"elbow_joint_pos": "aux", "elbow_joint_tau": "other"}, {}),  # a log of five joints
    ],
)
def test_a_joint_that_the_log_has_without_positions_is_named(change: dict[str, str], told: dict[str, str]) -> None:
    robot = read_robot("generic-6r")
    robot = replace(robot, joints=tuple(replace(j, name=name) for j, name in zip(robot.joints, UR, strict=True)))
    header = ["t", *(change.get(f"{name}{end}", f"{name}{end}") for end in ("_pos", "_tau") for name in UR)]
    positions = [name for name in header if name.endswith("_joint_pos") and "elbw" not in name]
    found = without_positions(robot, header, positions)
    assert found.keys() == told.keys()
    assert all(words in found[name] for name, words in told.items())


def test_units_of_each_axis_in_names_of_joints_make_one_signal() -> None:
    header = ["Time", "X.ActPos [mm]", "A.ActPos [deg]", "X.ActCurrent [A]", "A.ActCurrent [A]"]
    q, current = groups_of(header, ("X", "A"))
    assert (q.names, q.units, q.meaning.unit, q.pattern) == (tuple(header[1:3]), ("mm", "deg"), "", "")
    assert (current.names, current.units, current.pattern) == (tuple(header[3:]), (), "{joint}.ActCurrent [A]")
    in_words = groups_of(["X_pos_mm", "A_pos_deg"], ("X", "A"))
    assert [(group.names, group.units) for group in in_words] == [(("X_pos_mm", "A_pos_deg"), ("mm", "deg"))]


def test_columns_of_a_joint_in_two_units_are_two_signals() -> None:
    header = ["X.pos [rad]", "A.pos [rad]", "X.pos [deg]", "A.pos [deg]"]
    found = [(group.names, group.meaning.unit, group.units) for group in groups_of(header, ("X", "A"))]
    assert found == [(tuple(header[:2]), "rad", ()), (tuple(header[2:]), "deg", ())]


def test_addresses_of_drives_may_begin_anywhere() -> None:
    header = ["millis", *(f"m{k}_present_position" for k in (11, 12, 13)), *(f"m{k}_current_mA" for k in (11, 12, 13))]
    q, current = groups_of(header, ("a", "b", "c"))
    assert (q.names, q.pattern, q.meaning.signal, q.meaning.strange) == (tuple(header[1:4]), "", "q", ())
    assert (current.names, current.meaning.unit, current.meaning.strange) == (tuple(header[4:]), "mA", ())
    assert not groups_of(header, ("a", "b"))  # of two joints the three are not


@pytest.mark.parametrize("name, unit", [("millis", "ms"), ("micros", "us")])
def test_counters_of_microcontrollers_are_a_time(name: str, unit: str) -> None:
    assert time_columns([name]) == [name] and unit_of_time(name) == unit


@pytest.mark.parametrize(
    "name, signal, unit",
    [
        ("q1 [rev]", "q", "360 deg"),
        ("Achse1.Istposition [Umdr]", "q", "360 deg"),
        ("qd1 [rpm]", "dq", "6 deg/s"),
        ("motor_speed_rpm_1", "dq", "6 deg/s"),
        ("vel_1 [rev/s]", "dq", "360 deg/s"),
        ("motor_pos_counts_1", "q", ""),
        ("Encoder1", "q", ""),
        ("enc_1 [inc]", "q", ""),
    ],
)
def test_turns_and_counts_are_units(name: str, signal: str, unit: str) -> None:
    (group,) = groups_of([name, name.replace("1", "2")], ("a", "b"))
    assert (group.meaning.signal, group.meaning.unit, group.meaning.strange) == (signal, unit, ())


def test_positions_in_turns_are_judged_by_the_limits_of_the_joints() -> None:
    joints = read_robot("generic-6r").active
    q = 0.2 * np.sin(np.linspace(0.0, 6.0, 50))[:, None] * np.ones(6)
    told = position_unit(q, joints, "360 deg")
    assert told.certain and told.words == ("360 deg",) * 6
    np.testing.assert_allclose(position_factors(told, 6), 2 * np.pi)
    counts = position_unit(np.round(2048 + 651.9 * q), joints, "")
    assert not counts.certain and "4096 a turn" in counts.why and "zero: -pi" in counts.why
    far = position_unit(np.round(9e4 * q), joints, "")
    assert "by the limits 3.6e+04 or more a turn of a joint: state 360 / (counts a turn) deg" in far.why
    assert "4096" not in far.why and "side: {q: motor} and the gear_ratio" in far.why
