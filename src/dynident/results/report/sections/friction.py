"""Friction of each drive: coefficients, and the curve over what was measured less the rest of the model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from markupsafe import Markup

from dynident.arrays import Array
from dynident.errors import DynidentError
from dynident.identification.estimate.estimate import Estimate
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.results.figures import friction_chart
from dynident.results.figures.residuals import speed_grid
from dynident.results.report.sections.base import ReportSection, drawn
from dynident.results.report.subject import Subject
from dynident.results.text import MISSING, Table, columns_of, format_number, format_value, label, pretty_unit


@dataclass(frozen=True)
class FrictionSection(ReportSection):
    """Coefficients and curves; left out for a model without friction."""

    title: ClassVar = "Friction"

    def context(self, subject: Subject) -> dict[str, Any]:
        estimate = subject.estimate
        if not estimate.model.friction:
            return {}
        figures: list[Markup] = []
        refused = ""
        try:
            figures = _figures(subject)
        except DynidentError as error:  # a part that needs more than positions and speeds
            refused = f"No curves: {error}."
        coupled = estimate.model.robot.is_coupled
        return {"table": _coefficients(estimate), "figures": figures, "refused": refused, "coupled": coupled}


def standard_parameters(estimate: Estimate) -> Array:
    """Return theta, or the one with zeros outside the base columns, which has the same torque, shape (p,)."""
    return np.asarray(estimate.base.to_standard(estimate.beta) if estimate.theta is None else estimate.theta)


def friction_torque(model: DynamicModel, theta: Array, q: Array, dq: Array) -> Array:
    """Return the friction of the drives at joint positions q and speeds dq, both (N, n), shape (N, n).

    The rotor inertia is no friction: accelerations are taken as zero. Nor is what follows the position alone, a spring
    or a ripple. For coupled motors it is the torque at the motor. The load of a drive, where friction depends on it,
    is that of theta at these positions and speeds.
    """
    values = model.friction_values(model.loaded(Motion(q, dq, np.zeros_like(dq)), theta))
    counts = np.array([not part.is_of_position for part in model.friction for _ in part.coefficients])
    return np.einsum("sjk,jk->sj", values, model.coefficient_table(theta) * counts)


def _figures(subject: Subject) -> list[Markup]:
    """Draw friction and residual, which together are the measured torque less the rigid-body part."""
    estimate = subject.estimate
    model, robot = estimate.model, estimate.model.robot
    validations = [dataset.validation for dataset in subject.datasets]
    if not validations:
        return []
    theta, coupling = standard_parameters(estimate), np.asarray(robot.coupling)
    q = np.concatenate([v.q for v in validations])
    dq = np.concatenate([v.dq for v in validations])
    left = np.concatenate([v.measured - v.predicted for v in validations])
    residual = np.linalg.solve(coupling.T, left.T).T
    speed = dq @ coupling.T
    torque = friction_torque(model, theta, q, dq) + residual
    charts = []
    for i, (name, unit) in enumerate(zip(robot.joint_names, robot.units, strict=True)):
        grid = speed_grid(speed[:, i])
        motor = np.zeros((len(grid), robot.dof))
        motor[:, i] = grid
        joint = np.linalg.solve(coupling, motor.T).T
        curve = friction_torque(model, theta, np.zeros_like(joint), joint)[:, i]
        rate = "rad/s" if unit == "N m" else "m/s"
        charts.append(
            drawn(friction_chart(name, unit, rate, speed[:, i], torque[:, i], (grid, curve)), "friction", name)
        )
    return charts


def _coefficients(estimate: Estimate) -> Table:
    columns = columns_of("drive", "coefficient", ">value", ">std", "unit", "verdict")
    theta, base = standard_parameters(estimate), estimate.base
    alone = {int(base.independent[row]): row for row in range(base.count) if np.count_nonzero(base.matrix[row]) == 1}
    rows = []
    for k in range(estimate.model.inertial_count, len(base.parameters)):
        parameter, value = base.parameters[k], float(theta[k])
        shown, spread = format_number(value), MISSING
        if k in alone:
            shown, spread = format_value(value, float(estimate.std[alone[k]]))
        unit, verdict = pretty_unit(parameter.unit), base.verdicts[k]
        rows.append((label(parameter.owner), parameter.symbol, shown, spread, unit, verdict))
    return Table(columns, tuple(rows))
