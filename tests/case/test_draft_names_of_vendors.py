"""Drafts of logs whose names are those of vendors, or give units: words at the end, a group for each kind of joint."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from drafted_logs import joints_called, moved, read, write_log, write_robot
from dynident.arrays import Array
from dynident.case.case_draft import draft_case
from dynident.case.draft.column_groups import StatedJoints, groups_of, groups_of_robot
from dynident.case.draft.servo_text import is_servo_log
from dynident.robot_files import read_robot

PAGES = sorted((Path(__file__).parents[2] / "docs" / "your-robot").glob("*.md"))

#: Columns of each signal that the cases of those pages read, as they write them.
BLOCKS = [
    (page.name, dict(re.findall(r'\b(time|q|torque|current): "?((?:[^,"{}]|\{\})+)"?', line)))
    for page in PAGES
    for line in page.read_text("utf-8").splitlines()
    if re.match(r"\s+columns: \{.*\bq: ", line)
]


@pytest.fixture(scope="module")
def slides() -> dict[str, Array]:
    """Motion of a robot with a slide after two joints that turn, and before one."""
    robot = read_robot("generic-scara")
    motion = moved(robot)
    linear = [joint.kind == "prismatic" for joint in robot.active]
    motion["q"][:, linear] = 0.2 * motion["q"][:, linear] + 0.1
    return motion


def columns_of(motion: dict[str, Array], q: list[str], torque: list[str], factors: Array) -> dict[str, Array]:
    columns = {"Time_s": motion["time"]} | dict(zip(q, (motion["q"] * factors).T, strict=True))
    return columns | dict(zip(torque, motion["torque"].T, strict=True))


@pytest.mark.parametrize(("page", "names"), BLOCKS)
def test_names_that_the_pages_of_vendors_use_are_recognized(page: str, names: dict[str, str], tmp_path: Path) -> None:
    robot = read_robot("generic-6r")
    motion = moved(robot)
    columns = {names.get("time", "t"): motion["time"] * (1e3 if names.get("time", "").endswith("ms") else 1.0)}
    for signal in ("q", "torque", "current"):
        if "{}" in names.get(signal, ""):
            values = motion["q"] if signal == "q" else motion["torque"]
            columns |= {names[signal].format(k + 1): values[:, k] for k in range(robot.dof)}
    draft = draft_case(write_robot(tmp_path / "arm.json", robot), write_log(tmp_path / "run.csv", columns), tmp_path)
    sources = draft.recognition.sources
    for signal in ("q", "torque", "current"):
        if "{}" in names.get(signal, ""):
            assert sources[signal].pattern == names[signal] and not sources[signal].unknown, page
    assert draft.remarks == () and "delay_s: auto" in draft.text


def test_the_pages_of_vendors_name_columns() -> None:
    assert {page for page, _ in BLOCKS} >= {"kuka.md", "abb.md", "staubli.md"}


def test_positions_of_kuka_that_are_set_are_the_commands(tmp_path: Path) -> None:
    robot = joints_called(read_robot("generic-6r"), *(f"A{k}" for k in range(1, 7)))
    motion = moved(robot)
    columns = {"t_ms": 1e3 * motion["time"]}
    for tag in ("AIPos", "ASPos", "MACur"):
        columns |= {f"{tag}.A{k + 1}": motion["torque" if tag == "MACur" else "q"][:, k] for k in range(6)}
    draft = draft_case(write_robot(tmp_path / "arm.json", robot), write_log(tmp_path / "run.csv", columns), tmp_path)
    sources = draft.recognition.sources
    patterns = {signal: sources[signal].pattern for signal in ("q", "q_ref", "current")}
    assert patterns == {"q": "AIPos.{joint}", "q_ref": "ASPos.{joint}", "current": "MACur.{joint}"}
    words = {name.replace("AI", "BI").replace("AS", "BS"): values for name, values in columns.items()}
    unknown = draft_case(write_robot(tmp_path / "arm.json", robot), write_log(tmp_path / "b.csv", words), tmp_path)
    assert "which columns are the measured positions" in unknown.text  # words that nobody knows are asked


def test_motor_states_of_unitree_are_those_of_joints(tmp_path: Path) -> None:
    robot = read_robot("generic-6r")
    motion = moved(robot)
    columns = {"timestamp": motion["time"]}
    columns |= {f"motor_state[{k}].q": motion["q"][:, k] for k in range(6)}
    columns |= {f"motor_state[{k}].tau_est": motion["torque"][:, k] for k in range(6)}
    draft = draft_case(write_robot(tmp_path / "arm.json", robot), write_log(tmp_path / "run.csv", columns), tmp_path)
    assert "side:" not in draft.text and "position: rad" in draft.text
    motors = {name.replace("state[", "side["): values for name, values in columns.items()}
    other = draft_case(write_robot(tmp_path / "arm.json", robot), write_log(tmp_path / "b.csv", motors), tmp_path)
    assert "side: {q: motor, torque: motor}" in other.text  # columns of motors are before the gears else


def test_a_draft_without_positions_has_the_lines_that_need_none(tmp_path: Path) -> None:
    robot = read_robot("generic-6r")
    motion = moved(robot)
    columns = {"t_ms": 1e3 * motion["time"]}
    columns |= {f"{side}_pos{k + 1}": motion["q"][:, k] for side in ("near", "away") for k in range(6)}
    columns |= {f"iq{k + 1}": motion["torque"][:, k] for k in range(6)}
    draft = draft_case(write_robot(tmp_path / "arm.json", robot), write_log(tmp_path / "run.csv", columns), tmp_path)
    assert "which columns are the measured positions" in draft.text and "current: 'iq{}'" in draft.text
    assert "delay_s: auto" in draft.text and "drives: ask" in draft.text and "looked at; likely ms" in draft.text
    answers = {"which columns": "'near_pos{}'", "the unit of the time": "ms", "the unit of the positions": "rad"}
    gains = ", ".join(f"{name}: {{gain: 1}}" for name in robot.joint_names)
    case = read(draft, tmp_path, {**answers, "the drives": f"{{{gains}}}"})
    np.testing.assert_allclose(np.asarray(case.read(case.train[0]).torque), motion["torque"])


@pytest.mark.parametrize(
    "efforts",
    [
        ["DriveTorque_Nm1", "DriveTorque_Nm2", "DriveForce_N", "DriveTorque_Nm3"],
        ["Torque1 [Nm]", "Torque2 [Nm]", "Force1 [N]", "Torque3 [Nm]"],
    ],
)
def test_forces_of_slides_and_torques_in_two_groups_are_the_efforts_of_all_joints(
    efforts: list[str], slides: dict[str, Array], tmp_path: Path
) -> None:
    columns = columns_of(slides, [f"ActPos{k}" for k in range(1, 5)], efforts, np.ones(4))
    columns |= {f"CmdPos{k + 1}": slides["q"][:, k] for k in range(4)}
    draft = draft_case("generic-scara", write_log(tmp_path / "run.csv", columns), tmp_path)
    found = draft.recognition
    assert found.sources["torque"].columns == tuple(efforts) and not is_servo_log(found)
    assert found.units["torque"].words == ("N m", "N m", "N", "N m")
    assert "friction:" in draft.text and "delay_s: auto" in draft.text and draft.remarks == ()
    log = read(draft, tmp_path, {"the bias of": "0"} if draft.needed else {}).read(str(tmp_path / "run.csv"))
    np.testing.assert_allclose(np.asarray(log.torque), slides["torque"])


def test_groups_of_other_counts_are_not_the_efforts_of_all_joints() -> None:
    robot = read_robot("generic-scara")
    header = [*(f"ActPos{k}" for k in range(1, 5)), *(f"Torque_Nm{k}" for k in range(1, 4))]
    for more in (
        ["Force_N1", "Force_N2"],
        ["CmdForce_N"],
        ["Force_mm"],
    ):  # two slides, another kind, no unit of a force
        assert {group.count for group in groups_of_robot([*header, *more], robot, StatedJoints())} <= {2, 3, 4}
        assert len(groups_of_robot([*header, *more], robot, StatedJoints())) == len(
            groups_of([*header, *more], robot.joint_names)
        )
    assert [group.count for group in groups_of_robot([*header, "Force_N"], robot, StatedJoints())] == [4, 4]


@pytest.mark.parametrize("spelt", ["axis_{}_actpos_{unit}", "pos_{}_{unit}", "pos_{unit}"])
@pytest.mark.parametrize("is_right", [True, False])
def test_units_at_the_end_of_names_of_positions_are_taken_where_the_limits_agree(
    spelt: str, is_right: bool, slides: dict[str, Array], tmp_path: Path
) -> None:
    linear = [joint.kind == "prismatic" for joint in read_robot("generic-scara").active]
    units = ["mm" if is_linear else "deg" for is_linear in linear]
    number = "{}" in spelt
    q = [spelt.format(k, unit=unit) for k, unit in enumerate(units, 1)]
    q = q if number else ["pos_deg1", "pos_deg2", "pos_mm", "pos_deg3"]
    factors = np.where(linear, 1e3, 180 / np.pi) * (1.0 if is_right else 100.0)
    columns = columns_of(slides, q, [f"tau{k}" for k in range(1, 5)], factors)
    draft = draft_case("generic-scara", write_log(tmp_path / "run.csv", columns), tmp_path)
    told = draft.recognition.units["position"]
    assert draft.recognition.sources["q"].columns == tuple(q) and told.certain == is_right
    assert told.words == tuple(units) if is_right else "the header states" in told.why
