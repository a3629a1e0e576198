"""Record a plan on a virtual cell: a log as the case reads it, and the truth beside it.

The robot of the case follows the plan under a joint controller. Sensors, clocks and all other effects are those of the
case's section 'cell', or of --cell in its place, changed by --set. The log has the columns and units of the case, so
that 'identify' reads it as it would a real one. Beside a log run.csv, run.truth.json states the true parameters and
run.truth.npz the true signals.

  dynident simulate case.yaml plan.json -o run.csv --set effort.noise=0.3 --set truth.friction.Fc=2
  dynident simulate case.yaml plan.json -o run.csv --cell cell.yaml --seed 1
  dynident identify case.yaml run.csv -o estimate.json
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynident.cli import console
from dynident.errors import BadOption
from dynident.files import check_outputs, check_place, write_atomically

if TYPE_CHECKING:
    from dynident.case.cell_section import CellSetup
    from dynident.model.dynamic_model import DynamicModel
    from dynident.simulation.cell import CellRun

SUMMARY = "record a plan on a virtual cell, with the truth beside the log"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("case", metavar="CASE", help="case file or robot model")
    parser.add_argument("plan", metavar="PLAN", help="plan of 'dynident excite'")
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="FILE",
        help="write the log here: .csv, .tsv, .npz, .parquet, .mat, .mcap, .db3, .bag",
    )
    parser.add_argument("--cell", metavar="FILE", help="the cell, in place of the case's (docs/virtual-cell.md)")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        dest="settings",
        metavar="KEY=VALUE",
        help="change one setting of the cell, such as encoder.noise=1e-5, controller=pid, truth.friction.Fc=2,1,1",
    )
    parser.add_argument("--repeats", type=int, default=1, metavar="N", help="periods of the motion (1)")
    parser.add_argument("--seed", type=int, default=0, help="seed of all that is random (0)")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of text")
    parser.add_argument("--quiet", action="store_true", help="no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.api.simulate import cell_setup, simulate_case, write_simulated_log
    from dynident.case.case import read_case
    from dynident.excitation.design.plan import breach_of, read_plan, worst_breach

    if options.seed < 0:
        raise BadOption("--seed", options.seed, "give 0 or more")
    target = Path(options.output)
    truth_files = (target.with_suffix(".truth.json"), target.with_suffix(".truth.npz"))
    for place in (target, *truth_files):
        check_place(place)
    case, plan = read_case(options.case), read_plan(options.plan)
    check_outputs((str(target), *map(str, truth_files)), (options.case, options.plan, *map(str, case.files)))
    setup = cell_setup(case, options.cell, options.settings)
    found, model = simulate_case(case, plan, setup, repeats=options.repeats, seed=options.seed), case.model
    write_simulated_log(found, case, target)
    facts = _facts(options, setup, model, found)
    _write_truth(truth_files, facts, found)
    if options.json:
        console.answer_json(facts)
        return 0
    _show(found, model, str(target), tuple(map(str, truth_files)), options.quiet)
    if (worst := worst_breach(plan)) is not None:
        console.remark(f"do not drive this plan: {breach_of(worst)}", options.quiet)
    return 0


def _facts(options: argparse.Namespace, setup: CellSetup, model: DynamicModel, found: CellRun) -> dict[str, Any]:
    """Return what is true of the log, as plain data."""
    from dynident.simulation.truth import KIND, VERSIONS

    robot = model.robot
    return {
        "kind": KIND,
        "format": VERSIONS.current,
        "log": options.output,
        "robot": robot.name,
        "plan": options.plan,
        "seed": options.seed,
        "samples": found.log.samples,
        "integration_hz": found.integration_rate,
        "gravity": found.gravity.tolist(),
        "parameters": [
            {"symbol": one.symbol, "owner": one.owner, "unit": one.unit, "value": float(value)}
            for one, value in zip(model.parameters, found.theta, strict=True)
        ],
        "cell": setup.cell.data(),
        "saturated": found.saturated,
        "tracking_error": dict(zip(robot.joint_names, found.tracking_error().tolist(), strict=True)),
        "left_behind": dict(found.left_behind()),
    }


def _write_truth(places: tuple[Any, Any], facts: dict[str, Any], found: CellRun) -> None:
    """Write the facts as JSON and the true signals as arrays."""
    import io

    import numpy as np

    truth = found.truth
    named = {"torque": "tau"}
    signals: Any = {named.get(name, name): values for name, values in truth.signals().items()}
    content = io.BytesIO()
    np.savez_compressed(content, t=truth.time, **signals, tau_friction=found.friction, tau_link=found.link_torque)
    write_atomically(places[0], json.dumps(facts, indent=1, allow_nan=False) + "\n")
    write_atomically(places[1], content.getvalue())


def _show(found: CellRun, model: DynamicModel, target: str, truths: tuple[str, ...], quiet: bool) -> None:
    import numpy as np

    from dynident.results.text import Table, columns_of, format_number, label, pretty_unit
    from dynident.simulation.truth import without_friction
    from dynident.studies.selftest.rehearsal_view import left_behind

    robot, log = model.robot, found.log
    console.answer(f"{log.samples} samples over {log.duration:.4g} s, {label(log.source.steps[0])}\n")
    torque = np.sqrt(np.mean(np.asarray(found.truth.torque) ** 2, axis=0))
    rows = [
        (label(joint.name), format_number(size, 3), pretty_unit(joint.unit), format_number(error, 2), moved)
        for joint, size, error, moved in zip(
            robot.active,
            torque,
            found.tracking_error(),
            ("rad" if joint.kind == "revolute" else "m" for joint in robot.active),
            strict=True,
        )
    ]
    columns = columns_of("joint", ">torque (rms)", "unit", ">tracking error (rms)", "unit")
    console.answer_table(Table(columns, tuple(rows)))
    if found.left_behind():
        console.remark(left_behind(found.left_behind(), found.saturated), quiet)
    nothing = without_friction(model, found.theta)
    if nothing:
        known = "give them with --set truth.friction.SYMBOL=VALUE"
        console.remark(f"{', '.join(nothing)}: 0 at every joint, as nothing states them; {known}", quiet)
    if found.saturated:
        console.remark(f"{found.saturated} torques were cut at the effort limits", quiet)
    console.remark(f"saved {target}, {', '.join(truths)}", quiet)
