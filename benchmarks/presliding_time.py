"""What presliding costs: drafts of the real sets identified with and without it, side by side in one run.

The draft of each set (see :mod:`benchmarks.init_cases`) is identified as it stands and without the parts that remember,
in turn, ROUNDS times each; the least processor seconds of both stand beside their ratio and the held-out errors, each
under the filter of the hand-written case.

Needs the logs under the folder that DYNIDENT_DATA names.
Run: python -m benchmarks.presliding_time [SET...]
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from benchmarks.init_cases import CASES, SETS, against_model, drafted
from dynident import identify, read_case

#: How often each is identified.
ROUNDS = 4


def row_of(name: str, data: Path, folder: Path) -> str:
    """Return the row of a set."""
    of, hand = SETS[name], read_case(CASES / f"{name}.yaml")
    case = drafted(name, data, folder)[1]
    train, test = ([case.read(str(data / path)) for path in own] for own in (of.train, of.test))
    if hand.split is not None and not test:
        parts = [hand.split.apply(log) for log in train]
        train, test = [a for a, _ in parts], [b for _, b in parts]
    plain = replace(case.model, friction=tuple(part for part in case.model.friction if not part.states))
    seconds: dict[str, list[float]] = {"with": [], "without": []}
    errors: dict[str, float] = {}
    for _ in range(ROUNDS):
        for way, model in (("with", case.model), ("without", plain)):
            begin = time.process_time()
            estimate = identify(model, train, case.estimator.name, case.preprocessing)
            seconds[way].append(time.process_time() - begin)
            same = replace(hand.preprocessing, delay_s=estimate.preprocessing.delay_s)
            errors[way] = against_model(estimate, test, same).total_relative_error
    least = {way: min(own) for way, own in seconds.items()}
    times = f"{least['with']:.1f} s | {least['without']:.1f} s | {least['with'] / least['without']:.2f}"
    return f"| {name} | {times} | {errors['with']:.3%} | {errors['without']:.3%} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="*", metavar="SET", help=f"default: {', '.join(SETS)}")
    options = parser.parse_args()
    print("| set | with presliding | without | ratio | error with it | without |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name in options.sets or SETS:
            print(row_of(name, Path(os.environ["DYNIDENT_DATA"]), Path(folder)), flush=True)


if __name__ == "__main__":
    main()
