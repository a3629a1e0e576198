"""Rehearse a run on a virtual robot before the real one moves: which parameters would be found, and how well.

CASE is a case file or a robot description. The motion is a plan of 'dynident excite' (--plan), or is designed here. A
virtual robot with known, physically consistent parameters records it with noise; the case's filter and estimator
identify it without being told any masses; the result is compared with the truth. Logs of half, double and four times
the length say what time would buy. The exit code is 1 where the planned log does not meet the tolerance.

  dynident selftest case.yaml --plan plan.json
  dynident selftest robot.urdf --noise 0.5 --tolerance 0.03
  dynident selftest robot.urdf --truth random --seed 3 --json

The virtual robot has the friction of the case and no elastic joints: passing is necessary, not sufficient.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dynident.arrays import Array
    from dynident.estimation.selftest.rehearsal import Plan, Rehearsal
    from dynident.experiment.case_file.case import Case
    from dynident.experiment.design.plan import Plan as PlannedMotion

SUMMARY = "rehearse a run on a virtual robot: what would be found, and how well"

#: Words for what stands behind the virtual robot.
_DESCRIBED, _RANDOM = "description", "random"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("case", metavar="CASE|ROBOT", help="case file, robot description or a robot that ships")
    motion = parser.add_argument_group("motion")
    motion.add_argument("--plan", metavar="FILE", help="plan of 'dynident excite -o'; default: one is designed")
    motion.add_argument("--period", type=float, default=10.0, metavar="S", help="period of a designed motion in s (10)")
    motion.add_argument(
        "--time-limit", type=float, default=20.0, metavar="S", help="longest search of a designed motion in s (20)"
    )
    motion.add_argument("--repeats", type=int, default=1, metavar="N", help="periods of the planned log (1)")
    robot = parser.add_argument_group("virtual robot")
    robot.add_argument(
        "--truth",
        default=_DESCRIBED,
        metavar="WHAT",
        help="description (default): its masses, friction that it does not state is invented; random: a random "
        "possible robot near it; or an estimate or description file",
    )
    robot.add_argument(
        "--noise",
        nargs="+",
        type=float,
        metavar="X",
        help="standard deviation of the torque, one number or one a joint, in N m or N; default: 1 %% of each effort "
        "limit",
    )
    robot.add_argument(
        "--position-noise", type=float, default=2e-5, metavar="RAD", help="of the encoders, in rad or m (2e-5)"
    )
    robot.add_argument("--resolution", type=float, default=0.0, metavar="RAD", help="step of the encoders (0: none)")
    robot.add_argument("--rate", type=float, default=1000.0, metavar="HZ", help="rows of the log a second (1000)")
    robot.add_argument("--control-rate", type=float, default=1000.0, metavar="HZ", help="of the controller (1000)")
    robot.add_argument("--seed", type=int, default=0, help="seed of truth, noise and search (0)")
    asked = parser.add_argument_group("what is asked")
    asked.add_argument("--estimator", metavar="NAME", help="see 'dynident list estimators'; default: that of the case")
    asked.add_argument(
        "--tolerance", type=float, default=0.05, metavar="SHARE", help="largest error of a joint's torque (0.05)"
    )
    asked.add_argument(
        "--parameter-tolerance",
        type=float,
        metavar="SHARE",
        help="largest error of a parameter that carries 1 %% of a torque; default: none is asked",
    )
    output = parser.add_argument_group("output")
    output.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    output.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.cli import console, jobs
    from dynident.errors import BadOption
    from dynident.estimation.selftest.rehearsal import SHARES, Tolerance, rehearse
    from dynident.experiment.case_file.case import read_case

    if options.seed < 0:
        raise BadOption("--seed", options.seed, "give 0 or more")
    tolerance = Tolerance(options.tolerance, options.parameter_tolerance)
    case = read_case(options.case)
    estimator = jobs.estimator_from(case, options.estimator, [])
    theta, source = _truth(options, case)
    with console.progress(3 + len(SHARES), options.quiet or options.json) as progress:
        progress.step("motion")
        plan, noise = _plan(options, case)
        guess = None if options.truth == _DESCRIBED else case.model.nominal()
        found = rehearse(
            case.model,
            theta,
            plan,
            estimator,
            tolerance,
            guess=guess,
            constraints=case.constraints,
            progress=progress.step,
        )
    facts = {
        "truth": source,
        **noise,
        "position_noise": options.position_noise,
        "motion": options.plan or "designed",
        "seed": options.seed,
        "estimator": options.estimator or case.estimator.name,
    }
    if options.json:
        console.answer_json({**found.figures(), **facts, "command": jobs.repeat_command()})
    else:
        _show(found, facts, case)
    return 0 if found.passed else 1


def _truth(options: argparse.Namespace, case: Case) -> tuple[Array, str]:
    """Return the parameters of the virtual robot, shape (p,), and where they come from."""
    from dynident.estimation.comparison.truth import read_truth
    from dynident.estimation.monte_carlo.possible_robots import described_truth, random_truth

    model = case.model
    if options.truth == _DESCRIBED:
        return described_truth(model, options.seed), "the description; friction that it does not state is invented"
    if options.truth == _RANDOM:
        return random_truth(model, options.seed), f"a random possible robot, seed {options.seed}"
    return read_truth(case.find(options.truth), model, case.locked), options.truth


def _plan(options: argparse.Namespace, case: Case) -> tuple[Plan, dict[str, Any]]:
    """Return what is rehearsed, and its noise with where that comes from."""
    import numpy as np

    from dynident.errors import BadOption
    from dynident.estimation.monte_carlo.virtual_run import Recording
    from dynident.estimation.selftest.rehearsal import Plan
    from dynident.experiment.design.plan import read_plan

    given = _per_joint(options.noise, case.robot.dof) if options.noise else None
    if options.plan:
        planned = read_plan(options.plan)
        if planned.joints != case.robot.joint_names:
            step = f"design it for this case; the robot moves {', '.join(case.robot.joint_names)}"
            raise BadOption("--plan", options.plan, step)
    else:
        planned = _designed(options, case, given)
    levels = np.asarray(planned.settings["noise"] if given is None else given, dtype=float)
    recording = Recording(
        rate=options.rate,
        control_rate=options.control_rate,
        position_noise=options.position_noise,
        torque_noise=levels,
        resolution=options.resolution,
    )
    facts = {
        "noise": levels.tolist(),
        "noise_source": planned.settings["noise_source"] if given is None else "given",
    }
    return Plan(planned.trajectory, planned.run_in, options.repeats, recording, case.preprocessing, options.seed), facts


def _designed(options: argparse.Namespace, case: Case, noise: Array | None) -> PlannedMotion:
    """Design a motion within the limits of the case."""
    from dynident.cli.plans import tool_limit
    from dynident.experiment.design.excitation import design_excitation
    from dynident.experiment.design.limits import limits_of
    from dynident.experiment.room.clearance import clearance_of

    return design_excitation(
        case.model,
        limits_of(case.robot),
        period=options.period,
        starts=2,
        seed=options.seed,
        noise=noise,
        clearance=None if case.workspace is None else clearance_of(case.robot, case.workspace),
        tool=tool_limit(case),
        time_limit=options.time_limit,
    )


def _per_joint(values: Sequence[float], joints: int) -> Array:
    """Return one number for each joint, shape (n,)."""
    import numpy as np

    from dynident.errors import BadOption

    if len(values) not in (1, joints) or not all(0 < value < float("inf") for value in values):
        raise BadOption("--noise", list(values), f"give one number above 0, or one for each of the {joints} joints")
    return np.broadcast_to(np.array(values, dtype=float), (joints,)).copy()


def _show(found: Rehearsal, facts: dict[str, Any], case: Case) -> None:
    from dynident.cli import console
    from dynident.results import rehearsal_view as view
    from dynident.results.text import label

    robot, stage = case.robot, found.planned
    console.answer(
        f"{label(robot.name)}: {robot.dof} joints, {len(found.names)} base parameters, {stage.seconds:.3g} s of motion "
        f"({label(facts['motion'])}), estimator {facts['estimator']}"
    )
    levels = ", ".join(f"{level:.3g}" for level in facts["noise"])
    console.answer(f"truth: {label(facts['truth'])}; torque noise {levels} ({facts['noise_source']})")
    if case.choose_friction:
        console.answer("friction: auto chooses from real logs; here the default parts are taken")
    if found.facts.get("saturated_torques"):
        console.answer(f"{found.facts['saturated_torques']} torques were cut at the effort limits")
    tables = (
        view.parameters_table(found, console.NAME_WIDTH), view.joints_table(found), view.lengths_table(found)
    )  # fmt: skip
    for table in tables:
        console.answer()
        console.answer_table(table, table.note)
    console.answer()
    for line in view.verdict(found):
        console.answer(line)
