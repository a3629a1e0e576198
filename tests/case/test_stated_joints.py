"""Cells that name joints beside numbered columns, as messages of ROS do: their order stands, not that of the chain."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drafted_logs import joints_called, moved, numbered, read, write_log, write_robot
from dynident.arrays import Array
from dynident.case.case_draft import Draft, draft_case
from dynident.case.draft.signal_units import position_unit
from dynident.errors import LogFormatError
from dynident.model.joint import JointLimits
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

#: What a driver writes: joints by the alphabet, and their places in the chain.
NAMES = ("elbow", "lift", "pan", "wrist_1", "wrist_2", "wrist_3")
ORDER = (2, 1, 0, 3, 4, 5)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return joints_called(read_robot("generic-6r"), *(NAMES[k] for k in ORDER))


@pytest.fixture(scope="module")
def motion(robot: Robot) -> dict[str, Array]:
    return moved(robot, 400)


def text_of(motion: dict[str, Array], names: Callable[[int], Sequence[str]], header: Sequence[str] | None) -> str:
    """Return a log whose rows hold the time, names by row, and positions, velocities and torques in their order."""
    signals = np.hstack([motion[key][:, ORDER] for key in ("q", "dq", "torque")])
    rows = [",".join(header)] if header else []
    for k, (time, values) in enumerate(zip(motion["time"], signals, strict=True)):
        stamp = [repr(float(time))] if header else [str(1700000000 + int(time)), str(round(time % 1 * 1e9)), "base"]
        rows.append(",".join([*stamp, *names(k), *map(repr, values.tolist())]))
    return "\n".join(rows) + "\n"


def header_of(name: str, signal: str, count: int = 6) -> list[str]:
    words = [signal.format(word) for word in ("position", "velocity", "effort")]
    return ["time", *(name.format(k) for k in range(count)), *(f"{w.format(k)}" for w in words for k in range(6))]


def drafted(folder: Path, robot: Robot, text: str, *more: str) -> Draft:
    logs = [folder / f"run{k}.csv" for k in range(1 + len(more))]
    for log, own in zip(logs, (text, *more), strict=True):
        log.write_text(own, encoding="utf-8")
    return draft_case(write_robot(folder / "arm.json", robot), str(logs[0]), folder, test=list(map(str, logs[1:])))


@pytest.mark.parametrize(("name", "signal"), [("name[{}]", "{}[{{}}]"), ("field.name{}", "field.{}{{}}")])
def test_joints_are_those_that_the_cells_name(
    name: str, signal: str, robot: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    draft = drafted(tmp_path, robot, text_of(motion, lambda _: NAMES, header_of(name, signal)))
    joints = draft.recognition.joints
    assert joints.names == robot.joint_names and joints.certain and not draft.needed
    assert joints.why == f"by {name.format(0)} to {name.format(5)}"
    log = read(draft, tmp_path).read("run0.csv")
    np.testing.assert_allclose(log.q, motion["q"])
    np.testing.assert_allclose(np.asarray(log.torque), motion["torque"])


@pytest.mark.parametrize("cell", ["[{}]", '"{}"', "\"['{}']\""])
def test_names_may_be_a_list_in_one_cell(cell: str, robot: Robot, motion: dict[str, Array], tmp_path: Path) -> None:
    """As a driver writes them, or a library of ROS bags."""
    sign = {"[{}]": " ", '"{}"': ", ", "\"['{}']\"": "', '"}[cell]
    text = text_of(
        motion, lambda _: [cell.format(sign.join(NAMES))], ["time", "name", *header_of("", "{}_{{}}", 0)[1:]]
    )
    draft = drafted(tmp_path, robot, text)
    assert draft.recognition.joints.why == "by name" and not draft.needed
    np.testing.assert_allclose(read(draft, tmp_path).read("run0.csv").q, motion["q"])


def test_joint_states_without_a_header_as_ros2_topic_echo_writes_them(
    robot: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    draft = drafted(tmp_path, robot, text_of(motion, lambda _: NAMES, None))
    assert "names: [sec, nanosec, frame_id, name0," in draft.text and draft.recognition.joints.certain
    log = read(draft, tmp_path).read("run0.csv")
    np.testing.assert_allclose(log.q, motion["q"])
    np.testing.assert_allclose(np.diff(log.time), 0.01, atol=1e-6)


def test_records_of_json_are_refused_with_the_line_that_makes_a_log_of_them(
    robot: Robot, motion: dict[str, Array], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pandas")
    rows = zip(motion["time"].tolist(), *(motion[key][:, ORDER].tolist() for key in ("q", "torque")), strict=True)
    records = [json.dumps({"stamp": t, "name": NAMES, "position": q, "effort": torque}) for t, q, torque in rows]
    (tmp_path / "run0.jsonl").write_text("\n".join(records), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(LogFormatError, match="write its records as a table") as refused:
        draft_case(write_robot(tmp_path / "arm.json", robot), "run0.jsonl")
    exec(str(refused.value).partition("as a table: ")[2])
    draft = draft_case("arm.json", "run0.jsonl.csv")
    assert draft.recognition.joints.why == "by name[0] to name[5]"
    np.testing.assert_allclose(read(draft, tmp_path).read("run0.jsonl.csv").q, motion["q"])


def test_names_that_change_their_order_are_an_error_with_the_row(
    robot: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    header, chain = header_of("name[{}]", "{}[{{}}]"), [NAMES[k] for k in ORDER]
    turned = text_of(motion, lambda row: chain if row > 7 else NAMES, header)
    with pytest.raises(
        LogFormatError, match=r"run0\.csv:10: name.* to .*: pan, lift, elbow, .* in place of elbow, lift,"
    ):
        drafted(tmp_path, robot, turned)
    with pytest.raises(LogFormatError, match=r"run1\.csv:2: .*write a column for each joint"):
        same = text_of(motion, lambda _: NAMES, header)
        drafted(tmp_path, robot, same, text_of(motion, lambda _: chain, header))


@pytest.mark.parametrize(
    ("names", "certain", "why"),
    [
        (
            ("a", "b", "c", "d", "e", "f"),
            False,
            "name[0] to name[5] hold other names than the joints of the robot: a, b,",
        ),
        (("elbow", "lift", "turret", *NAMES[3:]), False, "turret in name[0] to name[5]: no joint of the robot"),
        (NAMES[:5], False, "name[0] to name[4] hold another number of joints: elbow,"),
        (tuple(f"arm/{name}" for name in NAMES), True, "by name[0] to name[5]"),
    ],
)
def test_names_of_other_joints_are_asked(
    names: tuple[str, ...], certain: bool, why: str, robot: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    draft = drafted(tmp_path, robot, text_of(motion, lambda _: names, header_of("name[{}]", "{}[{{}}]", len(names))))
    assert draft.recognition.joints.certain == certain and why in draft.recognition.joints.why
    assert any("in their order" in question.text for question in draft.needed) == (not certain)


def test_few_joints_near_the_masses_do_not_settle_the_unit_of_torques_in_the_order_of_the_chain(
    robot: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    """Torques of one joint fit where the columns are in another order; names of the joints settle it."""
    one = motion["torque"] * np.where(np.arange(6) == 1, 1.0, 0.0) + np.random.default_rng(1).normal(size=(400, 6))
    only = {**motion, "torque": one}
    by_number = draft_case(write_robot(tmp_path / "arm.json", robot), write_log(tmp_path / "a.csv", numbered(only)))
    unit = by_number.recognition.units["torque"]
    assert not unit.certain and unit.words[0] == "N m"
    assert (
        "times the torque of the robot model's masses on 1 of 6 joints, too few" in unit.why
        and " to " not in unit.why[:8]
    )
    by_name = drafted(tmp_path, robot, text_of(only, lambda _: NAMES, header_of("name[{}]", "{}[{{}}]")))
    assert by_name.recognition.units["torque"].certain


def test_one_joint_beyond_its_limits_in_radians_is_no_arm_of_two_units(robot: Robot) -> None:
    limits = JointLimits(lower=-np.pi, upper=np.pi, velocity=2.0, effort=50.0)
    joints = [replace(joint, name=f"A{k}", limits=limits) for k, joint in enumerate(robot.joints[:5])]
    phase = np.linspace(0, 6, 200)
    q = np.stack([np.sin(phase + k) for k in range(5)], axis=1)
    q[:, 2] += 3.0
    told = position_unit(q, joints, "")
    assert not told.certain and told.text == "" and "where units differ" not in told.why
    assert "4 of 5 joints are within them as rad" in told.why
    assert "A2 leaves its limits" in told.why and told.why.endswith("correct these limits or the order of the columns")


def test_joints_at_rest_do_not_outvote_those_that_move_in_radians(robot: Robot) -> None:
    """Of a humanoid one arm moves; columns in another order had been offered in degrees for 32 of 39 joints."""
    limits = JointLimits(lower=-1.0, upper=1.0, velocity=2.0, effort=50.0)
    joints = [replace(joint, name=f"A{k}", limits=limits) for k, joint in enumerate(robot.joints)]
    q = np.tile([1.5, 1.4, -1.5, 0.2, 0.0, 0.0], (200, 1))
    q[:, 4:] += np.sin(np.linspace(0, 6, 200))[:, None] * [0.9, 0.8]
    told = position_unit(q, joints, "")
    assert not told.certain and told.text == "" and "where units differ" not in told.why
    assert "2 of 2 joints that move are within them as rad" in told.why
    assert told.why.endswith("correct these limits or the order of the columns")
    assert position_unit(np.degrees(q / 2), joints, "").text == "deg"
