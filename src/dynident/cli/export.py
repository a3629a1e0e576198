"""Write a plan for a controller, or an identified model for a simulator, a controller or a paper.

FILE is a plan of 'dynident excite -o' or an estimate of 'dynident identify -o'; which of the two it is says its
content, and that says which targets there are: 'dynident list motion_exporters' and 'dynident list model_exporters'.

A plan keeps its path; --speed slows it down for a first run. The motion begins and ends at rest, after a slow approach
to its first posture: from the posture that is stated, or by a move of the controller's own. A plan that passes a bound
is not written.

A model is written with physically consistent links only. An estimate that is not accepted, for a finding of the log
checks at error level, is refused without --force. The files are loaded again in every engine that is installed
and reads them, and torques are compared on 1000 random states: nothing is written where one differs by more than a
millionth. With --prove the model also follows the motion of a log, up to 10 s of it, in simulation under computed
torque and PD; nothing is written where a run diverges. What a format cannot hold stands in FILE.dynident.json.

Actuators, which 'dynident identify -o' writes for a case with servo:, go to mjcf, isaac, genesis, urdf and c_header;
where the logs have several position gains, --option kp=... says which.

  dynident export plan.json --to urscript -o excite.script --speed 20
  dynident export plan.json --to joint_trajectory -o excite.yaml --from-posture 0,-1.57,0,-1.57,0,0
  dynident export plan.json --to csv -o motion.csv --rate 250 --from-posture start --option degrees=true
  dynident export estimate.json --to urdf -o identified.urdf --description robot.urdf
  dynident export estimate.json --to mjcf -o robot.xml --prove
  dynident export estimate.json --to csv -o parameters.csv
  dynident export estimate.json --to usd -o identified.usda --description robot.usd
  dynident export actuators.json --to mjcf -o robot.xml --option kp=400

The target usd is a layer over the USD stage that was identified, with masses, centres of mass and inertias.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from dynident.cli import console, proving
from dynident.cli.proving import show_motion
from dynident.errors import BadArgument, BadOption
from dynident.files import check_outputs, files_behind

if TYPE_CHECKING:
    from dynident.excitation.design.plan import Plan
    from dynident.exports.models import ModelExport
    from dynident.exports.motions import MotionExport
    from dynident.identification.estimate.estimate import Estimate

SUMMARY = "a plan for a controller, or a model for other programs"

#: Options in the short help.
FREQUENT = ("-o", "--option", "--speed", "--from-posture", "--description", "--prove", "--check", "--json")

#: Options of one kind of file, by destination, with the value that stands for one that is not given.
_PLAN_ONLY = {"rate": None, "repeats": None, "speed": None, "from_posture": None, "units": None}
_MODEL_ONLY = {"description": None, "no_proof": False, "force": False, "prove": False, "motion": None}

#: Arguments of :func:`write_usd_layer` as the command calls them, with what to give.
_LAYER_FLAGS = {
    "path": ("-o", "give a file that ends with .usda"),
    "stage": ("--description", "give the stage that was identified: --description robot.usd"),
}


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        "file", metavar="FILE", help="plan of 'dynident excite -o', or estimate of 'dynident identify -o'"
    )
    parser.add_argument(
        "--to",
        required=True,
        metavar="NAME",
        help="the target; see 'dynident list motion_exporters' and 'model_exporters'",
    )
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="file (or folder) to write")
    parser.add_argument("--option", action="append", default=[], metavar="KEY=VALUE", help="an option of the exporter")
    motion = parser.add_argument_group("a plan")
    motion.add_argument("--rate", type=float, metavar="HZ", help="samples a second; default: those of the target")
    motion.add_argument("--repeats", type=int, metavar="N", help="periods (1)")
    motion.add_argument("--speed", type=float, metavar="PERCENT", help="10 to 100 per cent of the designed speed (100)")
    motion.add_argument(
        "--from-posture", metavar="Q1,Q2,..", help="where the robot stands, or 'start': at the first posture"
    )
    motion.add_argument("--units", choices=("rad", "deg"), help="of turning joints in --from-posture (rad); others: m")
    model = parser.add_argument_group("a model")
    model.add_argument(
        "--description",
        metavar="FILE",
        help="the robot model file to write the model into, for targets that take one; default: that of the "
        "identification, where it is unchanged",
    )
    proof = model.add_mutually_exclusive_group()
    proof.add_argument("--no-proof", action="store_true", help="do not load the files again; saves a second or two")
    proof.add_argument(
        "--prove", action="store_true", help="simulate the model along the motion of a log, with MuJoCo where installed"
    )
    model.add_argument(
        "--motion", metavar="LOG", help="with --prove: that log; default: the first test or training log of the fit"
    )
    model.add_argument(
        "--force", action="store_true", help="export an estimate that the log checks speak against (not accepted)"
    )
    output = parser.add_argument_group("output")
    output.add_argument("--check", action="store_true", help="write nothing, tell what would be written")
    output.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    output.add_argument("--quiet", action="store_true", help="no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.actuators import is_actuators
    from dynident.api.export import check_target, is_estimate, read_subject
    from dynident.excitation.design.plan import Plan

    if is_actuators(options.file):
        from dynident.cli.actuators import export

        return export(options, _pairs(options.option))
    is_plan = not is_estimate(options.file)
    kind, other = ("a plan", "an estimate") if is_plan else ("an estimate", "a plan")
    for name, default in (_MODEL_ONLY if is_plan else _PLAN_ONLY).items():
        if getattr(options, name) != default:
            option = f"--{name.replace('_', '-')}"
            raise BadOption(option, getattr(options, name), f"{options.file} is {kind}, and this goes with {other}")
    subject = read_subject(options.file, options.to)
    if options.to == "usd" and not isinstance(subject, Plan):
        return _write_layer(options, subject)
    check_target(subject, options.to, "--to")
    return _export_plan(options, subject) if isinstance(subject, Plan) else _export_model(options, subject)


def _export_plan(options: argparse.Namespace, plan: Plan) -> int:
    from dynident.api.export import export
    from dynident.exports.motions import MOTION_EXPORTERS, Playback, motion_export_data

    part = MOTION_EXPORTERS.make_from_text(options.to, _pairs(options.option))
    given = {name: getattr(options, name) for name in ("rate", "repeats", "speed")}
    posture = _posture(options.from_posture, plan, options.units or "rad")
    playback = Playback(from_posture=posture, **{name: value for name, value in given.items() if value is not None})
    check_outputs((options.output,), (options.file,))
    found = export(plan, part, options.output, playback=playback, write=False)
    check_outputs(found.files, (options.file,))
    if not options.json:
        _show(found)
    if not options.check:
        export(plan, part, options.output, playback=playback)
    if options.json:
        console.answer_json(motion_export_data(found))
        return 0
    _remark(options, found.files)
    return 0


def _export_model(options: argparse.Namespace, estimate: Estimate) -> int:
    from dynident.api.export import export
    from dynident.exports.models import MODEL_EXPORTERS, model_export_data

    part = MODEL_EXPORTERS.make_from_text(options.to, _pairs(options.option))
    inputs = (options.file, options.description or "", *files_behind(estimate.provenance))
    check_outputs((options.output,), inputs)
    chosen = options.description
    followed = proving.motion_of(estimate, options) if options.prove or options.motion else None
    found = export(
        estimate,
        part,
        options.output,
        description=chosen,
        proof=not options.no_proof if followed is None else followed,
        write=False,
        force=options.force,
    )
    check_outputs(found.files, inputs)
    if not options.check:
        export(estimate, part, options.output, description=chosen, proof=False, force=options.force)
    if options.json:
        console.answer_json(model_export_data(found))
        return 0
    _show_model(found)
    _remark(options, found.files)
    return 0


def _write_layer(options: argparse.Namespace, estimate: Estimate) -> int:
    from dynident.exports.usd_layer import write_usd_layer

    unread = ("option", "no_proof", "prove", "motion", "check", "json")
    for name, value in ((name, getattr(options, name)) for name in unread):
        if value:
            raise BadOption(f"--{name.replace('_', '-')}", value, "the target usd does without; leave it out")
    try:
        found = write_usd_layer(estimate, options.output, stage=options.description, force=options.force)
    except BadArgument as error:
        flag, step = _LAYER_FLAGS.get(error.argument, (error.argument, error.step))
        raise BadArgument(flag, error.evidence, step) from None
    for note in found.notes:
        console.answer(note)
    console.answer(
        f"read again by OpenUSD: torques differ by {found.relative:.1e} of the largest of each joint at most"
    )
    console.remark(f"saved {found.path}, a layer over {found.stage}", options.quiet)
    return 0


def _remark(options: argparse.Namespace, files: tuple[str, ...]) -> None:
    for file in files:
        console.remark(f"{'would write' if options.check else 'saved'} {file}", options.quiet)


def _pairs(items: list[str]) -> dict[str, str]:
    found: dict[str, str] = {}
    for item in items:
        key, equals, value = item.partition("=")
        if not equals:
            raise BadOption("--option", item, "write key=value, such as --option degrees=true")
        found[key] = value
    return found


def _posture(text: str | None, plan: Plan, units: str) -> Any:
    """Return the posture in SI units, the word for the first posture, or None."""
    import math

    if text is None or text.strip() == "start":
        return text and text.strip()
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        raise BadOption("--from-posture", text, "give numbers with commas between them, or 'start'") from None
    turns = plan.limits.revolute
    if len(values) != len(turns):
        raise BadOption("--from-posture", text, f"give {len(turns)} numbers, one for each joint, or 'start'")
    return [math.radians(v) if turn and units == "deg" else v for v, turn in zip(values, turns, strict=True)]


def _show(export: MotionExport) -> None:
    from dynident.results.plan_view import rows_table
    from dynident.results.text import label

    points = f"{export.points} points" + (f" at {export.rate:g} Hz" if export.rate else "")
    length = f"{export.duration:.6g} s at {100 * export.speed:g} % speed"
    console.answer(f"{label(export.robot)} to {export.exporter}: {length}, {points}")
    console.answer(f"approach: {export.approach}\n")
    table = rows_table(export.rows, "limits at this speed, margins taken off")
    console.answer_table(table, table.note)
    console.answer(f"\nlargest round-off of a position: {max(export.round_off.values()):.2g} rad or m")
    for proof in export.proofs:
        console.answer(f"read back by {proof.engine}: {proof.what}")
    for key, value in export.figures.data().items():
        worst = max(value.values()) if isinstance(value, dict) else value
        console.answer(f"{key.replace('_', ' ')}: {worst:.4g}" if isinstance(worst, float) else f"{key}: {worst}")
    for note in export.notes:
        console.answer(f"note: {label(note)}")


def _show_model(export: ModelExport) -> None:
    from dynident.results.model_export_view import left_out_lines, not_proved_lines, proofs_table
    from dynident.results.text import label

    parameters = f"standard parameters: {export.parameters}"
    console.answer(f"{label(export.robot)} to {export.exporter}: estimate of '{export.estimator}', {parameters}\n")
    if export.proofs:
        table = proofs_table(export.proofs, export.units.values())
        console.answer_table(table, table.note)
        for line in not_proved_lines(export.proofs):
            console.answer(line)
    else:
        console.answer("not loaded again: nothing is proved")
    if export.motion is not None:
        show_motion(export.motion)
    for line in left_out_lines(export):
        console.answer(line)
    for note in export.notes:
        console.answer(f"note: {label(note)}")
