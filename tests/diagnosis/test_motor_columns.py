"""Logs of motors of which one turns with the joint before it too, as of a parallelogram, read as logs of joints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from benchmarks.faults.trials import Trial, virtual

from dynident.case.case import Case, read_case
from dynident.diagnosis.causes.column_readings import PositionReadings

RATE = 100.0


def of_motors(case: Case, motor: int, way: float) -> tuple[Trial, Trial]:
    """Return a log of motors as if they were joints, and the same under the case that a user should have."""
    coupling = np.eye(case.robot.dof)
    coupling[motor, motor - 1] = way
    right = replace(case, robot=case.robot.with_drives({}, coupling))
    log = virtual(right, rate=RATE).columns
    turned = {name: log[name] @ coupling.T for name in ("q", "dq")}
    columns = {"t": log["t"], **turned, "tau": log["tau"] @ np.linalg.inv(coupling)}
    on_motors = replace(case.columns, motor=("q", "dq", "torque"))
    return Trial(case, columns), Trial(replace(right, columns=on_motors), columns)


def told(case: Case, motor: int, way: float, folder: Path) -> None:
    """Assert that the coupling is named, with its lines, and that nothing is said of a case that has them."""
    read, right = of_motors(case, motor, way)
    (found,) = [one for one in read.examined(folder).findings if one.severity == "error"]
    names, row = case.robot.joint_names, ["0"] * case.robot.dof
    assert (found.name, found.joint) == ("coupling", f"{names[motor - 1]}, {names[motor]}")
    assert found.numbers[f"entry {motor + 1}, {motor}"] == way
    row[motor - 1], row[motor] = f"{way:g}", "1"
    assert f"[{', '.join(row)}]" in found.remedy and "log: side: motor" in found.remedy
    assert [one.line() for one in right.examined(folder).findings if one.severity != "note"] == []


@pytest.mark.parametrize("way", [pytest.param(-1.0, marks=pytest.mark.battery), 1.0])
def test_a_motor_that_turns_with_the_joint_before_is_named_and_obeyed(case: Case, way: float, tmp_path: Path) -> None:
    told(case, 2, way, tmp_path)


@pytest.mark.battery
@pytest.mark.parametrize(("motor", "way"), [(2, 1.0), (2, -1.0), (3, 1.0)])
def test_so_it_is_on_an_arm_of_six_joints(motor: int, way: float, tmp_path: Path) -> None:
    case = read_case("generic-6r")
    drives = {one.name: replace(one.drive, gear_ratio=1.0) for one in case.robot.active}
    told(replace(case, robot=case.robot.with_drives(drives, np.eye(6))), motor, way, tmp_path)


def test_no_such_rows_are_made_of_a_right_log(case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(PositionReadings, "_coupled_rows", never)
    assert not any(one.severity == "error" for one in virtual(case, rate=RATE).examined(tmp_path).findings)


@pytest.mark.parametrize("way", [1.0, pytest.param(-1.0, marks=pytest.mark.battery)])
def test_an_angle_that_is_counted_from_the_base_is_named_and_its_line_is_right(
    case: Case, way: float, tmp_path: Path
) -> None:
    """As controllers do that count a forearm's angle from the horizontal; another scale of a position had been told."""
    names, log = case.robot.joint_names, virtual(case, rate=RATE).columns
    counted = {name: log[name] - way * log[name][:, [1]] * (np.arange(3) == 2) for name in ("q", "dq")}
    trial = Trial(case, {**log, **counted})
    (found,) = [one for one in trial.examined(tmp_path).findings if one.severity == "error"]
    assert (found.name, found.joint, found.numbers[f"of {names[1]}"]) == ("absolute angle", names[2], way)
    stated = yaml.safe_load(found.remedy[found.remedy.index("{") : found.remedy.rindex("}") + 1])
    columns = replace(case.columns, **{name: tuple(one) for name, one in stated.items()})
    right = replace(trial, case=replace(case, columns=columns))
    assert [one.line() for one in right.examined(tmp_path).findings if one.severity != "note"] == []
