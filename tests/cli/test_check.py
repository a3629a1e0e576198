"""The command check: lines, JSON, exit codes, and the mended file."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2]))

from benchmarks.faults import injections as put
from benchmarks.faults.trials import virtual

from dynident.case.case import read_case
from dynident.case.case_draft import draft_case
from dynident.cli import check
from dynident.cli.main import main
from dynident.data.formats import read_log
from dynident.data.preprocessing import default_preprocessing
from dynident.diagnosis import examination
from dynident.diagnosis.examination import Examination
from dynident.diagnosis.finding import Finding
from dynident.identification.files.estimate_file import write_estimate


def recorded(path: Path, torque_sign: float = 1.0) -> np.ndarray:
    """Write a log of the SCARA that ships: positions and torques that have nothing to do with a fault of the file."""
    t = np.arange(1200) / 100.0
    phase = t[:, None] * 2 * np.pi * np.array([0.3, 0.4, 0.5, 0.7]) + np.array([0.0, 1.0, 2.0, 3.0])
    q = np.array([1.0, 1.0, 0.08, 2.0]) * np.sin(phase) + np.array([0.0, 0.0, 0.09, 0.0])
    values = np.column_stack([t, q, torque_sign * np.cos(phase) + 0.01 * np.sin(40 * phase)])
    header = ",".join(["t", *(f"q{k}" for k in range(1, 5)), *(f"tau{k}" for k in range(1, 5))])
    np.savetxt(path, values, "%.9g", ",", header=header, comments="")
    return values


def doubled(path: Path) -> None:
    """Repeat a row and put another one out of order."""
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[500:500] = [lines[499]]
    lines[700], lines[701] = lines[701], lines[700]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def test_faults_of_the_file_are_told_and_fixed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, out = tmp_path / "run.csv", tmp_path / "mended.csv"
    values = recorded(log)
    doubled(log)
    assert main(["check", "generic-scara", str(log), "--fix", str(out), "--quiet"]) == 1
    told = capsys.readouterr().out
    assert "error: repeated rows: 1 of 1201 rows" in told and "line 501" in told
    assert "error: rows out of order" in told
    assert f"{out}: 1 repeated row left out" in told
    mended = read_log(out)
    assert np.array_equal(mended.time, values[:, 0])
    assert np.allclose(mended.q, values[:, 1:5], atol=1e-8)


def test_rows_exchanged_far_apart_are_sorted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, out = tmp_path / "run.csv", tmp_path / "mended.csv"
    values = recorded(log)
    lines = log.read_text(encoding="utf-8").splitlines()
    lines[100], lines[900] = lines[900], lines[100]
    log.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert main(["check", "generic-scara", str(log), "--fix", str(out), "--quiet"]) == 1
    assert f"{out}: rows sorted by time, 2 of them out of order" in capsys.readouterr().out
    assert np.array_equal(read_log(out).time, values[:, 0])
    drafted = draft_case("generic-scara", str(log), tmp_path)
    assert any("2 of 1200 rows are out of order" in told and "sorts them" in told for told in drafted.remarks)


def test_what_no_safe_repair_mends_is_told_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = tmp_path / "run.csv", tmp_path / "mended.csv"
    recorded(log)
    lines = log.read_text(encoding="utf-8").splitlines()
    log.write_text("\n".join([*lines, *lines[1:400]]) + "\n", encoding="utf-8")  # the clock starts again
    assert main(["check", "generic-scara", str(log), "--fix", str(out), "--quiet"]) == 1
    told = capsys.readouterr()
    assert "error: time runs back" in told.out and "spikes" not in told.out
    assert f"{log}: no safe repair makes it a sound log: time runs back, first in line 1202" in told.err
    assert str(out) not in told.err and not out.exists()
    drafted = draft_case("generic-scara", str(log), tmp_path)
    assert any("split the log" in told for told in drafted.remarks) and "--fix" not in " ".join(drafted.remarks)
    assert main(["check", "generic-scara", str(log), "--fix", str(tmp_path / "mended"), "--quiet"]) == 1
    assert "end the name in the suffix of its format: .csv" in capsys.readouterr().err


def test_a_mended_text_has_the_names_and_units_of_the_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, case, out = tmp_path / "run.csv", tmp_path / "case.yaml", tmp_path / "mended.csv"
    values = recorded(log)
    names = ["Time_ms", *(f"{word}{k}" for word in ("Pos_", "Trq_") for k in range(1, 5)), "remark"]
    shown = values.copy()
    shown[:, 0] *= 1e3
    shown[:, [1, 2, 4]] = np.degrees(shown[:, [1, 2, 4]])
    shown[600:800, 1] += 360.0
    rows = [";".join([*map(repr, row), "as it is"]).replace(".", ",") for row in shown.tolist()]
    rows[40] = rows[40].replace(rows[40].split(";")[3], "", 1)
    log.write_text("\n".join([";".join(names), *rows]) + "\n", encoding="utf-8")
    columns = (
        "  columns: {time: Time_ms, q: 'Pos_{}', torque: 'Trq_{}'}\n  units: {time: ms, position: [deg, deg, m, deg]}\n"
    )
    case.write_text(f"case: 2\nrobot: generic-scara\nlog:\n  decimal: ','\n{columns}", encoding="utf-8")
    assert main(["check", str(case), str(log), "--fix", str(out), "--quiet"]) == 1
    told = capsys.readouterr().out
    assert "1 of 1200 rows (0.083 %), the first in line 42, most of them in Pos_3" in told
    assert f"'dynident check {case} {log} --fix OUT.csv' writes the log without them" in told
    assert "the case reads it in place of the log" in told
    kept = out.read_text(encoding="utf-8").splitlines()
    assert kept[:41] == [";".join(names), *rows[:40]] and kept[41] == rows[41]
    assert kept[700].endswith("as it is") and kept[700] != rows[700]
    mended = read_case(case).read(out)
    assert np.allclose(mended.q, np.delete(values[:, 1:5], 40, axis=0), atol=1e-12)
    assert main(["check", str(case), str(out), "--quiet"]) == 0


#: An arm of one joint, whose drive gain nothing states.
ARM = """<robot name="arm"><link name="base"/><link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="shoulder"
type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint></robot>
"""


def test_a_case_that_still_asks_for_gains_is_checked_as_far_as_it_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, case = tmp_path / "run.csv", tmp_path / "case.yaml"
    recorded(log)
    doubled(log)
    (tmp_path / "arm.urdf").write_text(ARM, encoding="utf-8")
    text = "case: 2\nrobot: arm.urdf\ndrives:\n  shoulder: {gain: ask}  # ask: the gain\n"
    case.write_text(f"{text}log:\n  columns: {{q: [q1], torque: none, current: [tau1]}}\n", encoding="utf-8")
    assert main(["check", str(case), str(log), "--quiet"]) == 1
    told = capsys.readouterr().out
    assert "error: repeated rows" in told and "error: no drive gain (shoulder)" in told
    assert f"'dynident gains {case}' finds gains" in told


def test_json_is_one_object(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "run.csv"
    recorded(log)
    doubled(log)
    assert main(["check", "generic-scara", str(log), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["robot"] and found["sound"] is False and found["fixes"] is None
    (one,) = found["logs"]
    assert {"repeated rows", "rows out of order"} <= {finding["name"] for finding in one["findings"]}
    assert set(one["findings"][0]) == {"severity", "name", "joint", "evidence", "remedy", "numbers"}
    assert not log.with_name("mended.csv").exists()


def test_an_output_never_takes_the_place_of_the_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "run.csv"
    recorded(log)
    before = log.read_bytes()
    assert main(["check", "generic-scara", str(log), "--fix", str(log)]) == 1
    assert "would be overwritten" in capsys.readouterr().err
    assert log.read_bytes() == before


def test_a_log_must_be_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "generic-scara"]) == 1
    assert "name a log" in capsys.readouterr().err


def test_a_broken_cell_is_a_finding_and_cannot_be_fixed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "run.csv"
    log.write_text("t,q1,q2,q3,q4,tau1,tau2,tau3,tau4\n0,x,0,0,0,0,0,0,0\n", encoding="utf-8")
    assert main(["check", "generic-scara", str(log), "--quiet"]) == 1
    assert "error: unreadable: line 2: " in capsys.readouterr().out
    assert main(["check", "generic-scara", str(log), "--quiet", "--fix", str(tmp_path / "out.csv")]) == 1
    assert not (tmp_path / "out.csv").exists()


def test_logs_are_held_against_an_earlier_estimate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    case = replace(read_case("generic-scara"), preprocessing=default_preprocessing())
    trial = virtual(case, rate=100.0)
    write_estimate(virtual(case, seed=1, rate=100.0).estimate(tmp_path), "earlier.json")
    put.loaded(trial, 0.6, np.random.default_rng(0)).written(tmp_path, "loaded")
    assert main(["check", "generic-scara", "loaded.npz", "--against", "earlier.json", "--json"]) == 0
    (log,) = json.loads(capsys.readouterr().out)["logs"]
    assert "load at the flange" in {finding["name"] for finding in log["findings"]}
    assert main(["check", "er16", "loaded.npz", "--against", "earlier.json"]) == 1
    assert "give an estimate of this robot" in capsys.readouterr().err


def test_causes_that_a_log_does_not_tell_apart_are_one_note(capsys: pytest.CaptureFixture[str]) -> None:
    spring = Finding("note", "spring", "elbow", "follows the position", "model it")
    rival = Finding("note", "tilt", "", "not distinguishable from spring (elbow): leans", "", beside=spring.label)
    other = Finding("note", "drift", "", "not distinguishable from tilt: drifts", "warm up", beside="clock")
    check.show(Examination("run.csv", (spring, rival, other)))
    lines = capsys.readouterr().out.splitlines()
    assert lines == [
        "run.csv: no error or warning, 2 notes",
        "  note: spring (elbow): follows the position",
        "    model it",
        "    or tilt: leans",
        "  note: drift: not distinguishable from tilt: drifts",  # the likelier one is not told
        "    warm up",
    ]


def test_notes_of_one_kind_about_several_joints_are_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    """The right log of a seven-axis arm had given a page and a half."""
    curves = [Finding("note", "friction curve", joint, f"bends by {joint}", "add parts") for joint in ("j2", "j1")]
    errors = [Finding("error", "torque sign", joint, "is negative", "turn it") for joint in ("j1", "j2")]
    check.show(Examination("run.csv", (*errors, *curves)))
    assert capsys.readouterr().out.splitlines() == [
        "run.csv: 2 errors, 1 note",
        *(line for joint in ("j1", "j2") for line in (f"  error: torque sign ({joint}): is negative", "    turn it")),
        "  note: friction curve (j2, j1), at j2: bends by j2",
        "    add parts",
    ]


@pytest.mark.parametrize("is_told", [True, False])
def test_what_logs_have_together_is_no_nothing_of_each(
    is_told: bool, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twice "nothing found" had stood above what was found in both."""
    drift = Finding("warning", "friction drift", "", "falls from start to end", "warm the arm up first")
    found = [Examination("a.csv", ()), Examination("b.csv", ()), Examination("both logs", (drift,) * is_told)]
    monkeypatch.setattr(examination, "examine_logs", lambda *given: found)
    assert main(["check", "er16", "a.csv", "b.csv", "--quiet"]) == 0
    lines = capsys.readouterr().out.splitlines()
    nothing = "nothing of its own" if is_told else "nothing found"
    assert lines[:2] == [f"a.csv: {nothing}", f"b.csv: {nothing}"]
    assert lines[2] == ("both logs: 1 warning" if is_told else "both logs: nothing found")
