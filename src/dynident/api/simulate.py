"""simulate a case: a plan recorded on the virtual cell of the case, with its true and its believed parameters."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dynident.arrays import Array
from dynident.case.case import Case
from dynident.case.cell_section import CellSetup, read_cell
from dynident.case.simulated_log import BAGS, case_columns, wants_current, write_bag, write_columns
from dynident.diagnosis.earlier import check_same
from dynident.errors import BadOption
from dynident.excitation.design.plan import Plan
from dynident.identification.files.estimate_file import read_estimate
from dynident.simulation.cell import CellRun
from dynident.simulation.cell_simulation import simulate_cell
from dynident.simulation.truth import nominal_parameters, true_parameters


def simulate_case(
    case: Case, plan: Plan, setup: CellSetup | None = None, *, repeats: int = 1, seed: int = 0
) -> CellRun:
    """Record a plan on a virtual cell.

    Args:
        case: The case.
        plan: Of the robot of the case.
        setup: The cell and its truth; None for those of the case, or the default ones.
        repeats: Periods of the motion.
        seed: Of all that is random, 0 or more.

    Raises:
        BadOption: A plan of another robot, or an option out of range.
        DynidentError: As :func:`~dynident.simulation.cell_simulation.simulate_cell` and :func:`stated_parameters`.
    """
    model, robot, setup = case.model, case.robot, setup or cell_setup(case)
    if seed < 0:
        raise BadOption("seed", seed, "give 0 or more")
    if plan.joints != robot.joint_names:
        step = f"the robot of the case has {', '.join(robot.joint_names)}; design the plan for this case"
        raise BadOption("plan", f"for {', '.join(plan.joints)}", step)
    gains = {j.name: j.drive.gain for j in robot.active if j.drive.gain is not None}
    return simulate_cell(
        model,
        true_parameters(model, stated_parameters(setup.truth.parameters, case), setup.truth, seed),
        plan.motion(repeats),
        setup.cell,
        gains=gains if wants_current(case.columns) else None,
        believed=believed_parameters(setup, case),
        seed=seed,
    )


def write_simulated_log(found: CellRun, case: Case, path: str | Path) -> None:
    """Write the log of a virtual cell with the columns and units of the case, so that it is read as a real one.

    Raises:
        DynidentError: The format cannot be written, or the file.
    """
    target, columns = Path(path), case.columns
    table = case_columns(found.log, columns, case.robot, case.locked)
    if target.suffix.lower() in BAGS:
        signals = {name: values for name, values in table.items() if name != columns.time}
        write_bag(signals, target, found.log.time, columns.joints or found.log.joints)
    else:
        write_columns(table, target, columns.decimal)


def cell_setup(case: Case, path: str | None = None, settings: Sequence[str] = ()) -> CellSetup:
    """Return the cell of a file, or else of the case, changed by settings of the form KEY=VALUE.

    Raises:
        BadOption: A setting that is not of this form.
        DescriptionError: An unknown key, or a value that cannot be.
        FileError: The file cannot be read.
        UnknownChoice: A controller that does not exist.
    """
    setup = read_cell(path) if path else case.cell or CellSetup(path=case.path or case.robot_path or "cell")
    return setup.changed(settings)


def stated_parameters(name: str, case: Case) -> Array:
    """Return the parameters of the robot model (``nominal``) or of an estimate file, shape (p,).

    Raises:
        DynidentError: The robot model states no inertias; the file cannot be read or is of another model.
    """
    if name == "nominal":
        return nominal_parameters(case.model)
    path = str(case.find(name))
    estimate = read_estimate(path)
    check_same(estimate, case.model, path)
    return estimate.base.to_standard(estimate.beta) if estimate.theta is None else estimate.theta


def believed_parameters(setup: CellSetup, case: Case) -> Array | None:
    """Return what the controller believes, shape (p,); None for the truth.

    Raises:
        DynidentError: As :func:`stated_parameters`.
    """
    return None if setup.truth.believed == "truth" else stated_parameters(setup.truth.believed, case)


def current_scale(case: Case) -> Array:
    """Return a unit of logged effort as a torque, shape (n,): a drive's gain where logs are of currents, else 1.

    Raises:
        BadOption: Logs of currents and a drive without gain.
    """
    if not wants_current(case.columns):
        return np.ones(case.robot.dof)
    for joint in case.robot.active:
        if not joint.drive.gain:
            raise BadOption(f"gain of {joint.name}", joint.drive.gain, "give each drive's gain in N m/A, not 0")
    return np.array([abs(joint.drive.gain or 0.0) for joint in case.robot.active])
