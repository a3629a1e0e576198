"""The delay of the torque: found to what part of a sample, and what is left of the fit once it is taken out.

Run: python -m benchmarks.faults.delays [ROBOT ...]
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.faults.trials import RATE, VIRTUAL, virtual
from dynident.case.case import read_case
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.identify import identify
from dynident.identification.validate import validate

SAMPLES = (0.3, 0.5, 1.0, 2.0, 3.7, 5.0, 10.0, 20.0)


def worst_move(estimate: Estimate, against: Estimate) -> float:
    """Return the largest move of a base parameter known to 1 %, as a share."""
    known = against.relative_std < 0.01
    return float(np.max(np.abs(estimate.beta - against.beta)[known] / np.abs(against.beta)[known]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=list(VIRTUAL))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for robot in parser.parse_args().robots:
            case = read_case(robot)
            how = replace(case.preprocessing, delay_s=None)
            held = case.read(virtual(case, seed=1).written(folder, "held"))
            plain = identify(case.model, [case.read(virtual(case).written(folder))], "wls", case.preprocessing)
            error = validate(plain, [held], case.preprocessing).total_relative_error
            print(f"{robot}: held-out error {100 * error:.3f} % without a delay")
            for samples in SAMPLES:
                trial = virtual(case, delay=samples / RATE)
                found = [one for one in trial.examined(folder).findings if one.name == "torque delay"]
                told = found[0].numbers["delay_s"] * RATE if found else float("nan")
                late = case.read(trial.written(folder))
                after = identify(case.model, [late], "wls", how)
                left = validate(after, [held], case.preprocessing).total_relative_error
                ignored = identify(case.model, [late], "wls", case.preprocessing)
                harm = validate(ignored, [held], case.preprocessing).total_relative_error
                print(
                    f"  {samples:5.1f} samples: told {told:7.3f}; held-out error {100 * left:.3f} % "
                    f"({100 * (left / error - 1):+.1f} %; {100 * harm:.3f} % where it is left in), "
                    f"largest move of a parameter {100 * worst_move(after, plain):.2f} %",
                    flush=True,
                )


if __name__ == "__main__":
    main()
