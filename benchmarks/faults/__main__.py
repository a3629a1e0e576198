"""Run the matrix: python -m benchmarks.faults [ROBOT ...] [--only WORDS] [--table FILE]."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from benchmarks.faults.matrix import Outcome, alarms, outcomes
from benchmarks.faults.trials import REAL, robots

#: Share of the faults that must be named.
ENOUGH = 0.95


def shown(outcome: Outcome) -> str:
    mark = {"exact": "named", "wide": "WIDE", "false": "FALSE", "": "MISSED"}[outcome.grade]
    bound = "" if outcome.log_tells else f"[the log does not tell: t = {outcome.sureness:.2g} at most] "
    return f"  {outcome.kind:32} {outcome.strength:<10.3g} {mark:7} {bound}{'; '.join(outcome.said)}"


def figured(grades: Counter[str]) -> str:
    """Return how many were told with direction and figure, with a wide interval that holds it, and falsely.

    Those of the rest are counted besides of which the log does not tell more, by the Cramer-Rao bound.
    """
    return (
        f"{grades['exact']} with direction and figure, {grades['wide']} in a wide interval, {grades['false']} falsely; "
        f"of {grades['silent']} the log does not tell more"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*")
    parser.add_argument("--only", default="", help="kinds whose name has one of these words, separated by commas")
    options = parser.parse_args()
    total, named, grades = 0, 0, Counter[str]()
    with tempfile.TemporaryDirectory() as name:
        for robot, (trial, held) in robots(options.robots).items():
            begin, each = time.perf_counter(), []
            counts = alarms(trial, held, Path(name))
            print(f"{robot}: clean: " + ", ".join(f"{count} {severity}s" for severity, count in counts.items()))
            for outcome in outcomes(trial, held, Path(name), options.only, robot in REAL):
                each.append(outcome)
                print(shown(outcome), flush=True)
            good = sum(outcome.named for outcome in each)
            own = Counter([*(one.grade for one in each), *("silent" for one in each if not one.log_tells)])
            total, named, grades = total + len(each), named + good, grades + own
            print(f"{robot}: {good} of {len(each)} named rightly, {figured(own)}, {time.perf_counter() - begin:.0f} s")
    print(f"{named} of {total} named rightly ({100 * named / max(total, 1):.1f} %), {figured(grades)}")
    sys.exit(0 if named >= ENOUGH * total else 1)


if __name__ == "__main__":
    main()
