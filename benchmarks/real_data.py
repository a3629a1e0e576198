"""Accuracy on real logs: each case in examples/cases by weighted and by consistent least squares, as a Markdown table.

Needs the logs under the folder that DYNIDENT_DATA names.
Run: python -m benchmarks.real_data [CASE...] [--friction auto | drafted]

With ``drafted`` the model is the one that ``init`` drafts, with an unknown delay as in a draft, on the rows and at the
cut-off of the hand-written case.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.init_cases import against_model, drafted
from dynident import read_case
from dynident.case.case import Case
from dynident.data.preprocessing import FILTERS
from dynident.data.split import Split
from dynident.identification.identify import identify
from dynident.model.friction import FRICTION, Friction

CASES = Path(__file__).resolve().parent.parent / "examples" / "cases"

KINDS = ("train", "test")

#: Case, what is trained and tested, and how the case file is changed for it.
RUNS = (
    ("panda", "all data", {"split": None}),
    ("panda", "first two thirds -> last third", {}),
    ("tx40", "rows 0:24750 -> 29250:45000, 50 Hz", {}),
    ("tx40", "rows 2500:29167 -> 29167:42500, 30 Hz", {
        "split": Split.parse("samples:2500:29167,29167:42500"), "cutoff_hz": 30.0, "trim_s": 0.1, "delay_s": None,
        "friction": ("degressive", "load"),
    }),
    ("ur10e", "seven runs -> two runs", {}),
    ("lwr4", "runs 2, 3 -> 1", {}),
    ("lwr4", "runs 1, 3 -> 2", {"train": (1, 3), "test": (2,)}),
    ("lwr4", "runs 1, 2 -> 3 (twice as fast)", {"train": (1, 2), "test": (3,)}),
    ("tiago", "rows 921:4835 -> 4835:6792", {}),
)  # fmt: skip


def data_of(case, change):
    """Return training and test logs of a run."""
    runs = {key: tuple(f"kuka_lwr4_flobaroid/measurements_{i}.csv" for i in change.get(key, ())) for key in KINDS}
    train, test = ([case.read(file) for file in runs[key] or getattr(case, key)] for key in KINDS)
    split: Split | None = change.get("split", case.split)
    if split is None:
        return train, test
    parts = [split.apply(log) for log in train]
    return [a for a, _ in parts], [b for _, b in parts]


def how_of(case, change):
    """Return the preprocessing of a run."""
    how = case.preprocessing
    if "cutoff_hz" in change:
        how = replace(how, filter=FILTERS.make("butterworth", {"cutoff_hz": change["cutoff_hz"]}))
    return replace(how, trim_s=change.get("trim_s", how.trim_s), delay_s=change.get("delay_s", how.delay_s))


def drafts(name: str) -> Case:
    """Return the case that ``init`` drafts for the logs of a set."""
    with tempfile.TemporaryDirectory() as folder:
        return drafted(name, Path(os.environ["DYNIDENT_DATA"]), Path(folder))[1]


def moving_error(validation) -> float:
    """Return |residual| / |torque| over all joints and the rows in which they move."""
    fits = [fit for fit in validation.moving if fit.samples and fit.relative_error > 0]
    error = np.array([fit.samples * fit.rmse**2 for fit in fits])
    torque = error / np.array([fit.relative_error for fit in fits]) ** 2
    return float(np.sqrt(error.sum() / torque.sum()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help="default: all")
    parser.add_argument("--friction", choices=("given", "auto", "drafted"), default="given")
    options = parser.parse_args()
    print("| case | data | estimator | train | test | test, moving | RMSE against the unfiltered torque | consistent |")
    print("|---|---|---|---|---|---|---|---|")
    for name, data, change in RUNS:
        if options.cases and name not in options.cases:
            continue
        case = hand = read_case(CASES / f"{name}.yaml")
        how, choose = how_of(case, change), options.friction == "auto"
        if options.friction == "drafted":
            case, how = drafts(name), replace(how, delay_s=None)
            model = case.model
            train, test = data_of(replace(case, split=hand.split, train=hand.train, test=hand.test), change)
        else:
            more = tuple(FRICTION.make(part) for part in change.get("friction") or ())
            model = replace(case.model, friction=(*case.friction, *more))
            train, test = data_of(case, change)
        for estimator in ("wls", "consistent") if options.friction != "drafted" else ("consistent",):
            estimate = identify(model, train, estimator, how, choose_friction=choose)
            found = against_model(estimate, test) if test else None
            errors = " ".join(f"{fit.rmse_unfiltered:.3g}" for fit in (found or estimate.train).joints)
            held_out, moving = (
                ("", "") if found is None else (percent(found.total_relative_error), percent(moving_error(found)))
            )
            fit = percent(estimate.train.total_relative_error)
            verdict = "yes" if estimate.consistency.consistent else "no"
            print(
                f"| {name} | {data} | {estimator} | {fit} | {held_out} | {moving} | {errors} | {verdict} |", flush=True
            )
            if options.friction != "given":
                print(f"    {list(map(label, estimate.model.friction))}", flush=True)


def label(part: Friction) -> str:
    """Return a part with the fields that may be chosen."""
    fields = ", ".join(f"{name} {value:.3g}" for name, value in part.options.items() if name in part.ranges)
    return FRICTION.name_of(part) + f" ({fields})" * bool(fields)


def percent(fraction: float) -> str:
    """Return a fraction in percent with three digits."""
    return f"{100 * fraction:.3g} %"


if __name__ == "__main__":
    main()
