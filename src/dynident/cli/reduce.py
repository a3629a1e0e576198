"""Reduce logs of any size to triangles, from which 'identify --from' gives the same estimate as from the logs.

Memory holds one window of a log. Work that is cut short goes on where it stood when the same command is given again.
Triangles of several runs merge: see 'dynident merge'.

  dynident reduce case.yaml monday.parquet -o monday.tri
  dynident merge monday.tri tuesday.tri -o week.tri
  dynident identify case.yaml --from week.tri -o estimate.json
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynident.estimation.streaming.digest import Digest

SUMMARY = "logs larger than memory to triangles that identify takes"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    from dynident.cli.jobs import add_case_options

    parser.add_argument("case", metavar="CASE|ROBOT", help="case file or robot description")
    parser.add_argument("logs", nargs="*", metavar="LOG", help="logs; default: those of the case file that train")
    add_case_options(parser)
    output = parser.add_argument_group("output")
    output.add_argument("-o", "--output", metavar="FILE", required=True, help="write the triangles (.tri) here")
    output.add_argument(
        "--checkpoint", type=float, default=30.0, metavar="S", help="seconds between checkpoints beside it; 0: none"
    )
    output.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    output.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from pathlib import Path

    from dynident.cli import console, jobs
    from dynident.errors import BadOption
    from dynident.estimation.streaming.reduction import Checkpoint, reduce_logs
    from dynident.estimation.streaming.triangle_file import write_digest
    from dynident.files import check_place

    if not 0 <= options.checkpoint < float("inf"):
        raise BadOption("--checkpoint", options.checkpoint, "give seconds, 0 for none")
    check_place(options.output)
    options.test = []
    case = jobs.case_from(options)
    names = tuple(options.logs) or case.train
    if not names:
        raise BadOption("LOG", "", "name a log on the command line, or under train: in the case file")
    jobs.check_outputs((options.output,), (options.case, *case.files, *(case.find(name) for name in names)))
    checkpoint = Checkpoint(Path(options.output), options.checkpoint) if options.checkpoint else None
    with console.progress(1, options.quiet or options.json) as progress:
        progress.step(f"reducing {len(names)} log{'s' if len(names) > 1 else ''}")
        digest = reduce_logs(case, names, progress.update, checkpoint)
        write_digest(digest, options.output)
    if checkpoint is not None:
        checkpoint.remove(len(names))
    report(digest, options)
    step = f"dynident identify {options.case} --from {options.output}"
    console.remark(f"saved {options.output}; next: {step}", options.quiet or options.json)
    return 0


def report(digest: Digest, options: argparse.Namespace) -> None:
    """Print what is in a digest."""
    from dynident.cli import console

    facts = {
        "robot": digest.model.robot.name,
        "joints": list(digest.model.robot.joint_names),
        "base_parameters": digest.base.count,
        "samples": digest.samples,
        "rows": [int(joint.counts.sum()) for joint in digest.joints],
        "stretches": len(digest.joints[0].counts),
        "filter": digest.how.statement(),
        "logs": [
            {"path": c.path, "sha256": c.sha256, "rows": c.rows, "samples": c.samples, "steps": list(c.steps)}
            for c in digest.chunks
        ],
    }
    if options.json:
        console.answer_json(facts)
        return
    console.answer(
        f"{facts['robot']}: {facts['base_parameters']} base parameters, {digest.samples:,} samples "
        f"of {len(digest.chunks)} log{'s' if len(digest.chunks) > 1 else ''}"
    )
    cutoff, delay = digest.how.filter.bandwidth(), digest.how.delay_s or 0.0
    told = f"both sides at {cutoff:g} Hz" if cutoff is not None else str(digest.how.statement()["kind"])
    console.answer(f"  filter: {told}" + f", delay of the torque {delay:.4g} s" * bool(delay))
    for chunk in digest.chunks:
        console.answer(f"  {chunk.path}: {chunk.rows:,} rows, {chunk.samples:,} used at {chunk.rate:.5g} Hz")
