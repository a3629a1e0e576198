"""The first example in the help of each command runs as it stands, in a folder with the files that it names."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from dynident.cli.main import COMMANDS, build_parser, main
from two_joint_arm import URDF

pytestmark = pytest.mark.battery

CASE = """\
case: 2
robot: robot.urdf
friction: [coulomb, viscous, offset]
preprocessing:
  filter: {butterworth: {cutoff_hz: 10}}
"""
LOGS = "train: monday.csv\ntest: friday.csv\n"

#: In the order in which each finds what it reads, with the files that are copies of others.
RUN = (
    "list", "environment", "inspect", "excite", "simulate", "check", "init", "identify", "reduce", "merge", "validate",
    "predict", "payload", "monitor", "track", "compare", "diff", "fleet", "report", "selftest",
)  # fmt: skip

#: Not run here, and what runs them.
ELSEWHERE = {
    "demo": "tests/cli/test_cli.py",
    "gains": "tests/cli/test_gains_command.py",  # needs a case with motor currents
    "export": "tests/cli/test_export.py",  # needs a robot of Universal Robots
    "benchmark": "tests/cli/test_benchmark_command.py",
    "studio": "tests/studio",  # serves until it is stopped
    "completion": "tests/cli/test_completion.py",
}


def example(command: str) -> list[str]:
    """Return the words of the first example in the help of a command."""
    parser = next(action for action in build_parser(command)._actions if action.dest == "command")
    text = parser.choices[command].description  # type: ignore[index]
    found = re.search(rf"^ *dynident ({command}\b.*)$", text, re.MULTILINE)
    assert found is not None
    return shlex.split(found[1].partition("   ")[0])


def test_every_command_has_an_example_that_is_run() -> None:
    assert {*RUN, *ELSEWHERE} == set(COMMANDS)
    assert all((Path(__file__).parents[2] / place).exists() for place in ELSEWHERE.values())


def test_first_examples_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("robot.urdf").write_text(URDF)
    Path("case.yaml").write_text(CASE)
    for command in RUN:
        words = example(command)
        if command == "init":  # writes over no file
            Path("case.yaml").rename("own.yaml")
        if "cell-*.json" in words:  # by the shell
            words[words.index("cell-*.json") : words.index("cell-*.json") + 1] = ["cell-1.json", "cell-2.json"]
        code = 1 if command == "payload" else 0  # two joints do not determine the mass of a load, as the help says
        assert main(words) == code, f"{' '.join(words)}: {capsys.readouterr()}"
        capsys.readouterr()
        if command == "init":
            Path("own.yaml").rename("case.yaml")
        if command == "simulate":
            for seed, name in enumerate(("monday", "tuesday", "friday", "other-run", "loaded", "shift"), start=1):
                again = [*words, "--seed", str(seed)]
                again[words.index("run.csv")] = f"{name}.csv"
                assert main([*again, "--quiet"]) == 0
            Path("case.yaml").write_text(CASE + LOGS)
        if command == "identify":
            assert main(["identify", "case.yaml", "-o", "estimate.json", "--quiet"]) == 0
            for name, log in (("monday", "monday"), ("friday", "friday"), ("cell-1", "loaded"), ("cell-2", "shift")):
                words = ["identify", "case.yaml", f"{log}.csv", "--test", "other-run.csv", "-o", f"{name}.json"]
                assert main([*words, "--quiet"]) == 0
        if command == "reduce":
            assert main(["reduce", "case.yaml", "tuesday.csv", "-o", "tuesday.tri", "--quiet"]) == 0
