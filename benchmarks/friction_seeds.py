"""Friction that is known, drawn again for each seed: parts that the choice takes though they are not there, or misses.

Each seed has a robot of :data:`benchmarks.frictions.ROBOTS` with its own bodies, motion and noise, coefficients of
friction times up to two either way, one drawn width of dry friction, a torque that is late by 0 to 3 samples and,
where the robot has presliding, a drawn length. Its two logs of the virtual cell are drafted with ``init`` and
identified. A row for each robot: in how many seeds a part is taken that is not there (with a share above 1 % of dry
friction in brackets), the delay is more than 0.3 of a sample off, or level or length of presliding is more than 10 %
off, and the median and 90 % of these errors.

Run: python -m benchmarks.friction_seeds [ROBOT...] [--seeds N] [--first K] [--each]
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.frictions import ROBOTS, Virtual, drafted, fades, logged, planar
from dynident.identification.identify import identify
from dynident.model.friction import FRICTION
from dynident.simulation.cell import Cell
from dynident.simulation.effects import Bristles

#: Robots beside those of :mod:`benchmarks.frictions`: of three joints, so that many seeds take minutes.
LEVELS, SLOPES = (4, 5, 3), (3, 4, 2)
BESIDE: Mapping[str, Virtual] = {
    "plain-3-pid": Virtual(
        planar(), (("coulomb", {"width": 0.01}, LEVELS), ("viscous", {}, SLOPES)), controller="pid", periods=16
    ),
    "presliding-3": Virtual(
        planar(),
        (
            ("coulomb", {"width": 0.01}, (1.2, 1.5, 0.9)),
            ("viscous", {}, SLOPES),
            ("presliding", {"length": 5e-3}, (2.8, 3.5, 2.1)),
        ),
    ),
    "stribeck-3": Virtual(
        planar(),
        (
            ("coulomb", {"width": 0.01}, LEVELS),
            ("viscous", {}, SLOPES),
            ("stribeck", {"velocity": 0.06, "exponent": 2.0, "width": 0.01}, (1.6, 2.0, 1.2)),
        ),
    ),
    "both-3": Virtual(
        planar(),
        (
            ("coulomb", {"width": 0.01}, (1.2, 1.5, 0.9)),
            ("viscous", {}, SLOPES),
            ("presliding", {"length": 5e-3}, (2.8, 3.5, 2.1)),
            ("stribeck", {"velocity": 0.06, "exponent": 2.0, "width": 0.01}, (1.6, 2.0, 1.2)),
        ),
    ),
    "bristles-3": Virtual(
        planar(),
        (("coulomb", {"width": 0.01}, LEVELS), ("viscous", {}, SLOPES)),
        cell=Cell(bristles=Bristles(5e-3, damping=0.0)),
    ),
    "damped-3": Virtual(
        planar(), (("coulomb", {"width": 0.01}, LEVELS), ("viscous", {}, SLOPES)), cell=Cell(bristles=Bristles(5e-3))
    ),
}


@dataclass(frozen=True)
class Found:
    """What came of a seed.

    Attributes:
        width: Drawn width of dry friction, in rad/s.
        late: Samples by which the torque is late.
        length: Drawn length of presliding, in rad; 0 for none.
        taken: Names of the parts in the estimate that may be missing.
        fades: Whether a Stribeck effect of more than a hundredth of the dry friction is among them.
        delay: Largest error of a delay, in samples.
        level: Largest relative error of the level of presliding of a joint; nan where there is none.
        found: Length of presliding, in rad; 0 for none.
    """

    width: float
    late: float
    length: float
    taken: tuple[str, ...]
    fades: bool
    delay: float
    level: float
    found: float


def drawn(virtual: Virtual, seed: int) -> Virtual:
    """Return a robot with the friction and the motion of a seed."""
    generator = np.random.default_rng([seed, 27])
    width, length = (float(np.exp(generator.uniform(*np.log(span)))) for span in ((3e-3, 0.03), (2e-3, 0.02)))
    late, first = float(generator.integers(4)), virtual.first * 2.0 ** generator.uniform(-0.5, 0.5)
    shared: Mapping[str, float] = {"width": width, "length": length}

    def one(part: tuple[str, Mapping[str, Any], Any]) -> tuple[str, Mapping[str, Any], Any]:
        name, options, values = part
        factors = 2.0 ** generator.uniform(-1, 1, size=np.shape(values))
        return name, {key: shared.get(key, value) for key, value in options.items()}, np.asarray(values) * factors

    bristles = virtual.cell.bristles
    if bristles.presliding:
        virtual = replace(virtual, cell=replace(virtual.cell, bristles=replace(bristles, presliding=length)))
    return replace(virtual, friction=[one(part) for part in virtual.friction], late=late, first=first, truth=())


def outcome(name: str, seed: int) -> Found:
    """Return what comes of a robot and a seed."""
    virtual = drawn({**ROBOTS, **BESIDE}[name], seed)
    with tempfile.TemporaryDirectory() as folder:
        logs = logged(name, virtual, Path(folder), seed, logs=2)
        case = drafted(Path(folder), logs)
        learn = [case.read(path) for path in logs]
    found = identify(case.model, learn, case.estimator.name, case.preprocessing)
    options = {part: own for part, own, _ in virtual.friction}
    levels = next((own for part, _, own in virtual.friction if part == "presliding"), None)
    length = options.get("presliding", {}).get("length", 0.0)
    if virtual.cell.bristles.presliding:
        levels, length = (
            (own for part, _, own in virtual.friction if part == "coulomb"),
            virtual.cell.bristles.presliding,
        )
        (levels,) = levels
    own = [p["value"] for p in found.parameters() if p["name"].startswith("Fp[")]
    level = np.nan if levels is None else float(np.max(np.abs(np.array(own) / levels - 1))) if own else 1.0
    taken = [FRICTION.name_of(part) for part in found.model.friction]
    return Found(
        options["coulomb"]["width"],
        virtual.late,
        length,
        tuple(dict.fromkeys(part for part in taken if part not in ("coulomb", "viscous", "offset"))),
        fades(found),
        max(abs(one.applied * virtual.rate - virtual.late) for one in found.choices.delays or ()),
        level,
        max((part.options["length"] for part in found.model.friction if part.states), default=0.0),
    )


def row_of(name: str, found: Sequence[Found], parts: Sequence[str]) -> str:
    """Return the row of a robot whose friction has some parts."""
    false = {part: sum(part in one.taken for one in found) for part in ("stribeck", "presliding", "degressive", "load")}
    told = [f"{count}" if part not in parts else f"{count} (there)" for part, count in false.items()]
    told[0] += f" [{sum(one.fades for one in found)}]"
    late = sum(not one.delay <= 0.3 for one in found)
    lengths = np.array([abs(one.found / one.length - 1) if one.length else np.nan for one in found])
    levels = np.array([one.level for one in found])
    off = [
        "-" if np.isnan(own).any() else f"{int(np.sum(own > 0.1))} ({np.median(own):.1%}, {np.quantile(own, 0.9):.1%})"
        for own in (levels, lengths)
    ]
    return f"| {name} | {len(found)} | {' | '.join(told)} | {late} | {' | '.join(off)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", metavar="ROBOT", default=["plain-3", *BESIDE])
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--each", action="store_true", help="a line for each seed as well")
    options = parser.parse_args()
    print("| robot | seeds | Stribeck | presliding | degressive | load | delay off | level off | length off |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in options.robots:
        virtual, found = {**ROBOTS, **BESIDE}[name], []
        for seed in range(options.first, options.first + options.seeds):
            found.append(outcome(name, seed))
            if options.each:
                print(seed, found[-1], flush=True)
        there = [part for part, *_ in virtual.friction] + ["presliding"] * bool(virtual.cell.bristles.presliding)
        print(row_of(name, found, there), flush=True)


if __name__ == "__main__":
    main()
