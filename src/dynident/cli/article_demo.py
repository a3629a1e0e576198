"""The article's case from end to end, in two parts, with one table each: ``dynident demo article``.

(a) as published: the torques of Table 2 along the published trajectories; the bee colony in the published box against
    least squares and the certified optimum of that box
(b) a virtual, physically consistent ER-16 in closed loop: preprocess, identify by every method, validate on beta_2
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from dynident.cli import console
from dynident.cli.jobs import repeat_command
from dynident.files import write_atomically

if TYPE_CHECKING:
    from pathlib import Path

    from dynident.results.report.subject import Comparison
    from dynident.studies.reproduction import ReproductionPart


def run_article(folder: Path, options: argparse.Namespace) -> int:
    """Run both parts and write report, estimates, logs and a case file into a folder.

    Args:
        folder: The folder; it exists.
        options: Seed, iterations, json and quiet of the command.
    """
    from dynident.studies.reproduction import CONVERGED, as_published, virtual_er16

    with console.progress(16, options.quiet or options.json) as progress:
        published = as_published(options.seed, progress.step)
        iterations = CONVERGED if options.iterations is None else options.iterations
        virtual = virtual_er16(options.seed, iterations, progress.step)
        progress.step("writing report, estimates, logs and case file")
        written = _write(folder, published, virtual)
    if options.json:
        from dynident.arrays import plain

        console.answer_json({part.title: plain([row.row() for row in part.rows]) for part in (published, virtual)})
        return 0
    for part in (published, virtual):
        _show(part)
    console.remark(f"wrote {', '.join(written)} into {folder}", options.quiet)
    return 0


def _show(part: ReproductionPart) -> None:
    from dynident.results.text import comparison_table

    console.answer_table(comparison_table([row.row() for row in part.rows]), part.title)
    for fact in part.facts:
        console.answer(f"  {fact}")
    console.answer()


def _write(folder: Path, published: ReproductionPart, virtual: ReproductionPart) -> list[str]:
    """Write everything that the demo leaves behind, and return the names."""
    from dynident.api.estimate_output import write_estimate
    from dynident.data.formats import write_log
    from dynident.results.report import write_report

    names = []
    for part, label in ((published, "published"), (virtual, "virtual")):
        for log, run in zip(part.logs, ("beta_1", "beta_2"), strict=True):
            names.append(f"{label}-{run}.csv")
            write_log(log, folder / names[-1])
        for row in part.rows:
            names.append(f"{label}-{_slug(row.method)}.json")
            write_estimate(row.estimate, folder / names[-1])
    names.append("er16-virtual.yaml")
    write_atomically(folder / names[-1], _CASE)
    chosen = virtual.rows[-1]
    names.append("report.html")
    write_report(
        folder / names[-1],
        chosen.estimate,
        (chosen.test,),
        comparison=_comparison((("(a)", published), ("(b)", virtual))),
        command=repeat_command(),
    )
    return names


def _comparison(parts: tuple[tuple[str, ReproductionPart], ...]) -> Comparison:
    """Return the tables of both parts as one, and the objective of the colonies per iteration (Figure 6)."""
    from dynident.identification.search.box_search import SearchRun
    from dynident.results.report.subject import Comparison

    rows = tuple({"part": label, **row.row()} for label, part in parts for row in part.rows)
    traces = {
        f"{label} {row.method}": run.trace or ()
        for label, part in parts
        for row in part.rows
        if isinstance(run := row.estimate.run, SearchRun) and not run.polished
    }
    return Comparison(rows, traces, objective="F (9) [N m]")


def _slug(method: str) -> str:
    return "-".join("".join(c if c.isalnum() else " " for c in method.lower()).split())


_CASE = """\
# The virtual ER-16 of 'dynident demo article', part (b); docs/case-file.md describes every key.
case: 2
robot: er16                      # ships with dynident
locked: {joint4: 0, joint5: 0, joint6: 0}
joints: [joint1, joint2, joint3] # in the order of the columns
friction:
  - coulomb: {width: 0.02}
  - viscous
preprocessing:
  filter:
    fourier_fit: {period_s: 25, harmonics: 5}
  rate_hz: all
  trim_s: 0
  rest: keep
train: virtual-beta_1.csv
test: virtual-beta_2.csv
"""
