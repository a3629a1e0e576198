"""Every example runs in a process of its own and says what it promises."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


def said_by(name: str, folder: Path, *arguments: str) -> str:
    """Run an example with warnings as errors and return what it prints."""
    command = [sys.executable, "-W", "error", str(EXAMPLES / name), *arguments]
    done = subprocess.run(command, check=False, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


def test_what_can_be_identified(tmp_path: Path) -> None:
    """The generic six-joint arm has 36 inertial base parameters; another robot is named on the command line."""
    said = said_by("what_can_be_identified.py", tmp_path)
    assert "6 joints, 78 standard parameters, 54 base parameters" in said
    assert "4 joints" in said_by("what_can_be_identified.py", tmp_path, "generic-scara")


def test_identify_virtual_robot(tmp_path: Path) -> None:
    """The truth lies within a few standard deviations, the bodies are possible, and the files are there."""
    said = said_by("identify_virtual_robot.py", tmp_path, str(tmp_path))
    rows = re.findall(r" (\S+) \+- (\S+)  truth +(\S+) ", said)
    away = [abs(float(value) - float(true)) / float(std) for value, std, true in rows]
    assert len(away) == 16 and max(away) < 5 and sum(a < 2 for a in away) >= 12
    assert "physically consistent: True" in said
    error = re.search(r"test run: ([\d.]+)%", said)
    assert error and float(error[1]) < 3
    assert {file.name for file in tmp_path.iterdir()} == {"train.csv", "test.csv", "estimate.json", "report.html"}


def test_compare_estimators(tmp_path: Path) -> None:
    """Least squares finds impossible bodies, the consistent fit does not, and it predicts better."""
    table = {line.split()[0]: line for line in said_by("compare_estimators.py", tmp_path).splitlines()[1:]}
    errors = {name: [float(part) for part in re.findall(r"([\d.]+)%", line)] for name, line in table.items()}
    assert "no: " in table["ols"] and "no: " in table["wls"] and table["consistent"].endswith("yes")
    assert errors["consistent"][1] < errors["wls"][1] < errors["ols"][1]


def test_computed_torque(tmp_path: Path) -> None:
    """The identified model tracks with at most half the error of a nominal one that is 20 % wrong."""
    said = said_by("computed_torque.py", tmp_path)
    ratio = re.search(r"identified over nominal: ([\d.]+)", said)
    assert ratio and 0 < float(ratio[1]) < 0.5


@pytest.mark.parametrize("file", sorted(EXAMPLES.glob("*.py")), ids=lambda file: file.stem)
def test_every_example_has_a_test(file: Path) -> None:
    """A new example needs a test above."""
    assert f"test_{file.stem}" in globals()
