"""Run the matrix: python -m benchmarks.faults [ROBOT ...] [--only WORDS] [--table FILE]."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.faults.matrix import Outcome, alarms, outcomes
from benchmarks.faults.trials import robots

#: Share of the faults that must be named.
ENOUGH = 0.95


def shown(outcome: Outcome) -> str:
    mark = ("named" if outcome.figured else "FIGURE") if outcome.named else "MISSED"
    return f"  {outcome.kind:32} {outcome.strength:<10.3g} {mark:7} {'; '.join(outcome.said)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*")
    parser.add_argument("--only", default="", help="kinds whose name has one of these words, separated by commas")
    options = parser.parse_args()
    total = named = figured = 0
    with tempfile.TemporaryDirectory() as name:
        for robot, (trial, held) in robots(options.robots).items():
            begin, each = time.perf_counter(), []
            counts = alarms(trial, held, Path(name))
            print(f"{robot}: clean: " + ", ".join(f"{count} {severity}s" for severity, count in counts.items()))
            for outcome in outcomes(trial, held, Path(name), options.only):
                each.append(outcome)
                print(shown(outcome), flush=True)
            good = sum(outcome.named for outcome in each)
            exact = sum(outcome.figured for outcome in each)
            total, named, figured = total + len(each), named + good, figured + exact
            took = time.perf_counter() - begin
            print(f"{robot}: {good} of {len(each)} named rightly, {exact} with direction and figure, {took:.0f} s")
    shares = [f"{count} of {total} ({100 * count / max(total, 1):.1f} %)" for count in (named, figured)]
    print(f"{shares[0]} named rightly, {shares[1]} with direction and figure")
    sys.exit(0 if named >= ENOUGH * total else 1)


if __name__ == "__main__":
    main()
