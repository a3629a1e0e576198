"""'dynident identify' of a case with the key servo: actuators in place of a dynamic model."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynident.case.case import Case

#: Options of 'identify' that are for logs with torques, and have no meaning here.
_FOREIGN = (
    "triangles", "estimator", "option", "prior", "bodies", "constraints", "friction", "split", "cutoff", "rate",
    "delay", "accept", "cross_validate", "bootstrap", "no_sensitivity", "report",
)  # fmt: skip

#: Options of 'export' that are for plans and models.
_OF_OTHERS = (
    "rate", "repeats", "speed", "from_posture", "units", "description", "no_proof", "force", "prove", "motion",
)  # fmt: skip


def run(case: Case, options: argparse.Namespace) -> int:
    """Identify the actuators of a case and print the answer.

    Raises:
        BadOption: An option that is for logs with torques.
        DynidentError: Any fault of the case or a log.
    """
    from dynident.actuators.estimate import as_data, write_actuators
    from dynident.api.actuators import actuators
    from dynident.cli import console, jobs
    from dynident.errors import BadOption
    from dynident.files import check_outputs
    from dynident.results.actuator_text import headline, joint_lines, joint_warnings, parameter_table

    for name in _FOREIGN:
        if getattr(options, name):
            step = "leave it out: the case has servo:, and its logs have no torque; the key servo states what is fitted"
            raise BadOption(name, getattr(options, name), step)
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
    console.answer(headline(found))
    for joint in found.joints:
        console.answer()
        console.answer_table(parameter_table(joint), joint.name)
        for line in joint_lines(joint):
            console.answer(f"  {line}")
        for warning in joint_warnings(joint):
            console.answer(f"warning: {joint.name}: {warning}")
    if options.output:
        console.remark(f"saved {options.output}", options.quiet)
    return 0


def export(options: argparse.Namespace) -> int:
    """Write actuators for a simulator or a controller.

    Raises:
        BadOption: An option that is for plans or models.
        DynidentError: No such target, several gains, or a package that is not installed.
    """
    from dynident.actuators.estimate import read_actuators
    from dynident.cli import console
    from dynident.errors import BadOption
    from dynident.exports.actuator_files import actuator_file
    from dynident.files import check_outputs, write_atomically

    for name in _OF_OTHERS:
        if getattr(options, name):
            option = f"--{name.replace('_', '-')}"
            raise BadOption(option, getattr(options, name), f"{options.file} holds actuators; leave it out")
    stated: dict[str, str] = {}
    for item in options.option:
        key, equals, value = item.partition("=")
        if not equals:
            raise BadOption("--option", item, "write key=value")
        stated[key] = value
    check_outputs((options.output,), (options.file,))
    text = actuator_file(read_actuators(options.file), options.to, stated)
    if not options.check:
        write_atomically(options.output, text)
    if options.json:
        console.answer_json({"files": [] if options.check else [options.output], "target": options.to})
    else:
        console.remark(f"{'would write' if options.check else 'wrote'} {options.output}", options.quiet)
    return 0
