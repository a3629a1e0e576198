"""Draft, answer, check, identify, validate, choose friction, report and export each stranger; print a table."""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import re
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.strangers.cases import STRANGERS, Stranger
from benchmarks.strangers.plant import run, urdf, waves
from dynident.cli.main import main as dynident

#: Largest error of the draft over that of the case with the true friction.
BOUND = 1.1


@dataclass
class Row:
    """What came of a stranger."""

    name: str
    needed: int
    found: str
    errors: dict[str, float]
    failed: list[str]

    @property
    def good(self) -> bool:
        return not self.failed and self.errors["drafted"] <= BOUND * self.errors["true"]


def called(failed: list[str], *words: object) -> str:
    """Run a command and return what it says; a fault or a traceback is kept."""
    out, bad = io.StringIO(), io.StringIO()
    begin = time.process_time()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(bad):
        try:
            code = dynident([str(word) for word in words])
        except Exception:  # a traceback is what is looked for
            traceback.print_exc(file=bad)
            code = 99
    if code:
        failed.append(f"{words[0]}: {bad.getvalue().strip()[-300:]}")
    print(f"    {words[0]} {code}, {time.process_time() - begin:.1f} s", file=sys.stderr, flush=True)
    return out.getvalue()


def answered(text: str, stranger: Stranger) -> str:
    """Return the draft with the answers; one that begins with @ is for the line that asks about a column."""
    return "\n".join(_answer(line, stranger) for line in text.splitlines()) + "\n"


def _answer(line: str, stranger: Stranger) -> str:
    for key, answer in stranger.answers.items():
        if line.startswith(key) or (key[0] == "@" and key[1:] in line and "ask:" in line):
            return answer
    return line


def truly(text: str, stranger: Stranger) -> str:
    """Return the case with the friction that is there."""
    parts = "".join(f"  - {part}\n" for part in stranger.friction)
    return re.sub(r"^friction:\n(?:  .*\n|\n)+", f"friction:\n{parts}", text, count=1, flags=re.M)


def logs_of(name: str, stranger: Stranger, folder: Path, beyond: float) -> list[str]:
    """Write description and logs and return their names; the last moves ``beyond`` times as far and as fast."""
    (folder / "robot.urdf").write_text(urdf(name, stranger.bodies))
    truth, (reach, middle) = urdf(name, stranger.bodies, seed=len(name) + 1000), stranger.reach()
    found = []
    for k in range(stranger.learn + 1):
        noise = np.random.default_rng([k, 7])
        is_test = k == stranger.learn
        first = stranger.first * (1.2 if is_test else 1.0)
        share = stranger.share * (beyond if is_test else 1.0)
        motion = waves(stranger.bodies, first, 5, 50 + k, reach * (beyond if is_test else 1.0), middle, share)
        seconds = stranger.seconds * (1.0 if k < stranger.learn else 2 / 3)
        done = run(truth, motion, seconds, stranger.rate, stranger.drives, stranger.gravity)
        size = stranger.noise * np.abs(done.at_motors).max(axis=0)
        shaken = [torque + size * noise.normal(size=torque.shape) for torque in (done.at_sensors, done.at_motors)]
        done = replace(
            done, q=done.q + 1e-5 * noise.normal(size=done.q.shape), at_sensors=shaken[0], at_motors=shaken[1]
        )
        found.append(stranger.write(folder, f"log_{k}", stranger.bodies, done, noise))
    return found


def error_of(text: str) -> float:
    return float(json.loads(text)["test"]["total_relative_error"]) if text.strip() else float("nan")


def outcome(name: str, stranger: Stranger, folder: Path, short: bool, beyond: float = 1.0) -> Row:
    """Return what comes of a stranger."""
    failed: list[str] = []
    *train, test = logs_of(name, stranger, folder, beyond)
    case, learn, held = folder / "case.yaml", [folder / one for one in train], folder / test
    called(failed, "init", folder / "robot.urdf", *learn, "--test", held, "-o", case, *stranger.options)
    draft = case.read_text()
    needed = len(re.findall(r": ask   # ask:", draft))
    case.write_text(answered(draft, stranger))
    if "# coupling:" in stranger.answers:
        open_case = folder / "open.yaml"
        left_out = {key: answer for key, answer in stranger.answers.items() if key not in ("# coupling:", "  units:")}
        open_case.write_text(answered(draft, replace(stranger, answers=left_out)))
    else:
        open_case = case
    ignored: list[str] = []
    seen = json.loads(called(ignored, "check", open_case, "--json", "--quiet") or "{}")
    told = [f"{one['severity']}: {one['name']}" for log in seen.get("logs", []) for one in log["findings"]]
    errors = {}
    true = folder / "true.yaml"
    true.write_text(truly(case.read_text(), stranger))
    stated, free = folder / "stated.yaml", folder / "free.yaml"
    whole = case.read_text().replace("[part, width]", "part")
    stated.write_text(whole.replace(", choose: width}", "}"))
    free.write_text(whole.replace("choose: width", "vary: width"))
    ways = {"drafted": (case,), "stated": (stated,), "free": (free,), "true": (true,)} | (
        {} if short else {"auto": (case, "--friction", "auto")}
    )
    for way, words in ways.items():
        estimate = folder / f"{way}.json"
        called(failed, "identify", *words, "-o", estimate, "--quiet")
        errors[way] = (
            error_of(called(failed, "validate", estimate, held, "--json", "--quiet")) if not failed else np.nan
        )
    if not failed and not short:
        called(failed, "report", folder / "drafted.json", "--test", held, "-o", folder / "report.html", "--quiet")
        called(failed, "export", folder / "drafted.json", "--to", "urdf", "-o", folder / "found.urdf", "--quiet")
    grave = ", ".join(dict.fromkeys(one for one in told if not one.startswith("note"))) or "none"
    return Row(name, needed, grave, errors, failed)


def shown(rows: Sequence[Row]) -> str:
    """Return the table of the documentation."""
    head = ("robot", "needed", "check", "width stated", "drafted", "width free", "true structure", "ratio", "auto")
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for row in rows:
        ways = ("stated", "drafted", "free", "true", "auto")
        stated, drafted, free, true, auto = (row.errors.get(way, np.nan) for way in ways)
        figures = f"{stated:.3%} | {drafted:.3%} | {free:.3%} | {true:.3%} | {drafted / true:.3f} | {auto:.3%}"
        lines.append(f"| {row.name} | {row.needed} | {row.found} | {figures} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", choices=[*STRANGERS, []], default=[])
    parser.add_argument("--short", action="store_true", help="no choice of friction, report and export")
    parser.add_argument("--beyond", type=float, default=1.0, help="range and speed of the test log, times the others'")
    options = parser.parse_args()
    rows = []
    for name in options.robots or STRANGERS:
        with tempfile.TemporaryDirectory() as folder:
            print(f"{name} ...", file=sys.stderr, flush=True)
            row = outcome(name, STRANGERS[name], Path(folder), options.short, options.beyond)
        rows.append(row)
        print(shown([row]).splitlines()[-1], *(f"  FAILED {text}" for text in row.failed), sep="\n", flush=True)
    print(shown(rows))
    sys.exit(0 if all(row.good for row in rows) else 1)


if __name__ == "__main__":
    main()
