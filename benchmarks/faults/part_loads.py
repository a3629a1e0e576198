"""Loads that are carried for a part of a log: python -m benchmarks.faults.part_loads [FIRST LAST].

The random arms of ``benchmarks.faults.clean`` carry a body of 0.3 to 3 times the mass of the last link in one to three
spells, a tenth to six tenths of a log. Counted are the logs in which it is named, those whose spells are right but for
0.5 s of each end, the intervals at 95 % that hold the mass, and the error of the model on another motion without a
load, before and after the rows with it are left out.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio
from scipy.signal import butter, sosfiltfilt

from benchmarks.faults.clean import case_of, recorded, robot, written
from benchmarks.faults.end_stops import error_of
from benchmarks.faults.loads import loaded
from benchmarks.faults.trials import tracked
from benchmarks.strangers.plant import urdf
from dynident.diagnosis.examination import examine

ARMS, SMOOTH_HZ, RAMP_S, NEAR_S = 40, 10.0, 0.05, 0.5


def added(truth: str, more: str, columns: dict[str, np.ndarray]) -> np.ndarray:
    """Return by how much the torques of two robot models differ in the motion of some columns, shape (N, n)."""
    t, step = columns["t"], columns["t"][1]
    q = sosfiltfilt(butter(4, 2 * step * SMOOTH_HZ, output="sos"), columns["q"], axis=0)
    dq = np.gradient(q, t, axis=0)
    motion = list(zip(q, dq, np.gradient(dq, t, axis=0), strict=True))
    models = [pinocchio.buildModelFromXML(one) for one in (more, truth)]
    torques = [
        np.array([pinocchio.rnea(one, data, *row) for row in motion]) for one in models for data in [one.createData()]
    ]
    return torques[0] - torques[1]


def carried(seed: int) -> tuple[str, str, list[dict[str, np.ndarray]], float, np.ndarray]:
    """Return a robot model, the side of its torques, a log and one without the load, its mass, and when it is there."""
    generator = np.random.default_rng([24, seed])
    bodies = robot(generator)
    truth = urdf("arm", bodies, seed)
    columns, side = recorded(generator, bodies, truth, 2)
    draw = np.random.default_rng([10, seed])
    mass = float(np.exp(draw.uniform(np.log(0.3), np.log(3.0)))) * bodies[-1].mass
    t, spells, share = columns[0]["t"], int(draw.integers(1, 4)), float(draw.uniform(0.1, 0.6))
    places = (np.arange(spells) + draw.uniform(0, 1 - share, spells)) / spells * t[-1]
    ends = places + share / spells * t[-1]
    ramps = [
        np.clip((t - a) / RAMP_S, 0, 1) - np.clip((t - b) / RAMP_S, 0, 1) for a, b in zip(places, ends, strict=True)
    ]
    there = np.sum(ramps, axis=0)
    more = loaded(truth, f"link_{len(bodies)}", mass, draw.normal(0, 0.1, 3))
    columns[0]["tau"] += there[:, None] * added(truth, more, columns[0])
    return urdf("arm", bodies), side, columns, mass, there > 0


@dataclass(frozen=True)
class Told:
    """What the log checks say of a log.

    Attributes:
        numbers: Those of the load; empty where none is named.
        evidence: What is said of it.
        right: Whether the first and the last spell begin and end where they should.
        others: Labels of other errors and warnings.
        before: Error on another motion, with the load in the log.
        after: The same without its rows.
    """

    numbers: Mapping[str, float]
    evidence: str
    right: bool
    others: tuple[str, ...]
    before: float
    after: float


def told(seed: int, folder: Path) -> tuple[float, Told]:
    """Return the mass of the load of a seed in kg, and what is said of the log."""
    described, side, (columns, unseen), mass, there = carried(seed)
    case = case_of(described, side, folder)
    written(columns, folder / "run.csv")
    found = [one for one in examine(case, str(folder / "run.csv")).findings if one.severity != "note"]
    loads = [one for one in found if one.name == "load for a while"]
    numbers, evidence = (loads[0].numbers, loads[0].evidence) if loads else ({}, "not named")
    edges = np.flatnonzero(np.diff(there.astype(int), prepend=0, append=0))
    places = columns["t"][np.minimum(edges, len(there) - 1)]
    off = (numbers.get("first", np.inf) - places[0], numbers.get("last", np.inf) - places[-1])
    mended = replace(case, preprocessing=replace(case.preprocessing, longest_gap_s=60.0))
    cut = {key: values[~there] for key, values in columns.items()}
    before, after = error_of(case, columns, unseen, folder), error_of(mended, cut, unseen, folder)
    others = tuple(one.label for one in found if one not in loads)
    return mass, Told(numbers, evidence, max(map(abs, off)) <= NEAR_S, others, before, after)


def main() -> None:
    first, last = (int(word) for word in sys.argv[1:3]) if len(sys.argv) > 2 else (0, ARMS)
    named, placed, weighed, held, gains, others = 0, 0, 0, 0, list[float](), list[str]()
    with tempfile.TemporaryDirectory() as name:
        for seed in tracked(range(first, last), "logs"):
            mass, one = told(seed, Path(name))
            print(f"{seed}: {mass:.3g} kg: error {one.before:.2%} with it, {one.after:.2%} without; {one.evidence}")
            others += [f"{seed}: {other}" for other in one.others]
            if one.numbers:
                named, placed, gains = named + 1, placed + one.right, [*gains, one.after / one.before]
            if "mass" in one.numbers:
                weighed += 1
                held += abs(one.numbers["mass"] - mass) <= one.numbers["half_width"]
    print(f"{named} of {last - first} named, {placed} with its spells, {held} of {weighed} intervals hold the mass")
    print(f"besides: {'; '.join(others) or 'nothing'}")
    print(f"errors without these rows over those with: median {np.median(gains):.2f}, most {max(gains, default=0):.2f}")


if __name__ == "__main__":
    main()
