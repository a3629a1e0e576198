"""Speed beside the peers: every row in a process of its own. Run: python -m benchmarks.speed [ROW ...] [--page]

Each row leaves ``benchmarks/results/ROW.json``; then the table of docs/performance.md is written from these files.
``--page`` only writes the table. BLAS runs on one thread. A peer that is not there is named, in the file and the table.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
import warnings

from benchmarks.speed.machine import machine
from benchmarks.speed.page import PAGE, RESULTS, ROWS, write_page


def measure(name: str) -> None:
    """Measure one row in this process and write its file."""
    warnings.simplefilter("ignore")  # of the peers
    before = machine()
    found = importlib.import_module(f"benchmarks.speed.rows.{name}").measure().data()
    RESULTS.mkdir(exist_ok=True)
    place = RESULTS / f"{name}.json"
    after = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    found = {**found, "machine": {**before, "load_after": round(after, 2)}}
    place.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(f"{name}: {len(found['lines'])} lines, missing: {', '.join(found['missing']) or 'none'}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.speed", description=__doc__.splitlines()[0])
    parser.add_argument("rows", nargs="*", choices=[*ROWS, []], help=f"of {', '.join(ROWS)}; all unless stated")
    parser.add_argument("--page", action="store_true", help="only write the table of the page")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.here:
        measure(chosen.rows[0])
        return
    failed = []
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    for name in [] if chosen.page else chosen.rows or ROWS:
        words = [sys.executable, "-m", "benchmarks.speed", "--here", name]
        if subprocess.run(words, env=environment, check=False).returncode:
            failed.append(name)
    write_page()
    print(f"written: {PAGE}")
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
