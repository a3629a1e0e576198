"""Friction of the drives in C or Python: one expression a coefficient, at the motion of each motor."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.exports.models.writing.expressions import Dialect
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Friction

#: Names of the inputs of an expression: motion and temperature of the motor, its torque without friction, and how far
#: it has moved since the last sample and for how long. States are z0, z1 and so on in the order of all parts.
INPUTS: Final = {"q": "x", "dq": "v", "ddq": "a", "load": "load", "temperature": "warm", "moved": "moved", "step": "dt"}


def c_dialect(upper: str) -> Dialect:
    """Return how a C header with some prefix, in capitals, writes it."""
    sign = f"{upper}_F(sign_)({{value}}, {{width}}, scale)"
    declaration = f"const {upper}_REAL {{name}} = {{value}};"
    return Dialect(f"{upper}_C({{}})", f"{upper}_M({{}})", sign, sign, declaration, "memory->state", "the C header")


@dataclass(frozen=True)
class DriveTerm:
    """One friction coefficient of one drive.

    Attributes:
        drive: Number of the drive.
        column: Its column in the standard parameters.
        is_inertia: Whether it is a rotor inertia, which the functions of the bodies hold.
        symbol: Its symbol.
        value: Its value.
        expression: What it is multiplied with, in C.
    """

    drive: int
    column: int
    is_inertia: bool
    symbol: str
    value: float
    expression: str

    def uses(self, name: str) -> bool:
        """Say whether the expression reads a variable."""
        return re.search(rf"\b{name}\b", self.expression) is not None


@dataclass(frozen=True)
class StateUpdate:
    """A state of friction, one for each drive.

    Attributes:
        start: Its value at the first sample.
        expression: Its value at a sample, by those at the sample before and the way since then.
    """

    start: float
    expression: str


def state_updates(model: DynamicModel, spelt: Dialect) -> tuple[StateUpdate, ...]:
    """Return the states of all friction parts in their order.

    Args:
        model: The model.
        spelt: The language.

    Raises:
        BadOption: A state that depends on more than the positions on the way to a sample and the time.
    """
    found: list[StateUpdate] = []
    for part in model.friction:
        names, programs = _names(model, part), part.expression.updates
        if more := {array for program in programs for array in program.arrays} - {"state", "moved", "step"}:
            evidence = f"{FRICTION.name_of(part)}, whose state depends on {', '.join(sorted(more))}"
            step = f"{spelt.target} keeps states of positions and the time; identify without it, or export to json"
            raise BadOption("friction", evidence, step)
        texts = [spelt.expression(program, names) for program in programs]
        found += [StateUpdate(state.start, text) for state, text in zip(part.states, texts, strict=True)]
    return tuple(found)


def _names(model: DynamicModel, part: Friction) -> dict[str, tuple[str, ...]]:
    """Return the names of what the expressions of a part read, entry by entry of each array."""
    before = sum(len(other.states) for other in model.friction[: model.friction.index(part)])
    states = tuple(f"z{before + k}" for k in range(len(part.states)))
    return {array: (name,) for array, name in INPUTS.items()} | {"state": states}


def drive_terms(model: DynamicModel, theta: Array, spelt: Dialect) -> tuple[DriveTerm, ...]:
    """Return every friction coefficient with its expression, drive by drive.

    Args:
        model: The model.
        theta: Standard parameters, shape (p,).
        spelt: The language.
    """
    parts = model.friction
    owners = [(part, k) for part in parts for k in range(len(part.coefficients))]
    texts = [spelt.expression(one, _names(model, part)) for part in parts for one in part.expression.programs]
    found = []
    for position, (drive, column) in enumerate(zip(*model.terms, strict=True)):
        part, k = owners[int(column)]
        place, symbol = model.inertial_count + position, part.coefficients[k].symbol
        value = float(np.asarray(theta)[place])
        found.append(DriveTerm(int(drive), place, part.is_inertia[k], symbol, value, texts[int(column)]))
    return tuple(found)


def combination(factors: Array, array: str, spelt: Dialect) -> str:
    """Return the sum of factors (n,) times the entries of an array."""
    terms = []
    for i, factor in enumerate(np.asarray(factors).tolist()):
        if factor == 1.0:
            terms.append(f"{array}[{i}]")
        elif factor:
            terms.append(f"{spelt.constant(factor)} * {array}[{i}]")
    return " + ".join(terms) or spelt.constant(0.0)


def motor_lines(model: DynamicModel, drive: int, terms: Sequence[DriveTerm], spelt: Dialect) -> Iterator[str]:
    """Yield the declarations of what the terms of one drive read."""
    coupling = np.asarray(model.robot.coupling)
    at_motor = np.linalg.inv(coupling.T)[drive]
    at_motor = np.where(np.abs(at_motor) < 1e-15 * np.abs(at_motor).max(), 0.0, at_motor)  # rounding of the inverse
    readings = (("x", "q", coupling[drive]), ("v", "dq", coupling[drive]), ("a", "ddq", coupling[drive]))
    for name, array, factors in (*readings, ("load", "rigid", at_motor)):
        if any(term.uses(name) for term in terms):
            yield spelt.variable.format(name=name, value=combination(factors, array, spelt))
    if any(term.uses("warm") for term in terms):
        yield spelt.variable.format(name="warm", value=f"temperature[{drive}]")
    states = sum(len(part.states) for part in model.friction)
    for k in range(states):
        if any(term.uses(f"z{k}") for term in terms):
            yield spelt.variable.format(name=f"z{k}", value=f"{spelt.states}[{states * drive + k}]")
