"""Compress logs of any size to QR factors; 'identify --from' gives the same estimate as from the logs.

Memory holds one window of a log. Work that is cut short goes on where it stood when the same command is given again.
With a split, the training parts are reduced. Merge the QR factors of several runs: see 'dynident merge'. LOG is a file,
a folder of logs, a pattern in quotes, or an address of a bucket. Workers reduce logs side by side, to the same bits.
'identify --from' takes --friction, --cutoff, --rate and --delay from the QR factors.

  dynident reduce case.yaml monday.csv -o monday.tri
  dynident merge monday.tri tuesday.tri -o week.tri
  dynident identify case.yaml --from week.tri -o estimate.json
  dynident reduce case.yaml runs/ 'more/*.csv' --jobs 4 -o year.tri
  dynident reduce case.yaml 's3://bucket/runs/*.parquet' --scheduler tcp://host:8786 -o year.tri
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from dynident.cli import console, jobs
from dynident.cli.jobs import add_case_options, add_pool_option, cluster_of
from dynident.errors import BadOption
from dynident.files import check_outputs, check_place

if TYPE_CHECKING:
    from dynident.cli.console import Progress
    from dynident.errors import DynidentError
    from dynident.identification.streaming.digest import Digest
    from dynident.identification.streaming.reduction import Standing

SUMMARY = "compress logs larger than memory to QR factors for identify"

#: Options in the short help.
FREQUENT = ("--split", "--jobs", "--skip-bad", "-o", "--json")


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("case", metavar="CASE|ROBOT", help="case file or robot model")
    parser.add_argument("logs", nargs="*", metavar="LOG", help="logs; default: those of the case file that train")
    add_case_options(parser)
    how = parser.add_argument_group("how")
    how.add_argument("--jobs", type=int, default=1, metavar="N", help="processes that reduce logs side by side (1)")
    add_pool_option(how)
    how.add_argument(
        "--skip-bad", action="store_true", help="leave logs out that cannot be reduced; default: refuse, and name them"
    )
    output = parser.add_argument_group("output")
    output.add_argument("-o", "--output", metavar="FILE", required=True, help="write the QR factors (.tri) here")
    output.add_argument(
        "--checkpoint", type=float, default=30.0, metavar="S", help="seconds between checkpoints beside it; 0: none"
    )
    output.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    output.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dataclasses import replace

    from dynident.api.case_logs import logs_named
    from dynident.data.log_places import is_address
    from dynident.identification.streaming.one_log import Checkpoint
    from dynident.identification.streaming.reduction import reduce_logs
    from dynident.identification.streaming.triangle_file import write_digest
    from dynident.workers.processes import local_pool

    if not 0 <= options.checkpoint < float("inf"):
        raise BadOption("--checkpoint", options.checkpoint, "give seconds, 0 for none")
    check_place(options.output)
    pool = cluster_of(options) or local_pool(options.jobs)
    options.test = []
    case = jobs.case_from(options)
    quiet = options.quiet or options.json
    names, others = logs_named(tuple(options.logs) or case.train, case.find)
    if not names:
        raise BadOption("LOG", "", "name a log on the command line, or under train: in the case file")
    if others:
        console.remark(f"no logs by their suffix, left out: {', '.join(others)}", quiet)
    inputs = [case.find(name) for name in names if not is_address(name)]
    check_outputs((options.output,), (options.case, *case.files, *inputs))
    checkpoint = Checkpoint(Path(options.output), options.checkpoint) if options.checkpoint else None
    bad: dict[str, DynidentError] = {}
    with console.progress(1, quiet) as progress:
        progress.step(f"reducing {len(names)} log{'s' if len(names) > 1 else ''}")
        digest = reduce_logs(
            case.stream_setup(),
            [case.place(name) for name in names],
            progress.update,
            checkpoint,
            pool=pool,
            skipped=bad.__setitem__ if options.skip_bad else None,
            standing=_teller(progress),
        )
        digest = replace(digest, options=jobs.model_options(options))
        write_digest(digest, options.output)
    if checkpoint is not None:
        checkpoint.remove(len(names))
    for error in bad.values():
        console.remark(f"left out: {error}", options.json)
    report(digest, options, {name: str(error) for name, error in bad.items()})
    step = f"dynident identify {quote(options.case)} --from {quote(options.output)}"
    console.remark(f"saved {options.output}; next: {step}", quiet)
    return 0


def _teller(progress: Progress) -> Callable[[Standing], None]:
    """Return what tells how far a reduction is: the bar by bytes, and a line for each log of several."""
    begun, finished = time.monotonic(), 0

    def told(standing: Standing) -> None:
        nonlocal finished
        progress.reach(standing.share)
        if standing.finished > finished and standing.logs > 1:
            finished = standing.finished
            known = 0.02 < standing.share < 1.0
            left = (time.monotonic() - begun) * (1.0 / standing.share - 1.0) if known else 0.0
            more = f", about {left:.0f} s left" if known else ""
            progress.note(f"{finished} of {standing.logs} logs{more}")

    return told


def report(digest: Digest, options: argparse.Namespace, bad: Mapping[str, str] | None = None) -> None:
    """Print what is in a digest; ``bad`` are logs that were left out, with the reason."""
    facts = {
        "robot": digest.model.robot.name,
        "joints": list(digest.model.robot.joint_names),
        "base_parameters": digest.base.count,
        "samples": digest.samples,
        "rows": [int(joint.counts.sum()) for joint in digest.joints],
        "segments": len(digest.joints[0].counts),
        "filter": digest.how.statement(),
        "logs": [
            {"path": c.path, "sha256": c.sha256, "rows": c.rows, "samples": c.samples, "steps": list(c.steps)}
            for c in digest.chunks
        ],
        "left_out": [{"path": path, "why": why} for path, why in (bad or {}).items()],
    }
    if options.json:
        console.answer_json(facts)
        return
    console.answer(
        f"{facts['robot']}: {facts['base_parameters']} base parameters, {digest.samples:,} samples "
        f"of {len(digest.chunks)} log{'s' if len(digest.chunks) > 1 else ''}"
        + (f"; {len(bad)} left out" if bad else "")
    )
    cutoff, delay = digest.how.filter.bandwidth(), digest.how.delay_s or 0.0
    told = f"both sides at {cutoff:g} Hz" if cutoff is not None else str(digest.how.statement()["kind"])
    console.answer(f"  filter: {told}" + f", time delay of torque {delay:.4g} s" * bool(delay))
    for chunk in digest.chunks:
        console.answer(f"  {chunk.path}: {chunk.rows:,} rows, {chunk.samples:,} used at {chunk.rate:.5g} Hz")
