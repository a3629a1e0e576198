"""Estimate many robots of one type together: each estimate is shrunk to their mean as far as its own log is short.

Give one file per robot: estimates of 'dynident identify -o', or QR factors of 'dynident reduce -o', all with one robot
model and one friction model. What the robots have in common helps where logs are short; where they are long the
estimates stay as they are. Outliers are named with the parameter that is furthest from the mean; where there are
none, any robot is named with the probability --rate. QR factors need not determine all base parameters.

  dynident fleet cell-*.json -o fleet             fleet/cell-1.json ... and fleet/fleet.json
  dynident fleet monday/*.tri --rate 0.01 --json
  dynident validate fleet/cell-1.json other-run.csv
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from dynident.cli import console, jobs
from dynident.errors import BadOption, FileError
from dynident.files import check_outputs, unreadable, write_atomically

if TYPE_CHECKING:
    from dynident.applications.fleet import Fleet, FleetRobot

SUMMARY = "many robots of one type: what they share, outliers named"

#: Name of the file about the whole fleet.
FLEET_FILE = "fleet.json"

#: Parameters that the table on the terminal shows.
SHOWN = 20

#: Robots up to which only gross outliers are told (docs/fleet.md, "Where it does not help").
FEW = 6


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("files", nargs="+", metavar="FILE", help="estimates or QR factors, one file per robot")
    parser.add_argument("-o", "--output", metavar="FOLDER", help=f"write one estimate per robot and {FLEET_FILE} here")
    parser.add_argument(
        "--rate",
        type=float,
        default=0.05,
        metavar="P",
        help="probability of naming any robot where none is an outlier (0.05)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    parser.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.api.estimate_output import write_estimate
    from dynident.applications.fleet import fleet_of

    places: list[str] = []
    if options.output:
        names = [Path(file).stem for file in options.files]
        if (own := Path(FLEET_FILE).stem) in names:
            raise BadOption("FILE", options.files[names.index(own)], f"{FLEET_FILE} is that of the whole fleet")
        places = [str(Path(options.output) / f"{name}.json") for name in names]
        if len(set(places)) == len(places):  # names that are there twice are refused with the robots
            check_outputs((*places, str(Path(options.output) / FLEET_FILE)), options.files)
    with console.progress(len(options.files) + 2, options.quiet or options.json) as progress:
        progress.step("reading")
        robots = [_read(file) for file in options.files]
        fleet = fleet_of(robots, options.rate, {"command": jobs.repeat_command()}, progress.step)
    if options.output:
        try:
            Path(options.output).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(options.output, f"no folder ({error.strerror})", "give another folder with -o") from error
        for place, estimate in zip(places, fleet.estimates, strict=True):
            write_estimate(estimate, place)
        whole = {"kind": "dynident fleet", "format": 2, **fleet.figures()}
        write_atomically(Path(options.output) / FLEET_FILE, json.dumps(whole, allow_nan=False) + "\n")
    if options.json:
        console.answer_json(fleet.figures())
        return 0
    _show(fleet)
    if options.output:
        step = f"next: dynident validate {quote(str(places[0]))} other-run.csv"
        console.remark(f"saved {len(places)} estimates and {FLEET_FILE} in {options.output}; {step}", options.quiet)
    return 0


def _read(file: str) -> FleetRobot:
    """Return the robot of an estimate or of a triangle file, whichever it is by its first bytes."""
    from dynident.applications.fleet import robot_of_digest, robot_of_estimate
    from dynident.identification.files.estimate_file import read_estimate
    from dynident.identification.streaming.triangle_file import read_digest

    try:
        with open(file, "rb") as stream:
            head = stream.read(2)
    except OSError as error:
        raise unreadable(file, error) from error
    name = Path(file).stem
    return robot_of_digest(name, read_digest(file)) if head == b"PK" else robot_of_estimate(name, read_estimate(file))


def _show(fleet: Fleet) -> None:
    import numpy as np

    from dynident.results.text import (
        Table,
        columns_of,
        format_number,
        format_percent,
        format_value,
        label,
        pretty_unit,
    )
    from dynident.results.text import shorten as shortened

    found, population = fleet.screening, fleet.screening.population
    count = len(fleet.robots)
    console.answer(f"{fleet.robots[0].model.robot.name}: {count} robots, {fleet.base.count} base parameters\n")
    heads = columns_of("robot", ">own share [%]", ">p of any", "consistent", "furthest parameter", ">score", "verdict")
    rows = []
    for robot, distance, estimate, share in zip(
        fleet.robots, found.distances, fleet.estimates, fleet.shares, strict=True
    ):
        verdict = "OUT" if robot.name in found.out else "belongs" if found.tested else "not tested"
        consistent = "yes" if estimate.consistency.consistent else "NO"
        furthest = shortened(label(fleet.base.names[distance.parameter]), 30)
        numbers = format_percent(float(np.median(share)), sign=False), format_number(min(1.0, distance.p * count), 2)
        score = format_number(float(distance.scores[distance.parameter]), 2)
        rows.append((label(robot.name), *numbers, consistent, furthest, score, verdict))
    console.answer_table(Table(heads, tuple(rows)))
    console.answer()
    heads = columns_of("base parameter", ">mean", ">std", ">spread", "unit")
    deviations = np.sqrt(np.diag(population.mean_covariance))
    rows = []
    for k in range(min(fleet.base.count, SHOWN)):
        name = shortened(label(fleet.base.names[k]), console.NAME_WIDTH)
        value, std = format_value(float(population.mean[k]), float(deviations[k]))
        spread = format_number(float(population.deviations[k]), 2)
        rows.append((name, value, std, spread, pretty_unit(fleet.base.units[k])))
    console.answer_table(Table(heads, tuple(rows)))
    if fleet.base.count > SHOWN:
        console.answer(f"... and {fleet.base.count - SHOWN} more; --json has all")
    console.answer()
    for distance in found.distances:
        if distance.name in found.out:
            told = fleet.evidence(distance)
            sizes = f"{told['value']:.4g} {pretty_unit(told['unit'])} where the others have {told['mean']:.4g}"
            console.answer(
                f"{label(distance.name)} is OUT: {label(told['parameter'])} ({label(told['owner'])}) is {sizes} with a "
                f"spread of {told['spread']:.2g}; chi-square {distance.chi_square:.1f} over {distance.rank}, "
                f"p {found.adjusted[distance.name]:.2g} after {count} comparisons"
            )
    few = f"; {count} robots tell gross ones alone: look at the furthest parameters" if count <= FEW else ""
    if not found.out and found.tested:
        console.answer(f"no robot is out at a family-wise rate of {100 * found.rate:g} %{few}")
    if not found.tested:
        console.answer(f"{count} robots are too few to say that one is out; four or more are needed")
    if not population.settled:
        console.answer("warning: the spread has not settled; it is what the last round gave")
