"""Predict the joint torques of a motion, with 95 % bands, and write them as CSV.

The log is filtered as in the fit; its torques are not needed. Predicted and measured torques pass the same filter.
Samples that the filter spoils are left out, near both ends and near gaps. Two half widths of 95 % bands stand beside
the torque of each joint. 'half_model' is for the torque without noise: uncertainty of the parameters and noise of the
positions. 'half_measured' is for the measured torque, with the residual of the fit. Both bands assume a model of the
right form. Remarks name joints whose measured torques lie outside, and a motion beyond the training range.

  dynident predict estimate.json run.csv -o tau.csv
  dynident predict estimate.json planned.csv -o tau.csv --json
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from dynident.cli import console, jobs
from dynident.cli.jobs import add_log_case
from dynident.errors import LogFormatError
from dynident.files import check_outputs, check_place, files_behind, write_atomically

if TYPE_CHECKING:
    from dynident.applications.predicted_torque import PredictedTorque
    from dynident.arrays import Array
    from dynident.case.case import Case
    from dynident.data.log import Log
    from dynident.data.preprocessing import Prepared
    from dynident.identification.estimate.estimate import Estimate

#: Share of the rows in the 95 % band below which the model is not that of the robot in the log.
LEAST_INSIDE = 0.5

#: Share of a joint's torque (rms) below which an interval is not worth a remark.
SHOWN = 1e-3

SUMMARY = "torques of a motion by an estimate, with bands, as CSV"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("estimate", metavar="ESTIMATE", help="file that 'dynident identify -o' has written")
    parser.add_argument("log", metavar="LOG", help="the motion: time and positions; torques may be there")
    add_log_case(parser)
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="write the torques (CSV) here")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    parser.add_argument("--quiet", action="store_true", help="no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    import numpy as np

    from dynident.applications.predicted_torque import predict_torque
    from dynident.applications.start_states import warmed_torque
    from dynident.identification.files.estimate_file import read_estimate

    check_place(options.output)
    estimate = read_estimate(options.estimate)
    robot = estimate.model.robot
    check_outputs((options.output,), (options.estimate, options.log, *files_behind(estimate.provenance)))
    log = _motion(options.log, estimate, jobs.log_case(options))
    found = predict_torque(estimate, log.ordered(robot.joint_names))
    write_atomically(options.output, _csv(found))
    sizes = (_rms(one) for one in (found.torque, found.half_model, found.half_measured))
    widest = found.half_held.max(axis=0)
    joints = [
        {
            "name": name,
            "unit": unit,
            "torque": float(size),
            "half_width_model": float(narrow),
            "half_width_measured": float(wide),
            "half_width_held": float(held),
            "inside": float(share) if np.isfinite(share) else None,
        }
        for name, unit, size, narrow, wide, held, share in zip(
            robot.joint_names, robot.units, *sizes, widest, found.inside, strict=True
        )
    ]
    used = found.prepared.kept
    facts = {"log": log.name, "samples": used.samples, "left_out": found.prepared.log.samples - used.samples}
    remarks = [
        *_resting(joints, widest),
        *_beginning(found.starts, joints, warmed_torque(estimate, found.prepared)),
        *_of_gains(estimate),
        *_outside(estimate, found),
        *_beyond(estimate, found.prepared),
    ]
    if options.json:
        console.answer_json({**facts, "written": options.output, "joints": joints, "remarks": remarks})
        return 0
    _show(joints, facts)
    for remark in remarks:
        console.answer(f"remark: {remark}")
    console.remark(f"saved {options.output}", options.quiet)
    return 0


def _motion(path: str, estimate: Estimate, case: Case | None) -> Log:
    """Return the log with torques where it has them; columns of torques, currents and commands need not be there."""
    from dataclasses import replace

    from dynident.api.validate import other_columns, reading_of
    from dynident.data.log_of_robot import read_with

    own, robot, locked = reading_of(estimate, case)
    place = path if case is None else case.place(path)
    mapped = [name for name in ("current", "q_ref", "dq_ref") if getattr(own, name) is not None]
    lenient = replace(own, optional=tuple(dict.fromkeys((*own.optional, "torque", *mapped))))
    with other_columns(lenient, case):
        try:
            return read_with(place, lenient, robot, locked)
        except LogFormatError:
            if own.torque is not None:
                raise
        return read_with(place, replace(lenient, torque=()), robot, locked)


def _resting(joints: Sequence[dict[str, object]], widest: Array) -> list[str]:
    """Return what is to be said of joints that rest: their torque is an interval, at most of a half width (n,)."""
    held = _named(joints, widest)
    return (
        [f"at rest static friction holds any torque in an interval: the bands are wider there by up to {held}"]
        if held
        else []
    )


def _of_gains(estimate: Estimate) -> list[str]:
    """Return what is to be said of drive gains that are not certain: bands are those of the fit under these."""
    stated = estimate.choices.gain_std
    named = {} if stated is None else {name: value for name, value in stated.relative.items() if value > 0.0}
    each = ", ".join(f"{name} {100 * value:.2g} %" for name, value in named.items())
    text = "the bands leave out that gains have a relative std, by which the torque of a drive is off as a whole: "
    return [text + each] if each else []


def _beginning(starts: Sequence[dict[str, object]], joints: Sequence[dict[str, object]], changes: Array) -> list[str]:
    """Return what is to be said of drives that warm up, whose torque changes by so much (n,) where they begin warm."""
    from dynident.diagnosis.warnings import start_sentences

    if starts:
        return start_sentences(starts)
    told = _named(joints, changes)
    text = "the drives are taken to begin cold; as warm as at the end of the motion their torque differs by up to "
    return [text + told] if told else []


def _named(joints: Sequence[dict[str, object]], sizes: Array) -> str:
    """Return the joints with sizes (n,) that show beside their torque."""
    pairs = zip(joints, sizes.tolist(), strict=True)
    shown = [(one, size) for one, size in pairs if size > SHOWN * float(str(one["torque"]))]
    return ", ".join(f"{one['name']} {size:.3g} {one['unit']}" for one, size in shown)


def _outside(estimate: Estimate, found: PredictedTorque) -> list[str]:
    """Return what is to be said of joints whose measured torques the bands do not hold."""
    from dynident.diagnosis.constant_residual import constant_residual
    from dynident.identification.estimate.validation import Z_95

    shares = zip(estimate.model.robot.joint_names, found.inside, strict=True)
    low = [f"{name} {100 * share:.0f} %" for name, share in shares if share < LEAST_INSIDE]
    dq = found.prepared.kept.dq
    if not low or found.measured is None or dq is None:
        return []
    signals, own = (found.measured, found.torque, dq), (found.half_model - found.half_held) / Z_95
    constant = constant_residual(estimate, *signals, estimate.preprocessing.standstill, own)
    text = (
        f"few measured torques lie in the band ({', '.join(low)}): the log may be of another robot, load or mounting; "
    )
    return [*([constant] if constant else []), text + "look at units, signs and order of its columns"]


def _beyond(estimate: Estimate, prepared: Prepared) -> list[str]:
    """Return where the motion leaves what the logs of the fit have seen."""
    from dataclasses import replace

    import numpy as np

    from dynident.identification.estimate.envelope import departure_of
    from dynident.identification.problem.regressor_stream import RegressorStream

    if estimate.envelope is None:
        return []
    log = replace(prepared.log, torque=np.zeros_like(prepared.log.q))  # bands do not depend on measured torques
    regressor = RegressorStream(estimate.model, estimate.base, estimate.beta)
    triangles = regressor.triangles(replace(prepared, log=log), np.ones((len(prepared.keep), log.q.shape[1]), bool))
    sentence = departure_of(estimate.envelope, [prepared.kept], triangles, estimate.covariance).sentence(
        estimate.envelope
    )
    return [sentence] if sentence else []


def _rms(values: Array) -> Array:
    import numpy as np

    return np.sqrt(np.mean(np.square(values), axis=0))


def _csv(found: PredictedTorque) -> str:
    """Return the table: time, then torque, half widths and measured torque of all joints."""
    import numpy as np

    log = found.prepared.kept
    blocks = {"tau_model": found.torque, "half_model": found.half_model, "half_measured": found.half_measured}
    if log.torque is not None:
        blocks["tau_measured"] = log.torque
    names = ["t", *(f"{kind}{i}" for kind in blocks for i in range(1, len(log.joints) + 1))]
    rows = np.concatenate(list(blocks.values()), axis=1)
    times = (f"{time:.15g}" for time in log.time)  # of the epoch in s it shows less than a microsecond
    lines = [",".join([time, *(f"{value:.9g}" for value in row)]) for time, row in zip(times, rows, strict=True)]
    return "\n".join([",".join(names), *lines]) + "\n"


def _show(joints: list[dict[str, object]], facts: dict[str, object]) -> None:
    from dynident.results.text import (
        MISSING,
        Column,
        Table,
        columns_of,
        format_number,
        format_percent,
        label,
        pretty_unit,
    )

    rows = []
    for one in joints:
        keys = ("torque", "half_width_model", "half_width_measured")
        sizes = (format_number(float(str(one[key])), 3) for key in keys)
        share = MISSING if one["inside"] is None else format_percent(float(str(one["inside"])), sign=False)
        rows.append((label(one["name"]), *sizes, pretty_unit(str(one["unit"])), share))
    headings = ("torque (rms)", "without noise", "measured")
    columns = columns_of("joint", *(Column(text, numeric=True) for text in headings), "unit", "inside, %")
    left_out = f", {facts['left_out']} that the filter spoils left out" if facts["left_out"] else ""
    console.answer(f"{label(facts['log'])}: {facts['samples']} samples{left_out}")
    console.answer("half widths of the 95 % bands (rms): of the torque without noise, and of the measured torque\n")
    console.answer_table(Table(columns, tuple(rows)))
