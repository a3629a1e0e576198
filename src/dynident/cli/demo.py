"""Run the whole job on an industrial arm: from its URDF and a log to report, URDF, MJCF and C.

The arm is a virtual one: its log is simulated with noise, its URDF states wrong inertias. With DYNIDENT_DATA set to a
folder that has the logs of a UR10e, it is that real arm. 'dynident demo article' reproduces the article on the ER-16:
as published, and on a virtual robot whose true parameters are known.

  dynident demo
  dynident demo --out my-demo
  dynident demo article --out er16 --seed 3
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from dynident.cli import console, jobs, verdicts
from dynident.errors import BadOption, FileError

if TYPE_CHECKING:
    from dynident.api.demo import Demo
    from dynident.exports.models import ModelExport

SUMMARY = "the whole job on an industrial arm; the article's case"

#: Extra by the engine that it brings.
_EXTRAS = {"MuJoCo": "mujoco", "Pinocchio": "pin"}

#: Steps of which progress is shown.
_STEPS = 14


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("what", nargs="?", choices=("arm", "article"), default="arm", help="which demo (arm)")
    parser.add_argument("--out", metavar="DIR", default="dynident-demo", help="folder to write into (dynident-demo)")
    article = parser.add_argument_group("article")
    article.add_argument("--seed", type=int, default=None, help="seed of noise and colonies (0)")
    article.add_argument(
        "--iterations", type=int, default=None, metavar="N", help="iterations of the colony that converges (4000)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    parser.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.api.demo import run_demo
    from dynident.api.estimate_output import summary
    from dynident.cli.article_demo import run_article

    is_article = options.what == "article"
    for name in ("seed", "iterations"):
        if getattr(options, name) is not None and not is_article:
            raise BadOption(f"--{name}", getattr(options, name), "it goes with: dynident demo article")
    if options.seed is not None and options.seed < 0:
        raise BadOption("--seed", options.seed, "give 0 or more")
    folder = Path(options.out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(folder, f"cannot be made ({error.strerror})", "choose another folder with --out") from error
    if is_article:
        options.seed = options.seed or 0
        return run_article(folder, options)
    with console.progress(_STEPS, options.quiet or options.json) as progress:
        demo = run_demo(folder, jobs.repeat_command(), progress.step)
    if options.json:
        console.answer_json({"source": demo.source, "files": list(demo.files), **summary(demo.estimate, demo.test)})
        return 0
    _show(demo)
    console.remark(f"wrote {', '.join(demo.files)} into {folder}", options.quiet)
    own = "your own robot: dynident init robot.urdf run.csv, then dynident identify case.yaml --report report.html"
    console.remark(own, options.quiet)
    return 0


def _show(demo: Demo) -> None:
    from dynident.diagnosis.verdict import verdict_of
    from dynident.results.text import Table, columns_of

    console.answer(demo.source)
    verdicts.show_short(demo.estimate, demo.test, verdict_of(demo.estimate, demo.test), "report.html")
    rows = tuple((_name(done), *_proof(done)) for done in demo.exports)
    console.answer()
    console.answer_table(Table(columns_of("file", ">torques equal to", "proof by"), rows))
    engines = [one.engine for done in demo.exports for one in done.proofs if one.why_not == "not installed"]
    extras = ",".join(extra for engine, extra in _EXTRAS.items() if engine in engines)
    if extras:
        console.answer(f"proof by the engines that are not installed: pip install 'dynident[{extras}]'")


def _name(done: ModelExport) -> str:
    return Path(done.files[0]).name


def _proof(done: ModelExport) -> tuple[str, str]:
    """Return the largest relative difference of a torque, and the engines; of those not asked, why."""
    made = [one for one in done.proofs if one.relative is not None]
    worst = max((float(one.relative or 0.0) for one in made if one.allowed <= 1e-6), default=None)
    engines = dict.fromkeys(
        [one.engine for one in made] + [f"{o.engine}: {o.why_not}" for o in done.proofs if o.why_not]
    )
    return ("not proved" if worst is None else f"{worst:.0e}"), "; ".join(engines)
