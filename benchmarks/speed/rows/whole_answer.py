"""The whole answer: commands from files to files on three real robots, beside what a script of the field does.

Each call is a process of its own, the interpreter's start and reading the logs included, from a warm cache of machine
code. The peer is :mod:`benchmarks.speed.peer_process`: no choice, no interval, no check. DYNIDENT_DATA names the logs.
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from benchmarks.speed.harness import Line, Record, Times
from benchmarks.speed.rows.start_up import COMMAND, process

REPEATS = 5
CASES = Path(__file__).resolve().parents[3] / "examples/cases"
PEER = Path(__file__).resolve().parents[1] / "peer_process.py"


@dataclass(frozen=True)
class Robot:
    """What the peer is told: folder, cut-off, one row in so many, torque columns, gains, logs."""

    folder: str
    cutoff_hz: float
    step: int
    column: str
    gains: str
    logs: tuple[str, ...]


ROBOTS = {
    "panda": Robot("panda_gaz2019", 4.0, 5, "tau", "1", ("exciting_traj_1",)),
    "ur10e": Robot(
        "ur10e_mamedov",
        5.0,
        1,
        "i",
        "14.87,13.26,11.13,10.62,11.03,11.47",
        tuple(
            f"ident_20_{run}"
            for run in (
                "01_31_unload",
                "02_05_20sec_12harm",
                "02_05_20sec_8harm",
                "02_06_20sec_10harm",
                "02_06_20sec_5harm",
                "02_10_20sec_7harm",
                "02_10_30sec_12harm",
            )
        ),
    ),
    "lwr4": Robot("kuka_lwr4_flobaroid", 8.0, 1, "tau", "1", ("measurements_2", "measurements_3")),
}

#: What is done, the words of the command after its name, and how many times the peer's time it may take.
WORKS = {
    "identify without checks": (["identify", "{case}", "--no-check", "--quiet", "-o", "{folder}/free.json"], 0.7),
    "identify": (["identify", "{case}", "--quiet", "-o", "{folder}/estimate.json"], 1.0),
    "identify a draft of init": (["identify", "{draft}", "--quiet", "-o", "{folder}/draft.json"], 1.5),
    "check": (["check", "{case}", "--quiet"], 0.7),
    "identify --friction auto": (
        ["identify", "{case}", "--friction", "auto", "--quiet", "-o", "{folder}/auto.json"],
        2.5,
    ),
    "report": (["report", "{folder}/estimate.json", "--quiet", "-o", "{folder}/report.html"], 1.0),
}


def measure() -> Record:
    found = Record("whole_answer", "processes from files to files, three real robots, warm cache")
    data = os.environ.get("DYNIDENT_DATA", "")
    if not data or not found.peer("pinocchio", "pin") or not found.peer("pandas"):
        raise SystemExit("whole_answer: set DYNIDENT_DATA to the folder of the logs; pin and pandas must be installed")
    for name, robot in ROBOTS.items():
        with tempfile.TemporaryDirectory() as folder:
            _of_robot(found, name, robot, Path(data) / robot.folder, folder)
    return found


def _of_robot(found: Record, name: str, robot: Robot, place: Path, folder: str) -> None:
    logs = [str(place / f"{log}.csv") for log in robot.logs]
    peer = [sys.executable, str(PEER), str(place / "robot.urdf"), str(robot.cutoff_hz), str(robot.step)]
    calls = {f"{name}, peer": [*peer, robot.column, robot.gains, *logs]}
    draft = f"{folder}/draft.yaml"
    process([*COMMAND, "init", str(place / "robot.urdf"), *logs, "-o", draft, "--quiet"], dict(os.environ))
    text = Path(draft).read_text()
    for gain in robot.gains.split(","):  # a draft asks for the gains of currents
        text = text.replace("gain: ask", f"gain: {gain}", 1)
    Path(draft).write_text(text)
    for work, (words, most) in WORKS.items():
        places = {"case": str(CASES / f"{name}.yaml"), "folder": folder, "draft": draft}
        calls[f"{name}, {work}"] = [*COMMAND, *(word.format(**places) for word in words)]
        found.lines.append(Line(f"{name}: {work}", f"{name}, {work}", f"{name}, peer", 1.0 / most))
    found.times |= {side: Times() for side in calls}
    for k in range(REPEATS + 1):
        for side, words in calls.items():
            wall, processor = process(words, dict(os.environ))
            if k:  # the first fills the caches
                found.times[side].note([processor], [wall])
