"""Every estimator in one comparison: on the virtual ER-16 of the demo, whose truth is known, and on a real log.

The methods of the first table are given a robot without inertias, as those of the demo. The second one needs the folder
of logs that DYNIDENT_DATA names; it is what 'dynident compare examples/cases/panda.yaml' prints. Prints Markdown.
Run: python -m benchmarks.compare [er16] [panda] [--limit S] [--estimators NAMES]
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynident import DynamicModel, Preprocessing, read_case
from dynident.api.compare import methods_of
from dynident.case.case import case_of_robot
from dynident.data.preprocessing.fourier_fit import FourierFit
from dynident.identification.build_problem import build_problem
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.results.text import comparison_table
from dynident.simulation.virtual_robot import Noise, Timing, simulate
from dynident.studies.comparison.compare import compare, contest_of, ranked
from dynident.studies.comparison.comparison_view import comparison_rows
from dynident.studies.er16_article import NOISE_SHARE, PERIOD, RATE, SAMPLES
from dynident.studies.reproduction import POSITION_NOISE, er16_three_joints, trajectories

PANDA = Path(__file__).resolve().parent.parent / "examples/cases/panda.yaml"


def er16(seed=0):
    """Return the contest on beta_1 and beta_2 of part (b) of the demo, and a case for the methods' options."""
    model = DynamicModel(er16_three_joints(), (Coulomb(0.02), Viscous()))
    theta = model.nominal()
    motion = Motion(*trajectories()[0].evaluate(np.arange(SAMPLES) / RATE))
    spread = NOISE_SHARE * np.std(model.torque(motion, theta), axis=0)
    noise = Noise(position=POSITION_NOISE, torque=spread)
    train, test = (
        simulate(model, theta, path, timing=Timing(duration=PERIOD), noise=noise, seed=seed + i).log
        for i, path in enumerate(trajectories(), start=1)
    )
    links = tuple(replace(link, inertia=None) for link in model.robot.links)
    blind = DynamicModel(replace(model.robot, links=links), model.friction)
    how = Preprocessing(FourierFit(period_s=PERIOD, harmonics=5), rest="keep")
    return case_of_robot("er16"), contest_of(build_problem(blind, [train], how), [test], theta)


def panda():
    """Return the contest on the first two thirds and the last third of the Panda's log, and its case."""
    case = read_case(PANDA)
    train, test = case.split.apply(case.read(case.train[0]))
    return case, contest_of(build_problem(case.model, [train], case.preprocessing), [test])


def printed(title, case, contest, options):
    methods = methods_of(case, options.estimators)
    problem = contest.problem
    print(f"\n{title}: {problem.base.count} parameters, {problem.samples} samples, ", end="")
    print(f"{sum(len(log.keep) for log in contest.tests)} to test on", flush=True)
    if contest.truth_error is not None:
        print(f"held-out error of the truth itself: {100 * contest.truth_error:.4g} %")
    print()

    def tell(step):
        print(f"  {step}", file=sys.stderr, flush=True)

    outcomes = ranked(list(compare(contest, methods, time_limit=options.limit, jobs=1, progress=tell)))
    table = comparison_table(comparison_rows(outcomes))
    heads = [f"{column.heading} [{column.unit}]" if column.unit else column.heading for column in table.columns]
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    for row in table.rows:
        method, *cells = (cell.replace("|", r"\|").strip() for cell in row)
        print(f"| `{method}` | " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", nargs="*", default=["er16", "panda"], choices=["er16", "panda"])
    parser.add_argument("--limit", type=float, default=300.0)
    parser.add_argument("--estimators", default="all")
    options = parser.parse_args()
    if "er16" in options.data:
        printed("virtual ER-16", *er16(), options)
    if "panda" in options.data and not Path(os.environ.get("DYNIDENT_DATA", "missing")).is_dir():
        print("\npanda: left out, DYNIDENT_DATA names no folder")
    elif "panda" in options.data:
        printed("Panda", *panda(), options)


if __name__ == "__main__":
    main()
