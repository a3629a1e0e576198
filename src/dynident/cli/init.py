"""Write a commented case file from a robot description and a log.

What is found is filled in; what no log can tell (units, gains, mounting) stands there to be checked.

  dynident init robot.urdf run.csv -o case.yaml
"""

from __future__ import annotations

import argparse

SUMMARY = "a commented case file from a robot and a log"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("robot", metavar="ROBOT", help="robot description or a robot that ships")
    parser.add_argument("log", metavar="LOG", help="log of a motion")
    parser.add_argument("-o", "--output", metavar="FILE", default="case.yaml", help="default: case.yaml")
    parser.add_argument("--force", action="store_true", help="write over a file that is there")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from pathlib import Path

    from dynident.cli import console
    from dynident.cli.jobs import check_outputs
    from dynident.errors import FileError
    from dynident.experiment.case_file.case_draft import draft_case
    from dynident.files import write_atomically

    if Path(options.output).exists() and not options.force:
        raise FileError(options.output, "it is there already", "choose another name with -o, or give --force")
    check_outputs((options.output,), (options.robot, options.log))
    draft = draft_case(options.robot, options.log, Path(options.output).parent)
    write_atomically(options.output, draft.text)
    for finding in draft.remarks:
        console.remark(f"check: {finding}")
    console.remark(f"wrote {options.output}; next: dynident identify {options.output}")
    return 0
