"""Every command that a page shows exists with its options, and every block that no test runs has its reason here."""

from __future__ import annotations

import argparse
import re
import shlex
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from dynident.cli.main import COMMANDS, build_parser
from test_documentation import PAGES, ROOT, Block, blocks_of

#: Blocks that no test runs: page, how many, why. The commands in them are parsed nevertheless.
NOT_RUN = {
    "README.md": (1, "installation: .ci/run does it in a fresh environment"),
    "docs/adding-a-part.md": (1, "another project: tests/guest is one, which tests/trust/test_guest_parts.py runs"),
    "docs/benchmark.md": (4, "hours: tests/cli/test_benchmark_command.py runs a short one"),
    "docs/drive-gains.md": (4, "logs of the reader's robot, real logs: tests/cli/test_gains_command.py"),
    "docs/exports.md": (1, "needs ROS"),
    "docs/fleet.md": (1, "logs of several robots: tests/cli/test_fleet_and_track.py"),
    "docs/into-simulators.md": (1, "needs a compiler: tests/exports/models"),
    "docs/log-formats.md": (2, "any log: tests/case/test_draft_structure.py, tests/data/test_logs_of_mujoco.py"),
    "docs/logs.md": (5, "one for each kind of log: tests/case/test_draft_profiles.py"),
    "docs/friction-memory.md": (1, "needs a compiler: tests/exports/models"),
    "docs/model-exports.md": (3, "needs a compiler, an FMU runner, Pinocchio: tests/exports/models"),
    "docs/monitor.md": (2, "a log with a contact: tests/cli/test_use_commands.py"),
    "docs/notebooks/compare-estimators-and-friction.md": (6, "a notebook: tests/test_notebooks.py"),
    "docs/notebooks/design-to-mujoco.md": (8, "a notebook: tests/test_notebooks.py"),
    "docs/notebooks/first-identification.md": (9, "a notebook: tests/test_notebooks.py"),
    "docs/online.md": (1, "a log with a change: tests/cli/test_fleet_and_track.py"),
    "docs/packaging.md": (3, "installation, and what is installed here: tests/cli/test_environment.py"),
    "docs/payload.md": (1, "a log with a load: tests/cli/test_use_commands.py"),
    "docs/report.md": (1, "the demo: tests/cli/test_cli.py"),
    "docs/robot-models.md": (5, "needs xacro, USD: tests/robot_files/test_xacro.py, test_usd.py"),
    "docs/scale.md": (3, "a cluster and a bucket: tests/workers"),
    "docs/selftest.md": (1, "a plan: tests/cli/test_selftest_command.py"),
    "docs/servo-bodies.md": (1, "a case of a servo whose bodies are off: tests/actuators"),
    "docs/servo-tutorial.md": (2, "parts of examples/cases/xl330.yaml and of examples/servo_arm/arm.yaml"),
    "docs/servo-logs.md": (2, "a case of a servo and its files: tests/actuators"),
    "docs/servos.md": (4, "a case of a servo and its files: tests/actuators"),
    "docs/studio.md": (2, "installation, a browser: tests/studio"),
    "docs/tutorial.md": (1, "the address of the repository"),
    "docs/virtual-cell.md": (1, "a search: tests/cli/test_simulate_command.py"),
    "docs/your-robot/franka.md": (1, "a search of seconds: tests/cli/test_excite.py"),
    "docs/your-robot/ros2.md": (1, "needs ROS"),
    "docs/your-robot/universal-robots.md": (2, "needs the robot; a search: tests/cli/test_excite.py"),
}  # fmt: skip

#: Kinds of files that their JSON states as ``dynident KIND``.
KINDS = ("plan", "truth")

_RUN = {"run", "real", "case", "robot", "refused"}


def is_run(block: Block) -> bool:
    """Return whether a test of the pages runs a block or compares it; texts are formulas and messages."""
    return block.language == "text" or bool(_RUN & set(block.marks)) or any("part=" in mark for mark in block.marks)


def test_blocks_that_no_test_runs_have_their_reason() -> None:
    found = Counter(
        page.relative_to(ROOT).as_posix() for page in PAGES for block in blocks_of(page) if not is_run(block)
    )
    assert found == {page: count for page, (count, _) in NOT_RUN.items()}
    for _, reason in NOT_RUN.values():
        for place in re.findall(r"(?:tests|\.ci)/\S*\w", reason):
            assert (ROOT / place).exists(), place


def parser_of(command: str) -> argparse.ArgumentParser:
    parser = build_parser(command)
    (commands,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    return commands.choices[command]


def spoken(page: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the place and the words of every command on a page, in blocks and between the lines."""
    text = page.read_text(encoding="utf-8")
    bare = re.sub(r"^```[^\n`]*\n.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    found = [(page.name, one) for one in re.findall(r"`(dynident [^`]+)`", bare)]
    for block in blocks_of(page):
        start = r"^\$ " if block.language == "console" else "^"
        for line in block.text.replace("\\\n", " ").splitlines():
            found += [(block.place, one) for one in re.findall(rf"{start}(?:[\w. -]*\| )?(dynident .*)", line.strip())]
    for place, one in found:
        for part in re.split(r"\s*(?:&&|\||;)\s*", one.partition("  #")[0]):
            words = shlex.split(part.replace("'", "").replace('"', ""), comments=True)
            if words[:1] == ["dynident"] and len(words) > 1:
                yield place, words[1:]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_commands_on_a_page_exist_with_their_options(page: Path) -> None:
    for place, (command, *words) in spoken(page):
        if command in ("...", "COMMAND", "--version", "--help") or (command in KINDS and not words):
            continue
        assert command in COMMANDS, f"{place}: dynident {command}"
        known = {option for action in parser_of(command)._actions for option in action.option_strings}
        used = {re.match(r"-{1,2}[A-Za-z][\w-]*", word) for word in words}
        assert {word[0] for word in used if word} <= known, f"{place}: dynident {command} {' '.join(words)}"
