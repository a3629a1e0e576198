"""Every bad input ends in one line that names file, row or joint and the next step, exit code 1 and no output file."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from dynident.cli.main import main

MEMORY_STEP = "raise its limit (ulimit -v), end other programs, or use fewer samples"
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
    dq = np.gradient(q, time, axis=0)
    ddq = np.gradient(dq, time, axis=0)
    cos, cross = np.cos(q[:, 1]), -2 * 0.4 * 0.15 * np.sin(q[:, 1])
    own, both = 0.03 + 2 * 0.15**2, 2 * 0.4 * 0.15 * cos  # of the arm above, two links in the vertical plane
    whole = 0.05 + 3 * 0.2**2 + 2 * 0.4**2 + own + 2 * both
    weight = -9.81 * 2 * 0.15 * np.cos(q.sum(axis=1))
    torque = np.column_stack([
        whole * ddq[:, 0] + (own + both) * ddq[:, 1] + cross * dq[:, 1] * (2 * dq[:, 0] + dq[:, 1])
        - 9.81 * (3 * 0.2 + 2 * 0.4) * np.cos(q[:, 0]) + weight,
        (own + both) * ddq[:, 0] + own * ddq[:, 1] - cross * dq[:, 0] ** 2 + weight,
    ])  # fmt: skip
    torque = torque + 0.5 * dq + np.random.default_rng(0).normal(0, 0.1, q.shape)
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


def test_the_log_of_these_tests_is_sound(
    arm: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "run.csv"
    log.write_text(table(rows()), encoding="utf-8")
    assert main(["identify", str(arm()), str(log), "--quiet"]) == 0
    assert "physically consistent" in capsys.readouterr().out


@pytest.mark.skipif(os.name != "posix", reason="links of POSIX")
@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("identify arm.urdf loop.csv", "loop.csv: cannot be read (too many levels of symbolic links); check"),
        ("identify arm.urdf run.csv --test loop.csv", "loop.csv: cannot be read (too many levels of symbolic links); "),
        ("identify loop.yaml run.csv", "loop.yaml: no such file; give a file"),
        ("identify arm.urdf run.csv -o loop.json", "loop.json: this link leads to itself; give the name of a file"),
        (
            "identify arm.urdf run.csv --report loop.html",
            "loop.html: this link leads to itself; give the name of a file",
        ),
        ("init arm.urdf loop.csv -o new.yaml", "loop.csv: cannot be read (too many levels of symbolic links); check"),
        ("init arm.urdf run.csv -o loop.yaml --force", "loop.yaml: this link leads to itself; give the name of a file"),
        ("reduce arm.urdf loop.csv -o all.tri", "loop.csv: cannot be read (too many levels of symbolic links); check"),
        ("check arm.urdf loop.csv", "loop.csv: cannot be read (too many levels of symbolic links); check"),
    ],
)
def test_loops_of_links(
    words: str,
    message: str,
    arm: Callable[..., Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    arm()
    (tmp_path / "run.csv").write_text(table(rows()), encoding="utf-8")
    for ending in ("csv", "yaml", "json", "html"):
        (tmp_path / f"loop.{ending}").symlink_to(f"loop.{ending}")
    monkeypatch.chdir(tmp_path)
    assert message in refused(words.split(), tmp_path, capsys)


def test_too_little_memory_is_named(
    arm: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As NumPy says it, as Python does, and as a library that does not load hides it."""
    behind = OSError("lib.so: failed to map segment from shared object")
    hidden = OSError("Could not find/load shared object file 'lib.so'")
    hidden.__context__ = behind
    not_loaded = ImportError("lib.so: failed to map segment from shared object")
    for error, evidence in (
        (MemoryError(), ""),
        (MemoryError("Unable to allocate 3 GiB"), " (Unable to allocate 3 GiB)"),
        (hidden, f" ({behind})"),
        (not_loaded, f" ({not_loaded})"),
    ):
        monkeypatch.setattr("dynident.case.case.read_case", Mock(side_effect=error))
        said = refused(["inspect", str(arm())], tmp_path, capsys)
        assert said == f"error: there is not enough memory{evidence}; {MEMORY_STEP}"
    monkeypatch.setattr("dynident.case.case.read_case", Mock(side_effect=ImportError("no lib.so")))
    with pytest.raises(ImportError, match=r"no lib\.so"):  # an installation with a fault, which is no lack of memory
        main(["inspect", str(arm())])


@pytest.mark.battery
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a limit of Linux")
def test_a_limit_of_the_address_space(arm: Callable[..., Path], tmp_path: Path) -> None:
    call = "import resource; resource.setrlimit(resource.RLIMIT_AS, (300_000 << 10,) * 2); "
    call += "from dynident.cli.main import entry_point; entry_point()"
    (tmp_path / "run.csv").write_text(table(rows()), encoding="utf-8")
    command = [sys.executable, "-c", call, "identify", str(arm()), str(tmp_path / "run.csv"), "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert done.stderr.splitlines()[-1].startswith("error: there is not enough memory"), done.stderr
