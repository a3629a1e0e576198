"""Fuzz one target or all: ``python -m fuzz NAME --runs N``; says executions, faults and the rate.

An input is taken or refused by a named error. Everything else is a fault: another exception, more than 10 s, more than
1 GiB beyond the memory of the process, a file outside the folder, a process or a connection. Inputs with faults are
kept. With atheris installed, changes are guided by the branches they reach; ``--plain`` goes without.
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

from fuzz.targets import TARGETS

_START = 120.0  # s that a process may take to load
_STILL = 30.0  # s without a new execution, after which a process that is stuck in compiled code is ended


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("name", choices=[*TARGETS, "all"])
    parser.add_argument("--runs", type=int, default=10_000, help="executions of each target (10000)")
    parser.add_argument("--seed", type=int, default=0, help="another seed gives other inputs")
    parser.add_argument("--plain", action="store_true", help="without atheris even where it is installed")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="end each target after this time")
    parser.add_argument("--out", type=Path, default=Path("build/fuzz"), help="folder of scores and inputs with faults")
    return parser.parse_args()


def _fuzz(name: str, options: argparse.Namespace, guided: bool) -> dict[str, Any]:
    """Run the children of one target: where compiled code ends or blocks one, the next goes on behind that input."""
    kept = (options.out / name).resolve()
    kept.mkdir(parents=True, exist_ok=True)
    for old in kept.glob("score*.json"):
        old.unlink()
    total: dict[str, Any] = {"faults": {}}
    first, left_s = 0, options.seconds
    while first < options.runs and left_s > 0:
        with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
            (kept / "number").write_text(str(first))
            way = "guided" if guided else "plain"
            left = options.runs - first if guided else options.runs
            words = [name, str(left), str(options.seed + (first if guided else 0)), str(first), way, str(kept), folder]
            state = _followed(words, kept, left_s)
            found = _score(kept)
            left_s -= found.get("seconds", 0.0)
            _add(total, found)
            last = first + found["executions"] if guided else int((kept / "number").read_text() or first)
            if state == "done":
                break
            if state != "time":
                at_fault = next(Path(folder).glob("input*"), None)
                if at_fault is None:
                    sys.exit(f"{name}: the process ended before its first input; see {kept / 'child.txt'}")
                saved = kept / f"died-{last}{at_fault.suffix}"
                saved.write_bytes(at_fault.read_bytes())
                total["faults"][f"{state} at input {last}"] = saved.name
                kind = "hang" if state == "stuck" else "crash"
                total[kind] += 1
                total["executions"] += 1
        first = last + 1
    return total


def _followed(words: list[str], kept: Path, seconds: float) -> str:
    """Return how a child ended: done, time (counted from its first input), stuck, or died with its code."""
    own = {
        "OPENBLAS_NUM_THREADS": "1",
        "ARROW_DEFAULT_MEMORY_POOL": "system",
        "NUMBA_CACHE_DIR": f"{kept.parent / 'numba'}",
    }
    environment = {**os.environ, **own}
    with open(kept / "child.txt", "w") as output:
        child = subprocess.Popen(
            [sys.executable, "-m", "fuzz.child", *words], stdout=output, stderr=output, env=environment
        )
        before, since, ended = "", time.monotonic() + _START, float("inf")
        while child.poll() is None:
            time.sleep(0.2)
            score = kept / "score.json"
            now = f"{score.stat().st_mtime_ns if score.exists() else 0} {(kept / 'number').stat().st_mtime_ns}"
            if score.exists():
                ended = min(ended, time.monotonic() + seconds)
            if now != before:
                since = max(since, time.monotonic())
                before = now
            late = time.monotonic() > ended
            if late or time.monotonic() - since > _STILL:
                child.kill()
                child.wait()
                return "time" if late else "stuck"
    return "done" if child.returncode == 0 else f"died ({child.returncode})"


def _score(kept: Path) -> dict[str, Any]:
    place = kept / "score.json"
    if not place.exists():
        return {"executions": 0, "faults": {}}
    found = json.loads(place.read_text())
    place.unlink()
    return found


def _add(total: dict[str, Any], found: dict[str, Any]) -> None:
    for key, value in found.items():
        if key == "faults":
            total["faults"] |= value
        else:
            total[key] = max(total.get(key, 0), value) if key == "slowest_s" else total.get(key, 0) + value


def main() -> None:
    """Fuzz what was asked for and exit with 1 where a fault was found."""
    options = _options()
    guided = not options.plain and importlib.util.find_spec("atheris") is not None
    sys.stdout.write(f"{'guided by branches (atheris)' if guided else 'own changes, not guided'}\n")
    faulty = False
    for name in TARGETS if options.name == "all" else [options.name]:
        facts = _fuzz(name, options, guided)
        (options.out / name / "result.json").write_text(json.dumps(facts, indent=1))
        rate = facts.get("executions", 0) / max(facts.get("seconds", 0.0), 1e-3)
        words = ", ".join(
            f"{facts.get(key, 0)} {key}" for key in ("taken", "refused", "crash", "hang", "memory", "escape")
        )
        slow = f"slowest {facts.get('slowest_s', 0)} s"
        sys.stdout.write(f"{name}: {facts.get('executions', 0):,} executions, {words}; {rate:.0f}/s, {slow}\n")
        for fault, file in facts["faults"].items():
            sys.stdout.write(f"  {fault}  ({options.out / name / file})\n")
        sys.stdout.flush()
        faulty |= bool(facts["faults"])
    sys.exit(int(faulty))


if __name__ == "__main__":
    main()
