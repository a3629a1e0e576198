"""Rehearse a run on a virtual robot before the real one moves: which parameters would be found, and how well.

CASE is a case file or a robot model. The motion is a plan of 'dynident excite' (--plan), or is designed here. A
virtual cell around a robot with known, physically consistent parameters records it with noise: that of the case's
section 'cell', as for 'dynident simulate', or a PD controller where there is none. The case's filter and estimator
identify it without the masses; the result is compared with the truth. Logs of half, double and four times
the length show how the errors fall with it. The exit code is 1 where the planned log does not meet the tolerance.

  dynident selftest case.yaml --plan plan.json
  dynident selftest robot.urdf --noise 0.5 --tolerance 0.03
  dynident selftest robot.urdf --truth random --seed 3 --json
  dynident selftest case.yaml --set controller=cascade --set bristles.presliding=1e-3

What neither the case nor its cell states is not rehearsed: passing is necessary, not sufficient.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from dynident.cli import console, jobs
from dynident.cli.plans import breached
from dynident.errors import BadOption

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dynident.arrays import Array
    from dynident.case.case import Case
    from dynident.case.cell_section import CellSetup
    from dynident.excitation.design.plan import Plan as PlannedMotion
    from dynident.simulation.cell import Cell
    from dynident.studies.selftest.rehearsal import Rehearsal, RehearsalPlan

SUMMARY = "rehearse a run on a virtual robot: what would be found"

#: Options in the short help.
FREQUENT = ("--plan", "--noise", "--truth", "--seed", "--tolerance", "--json")

#: Words for what stands behind the virtual robot.
_NOMINAL, _RANDOM = "nominal", "random"

#: Noise of the encoders, in rad or m, where no cell states them.
POSITION_NOISE = 2e-5


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("case", metavar="CASE|ROBOT", help="case file, robot model or built-in example robot")
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
        metavar="WHAT",
        help="nominal (default, where the cell names no other): masses of the robot model; friction that it does not "
        "state is invented; random: a random physically consistent robot near it; or a file: estimate, robot model, "
        "truth of simulate",
    )
    robot.add_argument(
        "--noise",
        nargs="+",
        type=float,
        metavar="X",
        help="standard deviation of the torque, one number or one a joint, in N m or N; default: that of the "
        "cell, else that of the plan, which is 1 %% of each effort limit unless stated",
    )
    robot.add_argument(
        "--position-noise",
        type=float,
        metavar="RAD",
        help="of the encoders, in rad or m; default: the cell's, 2e-5 where it has no encoder",
    )
    robot.add_argument("--resolution", type=float, metavar="RAD", help="step of the encoders; default: the cell's")
    robot.add_argument("--rate", type=float, metavar="HZ", help="samples of the log a second; default: the cell's")
    robot.add_argument("--control-rate", type=float, metavar="HZ", help="of the controller; default: the cell's")
    robot.add_argument("--cell", metavar="FILE", help="the cell, in place of the case's (docs/virtual-cell.md)")
    robot.add_argument(
        "--set",
        action="append",
        default=[],
        dest="settings",
        metavar="KEY=VALUE",
        help="change one setting of the cell, such as encoder.noise=1e-5 or controller=pid",
    )
    robot.add_argument("--seed", type=int, default=0, help="seed of truth, noise and search (0)")
    asked = parser.add_argument_group("acceptance")
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
    from dynident.api.case_options import estimator_of
    from dynident.api.simulate import believed_parameters, cell_setup
    from dynident.case.case import read_case
    from dynident.studies.selftest.rehearsal import SHARES, KnownBefore, Tolerance, rehearse

    if options.seed < 0:
        raise BadOption("--seed", options.seed, "give 0 or more")
    tolerance = Tolerance(options.tolerance, options.parameter_tolerance)
    case = read_case(options.case)
    estimator = estimator_of(case, options.estimator)
    setup = cell_setup(case, options.cell, options.settings)
    believed = believed_parameters(setup, case)
    theta, source = _truth(options, case, setup)
    with console.progress(3 + len(SHARES), options.quiet or options.json) as progress:
        progress.step("motion")
        plan, noise = _plan(options, case, setup)
        guess = None if source.startswith("the robot model") else case.model.nominal()
        found = rehearse(
            case.model,
            theta,
            plan,
            estimator,
            tolerance,
            known=KnownBefore(guess, believed, case.constraints),
            progress=progress.step,
        )
    facts = {
        "truth": source,
        **noise,
        "cell": plan.cell.data(),
        "motion": options.plan or "designed",
        "seed": options.seed,
        "estimator": options.estimator or case.estimator.name,
    }
    if options.json:
        console.answer_json({**found.figures(), **facts, "command": jobs.repeat_command()})
    else:
        _show(found, plan, facts, case)
    return 0 if found.passed else 1


def _truth(options: argparse.Namespace, case: Case, setup: CellSetup) -> tuple[Array, str]:
    """Return the parameters of the virtual robot, shape (p,), and where they come from."""
    from dataclasses import replace

    from dynident.simulation.truth import true_parameters
    from dynident.studies.benchmark.possible_robots import described_truth, random_truth
    from dynident.studies.comparison.truth import read_truth

    model, truth, stated = case.model, setup.truth, options.truth is not None
    name = options.truth if stated else truth.parameters
    if name == _NOMINAL:
        theta, source = (
            described_truth(model, options.seed),
            "the robot model; friction that it does not state is invented",
        )
    elif name == _RANDOM:
        theta, source = random_truth(model, options.seed), f"a random physically consistent robot, seed {options.seed}"
    else:
        theta, source = read_truth(case.find(name), model, case.locked), name
    if stated:
        truth = replace(truth, spread=0.0, friction=truth.friction if name in (_NOMINAL, _RANDOM) else {})
    changed = [f"{word} of the cell" for word, own in (("spread", truth.spread), ("friction", truth.friction)) if own]
    return true_parameters(model, theta, truth, options.seed), "; ".join([source, *changed])


def _plan(options: argparse.Namespace, case: Case, setup: CellSetup) -> tuple[RehearsalPlan, dict[str, Any]]:
    """Return what is rehearsed, and its noise with where that comes from."""
    from dynident.excitation.design.plan import read_plan, worst_breach
    from dynident.studies.selftest.rehearsal import RehearsalPlan

    given, source = _noise(options, case, setup)
    if options.plan:
        planned = read_plan(options.plan)
        if planned.joints != case.robot.joint_names:
            step = f"design it for this case; the robot moves {', '.join(case.robot.joint_names)}"
            raise BadOption("--plan", options.plan, step)
        if (worst := worst_breach(planned)) is not None:
            raise breached(worst, options.plan)
    else:
        planned = _designed(options, case, given)
    levels = planned.settings["noise"] if given is None else given.tolist()
    facts = {"noise": list(levels), "noise_source": source or planned.settings["noise_source"]}
    cell = _cell(options, case, setup, tuple(levels))
    return RehearsalPlan(
        planned.trajectory, planned.run_in, options.repeats, cell, case.preprocessing, options.seed
    ), facts


def _noise(options: argparse.Namespace, case: Case, setup: CellSetup) -> tuple[Array | None, str]:
    """Return the torque noise that is stated, shape (n,), and by whom; None for that of the plan."""
    from dynident.api.simulate import current_scale
    from dynident.simulation.effects import each

    joints = case.robot.dof
    if options.noise:
        return _per_joint(options.noise, joints), "given"
    levels = each("effort.noise", setup.cell.effort.noise, joints) * current_scale(case)
    return (levels, "of the cell") if levels.all() else (None, "")


def _cell(options: argparse.Namespace, case: Case, setup: CellSetup, noise: tuple[float, ...]) -> Cell:
    """Return the cell of the case with what the command line states beside it; it measures torques."""
    from dataclasses import replace

    from dynident.api.simulate import current_scale
    from dynident.simulation.effects import Encoder, each

    cell = setup.cell
    encoder = cell.encoder if "encoder" in setup.values else Encoder(noise=(POSITION_NOISE,))
    if options.position_noise is not None:
        encoder = replace(encoder, noise=(options.position_noise,))
    if options.resolution is not None:
        encoder = replace(encoder, resolution=(options.resolution,))
    steps = each("effort.resolution", cell.effort.resolution, case.robot.dof) * current_scale(case)
    effort = replace(cell.effort, noise=noise, resolution=tuple(steps.tolist()))
    recorder = cell.recorder if options.rate is None else replace(cell.recorder, rate=options.rate)
    controller = cell.controller
    if options.control_rate is not None:
        controller = replace(controller, rate=options.control_rate)
    return replace(cell, controller=controller, encoder=encoder, effort=effort, recorder=recorder)


def _designed(options: argparse.Namespace, case: Case, noise: Array | None) -> PlannedMotion:
    """Design a motion within the limits of the case."""
    from dynident.api.excite import space_limits
    from dynident.excitation.design.excitation import design_excitation
    from dynident.excitation.design.limits import limits_of
    from dynident.excitation.design.options import DesignKnowledge, SearchOptions, TrajectoryOptions

    return design_excitation(
        case.model,
        limits_of(case.robot),
        trajectory=TrajectoryOptions(period=options.period),
        search=SearchOptions(starts=2, seed=options.seed, time_limit=options.time_limit),
        knowledge=DesignKnowledge(noise=noise),
        space=space_limits(case),
    )


def _words(cell: Cell) -> str:
    """Return controller, rates and effects of a cell in words."""
    from dynident.simulation.controllers import CONTROLLERS

    name = CONTROLLERS.name_of(cell.controller)
    rates = f"{name} at {cell.controller.rate:g} Hz, {cell.recorder.rate:g} samples a second"
    effects = ", ".join(cell.changes())
    return f"{rates}; beside the default: {effects}" if effects else rates


def _per_joint(values: Sequence[float], joints: int) -> Array:
    """Return one number for each joint, shape (n,)."""
    import numpy as np

    if len(values) not in (1, joints) or not all(0 < value < float("inf") for value in values):
        raise BadOption("--noise", list(values), f"give one number above 0, or one for each of the {joints} joints")
    return np.broadcast_to(np.array(values, dtype=float), (joints,)).copy()


def _show(found: Rehearsal, plan: RehearsalPlan, facts: dict[str, Any], case: Case) -> None:
    from dynident.results.text import label
    from dynident.studies.selftest import rehearsal_view as view

    robot, stage = case.robot, found.planned
    console.answer(
        f"{label(robot.name)}: {robot.dof} joints, {len(found.names)} base parameters, {stage.seconds:.3g} s of motion "
        f"({label(facts['motion'])}), estimator {facts['estimator']}"
    )
    levels = ", ".join(f"{level:.3g}" for level in facts["noise"])
    console.answer(f"truth: {label(facts['truth'])}; torque noise {levels} ({facts['noise_source']})")
    console.answer(f"virtual cell: {_words(plan.cell)}")
    if case.choose_friction:
        console.answer("friction: auto chooses from real logs; here the default parts are taken")
    if found.saturated_torques:
        console.answer(f"{found.saturated_torques} torques were cut at the effort limits")
    tables = (
        view.parameters_table(found, console.NAME_WIDTH), view.joints_table(found), view.lengths_table(found)
    )  # fmt: skip
    for table in tables:
        console.answer()
        console.answer_table(table, table.note)
    console.answer()
    for line in view.verdict(found):
        console.answer(line)
