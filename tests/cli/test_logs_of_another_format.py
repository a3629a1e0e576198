"""Commands that use an estimate on logs of another format than those of its fit, read by a case file of their own."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_answers import refused

from dynident import (
    ColumnMap,
    DynamicModel,
    Log,
    identify,
    read_case,
    read_estimate,
    read_log,
    read_robot,
    validate,
    write_estimate,
    write_log,
)
from dynident.cli.main import main
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.model.friction import FRICTION
from scara_logs import recorded

#: How the other log is read: other names, another delimiter, another order, ms and degrees, currents.
CASE = """\
case: 2
robot: generic-scara
joints: [{joints}]
{drives}
log:
  columns: {{time: ms, q: "pos {{joint}}", dq: none, {effort}: "eff {{joint}}"}}
  units: {{time: ms, position: [{units}]}}
"""


def as_other(log: Log, path: Path, gains: dict[str, float]) -> Path:
    """Write the log with other columns and units, currents in place of torques where there are gains."""
    assert log.torque is not None
    names = log.joints[::-1]
    kinds = {joint.name: joint.kind for joint in read_robot("generic-scara").active}
    columns = [1000.0 * log.time]
    for name in names:
        q = log.q[:, log.joints.index(name)]
        columns.append(np.degrees(q) if kinds[name] == "revolute" else 1000.0 * q)
    columns += [log.torque[:, log.joints.index(name)] / gains.get(name, 1.0) for name in names]
    heads = ["ms", *(f"pos {name}" for name in names), *(f"eff {name}" for name in names)]
    rows = [";".join(f"{value:.15g}" for value in row) for row in np.stack(columns, axis=1)]
    path.write_text("\n".join([";".join(heads), *rows]) + "\n")
    units = ", ".join("deg" if kinds[name] == "revolute" else "mm" for name in names)
    asked = "".join(f"\n  {name}: {{gain: ask}}   # ask: N m/A" for name in names)
    effort, drives = ("current", f"drives:{asked}") if gains else ("torque", "note: torques")
    text = CASE.format(joints=", ".join(names), units=units, effort=effort, drives=drives)
    case = path.with_suffix(".yaml")
    case.write_text(text)
    return case


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an estimate, and one log as the fit's are and as others are."""
    folder = tmp_path_factory.mktemp("formats")
    robot = read_robot("generic-scara")
    model = DynamicModel(robot, (FRICTION.make("coulomb"), FRICTION.make("viscous")))
    columns = ColumnMap(joints=robot.joint_names, dq=())
    for name, seed in (("train", 1), ("run", 3)):
        write_log(replace(recorded(robot, seed, 1500), dq=None, ddq=None), folder / f"{name}.csv")
    how = Preprocessing(Butterworth(8.0))
    estimate = identify(model, [read_log(folder / "train.csv", columns)], "wls", how)
    write_estimate(replace(estimate, columns=columns), folder / "estimate.json")
    as_other(read_log(folder / "run.csv", columns), folder / "other.csv", {})
    return folder


def answer(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, object]:
    """Return what a command answers as JSON."""
    main([*words, "--json"])
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


def numbers_in(value: object) -> list[float]:
    """Return all numbers of an answer in its order."""
    if isinstance(value, dict):
        return [number for one in value.values() for number in numbers_in(one)]
    if isinstance(value, list):
        return [number for one in value for number in numbers_in(one)]
    return [float(value)] if isinstance(value, int | float) else []


@pytest.mark.parametrize("command", ["validate", "predict", "payload", "monitor", "track"])
def test_a_log_of_another_format_is_read_by_its_own_case(
    made: Path, command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(made)
    output = ["-o", str(tmp_path / "out.csv")] if command == "predict" else []
    clean = ["--clean", "run.csv"] if command in ("monitor", "track") else []
    known = answer(capsys, command, "estimate.json", "run.csv", *clean, *output)
    clean = ["--clean", "other.csv"] if clean else []
    other = answer(capsys, command, "estimate.json", "other.csv", "--case", "other.yaml", *clean, *output)
    assert numbers_in(other) == pytest.approx(numbers_in(known), rel=1e-3, abs=1e-4)
    told = refused(
        capsys, command, "estimate.json", "other.csv", *([] if not clean else ["--clean", "run.csv"]), *output
    )
    assert "no column" in told and "'dynident init' drafts it: --case FILE of validate, predict, payload" in told


def test_a_faulty_row_asks_for_no_case_file(
    made: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(made)
    rows = Path("run.csv").read_text().splitlines()
    rows[700] = "x" + rows[700]
    (tmp_path / "bad.csv").write_text("\n".join(rows))
    for command in ("validate", "predict"):
        output = ["-o", str(tmp_path / "out.csv")] if command == "predict" else []
        told = refused(capsys, command, "estimate.json", str(tmp_path / "bad.csv"), *output)
        assert "bad.csv:701" in told and "--case" not in told


def test_currents_of_another_log_have_the_gains_of_the_estimate(made: Path, tmp_path: Path) -> None:
    estimate = read_estimate(made / "estimate.json")
    robot, log = estimate.model.robot, read_log(made / "run.csv", estimate.columns)
    gains = dict(zip(robot.joint_names, (2.0, 3.0, 4.0, 5.0), strict=True))
    case = as_other(log, tmp_path / "currents.csv", gains)
    drives = {joint.name: replace(joint.drive, gain=gains[joint.name]) for joint in robot.active}
    model = replace(estimate.model, robot=robot.with_drives(drives))
    asked = read_case(case, open_gains=True)
    bare = {joint.name: replace(joint.drive, gain=None) for joint in asked.robot.active}  # as a URDF has it
    asked = replace(asked, robot=asked.robot.with_drives(bare))
    found = validate(replace(estimate, model=model), str(tmp_path / "currents.csv"), case=asked)
    assert found.total_relative_error == pytest.approx(validate(estimate, log).total_relative_error, rel=1e-4)
