"""Commands on a case with the key servo, and on its answer: actuators in place of a dynamic model."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from dynident.cli import console, jobs
from dynident.errors import BadOption, DynidentError
from dynident.files import check_outputs, check_place, files_behind, write_atomically

if TYPE_CHECKING:
    from dynident.actuators.estimate import ActuatorEstimate
    from dynident.actuators.followed_log import FollowedJoint
    from dynident.actuators.servo_log import ServoLog
    from dynident.case.case import Case

#: Options of 'identify' that are for logs with torques, and have no meaning here.
_FOREIGN = (
    "triangles", "estimator", "option", "prior", "friction", "split", "cutoff", "rate", "delay", "accept",
    "cross_validate", "bootstrap", "no_sensitivity", "report",
)  # fmt: skip

#: Options of 'export' that are for plans and models.
_OF_OTHERS = (
    "rate", "repeats", "speed", "from_posture", "units", "description", "force", "prove", "motion",
)  # fmt: skip


def run(case: Case, options: argparse.Namespace) -> int:
    """Identify the actuators of a case and print the answer.

    Raises:
        BadOption: An option that is for logs with torques.
        DynidentError: Any fault of the case or a log.
    """
    from dynident.actuators.estimate import as_data, write_actuators
    from dynident.api.actuators import actuators

    for name in _FOREIGN:
        if getattr(options, name):
            step = "leave it out: the case has servo:, and its logs have no torque; the key servo states what is fitted"
            page = "leave it out: of a case with servo: dynident report makes the page, from the file of -o"
            raise BadOption(name, getattr(options, name), page if name == "report" else step)
    own = case.files
    case = jobs.with_logs(case, options)
    check_outputs((options.output,), (*own, *case.files))
    with console.progress(4 + 3 * case.robot.dof, options.quiet or options.json) as progress:
        progress.step("reading")
        found = actuators(case, command=jobs.repeat_command(), progress=progress.step)
    if options.output:
        write_actuators(found, options.output)
    if options.json:
        console.answer_json(as_data(found))
        return 0
    _show(found)
    if options.output:
        console.remark(f"saved {options.output}", options.quiet)
    return 0


def _show(found: ActuatorEstimate) -> None:
    from dynident.results.actuator_text import (
        all_warnings,
        bodies_table,
        bodies_warnings,
        headline,
        joint_lines,
        parameter_table,
        scale_lines,
    )

    console.answer(headline(found))
    for joint in found.joints:
        console.answer()
        console.answer_table(parameter_table(joint), joint.name)
        for line in joint_lines(joint):
            console.answer(f"  {line}")
    console.answer()
    if found.bodies is not None:
        console.answer_table(bodies_table(found.bodies), "bodies")
    for line in scale_lines(found):
        console.answer(line)
    of_bodies = [] if found.bodies is None else bodies_warnings(found.bodies)
    for warning in (*of_bodies, *all_warnings(found.joints), *found.provenance.get("left_out", ())):
        console.answer(f"warning: {warning}")


#: Options of 'excite' that design a motion for torques.
_DESIGN = (
    "friction", "harmonics", "trajectory", "torque_margin", "noise", "noise_from", "sigmas", "earlier", "earlier_logs",
    "rows", "criterion", "starts", "seed", "time_limit", "jobs", "scheduler", "resume", "csv", "repeats",
)  # fmt: skip


def excite(case: Case, options: argparse.Namespace, defaults: argparse.Namespace) -> int:
    """Offer motions for the servos of a case and write them into a folder.

    Raises:
        BadOption: An option that designs a motion for torques, or a value that cannot be.
        DynidentError: A fault of the case, or no motion within its limits.
    """
    from dynident.actuators.command_files import motions_data, write_motions
    from dynident.api.servo_motions import servo_motions
    from dynident.results import actuator_text as shown
    from dynident.results.text import counted

    for name in _DESIGN:
        if getattr(options, name, None) != getattr(defaults, name, None):
            step = "leave it out: the case has servo:, and its motions are chosen for positions without torque"
            raise BadOption(f"--{name.replace('_', '-')}", getattr(options, name), step)
    with console.progress(case.robot.dof, options.quiet or options.json) as progress:
        found = servo_motions(
            case,
            rate=options.rate or 100.0,
            seconds=options.period or 6.0,
            margin=options.margin,
            gains=options.kp or (),
            pose=_numbers("--pose", options.pose),
            model=options.model,
            progress=progress.step,
        )
    if options.output:
        write_motions(found, options.output)
    if options.json:
        console.answer_json(motions_data(found))
        return 0
    request = found.request
    gains = f", kp {', '.join(f'{kp:g}' for kp in request.gains)}"
    motions = f"{request.seconds:g} s each at {request.rate:g} Hz"
    joints = counted(case.robot.dof, "joint")
    console.answer(f"{found.robot}: motions for servos of {joints}, {motions}{gains}")
    for line in shown.servo_lines(found):
        console.answer(line)
    console.answer()
    for table in shown.interval_tables(found):
        console.answer_table(table, "half widths of the 95 % intervals that the logs would give, in % of the value")
    for line in shown.unknown_lines(found):
        console.answer(line)
    console.answer()
    console.answer_table(shown.range_table(found), shown.range_heading(found))
    for text in (*shown.next_lines(found, case.path, options.output), *found.remarks):
        for line in shown.wrapped(text):
            console.answer(line)
    if options.output:
        console.remark(f"wrote {len(found.files)} files to {options.output}", options.quiet)
    return 0


def _numbers(name: str, text: str | None) -> list[float] | None:
    """Return the numbers of an option with commas between them; None where it is not stated."""
    if text is None:
        return None
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise BadOption(name, text, "give numbers with commas between them, one for each joint") from None


def _refuse(options: argparse.Namespace, names: Sequence[str], step: str) -> None:
    """Refuse options that have no meaning for actuators, with what to do.

    Raises:
        BadOption: One of them is stated.
    """
    for name in names:
        if getattr(options, name):
            raise BadOption(f"--{name.replace('_', '-')}", getattr(options, name), step)


def export(options: argparse.Namespace, stated: Mapping[str, str]) -> int:
    """Write actuators for a simulator or a controller, with the options of the target that are stated.

    Raises:
        BadOption: An option that is for plans or models.
        DynidentError: No such target, several gains, or a package that is not installed.
    """
    from dynident.actuators.estimate import read_actuators
    from dynident.api.actuators import logs_to_follow
    from dynident.exports.actuator_files import actuator_file
    from dynident.exports.actuator_proof import export_remarks, simulated_differences

    _refuse(options, _OF_OTHERS, f"{options.file} holds actuators; leave it out")
    estimate = read_actuators(options.file)
    model = str(dict(estimate.provenance.get("robot", {})).get("path", ""))
    check_outputs((options.output,), (options.file, model))
    text = actuator_file(estimate, options.to, stated)
    reason = list[str]()

    def logs() -> list[ServoLog]:
        try:
            return logs_to_follow(estimate)[1]
        except DynidentError as error:  # the case or a log is not there any more
            reason.append(str(error))
            return []

    proof = None if options.no_proof else simulated_differences(estimate, options.to, stated, logs)
    if not options.check:
        write_atomically(options.output, text)
    if options.json:
        files = [] if options.check else [options.output]
        own, on_logs = proof or (None, None)
        data = {"files": files, "target": options.to, "mujoco_difference_rad": own}
        console.answer_json({**data, "mujoco_difference_on_logs_rad": on_logs})
        return 0
    for line in _proof_lines(*proof) if proof is not None else ():
        console.answer(line)
    if reason:
        console.remark(f"not followed along a log: {reason[0]}", options.quiet)
    for text in export_remarks(estimate, options.to, stated):
        console.remark(text, options.quiet)
    console.remark(f"{'would write' if options.check else 'wrote'} {options.output}", options.quiet)
    return 0


def _proof_lines(differences: Mapping[str, float], on_logs: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Return how far MuJoCo is from the roll-out, in words."""
    from dynident.exports.actuator_proof import TOLERANCE
    from dynident.results.text import format_number

    if not differences:
        return ["not compared with MuJoCo: the robot model has joints that were not identified, and they have no drive"]
    found, step = list[str](), "compare on your own motions before you rely on it"
    for motion, own in (("chirp and steps", differences), *on_logs.items()):
        joint = max(own, key=lambda name: own[name])
        size = format_number(1e3 * own[joint], 2)
        text = f"MuJoCo and the roll-out differ by {size} mrad ({joint}; mean over {motion})"
        is_far = own[joint] > TOLERANCE
        found.append(f"warning: {text}, more than {1e3 * TOLERANCE:g} mrad: {step}" if is_far else text)
    return found


def validate(options: argparse.Namespace) -> int:
    """Follow logs with the actuators of a file and print the errors of the roll-outs.

    Raises:
        BadOption: An option that is for logs with torques.
        DynidentError: A log that cannot be read, or a case that is not that of the file any more.
    """
    from dynident.results.actuator_report import errors_table, mean_lines
    from dynident.results.actuator_text import all_warnings

    estimate, runs = _followed(options, ("case", "accept", "split", "full"), options.logs, options.report)
    if options.json:
        console.answer_json({"robot": estimate.robot, "roll_outs": _listed(runs)})
        return 0
    first, *others = mean_lines(runs)
    console.answer(f"{estimate.robot}: {first}")
    for line in others:
        console.answer(line)
    console.answer_table(errors_table(runs))
    for warning in all_warnings(estimate.joints):
        console.answer(f"warning: {warning}")
    if options.report:
        console.remark(f"wrote {options.report}", options.quiet)
    return 0


def report(options: argparse.Namespace) -> int:
    """Write the report of the actuators of a file.

    Raises:
        BadOption: An option that is for logs with torques.
        DynidentError: As of :func:`validate`.
    """
    foreign = ("split", "plan", "case", "no_log_quality", "prove", "motion", "figures", "format")
    estimate, runs = _followed(options, foreign, options.test, options.output)
    if options.json:
        console.answer_json({"report": options.output, "robot": estimate.robot, "roll_outs": _listed(runs)})
    else:
        console.remark(f"wrote {options.output}", options.quiet)
    return 0


def _followed(
    options: argparse.Namespace, foreign: Sequence[str], logs: Sequence[str], page: str | None
) -> tuple[ActuatorEstimate, tuple[FollowedJoint, ...]]:
    """Return the actuators of a file and their roll-outs over logs; the page is written where one is asked for."""
    from dynident.actuators.estimate import read_actuators
    from dynident.api.actuators import follow

    _refuse(options, foreign, f"{options.estimate} holds actuators; leave it out")
    if page:
        check_place(page)
    with console.progress(2, options.quiet or options.json) as progress:
        progress.step("reading")
        estimate = read_actuators(options.estimate)
        check_outputs((page,), (options.estimate, *logs, *files_behind(estimate.provenance)))
        progress.step("roll-outs")
        runs = follow(estimate, logs)
        if page:
            from dynident.results.actuator_report import actuator_page

            write_atomically(page, actuator_page(estimate, runs))
    return estimate, runs


def _listed(runs: Sequence[FollowedJoint]) -> list[dict[str, object]]:
    """Return the errors of roll-outs as plain data; what is infinite or not known is null."""

    def finite(value: float) -> float | None:
        return value if abs(value) < float("inf") else None

    return [
        {
            "joint": run.joint,
            "log": run.log,
            "kp": run.kp,
            "extrapolates": run.is_outside,
            "trained_on": run.is_trained,
            "error_rad": finite(run.error),
            "whole_arm_error_rad": finite(run.whole),
            "linear_error_rad": finite(run.linear),
            "robot_model_error_rad": finite(run.nominal),
        }
        for run in runs
    ]


def check(case: Case, options: argparse.Namespace) -> int:
    """Look at the logs of a case with servos; 1 where a log has an error.

    Raises:
        BadOption: An option that is for logs with torques.
        DynidentError: A log that cannot be read, or a robot model without inertias.
    """
    from dynident.actuators.joint_load import rigid_inertia
    from dynident.actuators.servo_log import kp_values, laws_of
    from dynident.api.actuators import logs_of_servos
    from dynident.diagnosis.servo_findings import arm_findings, servo_findings
    from dynident.results.text import counted

    _refuse(options, ("against", "fix"), "leave it out: it is for logs with torques")
    setup = case.servo
    case = replace(case, train=tuple(options.logs), test=()) if options.logs else case
    train, test = logs_of_servos(case)
    logs = train + test
    rigid_inertia(case.robot)
    laws = laws_of(setup, logs) if setup else ()
    trained = [()] * len(train) + [kp_values(train)] * len(test)
    found = [(log, servo_findings(log, laws, logs, kp)) for log, kp in zip(logs, trained, strict=True)]
    of_arm = arm_findings(case.robot, train, laws)
    sound = all(one.severity != "error" for own in (of_arm, *(own for _, own in found)) for one in own)
    if options.json:
        told = [{"path": log.name, "findings": [one.figures() for one in own]} for log, own in found]
        together = [one.figures() for one in of_arm]
        console.answer_json({"robot": case.robot.name, "sound": sound, "findings": together, "logs": told})
        return 0 if sound else 1
    for one in of_arm:
        console.answer(f"{one.severity}: {one.name} ({one.joint}): {one.evidence}")
        console.answer(f"  {one.remedy}")
    notes: dict[tuple[str, str, str], list[str]] = {}
    for log, own in found:
        heavy = [one for one in own if one.severity != "note"]
        console.answer(f"{log.name}: {counted(len(heavy), 'finding') if heavy else 'nothing found'}")
        for one in heavy:
            of = f" ({one.joint})" if one.joint else ""
            console.answer(f"  {one.severity}: {one.name}{of}: {one.evidence}")
            console.answer(f"    {one.remedy}")
        for one in own[len(heavy) :]:  # notes come last
            notes.setdefault((one.name, one.evidence, one.remedy), []).append(one.joint)
        for text in log.left_out:
            console.answer(f"  warning: {text}")
    for (name, evidence, remedy), joints in notes.items():
        of = ", ".join(dict.fromkeys(joint for joint in joints if joint))
        console.answer(f"note: {name}{f' ({of})' if of else ''}: {evidence}")
        console.answer(f"  {remedy}")
    return 0 if sound else 1
