"""Fuzz one target or all in turns: ``python -m fuzz NAME --runs N``; counts add up from one run to the next.

An input is taken or refused by a named error. Everything else is a fault: another exception, more than 10 s of the
processor, more than 1 GiB beyond the memory of the process, a file outside the folder, a process or a connection.
Inputs with faults are kept, and ``--again`` tells which of them still find one. With atheris installed, changes are
guided by the branches they reach; ``--plain`` goes without.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from fuzz.record import Record
from fuzz.targets import TARGETS

_START = 300.0  # s that a process may take to load
_STILL = 120.0  # s without news, after which a process that is stuck in compiled code is ended,
_AT_WORK = 20.0  # where it had so many s of the processor since: on a busy machine it may have had none,
_ASLEEP = 1800.0  # s without news, after which it is ended in any case
_KINDS = ("crash", "hang", "memory", "escape", "died")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("name", choices=[*TARGETS, "all"])
    parser.add_argument("--runs", type=int, default=10_000, help="executions of each target, earlier runs included")
    parser.add_argument("--plain", action="store_true", help="without atheris even where it is installed")
    parser.add_argument("--turn", type=float, default=60.0, help="seconds of a target before the next has its turn")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="end after this time")
    parser.add_argument("--out", type=Path, default=Path("build/fuzz"), help="folder of inputs: found faults, corpora")
    parser.add_argument("--record", type=Path, help="file of the counts; OUT/record.json by default")
    parser.add_argument("--page", type=Path, help="page that gets the table of the counts, in place of fuzzing")
    parser.add_argument("--again", action="store_true", help="only execute the kept inputs with faults again")
    return parser.parse_args()


def _turn(name: str, runs: int, first: int, seconds: float, way: str, out: Path) -> dict[str, Any]:
    """Execute one target in a process of its own; where compiled code ends or blocks it, that input is kept."""
    kept = (out / name).resolve()
    kept.mkdir(parents=True, exist_ok=True)
    (kept / "score.json").unlink(missing_ok=True)
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
        state = _followed([name, str(runs), str(first), str(seconds), way, str(kept), folder], kept)
        score: dict[str, Any] = {"faults": {}}
        if (kept / "score.json").exists():
            score = json.loads((kept / "score.json").read_text())
        if state != "done":
            number = Path(folder) / "number"
            if number.exists():  # the score is older than the last inputs
                score["executions"] = int(number.read_text()) - first
            at_fault = next(Path(folder).glob("input*"), None)
            if at_fault is None:
                sys.exit(f"{name}: the process ended before its first input; see {kept / 'child.txt'}")
            saved = kept / f"died-{first + score.get('executions', 0)}{at_fault.suffix}"
            saved.write_bytes(at_fault.read_bytes())
            score["faults"][state] = saved.name
            kind = "hang" if state == "stuck" else "crash"
            score[kind] = score.get(kind, 0) + 1
            score["executions"] = score.get("executions", 0) + 1
    return score


def _followed(words: list[str], kept: Path) -> str:
    """Return how a process ended: done, stuck, or died with its code."""
    child = _child(words, kept)
    score, since, spent = kept / "score.json", time.monotonic() + _START, 0.0
    before = 0
    while child.poll() is None:
        time.sleep(0.2)
        now = score.stat().st_mtime_ns if score.exists() else 0
        if now != before:
            since, before, spent = time.monotonic(), now, _spent(child.pid)
        still = time.monotonic() - since
        if still > _ASLEEP or (still > _STILL and _spent(child.pid) - spent > _AT_WORK):
            child.kill()
            child.wait()
            return "stuck"
    return "done" if child.returncode == 0 else f"died ({child.returncode})"


def _spent(process: int) -> float:
    """Return the time of the processor that a process had so far, in s; the clock where the system does not say."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return time.monotonic()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _child(words: list[str], kept: Path) -> subprocess.Popen[bytes]:
    own = {
        "OPENBLAS_NUM_THREADS": "1",
        "ARROW_DEFAULT_MEMORY_POOL": "system",
        "NUMBA_CACHE_DIR": f"{kept.parent / 'numba'}",
    }
    with open(kept / "child.txt", "w") as output:
        command = [sys.executable, "-m", "fuzz.child", *words]
        return subprocess.Popen(command, stdout=output, stderr=output, env={**os.environ, **own})


def _again(name: str, out: Path, record: Record) -> bool:
    """Execute the kept inputs of a target, say which still find a fault, and note those that do not."""
    kept, still = (out / name).resolve(), False
    for path in sorted(path for kind in _KINDS for path in kept.glob(f"{kind}-*")):
        with tempfile.TemporaryDirectory() as folder:
            code = _child([name, "1", "0", "60", path.name, str(kept), folder], kept).wait()
        said = (kept / "child.txt").read_text().strip().splitlines()
        sys.stdout.write(f"{name} {path.name}: {'none any more' if code == 0 else (said or [code])[-1]}\n")
        still |= code != 0
        if code == 0:
            record.mend(name, path.name)
    return still


def main() -> None:
    """Fuzz what was asked for, in turns, and exit with 1 where a fault was found."""
    options = _options()
    names = list(TARGETS) if options.name == "all" else [options.name]
    options.out.mkdir(parents=True, exist_ok=True)
    record = Record(options.record or options.out / "record.json")
    if options.page:
        record.into(options.page)
        return
    if options.again:
        sys.exit(int(any([_again(name, options.out, record) for name in names])))
    way = "guided" if not options.plain and importlib.util.find_spec("atheris") is not None else "plain"
    sys.stdout.write(f"{'guided by branches (atheris)' if way == 'guided' else 'own changes, not guided'}\n")
    ended, faulty = time.monotonic() + options.seconds, False
    while left := [name for name in names if record.executions(name) < options.runs]:
        for name in left:
            turn = min(options.turn, ended - time.monotonic())
            if turn <= 0:
                sys.exit(int(faulty))
            runs, first = options.runs - record.executions(name), record.begin(name, way)
            score = _turn(name, runs, first, turn, way, options.out)
            record.add(name, way, score)
            rate = score.get("executions", 0) / max(score.get("seconds", 0.0), 1e-3)
            words = ", ".join(f"{score.get(key, 0)} {key}" for key in ("taken", *_KINDS[:-1]))
            total, slow = record.executions(name), score.get("slowest_s", 0)
            sys.stdout.write(f"{name}: {total:,} executions; this turn {words}; {rate:.0f}/s, slowest {slow} s\n")
            for fault, file in score["faults"].items():
                sys.stdout.write(f"  {fault}  ({options.out / name / file})\n")
            sys.stdout.flush()
            faulty |= bool(score["faults"])
    sys.exit(int(faulty))


if __name__ == "__main__":
    main()
