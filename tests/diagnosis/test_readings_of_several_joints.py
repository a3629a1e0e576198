"""Signs of all joints and units of several: which of positions and torques are at fault."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from benchmarks.faults import injections as put
from benchmarks.faults.all_joints import logs
from benchmarks.faults.clean import findings_of
from benchmarks.faults.trials import Trial, virtual

from dynident.case.case import read_case
from dynident.diagnosis.causes.cause_search import Cause
from dynident.diagnosis.causes.trends import Trends
from dynident.diagnosis.checks.readings import is_zero
from dynident.diagnosis.examination import examine
from dynident.diagnosis.finding import Finding


def turned(trial: Trial, *names: str) -> Trial:
    return trial.with_columns(**{name: -trial.columns[name] for name in names})


def errors_of(trial: Trial, folder: Path) -> list[Finding]:
    return [one for one in trial.examined(folder).findings if one.severity == "error"]


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (("q", "dq"), "position sign"),
        (("tau",), "torque sign"),
        pytest.param(("q", "dq", "tau"), "axis sign", marks=pytest.mark.battery),  # tries all readings
    ],
)
def test_signs_of_all_joints_are_told_by_what_explains_the_log(
    names: tuple[str, ...], told: str, tmp_path: Path
) -> None:
    trial = virtual(read_case("generic-6r"), rate=100.0)
    (error,) = errors_of(turned(trial, *names), tmp_path)
    assert (error.name, error.joint) == (told, ", ".join(trial.case.robot.joint_names))
    assert all(f"-{unit}" in error.remedy for unit in (("N m",) if told == "torque sign" else ("rad",)))


def test_of_signs_that_a_symmetrical_arm_does_not_tell_those_of_the_torques_are_told(tmp_path: Path) -> None:
    """Mirrored in a plane through all its axes, the arm that turns the other way has the torques turned."""
    (error,) = errors_of(turned(virtual(read_case("generic-7r"), rate=100.0), "tau"), tmp_path)
    assert error.name == "torque sign" and "positions turned in place of all torques" in error.evidence


@pytest.mark.parametrize(("gain", "share", "is_told"), [(50.0, 0.9, True), (8.0, 0.9, False), (50.0, 0.2, False)])
def test_a_zero_that_explains_far_more_than_a_mounting_is_the_cause(gain: float, share: float, is_told: bool) -> None:
    """Figures of a humanoid's arm whose first axis is level: 49.9 by the zero of its roll, 7.2 by another gravity."""
    zero = SimpleNamespace(cause=Cause("position zero", "roll", np.zeros((1, 0, 1))), gain=gain, share=share, size=0.2)
    assert is_zero(cast("Trends", SimpleNamespace(blames=[zero])), 7.2) is is_told
    assert not is_zero(None, 7.2)


LINK = """<robot name="one"><link name="base"/><link name="link"><inertial><origin xyz="0.3 0 0"/><mass value="{mass}"/>
<inertia ixx="0.01" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="{kind}">
<parent link="base"/><child link="link"/><axis xyz="{axis}"/>
<limit lower="-2" upper="2" effort="200" velocity="5"/></joint></robot>"""


def one_joint(
    kind: str, folder: Path, signs: tuple[float, float], mass: float = 4.0, position: str = "SI", drag: float = 4.0
) -> Path:
    """Write a log of one pendulum or lift of 4 kg, position and torque times their signs; return its case."""
    t = np.arange(0.0, 20.0, 0.01)
    shape = 0.3 * np.sin(2 * np.pi * 0.23 * t) + 0.2 * np.sin(2 * np.pi * 0.61 * t + 1.0)
    q, dq, ddq = shape, np.gradient(shape, t), np.gradient(np.gradient(shape, t), t)
    rigid = (4 * 0.09 + 0.1) * ddq - 4 * 9.81 * 0.3 * np.cos(q) if kind == "revolute" else 4 * (ddq + 9.81)
    tau = rigid + drag * (dq + 1.5 * np.tanh(dq / 0.01)) + 0.05 * np.random.default_rng(1).normal(size=len(t))
    axis = "0 1 0" if kind == "revolute" else "0 0 1"
    (folder / "one.urdf").write_text(LINK.format(kind=kind, axis=axis, mass=mass))
    rows = np.column_stack([t, signs[0] * q, signs[1] * tau])
    np.savetxt(folder / "run.csv", rows, delimiter=",", header="t,q1,tau1", comments="")
    text = "case: 2\nrobot: one.urdf\nfriction: [coulomb, viscous, offset]\nlog: {columns: {time: t, q: [q1], torque: "
    (folder / "case.yaml").write_text(text + f"[tau1]}}, units: {{position: {position}}}}}\n")
    return folder / "case.yaml"


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize(("signs", "told"), [((-1.0, 1.0), "position sign"), ((1.0, -1.0), "torque sign")])
def test_masses_tell_signs_of_one_joint_that_its_motion_does_not(
    kind: str, signs: tuple[float, float], told: str, tmp_path: Path
) -> None:
    case = read_case(one_joint(kind, tmp_path, signs))
    (error,) = [one for one in examine(case, str(tmp_path / "run.csv")).findings if one.severity == "error"]
    assert error.name == told and "masses" in error.evidence
    right = read_case(one_joint(kind, tmp_path, (1.0, 1.0)))
    assert not [one for one in examine(right, str(tmp_path / "run.csv")).findings if one.severity != "note"]


@pytest.mark.parametrize(
    ("kind", "signs", "told"),
    [
        ("revolute", (-1.0, -1.0), "mounting"),
        ("revolute", (1.0, -1.0), "torque sign"),
        ("prismatic", (-1.0, 1.0), "position sign"),
        ("prismatic", (1.0, -1.0), "torque sign"),
    ],
)
def test_masses_tell_signs_where_friction_is_little(
    kind: str, signs: tuple[float, float], told: str, tmp_path: Path
) -> None:
    """A pendulum that counts the other way is no other than one upside down."""
    case = read_case(one_joint(kind, tmp_path, signs, drag=0.02))
    (error,) = [one for one in examine(case, str(tmp_path / "run.csv")).findings if one.severity == "error"]
    assert error.name == told
    assert ("not distinguishable from axis sign" in error.evidence) == (told == "mounting")


def test_signs_that_neither_motion_nor_masses_tell_are_told_as_one_of_two(tmp_path: Path) -> None:
    case = read_case(one_joint("revolute", tmp_path, (-1.0, 1.0), mass=0.0))
    (error,) = [one for one in examine(case, str(tmp_path / "run.csv")).findings if one.severity == "error"]
    assert "not distinguishable" in error.evidence


def test_a_slide_logged_in_metres_and_declared_in_millimetres(tmp_path: Path) -> None:
    case = read_case(one_joint("prismatic", tmp_path, (1.0, 1.0), position="mm"))
    (error,) = [one for one in examine(case, str(tmp_path / "run.csv")).findings if one.severity == "error"]
    assert (error.name, error.joint) == ("position unit", "j") and "units: {position: m}" in error.remedy


@pytest.mark.battery
@pytest.mark.parametrize("joints", [(1, 2), (0, 5), (2, 3)])
def test_positions_of_two_joints_in_degrees_are_told_as_both(joints: tuple[int, int], tmp_path: Path) -> None:
    trial = virtual(read_case("generic-6r"), rate=100.0).without("dq")
    words = tuple("deg" if k in joints else "rad" for k in range(6))
    (error,) = errors_of(put.declared(trial, position=words), tmp_path)
    names = trial.case.robot.joint_names
    assert (error.name, error.joint) == ("position unit", ", ".join(names[k] for k in joints))


@pytest.mark.parametrize("seed", [14, pytest.param(5, marks=pytest.mark.battery)])
def test_a_unit_of_all_torques_is_told_beside_an_unknown_tool(seed: int, tmp_path: Path) -> None:
    every = {kind: made for kind, *made in logs(seed)}
    for kind, factor in (("right with a tool", 0.0), ("tool, torques / 9.81", 1 / 9.81)):
        columns, model, side = every[kind]
        found = findings_of(columns, model, side, tmp_path)
        errors = [one for one in found if one.severity == "error"]
        assert [one.name for one in errors] == ["torque unit"] * bool(factor)
        assert not factor or errors[0].numbers["ratio"] == pytest.approx(factor, rel=0.25)
