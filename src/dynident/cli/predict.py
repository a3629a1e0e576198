"""Predict the joint torques of a motion, with bands, and write them as CSV.

The positions of the log are filtered like those of the fit. Its torques are not needed; where it has them they stand
beside the prediction, filtered. For each joint: the model's torque, not filtered; half the width of the 95 % band by
the covariance of the parameters; and the same with the residual of the fit, which takes in noise and what the model
does not have. The table counts the rows inside it, both sides filtered alike. Remarks name joints whose torques do not
lie there, and where the motion leaves what the logs of the fit have seen.

  dynident predict estimate.json run.csv -o tau.csv
  dynident predict estimate.json planned.csv -o tau.csv --json
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynident.arrays import Array
    from dynident.estimation.estimate import Estimate
    from dynident.experiment.log import Log
    from dynident.experiment.preprocessing import Prepared

#: Share of the rows in the 95 % band below which the model is not that of the robot in the log.
LEAST_INSIDE = 0.5

SUMMARY = "torques of a motion by an estimate, with bands, as CSV"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("estimate", metavar="ESTIMATE", help="file that 'dynident identify -o' has written")
    parser.add_argument("log", metavar="LOG", help="the motion: time and positions; torques may be there")
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="write the torques (CSV) here")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    parser.add_argument("--quiet", action="store_true", help="no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    import numpy as np

    from dynident.cli import console, jobs
    from dynident.estimation.estimate_file import read_estimate
    from dynident.estimation.observer import Observer
    from dynident.estimation.uncertainty.propagation import torque_deviations
    from dynident.estimation.validation import Z_95
    from dynident.experiment.preprocessing import preprocess
    from dynident.files import check_place, write_atomically

    check_place(options.output)
    estimate = read_estimate(options.estimate)
    jobs.check_outputs((options.output,), (options.estimate, options.log, *jobs.files_behind(estimate)))
    log = _motion(options.log, estimate.columns, estimate.model.robot)
    prepared = preprocess(log.ordered(estimate.model.robot.joint_names), estimate.preprocessing)
    moved = prepared.log
    torque = Observer(estimate.model, estimate.base).predict(moved, estimate.beta)
    by_parameters = Z_95 * torque_deviations(estimate, moved)
    whole = np.hypot(by_parameters, Z_95 * np.asarray(estimate.joint_deviations))
    write_atomically(options.output, _csv(moved, torque, by_parameters, whole))
    robot = estimate.model.robot
    inside = np.full(robot.dof, np.nan)
    if moved.torque is not None:
        away = np.asarray(moved.torque) - prepared.smooth(torque.T).T  # filtered alike on both sides
        inside = np.mean((np.abs(away) <= whole)[prepared.keep], axis=0)
    table = zip(
        robot.joint_names, robot.units, *(_rms(one) for one in (torque, by_parameters, whole)), inside, strict=True
    )
    joints = [
        {
            "name": name,
            "unit": unit,
            "torque": float(size),
            "half_width_parameters": float(narrow),
            "half_width": float(wide),
            "inside": float(share) if np.isfinite(share) else None,
        }
        for name, unit, size, narrow, wide, share in table
    ]
    remarks = [*_outside(robot.joint_names, inside), *_beyond(estimate, prepared)]
    if options.json:
        facts = {"log": log.name, "samples": moved.samples, "written": options.output}
        console.answer_json({**facts, "joints": joints, "remarks": remarks})
        return 0
    _show(joints, moved)
    for remark in remarks:
        console.answer(f"remark: {remark}")
    console.remark(f"saved {options.output}", options.quiet)
    return 0


def _motion(path: str, columns: object, robot: object) -> Log:
    """Return the log with torques where it has them; columns of torques and currents need not be there."""
    from dataclasses import replace
    from typing import Any

    from dynident.errors import LogFormatError
    from dynident.experiment.case_file.log_of_robot import read_with

    own: Any = columns
    arm: Any = robot
    both = ("torque", "current") if own.current is not None else ("torque",)
    lenient = replace(own, optional=tuple(dict.fromkeys((*own.optional, *both))))
    try:
        return read_with(path, lenient, arm)
    except LogFormatError:
        if own.torque is not None:
            raise
    return read_with(path, replace(lenient, torque=()), arm)


def _outside(names: Sequence[str], inside: Array) -> list[str]:
    """Return what is to be said of joints whose measured torques the bands do not hold."""
    low = [f"{name} {100 * share:.0f} %" for name, share in zip(names, inside, strict=True) if share < LEAST_INSIDE]
    if not low:
        return []
    text = (
        f"few measured torques lie in the band ({', '.join(low)}): the log may be of another robot, load or mounting; "
    )
    return [text + "look at units, signs and order of its columns"]


def _beyond(estimate: Estimate, prepared: Prepared) -> list[str]:
    """Return where the motion leaves what the logs of the fit have seen."""
    from dataclasses import replace

    import numpy as np

    from dynident.estimation.observer import Observer
    from dynident.estimation.uncertainty.envelope import departure_of

    if estimate.envelope is None:
        return []
    log = replace(prepared.log, torque=np.zeros_like(prepared.log.q))  # bands do not depend on measured torques
    observer = Observer(estimate.model, estimate.base, estimate.beta)
    triangles = observer.triangles(replace(prepared, log=log), np.ones((len(prepared.keep), log.q.shape[1]), bool))
    sentence = departure_of(estimate.envelope, [prepared.kept], triangles, estimate.covariance).sentence(
        estimate.envelope
    )
    return [sentence] if sentence else []


def _rms(values: Array) -> Array:
    import numpy as np

    return np.sqrt(np.mean(np.square(values), axis=0))


def _csv(log: Log, torque: Array, narrow: Array, wide: Array) -> str:
    """Return the table: time, then torque, half widths and measured torque of all joints."""
    import numpy as np

    count = range(1, len(log.joints) + 1)
    names = ["t", *(f"{kind}{i}" for kind in ("tau_model", "half_parameters", "half_whole") for i in count)]
    blocks = [log.time[:, None], torque, narrow, wide]
    if log.torque is not None:
        names += [f"tau_measured{i}" for i in count]
        blocks.append(np.asarray(log.torque))
    rows = np.concatenate(blocks, axis=1)
    lines = [",".join(f"{value:.9g}" for value in row) for row in rows]
    return "\n".join([",".join(names), *lines]) + "\n"


def _show(joints: list[dict[str, object]], log: Log) -> None:
    from dynident.cli import console
    from dynident.results.text import MISSING, Column, Table, format_number, format_percent, label, pretty_unit

    rows = []
    for one in joints:
        sizes = (format_number(float(str(one[key])), 3) for key in ("torque", "half_width_parameters", "half_width"))
        share = MISSING if one["inside"] is None else format_percent(float(str(one["inside"])), sign=False)
        rows.append((label(one["name"]), *sizes, pretty_unit(str(one["unit"])), share))
    headings = ("torque (rms)", "by the parameters", "with the residual")
    columns = (Column("joint"), *(Column(text, numeric=True) for text in headings), Column("unit"), Column("inside, %"))
    console.answer(f"{label(log.name)}: {log.samples} samples; half widths of 95 % bands (rms)\n")
    console.answer_table(Table(columns, tuple(rows)))
