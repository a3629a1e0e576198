"""Every bad input ends in one line that names file, row or joint and the next step, exit code 1 and no output file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dynident.cli.main import main

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="3"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.05"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.15 0 0"/><mass value="2"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="100" velocity="3"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="100" velocity="3"/></joint>
</robot>
"""


def rows(count: int = 2000) -> list[list[float]]:
    time = np.arange(count) / 200
    q = np.column_stack([np.sin(1.7 * time) + 0.3 * np.sin(5 * time), np.cos(2.3 * time) + 0.2 * np.sin(7 * time)])
    noise = np.random.default_rng(0).normal(0, 0.1, q.shape)
    torque = 10 * np.cos(q) + 0.5 * np.gradient(q, time, axis=0) + noise
    return np.column_stack([time, q, torque]).tolist()


def table(values: list[list[float]], header: str = "t,q1,q2,tau1,tau2") -> str:
    return "\n".join([header, *(",".join(map(repr, row)) for row in values)]) + "\n"


def changed(row: int, column: int, text: str) -> str:
    lines = table(rows()).splitlines()
    cells = lines[row].split(",")
    cells[column] = text
    lines[row] = ",".join(cells)
    return "\n".join(lines) + "\n"


def still() -> str:
    return table([[t, a, 0.25, x, y] for t, a, _, x, y in rows()])


def backwards() -> str:
    values = rows()
    values[100][0] = values[50][0]
    return table(values)


LOGS: dict[str, tuple[str, tuple[str, ...]]] = {
    "missing column": (
        table(rows(), "t,q1,q2,torque1,tau2"),
        ("run.csv:1", "no column 'tau1'", "columns: in the case"),
    ),
    "text": (changed(7, 3, "fast"), ("run.csv:8", "'tau1'", "fast")),
    "NaN": (changed(9, 2, "nan"), ("run.csv:10", "'q2'", "nan")),
    "time back": (backwards(), ("run.csv:102", "runs back", "split the log")),
    "few samples": (table(rows(8)), ("run.csv", "8 rows", "seconds of motion")),
    "still": (still(), ("run.csv", "elbow never moved", "locked")),
    "empty": ("", ("run.csv", "empty")),
    "header only": ("t,q1,q2,tau1,tau2\n", ("run.csv:1", "no rows")),
    "ragged": (table(rows()) + "1,2\n", ("run.csv:2002", "2")),
}


def refused(arguments: list[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    before = sorted(folder.rglob("*"))
    assert main(arguments) == 1
    out, err = capsys.readouterr()
    lines = [line for line in err.splitlines() if not line.startswith("  ")]  # progress is indented
    assert out == ""
    assert len(lines) == 1, err
    assert lines[0].startswith("error: ")
    assert "; " in lines[0], "no next step"
    assert sorted(folder.rglob("*")) == before, "a file was left behind"
    return lines[0]


@pytest.fixture
def arm(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str = URDF) -> Path:
        path = tmp_path / "arm.urdf"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize("fault", LOGS)
def test_bad_log(fault: str, arm: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text, words = LOGS[fault]
    log = tmp_path / "run.csv"
    log.write_text(text, encoding="utf-8")
    outputs = ["-o", str(tmp_path / "estimate.json"), "--report", str(tmp_path / "report.html")]
    message = refused(["identify", str(arm()), str(log), *outputs], tmp_path, capsys)
    assert all(word in message for word in words), message


ROBOTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "entity": (
        '<!DOCTYPE robot [<!ENTITY a "x">]>' + URDF.split("\n", 1)[1].replace('name="arm"', 'name="&a;"'),
        ("arm.urdf",),
    ),
    "dtd": ("<!DOCTYPE robot>" + URDF.split("\n", 1)[1], ("arm.urdf",)),
    "cycle": (URDF.replace('parent link="base"', 'parent link="lower"'), ("arm.urdf",)),
    "two roots": (
        URDF.replace('<link name="base"/>', '<link name="base"/><link name="stray"/>'),
        ("arm.urdf", "stray"),
    ),
    "mass 1,5": (URDF.replace('mass value="3"', 'mass value="1,5"'), ("arm.urdf", "upper", "'1,5'")),
    "mass nan": (URDF.replace('mass value="3"', 'mass value="nan"'), ("arm.urdf", "upper", "'nan'")),
    "mass negative": (URDF.replace('mass value="3"', 'mass value="-3"'), ("arm.urdf", "upper", "-3")),
    "axis zero": (URDF.replace('<axis xyz="0 1 0"/>\n', '<axis xyz="0 0 0"/>\n', 1), ("arm.urdf", "shoulder")),
    "cut off": (URDF[:300], ("arm.urdf",)),
}


@pytest.mark.parametrize("fault", ROBOTS)
def test_bad_robot(fault: str, arm: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text, words = ROBOTS[fault]
    message = refused(["inspect", str(arm(text))], tmp_path, capsys)
    assert all(word in message for word in words), message


CASES: dict[str, tuple[str, tuple[str, ...]]] = {
    "unknown key": ("frction: [coulomb]", ("case.yaml", "'frction'", "did you mean 'friction'?")),
    "unit word": ("log: {units: {position: degrees}}", ("case.yaml", "'degrees'", "did you mean 'deg'?")),
    "joint": ("joints: [shoulder, elbw]", ("case.yaml", "'elbw'", "elbow")),
    "friction": ("friction: [coulom]", ("case.yaml", "'coulom'", "did you mean 'coulomb'?")),
    "option": ("friction: [{coulomb: {widht: 0.1}}]", ("case.yaml", "widht", "did you mean 'width'?")),
    "value": ("friction: [{coulomb: {width: -1}}]", ("case.yaml", "width", "-1")),
    "split": ("split: first:1.5", ("case.yaml", "first:1.5")),
    "locked": ("locked: {wrist: 0}", ("case.yaml", "'wrist'")),
}


@pytest.mark.parametrize("fault", CASES)
def test_bad_case(fault: str, arm: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line, words = CASES[fault]
    arm()
    log = tmp_path / "run.csv"
    log.write_text(table(rows()), encoding="utf-8")
    case = tmp_path / "case.yaml"
    case.write_text(f"case: 1\nrobot: arm.urdf\n{line}\n", encoding="utf-8")
    message = refused(["identify", str(case), str(log)], tmp_path, capsys)
    assert all(word in message for word in words), message


def test_the_log_of_these_tests_is_sound(
    arm: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "run.csv"
    log.write_text(table(rows()), encoding="utf-8")
    assert main(["identify", str(arm()), str(log), "--quiet"]) == 0
    assert "physically consistent" in capsys.readouterr().out
