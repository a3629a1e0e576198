"""``dynident init`` from the command line: the file, the remarks, the questions, JSON, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from dynident.case.case import read_case
from dynident.cli.main import main

Capture = pytest.CaptureFixture[str]


def write(folder: Path, effort: str, degrees: bool = False) -> tuple[str, str]:
    """Write a log of the robot generic-6r and return its path and that of a case to be drafted."""
    time = np.arange(300) / 100
    q = 0.4 * np.sin(np.outer(time, np.linspace(1.0, 3.0, 6))) * (180 / np.pi if degrees else 1.0)
    header = ["t", *(f"q{k}" for k in range(1, 7)), *(f"{effort}{k}" for k in range(1, 7))]
    rows = np.column_stack([time, q, np.cos(q)]).tolist()
    (folder / "run.csv").write_text("\n".join([",".join(header), *(",".join(map(repr, row)) for row in rows)]) + "\n")
    return str(folder / "run.csv"), str(folder / "case.yaml")


def test_a_draft_names_the_lines_that_ask_and_so_does_identify(capsys: Capture, tmp_path: Path) -> None:
    log, case = write(tmp_path, "tau", degrees=True)
    assert main(["init", "generic-6r", log, "-o", case]) == 0
    out, err = capsys.readouterr()
    lines = Path(case).read_text().splitlines()
    asking = [k for k, line in enumerate(lines, start=1) if ": ask   # ask:" in line]
    assert out == "" and f"wrote {case}; it asks in lines {', '.join(map(str, asking))}; answer there, then: " in err
    for command in ("identify", "check"):
        assert main([command, case]) == 1
        assert f"case.yaml: line {asking[0]} asks for the unit of q1 to q6" in capsys.readouterr().err
    Path(case).write_text(
        "\n".join(lines).replace("position: ask", "position: deg").replace("torque: ask", "torque: N m")
    )
    assert read_case(case).columns.units.position == "deg"


def test_a_command_that_is_proposed_quotes_names_with_blanks(capsys: Capture, tmp_path: Path) -> None:
    log, _ = write(tmp_path, "tau")
    case = str(tmp_path / "Fall ä.yaml")
    assert main(["init", "generic-6r", log, "-o", case]) == 0
    assert f"dynident identify '{case}'\n" in capsys.readouterr().err


def test_a_pattern_and_a_folder_stand_for_their_logs(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, "tau")
    monkeypatch.chdir(tmp_path)
    Path("runs").mkdir()
    for name in ("a", "b"):
        Path("runs", f"{name}.csv").write_text(Path("run.csv").read_text())
    Path("runs", "notes.md").write_text("of Monday\n")
    for words in (["runs/*.csv", "--test", "run.csv"], ["runs", "--test", "r*.csv"]):
        assert main(["init", "generic-6r", *words, "-o", "case.yaml", "--force"]) == 0
        case = yaml.safe_load(Path("case.yaml").read_text())
        assert case["train"] == ["runs/a.csv", "runs/b.csv"] and case["test"] == "run.csv"
    assert main(["init", "generic-6r", "runs/*.csv", "runs/a.csv", "-o", "case.yaml", "--force"]) == 1
    assert "name each log once" in capsys.readouterr().err
    assert main(["init", "generic-6r", "runs/*.txt", "-o", "case.yaml", "--force"]) == 1
    assert "there is no log" in capsys.readouterr().err


def test_json_says_what_was_recognised(capsys: Capture, tmp_path: Path) -> None:
    log, case = write(tmp_path, "i")
    assert main(["init", "generic-6r", log, "-o", case, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["case"] == case and data["next"] == f"dynident identify {case}"
    assert data["signals"]["current"]["columns"] == [f"i{k}" for k in range(1, 7)]
    assert data["joints"]["confidence"] == "certain" and data["logs"][0]["rows"] == 300


def test_nothing_is_overwritten(capsys: Capture, tmp_path: Path) -> None:
    log, case = write(tmp_path, "i")
    Path(case).write_text("mine")
    assert main(["init", "generic-6r", log, "-o", case]) == 1
    assert "it is there already; choose another name with -o, or give --force" in capsys.readouterr().err
    assert main(["init", "generic-6r", log, "-o", log, "--force"]) == 1
    assert Path(case).read_text() == "mine" and Path(log).read_text().startswith("t,q1")
    assert main(["init", "generic-6r", log, "-o", case, "--force"]) == 0
    assert Path(case).read_text().startswith("# Case file of dynident")


def test_the_kind_of_log_can_be_stated(capsys: Capture, tmp_path: Path) -> None:
    log, case = write(tmp_path, "i")
    assert main(["init", "generic-6r", log, "-o", case, "--profile", "ur_rtde"]) == 1
    assert "profile = 'ur_rtde' is not possible; it reads timestamp, actual_q_{0}" in capsys.readouterr().err
    assert main(["init", "generic-6r", log, "-o", case, "--format-option", "decimal=,"]) == 1
    assert "write --format NAME --format-option key=value" in capsys.readouterr().err
    assert main(["init", "generic-6r", log, "-o", case, "--format", "csv", "--format-option", "decimal=."]) == 0
    assert "format: {csv: {decimal: .}}" in Path(case).read_text() and read_case(case).columns.form == "csv"


def test_a_log_that_is_named_twice_is_refused(capsys: Capture, tmp_path: Path) -> None:
    log, case = write(tmp_path, "tau")
    for logs in ([log, log], [log, "--test", str(tmp_path / "." / "run.csv")]):
        assert main(["init", "generic-6r", *logs, "-o", case]) == 1
        assert "name each log once" in capsys.readouterr().err
    assert not Path(case).exists()


def test_a_log_in_the_place_of_the_robot_model_is_told_as_one(capsys: Capture, tmp_path: Path) -> None:
    log, case = write(tmp_path, "tau")
    for command in (["init", log, "generic-6r", "-o", case], ["check", log, "generic-6r"], ["identify", log, log]):
        assert main(command) == 1
        told = capsys.readouterr().err
        assert "a log by its ending, where a robot model is wanted; give the robot model or the case file first" in told
    assert main(["init", f"{log}.csv", "generic-6r", "-o", case]) == 1
    assert "no such file" in capsys.readouterr().err
    assert main(["init", "generic-6r", log, "-o", case]) == 0
