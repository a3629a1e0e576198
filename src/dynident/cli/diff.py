"""Compare estimates of one robot side by side: of two days, two logs, two estimators, two robots of a type.

Base parameters are compared by their standard deviations, torques on random states within all training ranges.

  dynident diff monday.json friday.json
  dynident diff wls.json consistent.json --html side-by-side.html
  dynident diff robot-1.json robot-2.json robot-3.json --json
"""

from __future__ import annotations

import argparse
from pathlib import Path

from dynident.cli import console
from dynident.files import check_outputs, check_place

SUMMARY = "two or more estimates of one robot side by side"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("estimates", nargs="+", metavar="ESTIMATE", help="files of 'dynident identify -o'")
    parser.add_argument("--html", metavar="FILE", help="write one self-contained page here")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    parser.add_argument("--quiet", action="store_true", help="no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.identification.files.estimate_file import read_estimate
    from dynident.studies.comparison import difference_page as page
    from dynident.studies.comparison.difference_page import difference

    if options.html:
        check_place(options.html)
        check_outputs((options.html,), options.estimates)
    found = difference([read_estimate(name) for name in options.estimates], _names(options.estimates))
    if options.html:
        page.write_difference_page(options.html, found)
    if options.json:
        console.answer_json(found.figures())
        return 0
    console.answer_table(page.estimates_table(found))
    console.answer()
    beside = page.parameters_beside(found, console.NAME_WIDTH)
    console.answer_table(beside, beside.note)
    torques = page.torques_table(found)
    if torques is not None:
        console.answer()
        console.answer_table(torques, torques.note)
    console.answer()
    for said in page.verdicts(found):
        console.answer(said)
    if options.html:
        console.remark(f"wrote {options.html}", options.quiet)
    return 0


def _names(files: list[str]) -> list[str]:
    """Return names of files without their folders and suffixes where that tells them apart."""
    short = [Path(file).stem for file in files]
    return short if len(set(short)) == len(short) else files
