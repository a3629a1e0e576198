"""What the commands that run a virtual cell share: its settings, what its controller believes, and its units."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse

    from dynident.arrays import Array
    from dynident.case.case import Case
    from dynident.case.cell_section import CellSetup


def cell_setup(options: argparse.Namespace, case: Case) -> CellSetup:
    """Return the cell of ``--cell`` or of the case, changed by ``--set``.

    Raises:
        BadOption: A setting that is not of the form KEY=VALUE.
        DescriptionError: An unknown key, or a value that cannot be.
        FileError: The file cannot be read.
        UnknownChoice: A controller that does not exist.
    """
    from dynident.case.cell_section import CellSetup, read_cell

    setup = read_cell(options.cell) if options.cell else case.cell or CellSetup(path=options.case)
    return setup.changed(options.settings)


def stated_parameters(name: str, case: Case) -> Array:
    """Return the parameters of the description (``nominal``) or of an estimate file, shape (p,).

    Raises:
        DynidentError: The description states no inertias; the file cannot be read or is of another model.
    """
    from dynident.diagnosis.earlier import check_same
    from dynident.identification.files.estimate_file import read_estimate
    from dynident.simulation.truth import nominal_parameters

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
    import numpy as np

    from dynident.case.simulated_log import wants_current
    from dynident.errors import BadOption

    if not wants_current(case.columns):
        return np.ones(case.robot.dof)
    for joint in case.robot.active:
        if not joint.drive.gain:
            raise BadOption(f"gain of {joint.name}", joint.drive.gain, "give each drive's gain in N m/A, not 0")
    return np.array([abs(joint.drive.gain or 0.0) for joint in case.robot.active])
