"""SymbolicModel: regressor, gravity torque and base parameters of an arm of up to three joints as SymPy expressions.

The equations are those that the compiled kernels run (``model/kernels/recursion.py``), traced once and written out over
symbols in place of numbers. Columns are those of the base parameters, so that tau = Y beta + known torque.
"""

from __future__ import annotations

import importlib
import operator
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import prod
from typing import Any, Final

import numpy as np

from dynident.applications.symbolic.harmonic_sum import HarmonicEvaluator, HarmonicSum
from dynident.arrays import Array
from dynident.errors import BadOption, MissingDependency
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction
from dynident.model.kernels.recursion import TracedChain
from dynident.model.kernels.trace import Node, TracedProgram
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


#: Coefficients below this share of the largest of an expression are rounding of double precision.
ROUNDING: Final = 1e-13

#: Inputs of friction parts beside the motion, and their symbols.
_SIGNALS: Final = {"load": "load", "temperature": "T", "state": "z"}

#: Coefficients of sines and cosines by the frequency of each joint.
Waves = Mapping[tuple[float, ...], complex]


def sympy_module() -> Any:
    """Return the module sympy.

    Raises:
        MissingDependency: It is not installed.
    """
    try:
        return importlib.import_module("sympy")
    except ImportError as problem:
        raise MissingDependency("equations as expressions", "sympy", "symbolic") from problem


def symbols_of(name: str, count: int) -> tuple[Any, ...]:
    """Return real symbols of a name, numbered from 1."""
    sympy = sympy_module()
    return tuple(sympy.Symbol(f"{name}{k}", real=True) for k in range(1, count + 1))


def number(value: float, digits: int = 14) -> Any:
    """Return a number without the last digits, which are rounding; a whole one as an integer."""
    sympy, plain = sympy_module(), float(f"{value:.{digits}g}")
    return sympy.Integer(int(plain)) if plain.is_integer() else sympy.Float(plain)


def expression_of(subject: HarmonicSum, symbols: Mapping[str, tuple[Any, ...]]) -> Any:
    """Return a harmonic sum as an expression, terms with the same powers together.

    Args:
        subject: The sum.
        symbols: Symbols of ``q``, ``dq`` and ``ddq``.
    """
    sympy = sympy_module()
    variables = [symbol for array in HarmonicEvaluator.ARRAYS for symbol in symbols[array]]
    groups: dict[tuple[int, ...], dict[tuple[float, ...], complex]] = {}
    for term, value in subject.terms.items():
        groups.setdefault(term.powers, {})[term.frequencies] = value
    found = []
    for powers, waves in groups.items():
        factor = sympy.Mul(*(symbol**power for symbol, power in zip(variables, powers, strict=True) if power))
        found.append(factor * _shortest(waves, symbols["q"]))
    return sympy.Add(*found)


def _shortest(waves: Waves, q: tuple[Any, ...]) -> Any:
    """Return sines and cosines of sums of angles, or their products joint by joint where these are fewer."""
    sums, products = _sums(waves, q), _products(waves, q)
    return sympy_module().Add(*(products if len(products) < len(sums) else sums))


def _sums(waves: Waves, q: tuple[Any, ...]) -> list[Any]:
    """Return the terms with sines and cosines of sums of angles."""
    constant = sum(value.real for rates, value in waves.items() if not any(rates))
    upper = {rates: 2.0 * value for rates, value in waves.items() if next((k for k in rates if k), 0.0) > 0}
    return _one_angle(constant, ((_angle(rates, q), value.real, -value.imag) for rates, value in upper.items()))


def _one_angle(constant: float, waves: Iterable[tuple[Any, float, float]]) -> list[Any]:
    """Return c + sum a cos + b sin as terms; a constant and a cosine of the same size become a square.

    Args:
        constant: c.
        waves: Angle, a and b each.
    """
    sympy, found = sympy_module(), []
    for angle, cosine, sine in waves:
        floor = ROUNDING * max(abs(cosine), abs(sine))
        if constant and abs(abs(cosine) - abs(constant)) <= ROUNDING * abs(constant):
            wave = sympy.cos if cosine * constant > 0 else sympy.sin  # c + c cos a = 2 c cos(a/2)^2
            found.append(number(2.0 * constant) * wave(angle / 2) ** 2)
            constant = 0.0
        elif abs(cosine) > floor:
            found.append(number(cosine) * sympy.cos(angle))
        if abs(sine) > floor:
            found.append(number(sine) * sympy.sin(angle))
    return found + ([number(constant)] if constant else [])


def _angle(rates: Iterable[float], q: tuple[Any, ...]) -> Any:
    return sympy_module().Add(*(number(rate) * joint for rate, joint in zip(rates, q, strict=True)))


def _products(waves: Waves, q: tuple[Any, ...]) -> list[Any]:
    """Return the terms with a sine or cosine of each joint's own angle; one where they are a single product."""
    sympy = sympy_module()
    speeds = [sorted({abs(rates[joint]) for rates in waves}) for joint in range(len(q))]
    table = _product_table(waves, speeds)
    factors = _rank_one(table)
    if factors is not None:
        terms = []
        for joint, factor, own in zip(q, factors, speeds, strict=True):
            constant = factor[0] if own[0] == 0.0 else 0.0
            turning = [(number(rate) * joint, *factor[2 * k : 2 * k + 2]) for k, rate in enumerate(own) if rate]
            terms.append(sympy.Add(*_one_angle(float(constant), turning)))
        size, wave = sympy.Mul(*terms).as_coeff_Mul()
        return [number(float(size)) * wave]
    floor, found = ROUNDING * np.abs(table).max(), []
    for place in np.argwhere(np.abs(table) > floor):
        parts = [number(float(table[tuple(place)]))]
        for joint, entry, own in zip(q, place.tolist(), speeds, strict=True):
            angle = number(own[entry // 2]) * joint
            parts.append(sympy.sin(angle) if entry % 2 else sympy.cos(angle))
        found.append(sympy.Mul(*parts))
    return found


def _product_table(waves: Waves, speeds: list[list[float]]) -> Array:
    """Return coefficients of products: per joint an axis with cosine and sine of each of its speeds in turn."""
    table = np.zeros([2 * len(own) for own in speeds], dtype=complex)
    for rates, value in waves.items():  # exp(i k q) = product of cos(|k_j| q_j) + i sign(k_j) sin(|k_j| q_j)
        for kinds in product((0, 1), repeat=len(rates)):
            if any(kind and not rate for kind, rate in zip(kinds, rates, strict=True)):
                continue
            place = [2 * own.index(abs(rate)) + kind for own, rate, kind in zip(speeds, rates, kinds, strict=True)]
            turn = prod(1j * np.sign(rate) for kind, rate in zip(kinds, rates, strict=True) if kind)
            table[tuple(place)] += value * turn
    return np.ascontiguousarray(np.real(table), dtype=float)


def _rank_one(table: Array) -> list[Array] | None:
    """Return vectors whose outer product a table is, or None; all but the first have the largest entry 1."""
    peak = np.unravel_index(np.argmax(np.abs(table)), table.shape)
    factors = []
    for axis in range(table.ndim):
        line = table[(*peak[:axis], slice(None), *peak[axis + 1 :])]
        factors.append(np.array(line) if axis == 0 else line / table[peak])
    whole = factors[0]
    for factor in factors[1:]:
        whole = np.multiply.outer(whole, factor)
    return factors if np.abs(whole - table).max() <= ROUNDING * abs(table[peak]) else None


def friction_term(program: TracedProgram, moved: Mapping[str, Any], drive: int) -> Any:
    """Return the one output of a program of a friction part at a drive.

    Args:
        program: The program.
        moved: Expressions of ``q``, ``dq`` and ``ddq`` of the drive.
        drive: Number of the drive, from 0.
    """
    sympy = sympy_module()
    found: list[Any] = []
    for node in program.nodes:
        if node.source is not None:
            array, entry = node.source
            signal = f"{_SIGNALS.get(array, array)}{drive + 1}{f'_{entry + 1}' if array == 'state' else ''}"
            found.append(moved[array] if array in moved else sympy.Symbol(signal, real=True))
        else:
            found.append(_applied(node, [found[k] for k in node.operands]))
    return found[program.outputs[0]]


def _applied(node: Node, operands: list[Any]) -> Any:
    """Return what an operation of ``model/kernels/operations.py`` gives for expressions."""
    sympy, (one, other) = sympy_module(), (*operands, 0, 0)[:2]
    if node.operation == "turn":
        return sympy.tanh(number(1.0 / node.value) * one) if node.value else sympy.sign(one)
    if node.operation in _CONDITIONS:
        value, condition, otherwise = _CONDITIONS[node.operation](sympy, one, other)
        return sympy.Piecewise((value, condition), (otherwise, True))
    if node.operation in _SIGNS:
        return _SIGNS[node.operation](one, other)
    if node.operation in ("const", "pow"):
        return number(node.value) if node.operation == "const" else one ** number(node.value)
    return getattr(sympy, _NAMES.get(node.operation, node.operation))(*operands)


_SIGNS: Final[dict[str, Any]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "neg": lambda one, _: -one,
}

#: Functions that SymPy calls otherwise.
_NAMES: Final = {"abs": "Abs", "max": "Max", "min": "Min"}

#: A value, where it holds, and the value elsewhere.
_CONDITIONS: Final[dict[str, Any]] = {
    "side": lambda _, one, other: (1, one >= 0, -1),
    "greater": lambda _, one, other: (1, one > other, 0),
    "ratio": lambda sympy, one, other: (one / other, sympy.Ne(other, 0), 0),
}
