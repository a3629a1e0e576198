"""SymbolicModel: regressor, gravity torque and base parameters of an arm of up to three joints as SymPy expressions.

The equations are those that the compiled kernels run (``model/kernels/recursion.py``), traced once and written out over
symbols in place of numbers. Columns are those of the base parameters, so that tau = Y beta + known torque.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from dynident.applications.symbolic.expressions import (
    ROUNDING,
    expression_of,
    friction_term,
    number,
    symbols_of,
    sympy_module,
)
from dynident.applications.symbolic.harmonic_sum import HarmonicEvaluator
from dynident.errors import BadOption
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction
from dynident.model.kernels.recursion import TracedChain
from dynident.model.robot import Robot

#: Joints of the largest arm whose equations are written out.
MOST_JOINTS: Final = 3

#: A coefficient below this share of the largest of its entry comes from an angle that the robot model rounds.
_WEAK: Final = 1e-4


@dataclass(frozen=True, repr=False)
class SymbolicModel:
    """The equations of an arm over SymPy symbols.

    Attributes:
        model: Robot, drives and friction.
        base: Its base parameters.
        q: Symbols of the positions, n of them: q1, q2, ...
        dq: Symbols of the velocities.
        ddq: Symbols of the accelerations.
        beta: Symbols of the base parameters, b of them: beta1, beta2, ... as numbered by ``dynident inspect``.
        regressor: Y of the base parameters, a SymPy matrix (n, b).
        weak_terms: Number of terms with a coefficient below 1e-4 of the largest of their entry, as angles leave that
            the robot model rounds (1.5708 for a right angle).
    """

    model: DynamicModel
    base: BaseParameters
    q: tuple[Any, ...]
    dq: tuple[Any, ...]
    ddq: tuple[Any, ...]
    beta: tuple[Any, ...]
    regressor: Any
    weak_terms: int

    def __repr__(self) -> str:
        return f"<SymbolicModel of {self.model.robot.name}: {len(self.q)} joints, {len(self.beta)} base parameters>"

    @staticmethod
    def text(expression: Any) -> str:
        """Return an expression as SymPy reads it, numbers without trailing zeros."""
        return sympy_module().sstr(expression, full_prec=False)

    @cached_property
    def gravity(self) -> Any:
        """The gravity torque Y(q, 0, 0) beta of the bodies, a SymPy matrix (n, 1)."""
        still = dict.fromkeys((*self.dq, *self.ddq), 0)
        bodies = self.regressor[:, : int(np.sum(self.base.independent < self.model.inertial_count))]
        return bodies.subs(still) * sympy_module().Matrix(self.beta[: bodies.shape[1]])

    @cached_property
    def known_torque(self) -> Any:
        """Torque of the known rotor inertias less the drives' bias, which no base parameter has, (n, 1)."""
        sympy, robot = sympy_module(), self.model.robot
        rotors = sympy.Matrix([[number(value) for value in row] for row in robot.reflected_inertia.tolist()])
        return rotors * sympy.Matrix(self.ddq) - sympy.Matrix([number(value) for value in robot.bias.tolist()])

    @cached_property
    def torque(self) -> Any:
        """The torque of the drives, Y beta + known torque, a SymPy matrix (n, 1)."""
        return self.regressor * sympy_module().Matrix(self.beta) + self.known_torque

    @cached_property
    def combinations(self) -> tuple[Any, ...]:
        """Each base parameter over the standard parameters, whose symbols are their names: ``Izz[link1]``."""
        sympy = sympy_module()
        names = [sympy.Symbol(parameter.name, real=True) for parameter in self.base.parameters]
        kept = np.where(self.base.matters, self.base.matrix, 0.0)
        return tuple(
            sympy.Add(*(number(value, 12) * name for value, name in zip(row, names, strict=True) if value))
            for row in kept.tolist()
        )


def symbolic_model(subject: DynamicModel | Robot) -> SymbolicModel:
    """Return the equations of an arm as SymPy expressions.

    Args:
        subject: A dynamic model, or a robot, whose equations are then without friction.

    Raises:
        MissingDependency: SymPy is not installed (extra ``symbolic``).
        BadOption: An arm of more than three joints.
    """
    model = DynamicModel(subject) if isinstance(subject, Robot) else subject
    joints = model.robot.dof
    if joints > MOST_JOINTS:
        step = (
            f"{model.robot.name} has {joints} joints, and expressions are written for {MOST_JOINTS} at most: lock the "
            "others (locked: in the case file, Robot.locked in Python), or export functions: export --to casadi"
        )
        raise BadOption("symbolic", model.robot.name, step)
    sympy, base = sympy_module(), base_parameters(model)
    symbols = {array: symbols_of(array, joints) for array in HarmonicEvaluator.ARRAYS}
    table = sympy.zeros(joints, base.count)
    weak = 0
    chosen = base.independent.tolist()
    traced = TracedChain(model.robot.chain)
    bodies = [column for column in chosen if column < model.inertial_count]
    for slot, value in HarmonicEvaluator(joints).run(traced.trace.program(traced.regressor(bodies))).items():
        entry = value.without(ROUNDING)
        weak += entry.count_below(_WEAK)
        joint, column = divmod(slot, model.inertial_count)
        table[joint, chosen.index(column)] = expression_of(entry, symbols)
    for place, column in enumerate(chosen[len(bodies) :], start=len(bodies)):
        for joint, value in enumerate(_friction_column(model, column - model.inertial_count, symbols)):
            table[joint, place] = value
    beta = symbols_of("beta", base.count)
    return SymbolicModel(
        model, base, symbols["q"], symbols["dq"], symbols["ddq"], beta, sympy.ImmutableMatrix(table), weak
    )


def _friction_column(model: DynamicModel, place: int, symbols: dict[str, tuple[Any, ...]]) -> list[Any]:
    """Return a column of a friction coefficient by joint: C' times its value at its motor."""
    sympy = sympy_module()
    drive, column = (int(own[place]) for own in model.terms)
    coupling = [[number(value) for value in row] for row in np.asarray(model.robot.coupling).tolist()]
    moved = {
        array: sympy.Add(*(factor * symbol for factor, symbol in zip(coupling[drive], own, strict=True)))
        for array, own in symbols.items()
    }
    part, own = _part_of(model, column)
    value = friction_term(part.expression.programs[own], moved, drive)
    return [coupling[drive][joint] * value for joint in range(model.robot.dof)]


def _part_of(model: DynamicModel, column: int) -> tuple[Friction, int]:
    """Return the friction part of a column, and which of its coefficients it is."""
    for part in model.friction:
        if column < len(part.coefficients):
            return part, column
        column -= len(part.coefficients)
    raise AssertionError("the model has no such column")
