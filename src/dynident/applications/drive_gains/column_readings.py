"""Columns of the logs read otherwise: signs and units of positions, order of currents, where the gains fit poorly.

A gain follows whatever motion its current is put beside, and the bodies are shared: a position of the wrong sign made
gains of other joints wrong, with narrow intervals. Each other reading is fitted anew, and told where the currents are
explained far better by it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from dynident.applications.drive_gains.drive_gains import DriveGains
from dynident.applications.drive_gains.gain_solve import GainSolve, PreparedRuns
from dynident.arrays import Array
from dynident.data.preprocessing import Prepared
from dynident.diagnosis.causes.column_readings import GAIN, variance_falls
from dynident.errors import BadOption, SolverFailed

#: Share of its current that the fit of a drive leaves above which columns are read otherwise, and that of one of two
#: drives whose currents are exchanged.
DOUBTFUL, POOR = 0.1, 0.25


def other_readings(found: DriveGains, plain: float, solve: GainSolve, runs: PreparedRuns) -> list[tuple[float, str]]:
    """Return the misfit with columns read otherwise, and that in words, where they explain the currents far better.

    Args:
        found: The gains.
        plain: Their misfit.
        solve: What found them.
        runs: The logs, with few rows.
    """
    left = np.array([gain.residual / max(gain.current, 1e-100) for gain in found.gains])
    if left.max() < DOUBTFUL or any(gain.sign for gain in found.gains):
        return []
    told = []
    for positions, order, reason, remedy in _readings(solve, left):
        try:
            size = solve.misfit(_read(runs, positions, order, np.asarray(solve.model.robot.coupling)))
        except (BadOption, SolverFailed):
            continue
        gain = 2.0 * (plain - size)
        if gain > GAIN:
            told.append((size, f"{reason}, {variance_falls(gain)}; {remedy}"))
    return told


def _readings(solve: GainSolve, left: Array) -> Iterator[tuple[Array, list[int], str, str]]:
    """Yield factors of the positions (n,), which current is whose, what that is in words, and what to do."""
    robot = solve.model.robot
    names, joints = robot.joint_names, robot.dof
    ones, plain = np.ones(joints), list(range(joints))
    for i, name in enumerate(names):
        turned = np.where(np.arange(joints) == i, -1.0, 1.0)
        yield turned, plain, f"with the position of {name} reversed", "negate the column of its position, or the axis"
    for i, k in combinations(np.flatnonzero(left > DOUBTFUL).tolist(), 2):
        if max(left[i], left[k]) < POOR:
            continue
        order = [k if j == i else i if j == k else j for j in plain]
        remedy = "name the current columns in the order of the joints (log: columns: current)"
        yield ones, order, f"with the currents of {names[i]} and {names[k]} exchanged", remedy
    if np.mean(left > DOUBTFUL) >= 0.5 and all(joint.kind == "revolute" for joint in robot.active):
        for unit, other, factor in (("deg", "radians", np.pi / 180.0), ("rad", "degrees", 180.0 / np.pi)):
            remedy = f"state the unit (log: units: {{position: {unit}}})"
            yield factor * ones, plain, f"with positions in {unit} that were read as {other}", remedy


def _read(runs: PreparedRuns, positions: Array, order: list[int], coupling: Array) -> PreparedRuns:
    """Return the logs with positions times factors (n,) and currents in an order; their torques are C' i."""
    mixing = np.linalg.inv(coupling)[:, order] @ coupling

    def read(prepared: Prepared) -> Prepared:
        log = prepared.log
        motion = {key: np.asarray(getattr(log, key)) * positions for key in ("q", "dq", "ddq")}
        how = replace(prepared.how, standstill=prepared.how.standstill * float(np.abs(positions).min()))
        return replace(prepared, log=replace(log, **motion, torque=np.asarray(log.torque) @ mixing), how=how)

    return PreparedRuns(tuple(tuple(read(log) for log in run) for run in runs.logs), runs.delays)
