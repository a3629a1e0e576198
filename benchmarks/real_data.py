"""Accuracy on real logs: each case in examples/cases by weighted and by consistent least squares, as a Markdown table.

Needs the logs under the folder that DYNIDENT_DATA names. Run: python -m benchmarks.real_data
"""

from __future__ import annotations

from pathlib import Path

from dynident import identify, read_case, validate
from dynident.experiment.split import Split

CASES = Path(__file__).resolve().parent.parent / "examples" / "cases"

KINDS = ("train", "test")

#: Case, what is trained and tested, and how the case file is changed for it.
RUNS = (
    ("panda", "all data", {"split": None}),
    ("panda", "first two thirds -> last third", {}),
    ("tx40", "rows 0:24750 -> 29250:45000", {}),
    ("ur10e", "seven runs -> two runs", {}),
    ("lwr4", "runs 2, 3 -> 1", {}),
    ("lwr4", "runs 1, 3 -> 2", {"train": (1, 3), "test": (2,)}),
    ("lwr4", "runs 1, 2 -> 3 (twice as fast)", {"train": (1, 2), "test": (3,)}),
)


def data_of(case, change):
    """Return training and test logs of a run."""
    runs = {key: tuple(f"kuka_lwr4_flobaroid/measurements_{i}.csv" for i in change.get(key, ())) for key in KINDS}
    train, test = ([case.read(file) for file in runs[key] or getattr(case, key)] for key in KINDS)
    split: Split | None = change.get("split", case.split)
    if split is None:
        return train, test
    parts = [split.apply(log) for log in train]
    return [a for a, _ in parts], [b for _, b in parts]


def main() -> None:
    print("| case | data | estimator | train | test | RMSE against the unfiltered torque, per joint | consistent |")
    print("|---|---|---|---|---|---|---|")
    for name, data, change in RUNS:
        case = read_case(CASES / f"{name}.yaml")
        train, test = data_of(case, change)
        for estimator in ("wls", "consistent"):
            estimate = identify(case.model, train, estimator, case.preprocessing, case.columns)
            found = validate(estimate, test) if test else None
            errors = " ".join(f"{fit.rmse_unfiltered:.3g}" for fit in (found or estimate.train).joints)
            held_out = "" if found is None else percent(found.total_relative_error)
            fit = percent(estimate.train.total_relative_error)
            verdict = "yes" if estimate.consistency.consistent else "no"
            print(f"| {name} | {data} | {estimator} | {fit} | {held_out} | {errors} | {verdict} |")


def percent(fraction: float) -> str:
    """Return a fraction in percent with three digits."""
    return f"{100 * fraction:.3g} %"


if __name__ == "__main__":
    main()
