"""Drafted case files: what is told, what is asked, and a file that the reader takes once it is answered."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drafted_logs import joints_called, moved, named, numbered, read, write_log, write_robot
from dynident.api.case_logs import read_data
from dynident.api.init import init
from dynident.arrays import Array
from dynident.case import case_draft
from dynident.case.case_draft import draft_case, draft_summary
from dynident.case.draft import readings
from dynident.case.draft.recognise import cutoff_of
from dynident.case.evidence.positions import turns_into_limits
from dynident.data.formats import Units
from dynident.data.split import Split
from dynident.errors import BadOption, DescriptionError, FileError, LogFormatError, LogMismatch, UnknownChoice
from dynident.model.friction import FRICTION, auto_friction, motor_ripple
from dynident.model.joint import Drive, JointLimits
from dynident.model.robot import Robot
from dynident.robot_files import read_robot


@pytest.fixture(scope="module")
def six() -> Robot:
    """Six joints with limits, masses and no known gains."""
    robot = read_robot("generic-6r")
    return robot.with_drives(dict.fromkeys(robot.joint_names, Drive()))


@pytest.fixture
def arm(tmp_path: Path, six: Robot) -> str:
    return write_robot(tmp_path / "arm.json", six)


@pytest.fixture(scope="module")
def motion(six: Robot) -> dict[str, Array]:
    return moved(six)


def test_a_plain_log_asks_for_nothing(arm: str, six: Robot, motion: dict[str, Array], tmp_path: Path) -> None:
    draft = init(arm, write_log(tmp_path / "run.csv", numbered(motion)), tmp_path)
    assert draft.needed == () and draft.remarks == ()
    case = read(draft, tmp_path)
    log = case.read(case.train[0])
    np.testing.assert_allclose(log.q, motion["q"])
    np.testing.assert_allclose(np.asarray(log.torque), motion["torque"])
    assert case.robot.joint_names == six.joint_names and case.estimator.name == "consistent"
    assert case.columns.units == Units(position="rad", torque="N m")
    assert case.split is not None and case.preprocessing.delay_s is None and case.preprocessing.rate_hz is None
    of_long_or_warm_logs = [FRICTION.name_of(part) for part in auto_friction() if part not in case.friction]
    assert of_long_or_warm_logs == ["warm_up", "temperature"] and set(case.friction) < set(auto_friction())
    for words in ("rad   # within the limits as rad", "times the torque of the robot model's masses", "agree with it"):
        assert words in draft.text


@pytest.mark.parametrize("kind", ["warms", "constant", "sparse", "of two joints"])
def test_logged_temperatures_of_the_drives_are_read(
    kind: str, arm: str, six: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    names, time = [f"temperature{k}" for k in range(1, 7)], motion["time"]
    values = np.tile(30.0 + (time if kind != "constant" else 0.0 * time), (6, 1))
    values[:, 1::2] = np.nan if kind == "sparse" else values[:, 1::2]
    logged = numbered(motion) | dict(zip(names[: 2 if kind == "of two joints" else 6], values, strict=False))
    draft = init(arm, write_log(tmp_path / "run.csv", logged), tmp_path)
    case = read(draft, tmp_path)
    parts = [part for part in case.friction if FRICTION.name_of(part) == "temperature"]
    if kind == "warms":
        assert len(parts) == 1 and parts[0].is_optional and case.columns.temperature == tuple(names)
        assert "not read: temperature" not in draft.text
        np.testing.assert_allclose(np.asarray(case.read(case.train[0]).temperature), values.T)
    else:
        assert not parts and not case.columns.temperature
        assert ("# temperature: temperature1" in draft.text) == (kind != "of two joints")


def test_ripple_of_motors_whose_gear_ratios_are_known_is_left_to_the_logs(
    six: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    ratios = (121.0, 121.0, -101.0, 1.0, 161 / 3, 161 / 3)
    drives = {name: Drive(gear_ratio=ratio) for name, ratio in zip(six.joint_names, ratios, strict=True)}
    robot = write_robot(tmp_path / "geared.json", six.with_drives(drives))
    case = read(init(robot, write_log(tmp_path / "run.csv", numbered(motion)), tmp_path), tmp_path)
    offered = tuple(part for part in case.friction if FRICTION.name_of(part) == "periodic")
    assert offered == motor_ripple(case.robot) and all(part.is_optional for part in offered)
    assert [len(part.joints or ()) for part in offered] == [2, 1, 2]


@pytest.mark.parametrize("angle", [1.0, 5.0, 21.6])
def test_a_base_that_leans_is_asked_about(
    angle: float, arm: str, six: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    lean = np.radians(angle)
    tilted = six.with_gravity((9.81 * np.sin(lean), 0.0, -9.81 * np.cos(lean)))
    log = write_log(tmp_path / "run.csv", numbered(moved(tilted)))
    (line,) = [line for line in init(arm, log, tmp_path).text.splitlines() if "gravity: [" in line]
    if angle < 2:
        assert "the log's torques agree with it" in line
    else:
        told = line.split("how does the base stand? the log's torques follow [")[1].split(",")
        assert float(told[0]) == pytest.approx(9.81 * np.sin(lean), abs=0.05)


NAMES = {
    "numbers from 0": ("timestamp", "actual_q_{0}", "joint_torque_{0}"),
    "brackets": ("time", "pos[{0}]", "effort[{0}]"),
    "words": ("Time", "joint {} position", "joint {} torque"),
    "measured": ("t", "q{}_meas", "tau_meas_{}"),
    "camel": ("stamp", "jointPos{}", "jointTorque{}"),
    "joints": ("t", "{joint}/position", "{joint}/effort"),
    "padded": ("t", "q_0{}", "tau_0{}"),
    "German": ("Zeit", "Winkel Äx {}", "Drehmoment {}"),
    "hostile": ("t", "# ask: q{}", "ask: tau '\"{}"),
    "braces": ("t", "{{q}}{}", "{{tau}}{}"),
}


@pytest.mark.parametrize("names", NAMES.values(), ids=NAMES)
def test_columns_are_told_by_their_names(
    names: tuple[str, str, str], arm: str, six: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    def spelt(pattern: str, k: int, joint: str) -> str:
        plain = pattern.replace("{0}", str(k)).replace("{joint}", joint)
        return re.sub(r"(?<!\{)\{\}", str(k + 1), plain).replace("{{", "{").replace("}}", "}")

    time, *patterns = names
    columns = [[spelt(pattern, k, joint) for k, joint in enumerate(six.joint_names)] for pattern in patterns]
    signals = dict(zip(("q", "torque"), columns, strict=True))
    shuffled = named(motion, time, {key: signals[key] for key in ("torque", "q")})
    draft = draft_case(arm, write_log(tmp_path / "run.csv", shuffled, separator="\t"), tmp_path)
    assert draft.needed == (), draft.text
    case = read(draft, tmp_path)
    assert case.columns.time == time and case.columns.q == tuple(columns[0])
    np.testing.assert_allclose(np.asarray(case.read(case.train[0]).torque), motion["torque"])


def test_joints_in_another_order_are_matched_by_name(
    arm: str, six: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    order = list(reversed(range(6)))
    turned = {key: values if key == "time" else values[:, order] for key, values in motion.items()}
    names = [six.joint_names[k] for k in order]
    signals = {"position": "q", "velocity": "dq", "effort": "torque"}
    columns = {signal: [f"{name}.{word}" for name in names] for word, signal in signals.items()}
    draft = draft_case(arm, write_log(tmp_path / "run.csv", named(turned, "t", columns)), tmp_path)
    assert [fit.name for fit in draft.recognition.profiles] == ["joint_states"] and draft.needed == ()
    assert "is the effort a torque in N m? Drivers differ" in draft.text
    case = read(draft, tmp_path)
    np.testing.assert_allclose(case.read(case.train[0]).q, motion["q"])


def test_effort_that_the_masses_do_not_bear_out_is_asked_for(
    arm: str, six: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    """A driver that writes amperes where others write N m: the profile alone is no answer."""
    columns = {
        "q": [f"{name}.position" for name in six.joint_names],
        "torque": [f"{n}.effort" for n in six.joint_names],
    }
    run = write_log(tmp_path / "run.csv", named({**motion, "torque": motion["torque"] / 8}, "t", columns))
    draft = draft_case(arm, run, tmp_path)
    (question,) = draft.needed
    assert "drivers differ: 0.12 to 0.13 times the torque of the robot model's masses" in question.text
    assert "columns: {torque: none, current: '{joint}.effort'}" in question.text
    kept = draft.text.replace("    torque: ask", "    torque: N m")
    np.testing.assert_allclose(
        np.asarray(read(replace(draft, text=kept), tmp_path).read("run.csv").torque) * 8, motion["torque"]
    )


def test_gaps_are_bridged_as_long_as_they_are(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    time = motion["time"].copy()
    time[300:] += 1.5
    run = write_log(tmp_path / "run.csv", numbered({**motion, "time": time}))
    draft = draft_case(arm, run, tmp_path)
    (remark,) = draft.remarks
    assert re.fullmatch(r"run.csv has gaps in time, the longest of 1.5\d? s: samples near them are left out", remark)
    assert read(draft, tmp_path).preprocessing.longest_gap_s == pytest.approx(1.7, abs=0.05)
    time[300:] += 600.0
    far = draft_case(arm, write_log(tmp_path / "far.csv", numbered({**motion, "time": time})), tmp_path)
    assert far.remarks[0].endswith("split the log there") and "longest_gap_s" not in far.text
    assert far.needed == () and "times the torque of the robot model's masses" in far.text  # of the longer part
    case = replace(read(far, tmp_path), split=Split(first=0.999))
    with pytest.raises(LogMismatch, match=r"far.csv: a gap of 601.\d s after sample 300.*; split the log there"):
        read_data(case)


def test_degrees_are_asked_for_with_the_likely_answer(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    turned = {**motion, "q": np.rad2deg(motion["q"])}
    log = write_log(tmp_path / "run.csv", numbered(turned))
    draft = draft_case(arm, log, tmp_path)
    (question,) = draft.needed
    assert question.text.startswith("the unit of q1 to q6") and question.text.endswith("likely deg")
    with pytest.raises(DescriptionError, match=rf"line {question.line} asks for the unit of q1 to q6"):
        read(draft, tmp_path)
    case = read(draft, tmp_path, {"the unit of q1 to q6": "deg"})
    np.testing.assert_allclose(case.read(case.train[0]).q, motion["q"])


@pytest.mark.parametrize("unit", ["[deg]", "(deg)", "[°]"])
def test_a_unit_in_the_header_is_taken_where_the_limits_agree(
    unit: str, arm: str, motion: dict[str, Array], tmp_path: Path
) -> None:
    turned = {**motion, "q": np.rad2deg(motion["q"])}
    columns = numbered(turned, f"q{{}} {unit}", "tau{} [Nm]", "Time [ms]")
    columns["Time [ms]"] = 1e3 * motion["time"]
    draft = draft_case(arm, write_log(tmp_path / "run.csv", columns), tmp_path)
    assert draft.needed == ()
    case = read(draft, tmp_path)
    assert case.columns.units == Units("ms", "deg", torque="N m")
    np.testing.assert_allclose(case.read(case.train[0]).q, motion["q"])


def test_a_header_that_the_limits_contradict_is_asked(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    turned = {**motion, "q": 100 * np.rad2deg(motion["q"])}
    draft = draft_case(arm, write_log(tmp_path / "run.csv", numbered(turned, "q{} [deg]")), tmp_path)
    assert draft.needed[0].text.startswith("the unit of q1 [deg]")
    assert draft.recognition.units["position"].words == ()


def test_other_units_of_time_and_torque_are_asked(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    scaled = {**motion, "time": 1e3 * motion["time"], "torque": 1e3 * motion["torque"]}
    draft = draft_case(arm, write_log(tmp_path / "run.csv", numbered(scaled)), tmp_path)
    assert [q.text.rpartition("likely ")[2] for q in draft.needed] == ["ms", "mN m"]
    case = read(draft, tmp_path, {"the unit of t ": "ms", "the unit of tau1": "mN m"})
    np.testing.assert_allclose(np.asarray(case.read(case.train[0]).torque), motion["torque"])


def test_currents_ask_for_gains_and_say_roughly(arm: str, six: Robot, motion: dict[str, Array], tmp_path: Path) -> None:
    gains = np.array([12.0, -11.0, 10.0, 9.0, 8.0, 7.0])
    amperes = {**motion, "torque": motion["torque"] / gains}
    draft = draft_case(arm, write_log(tmp_path / "run.csv", numbered(amperes, torque="i{}")), tmp_path)
    assert [q.text.partition(",")[0] for q in draft.needed] == [f"the drive gain of {j}" for j in six.joint_names]
    assert "dynident gains" in draft.text
    for question, gain in zip(draft.needed, gains, strict=True):
        if "roughly" in question.text:
            assert float(question.text.partition("roughly ")[2].split()[0]) == pytest.approx(gain, rel=0.2)
    assert "roughly -1" in draft.text
    answers = {f"gain of {name},": f"{gain}" for name, gain in zip(six.joint_names, gains, strict=True)}
    case = read(draft, tmp_path, answers)
    np.testing.assert_allclose(np.asarray(case.read(case.train[0]).torque), motion["torque"])


def test_gains_of_milliamperes_are_per_ampere(arm: str, six: Robot, motion: dict[str, Array], tmp_path: Path) -> None:
    milli = {**motion, "torque": motion["torque"] / 12.0 * 1000}
    draft = draft_case(arm, write_log(tmp_path / "run.csv", numbered(milli, torque="i{} [mA]")), tmp_path)
    assert all("N m at the joint per A of i" in question.text for question in draft.needed)
    rough = [float(q.text.partition("roughly ")[2].split()[0]) for q in draft.needed if "roughly" in q.text]
    assert rough == pytest.approx([12.0] * len(rough), rel=0.2) and rough
    case = read(draft, tmp_path, {f"gain of {name},": "12" for name in six.joint_names})
    np.testing.assert_allclose(np.asarray(case.read(case.train[0]).torque), motion["torque"])


def test_units_that_the_header_states_column_by_column(tmp_path: Path) -> None:
    robot = read_robot("generic-scara")
    motion, linear = moved(robot), np.array([joint.kind == "prismatic" for joint in robot.active])
    motion["q"][:, linear] = 0.2 * motion["q"][:, linear] + 0.1
    q = motion["q"] * np.where(linear, 1e3, 180 / np.pi)
    for words, agree in ((("deg", "mm"), True), (("rad", "mm"), False)):
        units = [words[int(is_linear)] for is_linear in linear]
        efforts = ["N" if is_linear else "Nm" for is_linear in linear]
        columns = {"Zeit [s]": motion["time"]}
        columns |= {f"Istposition A{k + 1} [{unit}]": q[:, k] for k, unit in enumerate(units)}
        columns |= {f"Drehmoment A{k + 1} [{unit}]": motion["torque"][:, k] for k, unit in enumerate(efforts)}
        draft = draft_case("generic-scara", write_log(tmp_path / "run.csv", columns), tmp_path)
        asked = [question.text for question in draft.needed if "the unit of" in question.text]
        assert agree == (not asked) and not any("leaves its limits" in remark for remark in draft.remarks)
        if agree:
            log = read(draft, tmp_path, {"the bias of": "0"} if draft.needed else {}).read(str(tmp_path / "run.csv"))
            np.testing.assert_allclose(log.q, motion["q"], atol=1e-9)
            np.testing.assert_allclose(np.asarray(log.torque), motion["torque"], atol=1e-9)
        else:
            assert f"the header states [{', '.join(units)}]" in asked[0]


def test_torques_are_taken_before_currents_and_commands_never(
    arm: str, motion: dict[str, Array], tmp_path: Path
) -> None:
    columns = numbered(motion) | {f"i{k}": motion["time"] for k in range(1, 7)}
    columns |= {f"tau_des{k}": motion["time"] for k in range(1, 7)}
    columns |= {f"q_cmd{k}": motion["q"][:, k - 1] for k in range(1, 7)}
    plain_log = draft_case(arm, write_log(tmp_path / "plain.csv", columns), tmp_path)
    columns |= {"T1": motion["time"], "status": motion["time"]}
    draft = draft_case(arm, write_log(tmp_path / "run.csv", columns), tmp_path)
    case = read(draft, tmp_path)
    assert "    # not read: T1, status\n" in draft.text
    assert draft.text.count("not read") == 2 and plain_log.text.count("not read") == 1
    assert case.columns.torque == tuple(f"tau{k}" for k in range(1, 7)) and not case.columns.current
    assert case.columns.q_ref == tuple(f"q_cmd{k}" for k in range(1, 7))
    assert "# current: i1 to i6 are there as well" in draft.text
    assert "# not read: tau_des1 to tau_des6, commanded" in draft.text
    assert "not read: q_cmd" not in draft.text


def test_two_groups_that_fit_equally_are_asked(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    columns = numbered(motion, torque="left_tau{}") | numbered(motion, torque="right_tau{}")
    draft = draft_case(arm, write_log(tmp_path / "run.csv", columns), tmp_path)
    question, unit = draft.needed
    assert question.text == "which columns are the measured joint torques: 'left_tau{}' or 'right_tau{}'"
    assert unit.text.startswith("the unit of the torques (N m, mN m,")
    assert draft.remarks == ()
    case = read(draft, tmp_path, {"which columns": "'right_tau{}'", "the unit of the torques": "N m"})
    assert case.columns.torque == tuple(f"right_tau{k}" for k in range(1, 7))


def test_an_effort_whose_name_is_not_understood_is_asked_about(
    arm: str, motion: dict[str, Array], tmp_path: Path
) -> None:
    """The robot model's masses confirm it, then a comment asks; else an answer is needed."""
    for factor, needed in ((1.0, False), (0.05, True)):
        log = write_log(
            tmp_path / "run.csv", numbered({**motion, "torque": factor * motion["torque"]}, torque="tau_b{}")
        )
        draft = draft_case(arm, log)
        (question,) = (one for one in draft.questions if "'b' is not known" in one.text)
        assert question.needed == needed


def test_two_groups_of_velocities_are_left_out(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    columns = numbered(motion)
    for word in ("qd{}", "q_dot{}"):
        columns |= {word.format(k + 1): motion["dq"][:, k] for k in range(motion["dq"].shape[1])}
    draft = draft_case(arm, write_log(tmp_path / "run.csv", columns))
    assert not draft.needed and "# dq: qd1 to qd6 or q_dot1 to q_dot6" in draft.text


@pytest.mark.parametrize(("rate", "ways", "alone", "tested"), [(20, 1, 0, 0), (4, 1, 120, 140), (4, 2, 190, 290)])
def test_only_a_long_log_is_asked_whether_drives_warm_up_in_no_longer_a_time(
    arm: str, motion: dict[str, Array], tmp_path: Path, rate: float, ways: int, alone: int, tested: int
) -> None:
    """A log of 30, 150 or, there and back, 300 s; without a log to test on two thirds of it train."""
    there = {name: values if ways == 1 else np.concatenate([values, values[::-1]]) for name, values in motion.items()}
    there |= {"time": np.arange(600 * ways) / rate}
    log = write_log(tmp_path / "run.csv", numbered({**there, "dq": np.gradient(there["q"], 1.0 / rate, axis=0)}))
    for test, seconds in ((), alone), ((log,), tested):
        found = re.search(r"- warm_up: {time_constant: (\d+), choose", draft_case(arm, log, tmp_path, test=test).text)
        assert (int(found[1]) if found else 0) == seconds


def test_a_log_without_a_time_takes_its_rate(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    timeless = {name: values for name, values in numbered(motion).items() if name != "t"}
    draft = draft_case(arm, write_log(tmp_path / "run.csv", timeless), tmp_path)
    answers = {"the unit of the time": "s", "the unit of the positions": "rad", "the unit of the torques": "SI"}
    case = read(draft, tmp_path, {"the column of the time": "100 Hz", **answers})
    np.testing.assert_allclose(case.read(case.train[0]).time, motion["time"], atol=1e-12)
    assert any("draft again with --rate" in remark for remark in draft.remarks)


def test_units_are_looked_at_where_a_rate_stands_for_the_time(
    arm: str, motion: dict[str, Array], tmp_path: Path
) -> None:
    columns = numbered({**motion, "q": np.rad2deg(motion["q"])}, q="q{} [deg]")
    turning = np.array(np.gradient(motion["q"], motion["time"], axis=0))
    columns |= {f"dq{k + 1}": column for k, column in enumerate(turning.T)}
    timed = draft_case(arm, write_log(tmp_path / "timed.csv", columns), tmp_path)
    timeless = write_log(tmp_path / "run.csv", {name: values for name, values in columns.items() if name != "t"})
    draft = draft_case(arm, timeless, tmp_path, rate_hz=100.0)
    told, wanted = ({q: unit for q, unit in each.recognition.units.items() if q != "time"} for each in (draft, timed))
    assert not draft.needed and told == wanted
    case, other_case = (read(each, tmp_path) for each in (draft, timed))
    assert (case.columns.time, case.columns.units) == ("100 Hz", other_case.columns.units)
    found, log = case.read(case.train[0]), other_case.read(other_case.train[0])
    for one, other in ((found.time, log.time), (found.q, log.q), (found.torque, log.torque)):
        np.testing.assert_allclose(np.asarray(one), np.asarray(other), atol=1e-9)
    with pytest.raises(BadOption, match="rate = '0' is not possible; give the samples a second, above 0"):
        draft_case(arm, timeless, tmp_path, rate_hz=0.0)
    with pytest.raises(BadOption, match="leave the profile out, it names a column of the time"):
        draft_case(arm, timeless, tmp_path, rate_hz=100.0, profile="franka")


def test_velocities_in_another_unit_are_left_out(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    for factor, there in ((1.0, True), (57.3, False)):
        columns = numbered(motion) | {f"dq{k}": factor * motion["dq"][:, k - 1] for k in range(1, 7)}
        draft = draft_case(arm, write_log(tmp_path / "run.csv", columns), tmp_path)
        case = read(draft, tmp_path)
        assert (case.read(case.train[0]).dq is not None) == there
        assert ("57.3 times the derivative of the positions" in draft.text) != there


def test_velocities_in_the_unit_of_the_header_are_read(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    columns = numbered({**motion, "q": np.rad2deg(motion["q"])}, q="q{} [deg]")
    turning = np.rad2deg(np.gradient(motion["q"], motion["time"], axis=0))
    columns |= {f"qd{k + 1} [deg/s]": column for k, column in enumerate(turning.T)}
    case = read(draft_case(arm, write_log(tmp_path / "run.csv", columns), tmp_path), tmp_path)
    assert case.columns.units.velocity == "deg/s"
    np.testing.assert_allclose(np.asarray(case.read(case.train[0]).dq), np.deg2rad(turning), atol=1e-9)


@pytest.mark.parametrize("turn", [360.0, 2 * np.pi])
def test_turns_that_start_again_are_counted_on(turn: float, arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    factor = turn / (2 * np.pi)
    columns = numbered({**motion, "q": np.mod(motion["q"] * factor, turn)})
    draft = draft_case(arm, write_log(tmp_path / "run.csv", columns), tmp_path)
    assert draft.needed == ()
    case = read(draft, tmp_path)
    assert case.columns.wrapped == case.robot.joint_names
    assert case.columns.units.position == ("deg" if turn == 360.0 else "rad")
    np.testing.assert_allclose(case.read(case.train[0]).q, motion["q"], atol=1e-9)


def test_positions_that_start_again_are_held_against_limits_in_any_turn(
    arm: str, motion: dict[str, Array], tmp_path: Path
) -> None:
    """Joints of 30 to 330 degrees that stand about 180 had been told to leave their limits: zero, sign and order."""
    joints = read_robot(arm).active
    q = np.mod(np.rad2deg(motion["q"]), 360.0)
    draft = draft_case(arm, write_log(tmp_path / "run.csv", numbered({**motion, "q": q})), tmp_path)
    assert draft.recognition.wrapped and "leaves its limits" not in draft.text
    for low, turn in ((-3.6, 1.0), (2.9, 0.0), (9.0, -1.0)):
        joint = replace(joints[0], limits=JointLimits(np.deg2rad(30), np.deg2rad(330)))
        assert turns_into_limits(joint, low, low + 0.5) == pytest.approx(2 * np.pi * turn)
    assert turns_into_limits(replace(joints[0], limits=JointLimits()), -3.6, -2.9) == 0.0


def test_a_jump_of_some_degrees_is_no_turn(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    q = np.rad2deg(motion["q"])
    q[300:, 0] += 6.3
    draft = draft_case(arm, write_log(tmp_path / "run.csv", numbered({**motion, "q": q})), tmp_path)
    assert "wrapped" not in draft.text and "likely deg" in draft.text


def test_permille_before_the_number_of_the_joint(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    draft = draft_case(arm, write_log(tmp_path / "run.csv", numbered(motion, torque="tau_permille{}")), tmp_path)
    assert "the header states permille" in draft.text


def test_a_joint_that_stands_is_locked_where_it_stands(
    arm: str, six: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    q = motion["q"].copy()
    q[:, 1] = 0.7
    draft = draft_case(arm, write_log(tmp_path / "run.csv", numbered({**motion, "q": q})), tmp_path)
    name = six.joint_names[1]
    assert f"locked: {{{name}: 0.7}}" in draft.text and f"# CHECK: {name} never moves" in draft.text
    case = read(draft, tmp_path, {"the unit of tau": "N m"})
    assert name not in case.robot.joint_names and case.locked == {name: 0.7}
    q[:, 3] = 0.1
    two = draft_case(arm, write_log(tmp_path / "two.csv", numbered({**motion, "q": q})), tmp_path)
    both = f"{name}, {six.joint_names[3]} never move; they are locked where they stand"
    assert [both in remark for remark in two.remarks].count(True) == 1 and "left out: 0% of" in two.text


def test_fewer_columns_than_joints_ask_which_they_are(
    arm: str, six: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    four = {key: values if key == "time" else values[:, 1:5] for key, values in motion.items()}
    draft = draft_case(arm, write_log(tmp_path / "run.csv", numbered(four)), tmp_path)
    assert draft.needed[0].text.startswith("the joints of the 4 columns q1 to q4, in their order")
    names = f"[{', '.join(six.joint_names[1:5])}]"
    case = read(draft, tmp_path, {"the joints of the 4": names, "the unit of tau": "N m"})
    assert case.robot.joint_names == six.joint_names[1:5]
    assert case.locked == {six.joint_names[0]: 0.0, six.joint_names[5]: 0.0}
    np.testing.assert_allclose(case.read(case.train[0]).q, four["q"])


def test_named_joints_that_are_missing_are_locked(
    arm: str, six: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    names = six.joint_names[:4]
    four = {key: values if key == "time" else values[:, :4] for key, values in motion.items()}
    columns = {"q": [f"{n}_position" for n in names], "torque": [f"{n}_torque" for n in names]}
    draft = draft_case(arm, write_log(tmp_path / "run.csv", named(four, "t", columns)), tmp_path)
    assert "locked: rest   # ask: where do the 2 joints stand" in draft.text
    case = read(draft, tmp_path, {"the unit of": "N m"})
    assert case.robot.joint_names == names and set(case.locked) == set(six.joint_names[4:])


def test_motors_ask_for_gears_and_units(arm: str, six: Robot, motion: dict[str, Array], tmp_path: Path) -> None:
    turned = {**motion, "q": 50 * motion["q"], "torque": motion["torque"] / 50}
    draft = draft_case(arm, write_log(tmp_path / "run.csv", numbered(turned, "qm{}", "taum{}")), tmp_path)
    assert sum("gear ratio" in q.text for q in draft.needed) == 6 and "side: {q: motor, torque: motor}" in draft.text
    case = read(draft, tmp_path, {"gear ratio": "50", "the unit of qm": "rad", "the unit of taum": "N m"})
    np.testing.assert_allclose(np.asarray(case.read(case.train[0]).torque), motion["torque"])
    np.testing.assert_allclose(case.read(case.train[0]).q, motion["q"])


def test_a_turned_torque_is_remarked(arm: str, six: Robot, motion: dict[str, Array], tmp_path: Path) -> None:
    torque = motion["torque"].copy()
    torque[:, 1] *= -1
    draft = draft_case(arm, write_log(tmp_path / "run.csv", numbered({**motion, "torque": torque})), tmp_path)
    assert any(
        f"the torque of {six.joint_names[1]} has the opposite sign of the robot model's gravity torque" in remark
        for remark in draft.remarks
    )
    assert "and the direction of gravity" in "".join(draft.remarks) and "does the base stand upright?" in draft.text


def test_a_turned_torque_of_an_upright_axis_is_not_laid_to_gravity(tmp_path: Path) -> None:
    """The first axis of a SCARA stands upright: gravity does not load it, whatever its slide carries."""
    scara = read_robot("generic-scara")
    scara = scara.with_drives(dict.fromkeys(scara.joint_names, Drive()))
    turned = moved(scara)
    turned["torque"] = turned["torque"] * np.array([-1.0, 1.0, 1.0, 1.0])
    arm = write_robot(tmp_path / "arm.json", scara)
    remarks = draft_case(arm, write_log(tmp_path / "run.csv", numbered(turned)), tmp_path).remarks
    told = "".join(remarks)
    assert f"{scara.joint_names[0]} has the opposite sign of the robot model's inertia: check the sign" in told
    assert "gravity" not in told


def test_a_vertical_slide_asks_what_carries_its_weight(tmp_path: Path) -> None:
    robot = read_robot("generic-scara")
    robot = robot.with_drives(dict.fromkeys(robot.joint_names, Drive()))
    arm, motion = write_robot(tmp_path / "scara.json", robot), moved(robot)
    slide = next(joint.name for joint in robot.active if joint.kind == "prismatic")
    motion["q"][:, [j.kind == "prismatic" for j in robot.active]] *= 0.1
    draft = draft_case(arm, write_log(tmp_path / "run.csv", numbered(motion, torque="i{}")), tmp_path)
    assert any(q.text.startswith(f"the bias of {slide}: force in N") for q in draft.needed)


def test_only_positions_and_no_time_still_say_what_is_there(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    columns = {name: values for name, values in numbered(motion).items() if not name.startswith("tau")}
    draft = draft_case(arm, write_log(tmp_path / "run.csv", columns | {"odd": motion["time"]}), tmp_path)
    assert "no torques and no currents" in draft.remarks[0]
    (question,) = draft.needed
    assert question.text.endswith("the log also has odd") and "position: rad" in draft.text
    timeless = {name: values for name, values in numbered(motion).items() if name != "t"}
    draft = draft_case(arm, write_log(tmp_path / "b.csv", {"odd": motion["time"], **timeless}), tmp_path)
    question, *units = draft.needed
    assert question.text.startswith("the column of the time; the log has odd, q1")
    assert [unit.text.split(" (")[0] for unit in units] == [
        f"the unit of the {what}" for what in ("time", "positions", "torques")
    ]
    answers = {"the unit of the time": "s", "the unit of the positions": "rad", "the unit of the torques": "SI"}
    case = read(draft, tmp_path, {"the column of the time": "odd", **answers})
    np.testing.assert_allclose(case.read(case.train[0]).q, motion["q"])


def test_nothing_but_odd_columns(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    columns = {"t": motion["time"]} | {f"{chr(97 + k % 26)}x{k}": motion["time"] for k in range(300)}
    draft = draft_case(arm, write_log(tmp_path / "run.csv", columns), tmp_path)
    assert len(draft.needed) == 4 and "(300 in all)" in draft.needed[0].text
    assert max(map(len, draft.text.splitlines())) < 1500
    with pytest.raises(DescriptionError, match="asks for the measured positions"):
        read(draft, tmp_path)


def test_several_logs_and_their_parts(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    (tmp_path / "cases").mkdir()
    paths = [
        write_log(tmp_path / "logs" / f"{name}.csv", {k: v[: 600 - 10 * n] for k, v in numbered(motion).items()})
        for n, name in enumerate("abc")
    ]
    draft = draft_case(arm, paths, tmp_path / "cases")
    assert "which logs train and which test? Taken: the last of 3 tests" in draft.text
    case = read(draft, tmp_path / "cases")
    assert case.train == ("../logs/a.csv", "../logs/b.csv") and case.test == ("../logs/c.csv",) and not case.split
    assert case.read(case.test[0]).samples == 580
    stated = read(draft_case(arm, paths[:2], tmp_path / "cases", test=paths[2:]), tmp_path / "cases")
    assert (stated.train, stated.test) == (case.train, case.test)
    other = write_log(tmp_path / "d.csv", numbered(motion, torque="moment{}"))
    with pytest.raises(LogFormatError, match=r"no column 'tau1' as in the first log.* make a case for each kind"):
        draft_case(arm, [paths[0], other], tmp_path)
    parts = [
        write_log(tmp_path / f"{key}.csv", {k: v for k, v in numbered(motion).items() if k == "t" or k.startswith(key)})
        for key in ("q", "tau")
    ]
    with pytest.raises(LogFormatError, match="signals of one motion in several files: put their columns side by side"):
        draft_case(arm, parts, tmp_path)


def test_logs_that_are_reduced_as_a_stream_ask_for_nothing_that_a_stream_cannot_do(
    arm: str, motion: dict[str, Array], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_log(tmp_path / "run.csv", numbered(motion))
    monkeypatch.setattr(case_draft, "LARGE", Path(path).stat().st_size)
    case = read(draft_case(arm, path, tmp_path), tmp_path)
    assert case.split is not None and "torque" in case.model.needs
    monkeypatch.setattr(case_draft, "LARGE", Path(path).stat().st_size - 1)
    monkeypatch.setattr(readings, "MOST_ROWS", 400)
    draft = draft_case(arm, path, tmp_path)
    assert "run.csv: the first 400 rows" in draft.text and "another log to test on?" in draft.text
    assert draft.needed == ()
    read(draft, tmp_path).stream_setup().check()


def test_decimal_commas_are_stated_and_not_guessed(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    log = write_log(tmp_path / "run.csv", numbered(motion), separator=";", decimal=",")
    draft = draft_case(arm, log, tmp_path)
    case = read(draft, tmp_path)
    assert case.columns.decimal == "," and case.read("run.csv").samples == 600


def test_decimal_commas_are_seen_where_the_first_column_has_none(
    arm: str, motion: dict[str, Array], tmp_path: Path
) -> None:
    columns = {"time [ms]": np.round(1e3 * numbered(motion)["t"], 3)}
    columns |= {name: values for name, values in numbered(motion).items() if name != "t"}
    path = Path(write_log(tmp_path / "run.csv", columns))
    header, *rows = path.read_text().splitlines()
    rows = [";".join(f"{float(cell):.9g}".replace(".", ",") for cell in row.split(",")) for row in rows]
    path.write_text("\n".join([header.replace(",", ";"), *rows]) + "\n")
    draft = draft_case(arm, str(path), tmp_path)
    assert 'decimal: ","' in draft.text
    np.testing.assert_allclose(read(draft, tmp_path).read("run.csv").q, motion["q"], rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize(
    ("cells", "step"),
    [
        (("2024-05-01 12:00", "1"), "write the time in seconds, or as in 2024-"),
        (("1/2/2024 12:00:01", "1"), "write the time in seconds"),
        (("s", "ticks"), r"put them into the names, such as q1 \[rad\]"),
        (("0.1x", "1"), "correct the cell"),
    ],
)
def test_cells_that_are_no_numbers_say_what_to_do(cells: tuple[str, str], step: str, arm: str, tmp_path: Path) -> None:
    rows = "\n".join(f"{0.01 * k},{k}" for k in range(20))
    (tmp_path / "run.csv").write_text(f"t,q1\n{','.join(cells)}\n{rows}\n")
    with pytest.raises(LogFormatError, match=f"run.csv:2: .*not a number; .*{step}"):
        draft_case(arm, str(tmp_path / "run.csv"), tmp_path)


def test_vectors_in_archives(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    np.savez(tmp_path / "run.npz", time=motion["time"], joint_positions=motion["q"], joint_torques=motion["torque"])
    case = read(draft_case(arm, str(tmp_path / "run.npz"), tmp_path), tmp_path)
    np.testing.assert_allclose(case.read("run.npz").q, motion["q"])


def test_faulty_rows_are_told_and_left_to_the_log_checks(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    columns = {name: values.copy() for name, values in numbered(motion).items()}
    columns["tau3"][5] = np.nan
    columns["t"][9] = columns["t"][8]
    draft = draft_case(arm, write_log(tmp_path / "run.csv", columns), tmp_path)
    assert [remark.partition(":")[0] for remark in draft.remarks] == [
        "1 of 600 rows hold values that are not finite",
        "time repeats or runs back in 1 rows",
    ]
    assert "its --fix OUT.csv leaves them out" in draft.remarks[1]


def test_what_is_no_log_is_refused(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "header.csv").write_text("t,q1,tau1\n")
    (tmp_path / "text.csv").write_text("hello world\nthis is\nno log\n")
    one = write_log(tmp_path / "one.csv", {k: v[:1] for k, v in numbered(motion).items()})
    back = write_log(tmp_path / "back.csv", {k: v[40:0:-1] for k, v in numbered(motion).items()})
    for name, words in (
        ("empty.csv", "the file is empty"),
        ("header.csv", "a header and no rows"),
        ("text.csv", "which is not a number"),
        (one, "only 1 rows that can be used; an"),
        (back, "only 1 rows that can be used; time repeats or runs back in 39 rows; sort the rows"),
        ("none.bag2", "no log format has the suffix"),
    ):
        with pytest.raises(LogFormatError, match=words):
            draft_case(arm, str(tmp_path / name), tmp_path)
    with pytest.raises(FileError, match="there is no such file"):
        draft_case(arm, str(tmp_path / "none.csv"), tmp_path)
    log = write_log(tmp_path / "run.csv", numbered(motion))
    with pytest.raises(BadOption, match="franka"):
        draft_case(arm, log, tmp_path, profile="franka")
    with pytest.raises(UnknownChoice):
        draft_case(arm, log, tmp_path, profile="fanka")


@pytest.mark.parametrize("name", ["null", "yes", "1", "a: b", "it's", "#1", "a,b", "{x}", "-", "~", "ünï", "ask"])
def test_odd_names_are_quoted(name: str, planar_2r: Robot, tmp_path: Path) -> None:
    robot = joints_called(planar_2r, name, "plain")
    arm = write_robot(tmp_path / "arm.json", robot)
    draft = draft_case(arm, write_log(tmp_path / "run.csv", numbered(moved(robot))), tmp_path)
    assert read(draft, tmp_path).robot.joint_names == (name, "plain")


def test_units_of_each_joint_where_they_differ(tmp_path: Path) -> None:
    robot = read_robot("generic-scara")
    motion = moved(robot)
    motion["q"][:, [j.kind == "prismatic" for j in robot.active]] *= 0.2
    draft = draft_case("generic-scara", write_log(tmp_path / "run.csv", numbered(motion)), tmp_path)
    assert "robot: generic-scara" in draft.text
    case = read(draft, tmp_path, {"the unit of tau": "[N m, N m, N, N m]", "the unit of q": "[rad, rad, m, rad]"})
    units = case.columns.units
    assert units.of("position", 4) == ("rad", "rad", "m", "rad") and units.of("torque", 4) == ("N m", "N m", "N", "N m")


def test_the_summary_says_how_sure_it_is(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    turned = {**motion, "q": np.rad2deg(motion["q"])}
    log = write_log(tmp_path / "run.csv", numbered(turned))
    draft = draft_case(arm, log, tmp_path)
    data = json.loads(json.dumps(draft_summary(draft), allow_nan=False))
    assert data["units"]["position"]["confidence"] == "likely, asked" and data["units"]["position"]["unit"] == "deg"
    assert data["units"]["time"]["confidence"] == data["joints"]["confidence"] == "certain"
    assert data["logs"] == [
        {"path": log, "rows": 600, "duration_s": pytest.approx(5.99), "rate_hz": pytest.approx(100), "faults": []}
    ]
    (question,) = data["questions"][:1]
    lines = draft.text.splitlines()
    assert all(lines[q["line"] - 1].endswith(q["asks_for"]) for q in data["questions"]) and "line" in question
    assert draft.text == draft_case(arm, log, tmp_path).text


def test_the_cut_off_follows_the_band_of_the_motion(arm: str, six: Robot, tmp_path: Path) -> None:
    time = np.arange(6000) / 200
    q = 0.5 * np.sin(2 * np.pi * np.outer(time, np.full(6, 0.8)) + np.arange(6))
    columns = numbered({"time": time, "q": q, "torque": np.cos(q)})
    draft = draft_case(arm, write_log(tmp_path / "run.csv", columns), tmp_path)
    assert draft.recognition.band_hz == pytest.approx(0.8, abs=0.1)
    case = read(draft, tmp_path, {"the unit of tau": "N m"})
    assert 7 <= float(str(case.preprocessing.filter.statement()["cutoff_hz"])) <= 9.5
    assert replace(case.preprocessing, delay_s=0.0).rate_hz is None


@pytest.mark.parametrize("sway", [0.0, 2e-3])
def test_joints_that_stand_still_have_no_part_in_the_cut_off(arm: str, six: Robot, tmp_path: Path, sway: float) -> None:
    """Neither in the log of the motion nor in one in which nothing moves: what they have is the encoders' noise."""
    time = np.arange(2000) / 200
    q = 0.5 * np.sin(2 * np.pi * np.outer(time, np.full(6, 0.8)) + np.arange(6))
    noise = 1e-5 * np.random.default_rng(0).normal(size=q.shape)
    q[:, 2:4] = 0.3 + sway * np.sin(2 * np.pi * 20 * time)[:, None]  # of a drive that holds it
    logs = [
        write_log(tmp_path / f"{name}.csv", numbered({"time": time, "q": at + noise, "torque": np.cos(q)}))
        for name, at in (("moves", q), ("rests", q[:1]))
    ]
    draft = draft_case(arm, logs, tmp_path)
    assert draft.recognition.band_hz == pytest.approx(0.8, abs=0.15)
    assert sway or set(draft.recognition.still) == set(six.joint_names[2:4])
    assert "cutoff_hz: " in draft.text and cutoff_of(draft.recognition) < 10


def test_a_log_in_which_nothing_moves_has_no_band(arm: str, tmp_path: Path) -> None:
    noise = 1e-5 * np.random.default_rng(0).normal(size=(600, 6))
    columns = numbered({"time": np.arange(600) / 100, "q": 0.3 + noise, "torque": 1 + noise})
    draft = draft_case(arm, write_log(tmp_path / "run.csv", columns), tmp_path)
    assert draft.recognition.band_hz == 0.0 and "cutoff_hz" not in draft.text


GANTRY = (
    """<robot name="gantry"><link name="base"/>"""
    + "".join(
        f"""<link name="l{k}"><inertial><mass value="{9 - k}"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
    <joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="l{k}"/><axis xyz="{axis}"/>
    <limit lower="-2" upper="2" velocity="3" effort="900"/></joint>"""
        for k, (name, kind, parent, axis) in enumerate(
            [
                ("x", "prismatic", "base", "1 0 0"),
                ("y", "prismatic", "l0", "0 1 0"),
                ("turn", "revolute", "l1", "0 0 1"),
            ]
        )
    )
    + "</robot>"
)


def test_rotors_that_no_motion_tells_from_bodies_are_stated(tmp_path: Path) -> None:
    """Of a gantry the one of each drive acts as a body; of a SCARA that of its slide, whose weight may be an offset."""
    (tmp_path / "gantry.urdf").write_text(GANTRY)
    gantry, scara = read_robot(tmp_path / "gantry.urdf"), read_robot("generic-scara")
    scara = scara.with_drives(dict.fromkeys(scara.joint_names, Drive()))
    (slide,) = (joint.name for joint in scara.active if joint.kind == "prismatic")
    others = ", ".join(name for name in scara.joint_names if name != slide)
    for robot, place, options in (
        (gantry, str(tmp_path / "gantry.urdf"), ["joints: [x, y, turn]"]),
        (
            scara,
            write_robot(tmp_path / "scara.json", scara),
            [f"joints: [{slide}]", f"joints: [{others}], choose: part"],
        ),
    ):
        motion = moved(robot)
        motion["q"][:, [j.kind == "prismatic" for j in robot.active]] *= 0.1
        text = draft_case(place, write_log(tmp_path / "run.csv", numbered(motion)), tmp_path).text
        assert re.findall(r"- rotor_inertia: {(.*)}", text) == options


def test_rotors_of_an_arm_are_left_to_held_out_samples(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    text = draft_case(arm, write_log(tmp_path / "run.csv", numbered(motion)), tmp_path).text
    assert text.count("- rotor_inertia") == 1 and "- rotor_inertia: {choose: part}" in text
