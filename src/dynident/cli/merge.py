"""Merge QR factor files of one model into one, each log once.

dynident merge monday.tri tuesday.tri -o week.tri
"""

from __future__ import annotations

import argparse

from dynident.cli import console
from dynident.files import check_outputs, check_place

SUMMARY = "merge QR factors of several runs or machines into one file"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("files", nargs="+", metavar="FILE", help="files that 'dynident reduce' or this has written")
    parser.add_argument("-o", "--output", metavar="FILE", required=True, help="write the QR factors (.tri) here")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of text")
    parser.add_argument("--quiet", action="store_true", help="no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.api.matching_digests import merged_file
    from dynident.cli.reduce import report
    from dynident.identification.streaming.triangle_file import write_digest

    check_place(options.output)
    check_outputs((options.output,), options.files)
    digest = merged_file(options.files)
    write_digest(digest, options.output)
    report(digest, options)
    console.remark(f"saved {options.output}", options.quiet or options.json)
    return 0
