"""Write a commented case file from a robot model and logs.

Columns are recognized by vendor profiles and by their names, units by profiles, headers and values. Complete the
lines with a comment '# ask': logs do not determine them (drive gains, couplings, mounting, which joints the columns
are); where the value is the word 'ask', the case cannot be used before it is answered. Nothing is converted on a guess.

  dynident init robot.urdf run.csv -o case.yaml
  dynident init robot.urdf monday.csv tuesday.csv --test friday.csv -o case.yaml
  dynident init robot.urdf robot_data.csv --profile ur_rtde --json
"""

from __future__ import annotations

import argparse
from pathlib import Path
from shlex import quote

from dynident.cli import console
from dynident.errors import BadOption, FileError
from dynident.files import check_outputs, write_atomically

SUMMARY = "a commented case file from a robot and its logs"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("robot", metavar="ROBOT", help="robot model or built-in example robot")
    parser.add_argument("logs", nargs="+", metavar="LOG", help="logs with the same columns: files, folders, patterns")
    parser.add_argument("--test", nargs="+", default=[], metavar="LOG", help="logs to test on, not learned from")
    kind = parser.add_argument_group("kind of log (found from the columns and the suffix where not stated)")
    kind.add_argument("--profile", default="", metavar="NAME", help="profile of its vendor: 'dynident list profiles'")
    kind.add_argument("--format", default="", metavar="NAME", help="format of the file: 'dynident list formats'")
    kind.add_argument(
        "--format-option", action="append", default=[], metavar="KEY=VALUE", help="such as topics=/joint_states"
    )
    kind.add_argument("--rate", type=float, metavar="HZ", help="samples a second, where no column has the time")
    output = parser.add_argument_group("output")
    output.add_argument("-o", "--output", metavar="FILE", default="case.yaml", help="default: case.yaml")
    output.add_argument("--force", action="store_true", help="write over a file that is there")
    output.add_argument("--json", action="store_true", help="print what was recognised, with how sure it is")
    output.add_argument("--quiet", action="store_true", help="no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.api.init import LogKind, init
    from dynident.case.case_draft import draft_summary

    if Path(options.output).exists() and not options.force:
        raise FileError(options.output, "it is there already", "choose another name with -o, or give --force")
    check_outputs((options.output,), (options.robot, *options.logs, *options.test))
    kind = LogKind(options.profile, options.format, _format_options(options), options.rate)
    draft = init(options.robot, options.logs, Path(options.output).parent, test=options.test, kind=kind)
    write_atomically(options.output, draft.text)
    lines = ", ".join(str(question.line) for question in draft.needed)
    follow = f"dynident identify {quote(options.output)}"
    if options.json:
        console.answer_json({"case": options.output, **draft_summary(draft), "next": follow})
        return 0
    for finding in draft.remarks:
        console.remark(f"check: {finding}", options.quiet)
    if draft.needed:
        which = "line" if len(draft.needed) == 1 else "lines"
        text = f"wrote {options.output}; it asks in {which} {lines}; answer there, then: {follow}"
        console.remark(text, options.quiet)
    else:
        console.remark(f"wrote {options.output}; next: {follow}", options.quiet)
    return 0


def _format_options(options: argparse.Namespace) -> dict[str, str | None]:
    found: dict[str, str | None] = {}
    for item in options.format_option:
        key, equals, value = item.partition("=")
        if not equals or not options.format:
            raise BadOption("--format-option", item, "write --format NAME --format-option key=value")
        found[key] = value
    return found
