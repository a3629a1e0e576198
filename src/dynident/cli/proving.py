"""--prove of export and report: the log whose motion is followed, and what is shown of the simulation."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from dynident.cli import console
from dynident.errors import BadOption

if TYPE_CHECKING:
    from dynident.data.log import Log
    from dynident.exports.models.proving.followed_motion import MotionProof
    from dynident.identification.estimate.estimate import Estimate


def motion_of(estimate: Estimate, options: argparse.Namespace) -> Log:
    """Return the log of --motion, or the first test log of the fit, or its first training log.

    Raises:
        BadOption: --motion without --prove, or --prove where no log of the fit can be read again.
        DynidentError: Any fault of the log.
    """
    from dynident.api.validate import read_log
    from dynident.cli.origin import origin_of

    if options.motion and not options.prove:
        raise BadOption("--motion", options.motion, "it goes with --prove")
    if options.motion:
        return read_log(estimate, options.motion)
    origin = origin_of(estimate)
    for log in (*origin.held_out, *origin.train):
        return log
    reason = origin.why_not or "the fit has no log"
    raise BadOption("--prove", "", f"{reason}; name a log whose motion is to be followed: --motion LOG")


def show_motion(proof: MotionProof) -> None:
    """Print what was simulated."""
    from dynident.results.model_export_view import condition_line, followed_line, not_run_lines, runs_table

    console.answer(f"\n{followed_line(proof)}")
    table = runs_table(proof)
    console.answer_table(table, table.note)
    for line in (*not_run_lines(proof), condition_line(proof)):
        console.answer(line)
