"""Drafted case files: columns told by their names, doubts said aloud, and a file that the reader takes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynident.errors import LogFormatError
from dynident.experiment.case_file.case import read_case
from dynident.experiment.case_file.case_draft import WORDS, draft_case, find_columns
from dynident.experiment.formats import Units
from dynident.model.descriptions.native import robot_to_dict
from dynident.model.robot import Joint, JointLimits, Robot


@pytest.fixture
def arm(tmp_path: Path, planar_2r: Robot) -> Path:
    return write_robot(tmp_path, planar_2r)


def write_robot(folder: Path, robot: Robot) -> Path:
    path = folder / "arm.json"
    path.write_text(json.dumps(robot_to_dict(robot)))
    return path


def write_csv(folder: Path, names: list[str], columns: np.ndarray | None = None, name: str = "run.csv") -> Path:
    """Write a log of 50 samples, 10 ms apart; the first column is the time."""
    values = np.sin(np.outer(np.arange(50), np.linspace(0.1, 0.4, len(names) - 1))) if columns is None else columns
    rows = [",".join(names)] + [",".join([str(0.01 * k), *map(repr, row)]) for k, row in enumerate(values.tolist())]
    (folder / name).write_text("\n".join(rows) + "\n")
    return folder / name


def joints_called(robot: Robot, *names: str) -> Robot:
    return replace(robot, joints=tuple(replace(j, name=n) for j, n in zip(robot.joints, names, strict=True)))


HEADERS = [
    (["t", "q1", "q2", "tau1", "tau2"], {"q": ("q1", "q2"), "torque": ("tau1", "tau2")}),
    (["timestamp", "actual_q_0", "actual_q_1", "actual_current_0", "actual_current_1"],
     {"q": ("actual_q_0", "actual_q_1"), "current": ("actual_current_0", "actual_current_1")}),
    (["Time", "Position 2", "Position 1", "Velocity 1", "Velocity 2", "Torque 1", "Torque 2"],
     {"q": ("Position 1", "Position 2"), "dq": ("Velocity 1", "Velocity 2"), "torque": ("Torque 1", "Torque 2")}),
    (["stamp", "elbow_position", "shoulder_position", "effort_shoulder", "effort_elbow"],
     {"q": ("shoulder_position", "elbow_position"), "torque": ("effort_shoulder", "effort_elbow")}),
    (["t", "q_1", "q_2", "qd_1", "qd_2", "i1", "i2", "temp"],
     {"q": ("q_1", "q_2"), "dq": ("qd_1", "qd_2"), "current": ("i1", "i2")}),
    (["t", "q1", "q2"], {"q": ("q1", "q2")}),
]  # fmt: skip


@pytest.mark.parametrize(("header", "signals"), HEADERS, ids=lambda value: str(value)[:30])
def test_columns_are_told_by_their_names(
    header: list[str], signals: dict[str, tuple[str, ...]], planar_2r: Robot
) -> None:
    found = find_columns(header, joints_called(planar_2r, "shoulder", "elbow"), "run.csv")
    assert found.time == header[0] and dict(found.signals) == signals


@pytest.mark.parametrize(
    ("header", "missing"),
    [
        (["q1", "q2", "tau1", "tau2"], "time"),
        (["t", "tau1", "tau2"], "positions"),
        (["t", "q1", "tau1", "tau2"], "positions"),  # one joint too few
        (["t", "q1", "q2", "q3", "tau1"], "positions"),  # one too many: which two?
    ],
)
def test_what_cannot_be_told_is_asked_for(header: list[str], missing: str, planar_2r: Robot) -> None:
    with pytest.raises(LogFormatError) as caught:
        find_columns(header, planar_2r, "run.csv")
    assert str(caught.value) == (
        f"run.csv:1: no columns for the {missing} of 2 joints can be told; the header has {', '.join(header)}; "
        "write the case file by hand (docs/case-file.md) and name the columns there"
    )


@pytest.mark.parametrize("signal", [signal for signal in WORDS if signal != "time"])
def test_every_word_is_found(signal: str, planar_2r: Robot) -> None:
    for word in WORDS[signal]:
        header = ["t", "q1", "q2", f"{word.upper()}_1", f"{word.upper()}_2"]
        if signal == "q":
            header = ["t", f"{word.upper()}_1", f"{word.upper()}_2"]
        if word == "q":
            continue
        found = find_columns(header, planar_2r, "run.csv")
        assert found.signals[signal] == (f"{word.upper()}_1", f"{word.upper()}_2")


@pytest.mark.parametrize(("header", "signals"), HEADERS[:3], ids=lambda value: str(value)[:30])
def test_the_draft_is_a_case_that_reads_its_log(
    header: list[str], signals: dict[str, tuple[str, ...]], arm: Path, tmp_path: Path
) -> None:
    log = write_csv(tmp_path, header)
    text = draft_case(str(arm), str(log), tmp_path).text
    if "current" in signals:
        text = text.replace("{gain: }", "{gain: 2}")
    (tmp_path / "case.yaml").write_text(text)
    case = read_case(tmp_path / "case.yaml")
    assert case.train == ("run.csv",) and case.estimator.name == "consistent" and case.split is not None
    read = case.read(case.train[0])
    values = np.loadtxt(log, delimiter=",", skiprows=1)
    np.testing.assert_allclose(read.q, values[:, [header.index(name) for name in signals["q"]]])
    source, factor = ("torque", 1.0) if "torque" in signals else ("current", 2.0)
    expected = factor * values[:, [header.index(name) for name in signals[source]]]
    np.testing.assert_allclose(np.asarray(read.torque), expected)


def test_the_text_says_what_was_found(arm: Path, tmp_path: Path) -> None:
    draft = draft_case(str(arm), str(write_csv(tmp_path, ["t", "q1", "q2", "tau1", "tau2"])), tmp_path)
    lines = draft.text.splitlines()
    assert lines[0] == "# Case file of dynident; docs/case-file.md describes every key."
    assert lines[1:3] == [
        "# Drafted from run.csv: 50 samples, 0.49 s,",
        "# 100 Hz, steps of 10 to 10 ms.",
    ]
    assert {"case: 1", "robot: arm.json", "train: run.csv", "# locked: {joint6: 0}"} <= set(lines)
    assert "    torque: N m" in lines and "    position: rad" in lines
    assert draft.remarks == ()


def test_paths_are_relative_to_the_case(arm: Path, tmp_path: Path) -> None:
    log = write_csv(tmp_path, ["t", "q1", "q2", "tau1", "tau2"])
    (tmp_path / "cases").mkdir()
    text = draft_case(str(arm), str(log), tmp_path / "cases").text
    assert "robot: ../arm.json" in text and "train: ../run.csv" in text
    (tmp_path / "cases" / "case.yaml").write_text(text)
    case = read_case(tmp_path / "cases" / "case.yaml")
    assert case.read("../run.csv").samples == 50


def test_a_robot_that_ships_keeps_its_name(tmp_path: Path) -> None:
    names = ["t", *(f"{word}{k}" for word in ("q", "tau") for k in range(1, 5))]
    text = draft_case("generic-scara", str(write_csv(tmp_path, names)), tmp_path).text
    assert "robot: generic-scara" in text
    (tmp_path / "case.yaml").write_text(text)
    case = read_case(tmp_path / "case.yaml")
    assert case.columns.units == Units(position=("rad", "rad", "m", "rad"), torque=("N m", "N m", "N", "N m"))


def test_a_joint_that_stands_is_locked_where_it_stands(arm: Path, tmp_path: Path) -> None:
    values = np.column_stack([np.sin(np.arange(50.0)), np.full(50, 0.7), np.arange(50.0), np.ones(50)])
    draft = draft_case(str(arm), str(write_csv(tmp_path, ["t", "q1", "q2", "tau1", "tau2"], values)), tmp_path)
    assert draft.remarks == ("joint2 never moves; lock it (locked:) or record a motion of all joints",)
    assert "# CHECK: joint2 never moves; lock it (locked:) or record a motion of all joints" in draft.text
    (tmp_path / "case.yaml").write_text(draft.text)
    case = read_case(tmp_path / "case.yaml")
    assert case.robot.joint_names == ("joint1",)
    assert case.robot.links[0].fixed == ("link2",)
    assert "locked: {joint2: 0.7}" in draft.text


def test_degrees_are_suspected_and_never_converted(arm: Path, tmp_path: Path) -> None:
    values = 90.0 * np.sin(np.outer(np.arange(50), [0.1, 0.2, 0.3, 0.4]))
    draft = draft_case(str(arm), str(write_csv(tmp_path, ["t", "q1", "q2", "tau1", "tau2"], values)), tmp_path)
    assert draft.remarks == (
        f"positions reach {np.abs(values[:, :2]).max():.4g}: if they are degrees, set units: position: deg",
    )
    assert "    position: rad" in draft.text


def test_positions_beyond_the_limits_are_remarked(planar_2r: Robot, tmp_path: Path) -> None:
    limited: tuple[Joint, ...] = (replace(planar_2r.joints[0], limits=JointLimits(-0.5, 0.5)), planar_2r.joints[1])
    arm = write_robot(tmp_path, replace(planar_2r, joints=limited))
    log = write_csv(tmp_path, ["t", "q1", "q2", "tau1", "tau2"])
    (remark,) = draft_case(str(arm), str(log), tmp_path).remarks
    assert remark.startswith("joint1 leaves its limits (") and "limits -0.5 to 0.5)" in remark
    assert remark.endswith("check units, sign and order of the columns")


def test_missing_torques_and_gains_are_remarked(arm: Path, tmp_path: Path) -> None:
    only_currents = draft_case(str(arm), str(write_csv(tmp_path, ["t", "q1", "q2", "i1", "i2"])), tmp_path)
    assert only_currents.remarks == ("currents only: fill in the drive gains",)
    assert "  joint1: {gain: }" in only_currents.text and "    current: A" in only_currents.text
    neither = draft_case(str(arm), str(write_csv(tmp_path, ["t", "q1", "q2"])), tmp_path)
    assert neither.remarks == ("no torques and no currents",)


@pytest.mark.parametrize("name", ["null", "yes", "1", "a: b", "it's", "#1", "a,b", "{x}", "-", "~", "ünï"])
def test_odd_names_are_quoted(name: str, planar_2r: Robot, tmp_path: Path) -> None:
    arm = write_robot(tmp_path, joints_called(planar_2r, name, "plain"))
    header = ["t", "q1", "q2", "tau1", "tau2"]
    (tmp_path / "case.yaml").write_text(draft_case(str(arm), str(write_csv(tmp_path, header)), tmp_path).text)
    assert read_case(tmp_path / "case.yaml").robot.joint_names == (name, "plain")


def test_the_same_files_give_the_same_draft(arm: Path, tmp_path: Path) -> None:
    log = write_csv(tmp_path, ["t", "q1", "q2", "tau1", "tau2"])
    assert draft_case(str(arm), str(log), tmp_path) == draft_case(str(arm), str(log), tmp_path)
