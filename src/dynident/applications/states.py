"""States of a robot given as arrays: one or many, checked against its joints."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.case.evidence.positions import turns_into_limits
from dynident.errors import BadArgument
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.joint import Joint
from dynident.model.robot import Robot


def motion_of_arrays(
    robot: Robot,
    q: npt.ArrayLike,
    dq: npt.ArrayLike | None = None,
    ddq: npt.ArrayLike | None = None,
    temperature: npt.ArrayLike | None = None,
) -> tuple[Motion, bool]:
    """Return states as a motion of N rows, and whether they were one state of shape (n,).

    Args:
        robot: The robot.
        q: Positions, shape (n,) or (N, n), in rad or m.
        dq: Velocities of the same shape; None for zero.
        ddq: Accelerations of the same shape; None for zero.
        temperature: Of the drives, in degrees Celsius.

    Raises:
        BadArgument: A shape that does not fit, a value that is not finite, or positions in degrees.
    """
    rows = rows_of(robot, "q", q)
    for place, (joint, column) in enumerate(zip(robot.active, rows.T, strict=True)):
        widest, reach = max(abs(joint.limits.lower), abs(joint.limits.upper)), float(np.abs(column).max(initial=0.0))
        if joint.kind == "revolute" and np.isfinite(widest) and reach > max(3.0 * widest, 2.0 * np.pi):
            evidence = f"up to {reach:.4g} at {joint.name}, whose limit is {widest:.4g} rad"
            raise BadArgument("q", evidence, _other_unit(joint, place, column))
    given = {"dq": dq, "ddq": ddq, "temperature": temperature}
    others = {name: None if values is None else rows_of(robot, name, values) for name, values in given.items()}
    for name, values in others.items():
        if values is not None and values.shape != rows.shape:
            seen = np.shape(given[name])  # type: ignore[arg-type]
            raise BadArgument(name, f"shape {seen} where q has {np.shape(q)}", f"give {name} like q")
    still = np.zeros_like(rows)
    speed, rate = (still if others[name] is None else others[name] for name in ("dq", "ddq"))
    return Motion(rows, speed, rate, temperature=others["temperature"]), np.ndim(q) == 1  # type: ignore[arg-type]


def _other_unit(joint: Joint, place: int, column: Array) -> str:
    """Return what to do about positions (N,) of a joint far beyond its limits: whole turns too many, or degrees."""
    degrees, limits = "if it is in degrees write q = np.deg2rad(q)", joint.limits
    shift = turns_into_limits(joint, float(column.min()), float(column.max()))
    turns = round(-shift / (2.0 * np.pi))
    if not turns or column.min() + shift < limits.lower or column.max() + shift > limits.upper:
        return degrees
    many = "one turn" if abs(turns) == 1 else f"{abs(turns)} turns"
    step = f"q[..., {place}] {'-+'[turns < 0]}= {2 * abs(turns)} * np.pi"
    return f"they are {many} off, as np.unwrap may leave them: write {step}; {degrees}"


def rows_of(robot: Robot, name: str, values: npt.ArrayLike) -> Array:
    """Return values of all joints, of one state (n,) or of many (N, n), as rows (N, n).

    Raises:
        BadArgument: A shape that does not fit, or a value that is not finite.
    """
    array = plain_numbers(name, values)
    n = robot.dof
    if array.ndim not in (1, 2) or array.shape[-1] != n:
        turned = array.ndim == 2 and array.shape[0] == n
        step = f"write {name}.T" if turned else f"give one number for each of the {n} joints: ({n},) or (N, {n})"
        raise BadArgument(name, f"shape {array.shape} where ({n},) or (N, {n}) is wanted", step)
    return np.ascontiguousarray(np.atleast_2d(array))


def theta_or_nominal(model: DynamicModel, theta: npt.ArrayLike | None) -> Array:
    """Return standard parameters, shape (p,), those of the robot model where none are given.

    Raises:
        BadArgument: A wrong number of them, or a robot model without inertias.
    """
    found = model.nominal() if theta is None else np.asarray(theta, dtype=float)
    if found is None:
        step = "give standard parameters: estimate.base.to_standard(estimate.beta)"
        raise BadArgument("theta", "not given, and the robot model states no inertias", step)
    if found.shape != (len(model.parameters),):
        step = "give one number for each of model.parameters; for base parameters base.to_standard(beta)"
        raise BadArgument("theta", f"shape {found.shape} where ({len(model.parameters)},) is wanted", step)
    return found


def plain_numbers(name: str, values: Any) -> Array:
    """Return values as an array of finite numbers.

    Raises:
        BadArgument: Values that are masked, complex, no numbers, or not finite.
    """
    hidden = np.ma.getmaskarray(values) if isinstance(values, np.ma.MaskedArray) else np.zeros(1, dtype=bool)
    if isinstance(values, np.ndarray) and np.iscomplexobj(values):
        raise BadArgument(name, "complex numbers", f"give their real part: np.real({name})")
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError, RuntimeError) as error:
        evidence = f"{type(values).__name__} that is no array of numbers"
        step = f"give rows of equal length: np.asarray({name}, dtype=float)"
        if hasattr(values, "__array__") and not isinstance(values, np.ndarray) and not hasattr(values, "columns"):
            step = f"its own message: {error}"  # of a tensor that is not in the memory of the computer
        raise BadArgument(name, evidence, step) from None
    for bad, what in ((hidden, "masked"), (~np.isfinite(array), "not finite")):
        if bad.any():
            row = int(np.argmax(bad.reshape(len(bad), -1).any(axis=1))) if bad.ndim else 0
            step = f"keep the other rows, of all signals: keep = np.isfinite(np.ma.filled({name}, np.nan)).all(axis=-1)"
            evidence = f"shape {array.shape} with {int(bad.sum())} values that are {what}, first in row {row}"
            raise BadArgument(name, evidence, step)
    return array
