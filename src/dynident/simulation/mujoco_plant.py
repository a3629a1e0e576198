"""The bodies of a virtual cell in MuJoCo: an independent plant under the same drives, controller and steps."""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, MissingDependency, NotConsistent
from dynident.model.inertia import Inertia
from dynident.model.kernels.jit import compiled
from dynident.model.robot import Robot
from dynident.simulation.cell_loop import advance, closed_cell, load_joints
from dynident.simulation.cell_plant import CellPlant


def mujoco_loop(body: CellPlant) -> Callable[..., Any]:
    """Return the loop of the cell, interpreted, with mass matrix and bias torque from MuJoCo.

    All but the bodies is the code of the compiled loop: drives, friction, springs, controller, Runge-Kutta steps.

    Raises:
        BadOption: Joints that follow others, which this plant does not have.
        MissingDependency: MuJoCo is not installed.
        NotConsistent: MuJoCo refuses the bodies.
    """
    bodies, load = MujocoBodies(body.robot, body.inertial), _called(load_joints)

    def slope(tables: Any, drives: Any, state: Array, torque: Array, rise: Array, rate: Array, scratch: Any) -> bool:
        load(tables, drives, state, torque, rise, rate, scratch[1])
        mass, bias = bodies.dynamics(state[0], state[1])
        rate[1] = np.linalg.solve(mass + tables[4], rate[1] - bias)
        return True

    return _with(closed_cell, {"advance": _with(advance, {"slope": slope})})


class MujocoBodies:
    """The links of a robot as a MuJoCo model, without its own damping, friction and limits."""

    def __init__(self, robot: Robot, inertial: Array) -> None:
        if any(joint.mimic is not None for joint in robot.joints):
            raise BadOption("plant", "mujoco", "this robot has joints that follow others; take the plant 'own'")
        try:
            import mujoco
        except ImportError as error:
            raise MissingDependency("the plant 'mujoco'", "mujoco", "mujoco") from error
        self._mujoco: Any = mujoco
        try:
            self._model = self._mujoco.MjModel.from_xml_string(mjcf(robot, inertial))
        except ValueError as error:
            why = " ".join(str(error).split())
            raise NotConsistent(
                f"robot '{robot.name}'", why, "use the plant 'own', or physically consistent links"
            ) from error
        self._data = self._mujoco.MjData(self._model)

    def dynamics(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Return the mass matrix (n, n) and the torque of gravity and velocity (n,) at q and dq, each (n,)."""
        self._data.qpos[:], self._data.qvel[:] = q, dq
        self._mujoco.mj_forward(self._model, self._data)
        mass = np.zeros((len(q), len(q)))
        self._mujoco.mj_fullM(self._model, self._data, mass)
        return mass, self._data.qfrc_bias.copy()


def mjcf(robot: Robot, inertial: Array) -> str:
    """Return the links of a robot with the inertial parameters (10 l,) as the text of an MJCF model."""
    children: dict[int, list[int]] = {}
    for i, joint in enumerate(robot.joints):
        children.setdefault(joint.parent, []).append(i)

    def body(i: int) -> str:
        joint, inertia = robot.joints[i], Inertia.from_vector(inertial[10 * i : 10 * i + 10])
        about = inertia.about_centre
        full = (about[0, 0], about[1, 1], about[2, 2], about[0, 1], about[0, 2], about[1, 2])
        kind = "hinge" if joint.kind == "revolute" else "slide"
        rotation = np.asarray(joint.rotation)
        axes = (*rotation[:, 0], *rotation[:, 1])
        return (
            f'<body pos="{_numbers(joint.translation)}" xyaxes="{_numbers(axes)}">'
            f'<joint type="{kind}" axis="{_numbers(joint.axis)}"/>'
            f'<inertial mass="{inertia.mass:.17g}" pos="{_numbers(inertia.centre_of_mass)}" '
            f'fullinertia="{_numbers(full)}"/>{"".join(map(body, children.get(i, [])))}</body>'
        )

    return (
        '<mujoco><compiler angle="radian" autolimits="false"/>'
        f'<option gravity="{_numbers(robot.gravity)}"><flag contact="disable"/></option>'
        f"<worldbody>{''.join(map(body, children.get(-1, [])))}</worldbody></mujoco>"
    )


def _numbers(values: Sequence[float] | Array) -> str:
    return " ".join(f"{float(value):.17g}" for value in values)


def _with(function: Any, names: Mapping[str, Callable[..., Any]]) -> Callable[..., Any]:
    """Return the Python function behind a compiled one, with other functions for some that it calls."""
    plain = function.py_func
    calls = {name: part for name in plain.__code__.co_names if hasattr(part := plain.__globals__.get(name), "py_func")}
    parts = {name: _called(part) for name, part in calls.items() if name not in names}
    return types.FunctionType(plain.__code__, {**plain.__globals__, **parts, **names}, plain.__name__)


@cache
def _called(part: Any) -> Any:
    """Return a part of compiled functions so that Python may call it."""
    return compiled(part.py_func)
