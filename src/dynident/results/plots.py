"""Figures of an estimate by matplotlib, for notebooks and papers; the report draws its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dynident.errors import BadArgument, MissingDependency
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.results.figures.signals import run_time
from dynident.results.report.sections.friction import friction_torque, standard_parameters
from dynident.results.text import format_percent, label, pretty_unit, shorten

#: Points of a cloud at most: more are not seen, and are slow to draw.
MOST_POINTS = 4000

#: Size of a figure: width, and height of each of its plots, in inches.
WIDTH, HEIGHT = 8.0, 1.9


def plot_torques(estimate: Estimate, validation: Validation | None = None, joints: Sequence[str] | None = None) -> Any:
    """Return a figure of measured and predicted torque by joint, with the residual and its 95 % band.

    The torques that static friction can hold at rest are shaded; the residual is what is beyond them.

    Args:
        estimate: The estimate.
        validation: Test data; None for the data of the fit.
        joints: Names of the joints; None for all.

    Raises:
        MissingDependency: matplotlib is not installed.
        BadArgument: A joint that the robot does not have, or an estimate without samples.
    """
    if validation is not None and not isinstance(validation, Validation):
        step = "give a Validation: estimate.plot_torques(di.validate(estimate, log))"
        raise BadArgument("validation", f"{type(validation).__name__} where a Validation is wanted", step)
    data = estimate.train if validation is None else validation
    columns = _columns(estimate, joints)
    if not len(data.time):
        raise BadArgument(
            "validation", "not given, and the estimate holds no samples", "give di.validate(estimate, log)"
        )
    robot = estimate.model.robot
    figure, axes = _figure(len(columns))
    time = run_time(data.time, data.starts)
    time[np.asarray(data.starts[1:], dtype=int)] = np.nan  # the line ends where the next log begins
    bands = data.half_widths()
    for axis, k in zip(axes, columns, strict=True):
        unit, error = pretty_unit(robot.units[k]), data.joints[k].relative_error
        axis.plot(time, data.measured[:, k], color="0.55", linewidth=1.6, label="measured")
        axis.plot(time, data.predicted[:, k], color="C3", linewidth=0.9, label="predicted")
        axis.plot(time, data.residual[:, k], color="C0", linewidth=0.7, label="residual")
        if data.held is not None:
            low, high = (side[:, k] for side in data.held)
            axis.fill_between(time, low, high, color="C3", alpha=0.15, linewidth=0, label="static friction")
        if bands is not None:
            axis.fill_between(
                time, -bands[1][:, k], bands[1][:, k], color="C0", alpha=0.2, linewidth=0, label="95 % band"
            )
        axis.set_ylabel(f"{label(robot.joint_names[k])} [{unit}]")
        axis.set_title(f"relative error {format_percent(error)}", fontsize="small", loc="right")
    axes[0].legend(fontsize="small", ncols=5, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
    axes[-1].set_xlabel("time [s]")
    return figure


def plot_parameters(estimate: Estimate) -> Any:
    """Return a figure of the base parameters over their own size: 95 % interval, and the nominal value.

    Raises:
        MissingDependency: matplotlib is not installed.
    """
    half = estimate.half_widths()
    size = np.maximum(np.maximum(np.abs(estimate.beta), half), np.finfo(float).tiny)
    nominal = estimate.model.nominal()
    count = len(estimate.beta)
    figure, axes = _figure(1, height=1.2 + 0.2 * count)
    axis, place = axes[0], np.arange(count)[::-1]
    axis.errorbar(
        estimate.beta / size,
        place,
        xerr=half / size,
        fmt="o",
        markersize=4,
        capsize=2,
        label="identified, 95 % interval",
    )
    if nominal is not None:
        known = estimate.base.from_standard(nominal) / size
        axis.plot(np.clip(known, -3, 3), place, "x", color="0.5", label="robot model (beyond 3: at the edge)")
    axis.axvline(0.0, color="0.7", linewidth=0.8)
    axis.set_yticks(
        place, [f"{shorten(label(name), 40)} [{pretty_unit(unit)}]" for name, unit in _named(estimate)], fontsize=7
    )
    axis.set_xlim(-3.2, 3.2)
    axis.set_xlabel("value, scaled to 1, or to its interval where that is wider")
    axis.legend(fontsize="small", loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False)
    return figure


def plot_friction(estimate: Estimate, joints: Sequence[str] | None = None) -> Any:
    """Return a figure of the friction of each drive over speed: the model over measured less rigid-body torque.

    Args:
        estimate: The estimate.
        joints: Names of the joints; None for all.

    Raises:
        MissingDependency: matplotlib is not installed.
        BadArgument: A joint that the robot does not have, or a model without friction.
        BadOption: Friction that needs a temperature or a state.
    """
    model, robot, data = estimate.model, estimate.model.robot, estimate.train
    columns = _columns(estimate, joints)
    if not model.friction:
        step = 'identify with friction: di.DynamicModel(robot, ["coulomb", "viscous"])'
        raise BadArgument("estimate", "its model has no friction", step)
    theta, coupling = standard_parameters(estimate), np.asarray(robot.coupling)
    kept = slice(None, None, max(1, len(data.time) // MOST_POINTS))
    q, dq = np.asarray(data.q)[kept], np.asarray(data.dq)[kept]
    residual = np.linalg.solve(coupling.T, data.residual[kept].T).T
    cloud, speed = friction_torque(model, theta, q, dq) + residual, dq @ coupling.T
    figure, axes = _figure(len(columns), shared=False)
    for axis, k in zip(axes, columns, strict=True):
        reach = float(np.abs(speed[:, k]).max(initial=0.0)) or 1.0
        grid = np.linspace(-reach, reach, 401)
        motor = np.zeros((len(grid), robot.dof))
        motor[:, k] = grid
        joint = np.linalg.solve(coupling, motor.T).T
        curve = friction_torque(model, theta, np.zeros_like(joint), joint)[:, k]
        axis.plot(speed[:, k], cloud[:, k], ".", color="0.7", markersize=1.5, label="measured less rigid body")
        axis.plot(grid, curve, color="C3", label="friction model")
        axis.set_ylabel(f"{label(robot.joint_names[k])} [{pretty_unit(robot.units[k])}]")
        axis.set_xlabel("speed [rad/s]" if robot.units[k] == "N m" else "speed [m/s]")
    axes[0].legend(fontsize="small", ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
    return figure


def _figure(count: int, height: float = HEIGHT, shared: bool = True) -> tuple[Any, list[Any]]:
    """Return a figure with plots below each other: a notebook shows it once, and no window is left open."""
    try:
        from matplotlib import pyplot
    except ModuleNotFoundError as error:
        raise MissingDependency("a plot", "matplotlib", "plot") from error
    figure = pyplot.figure(figsize=(WIDTH, 0.5 + height * count), layout="constrained")
    pyplot.close(figure)
    axes = figure.subplots(count, 1, sharex=shared, squeeze=False)[:, 0]
    return figure, list(axes)


def _columns(estimate: Estimate, joints: Sequence[str] | None) -> list[int]:
    names = estimate.model.robot.joint_names
    one = isinstance(joints, str) or not isinstance(joints, Sequence | None)
    wanted = names if joints is None else (joints,) if one else tuple(joints)
    for name in wanted:
        if name not in names:
            raise BadArgument(
                "joints", f"{name!r} where the robot has {', '.join(names)}", f"give joints=[{names[0]!r}]"
            )
    return [names.index(name) for name in wanted]


def _named(estimate: Estimate) -> list[tuple[str, str]]:
    return list(zip(estimate.base.names, estimate.base.units, strict=True))
