"""Friction of the drives in C or Python: one expression a coefficient, at the speed of each motor."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Friction

#: One expression for each coefficient of a part: x, v, a are position, speed and acceleration of the motor, ``load``
#: its torque without friction, ``warm`` its temperature; ``SIGN``, ``POWER`` and options in braces are filled in.
TERMS: Final = {
    "coulomb": ("{SIGN}",),
    "viscous": ("v",),
    "offset": ("{ONE}",),
    "asymmetric": ("{MAX}({SIGN}, {ZERO})", "{MIN}({SIGN}, {ZERO})"),
    "stribeck": ("{EXP}(-{POWER}) * {SIGN}",),
    "load": ("{ABS}(load) * {SIGN}",),
    "degressive": ("v * {POW}(v * v + {width} * {width}, ({exponent} - {ONE}) / {TWO})",),
    "polynomial": ("{ABS}(v) * v", "v * v * v"),
    "periodic": (
        "{SIN}({cycles} * x)",
        "{COS}({cycles} * x)",
        "{SIN}({TWO} * {cycles} * x)",
        "{COS}({TWO} * {cycles} * x)",
    ),
    "temperature": ("(warm - {reference}) * {SIGN}", "(warm - {reference}) * v"),
    "rotor_inertia": ("a",),
}


@dataclass(frozen=True)
class Dialect:
    """How a language writes what friction needs; ``{}`` stands for the content.

    Attributes:
        number: A constant.
        call: A function of the mathematical library.
        sign: The sign of the speed v, ``{}`` the width over which it turns.
        variable: A declaration, ``{name}`` and ``{value}``.
        target: What is exported, for messages.
        names: Functions with other names than in C.
    """

    number: str
    call: str
    sign: str
    variable: str
    target: str
    names: Mapping[str, str] = field(default_factory=dict)

    def constant(self, value: float) -> str:
        """Return a number, to the last bit."""
        return self.number.format(repr(float(value) + 0.0))

    def function(self, name: str) -> str:
        """Return a function by its name in C."""
        return self.call.format(self.names.get(name, name))


def c_dialect(upper: str) -> Dialect:
    """Return how a C header with some prefix, in capitals, writes it."""
    sign = f"{upper}_F(sign_)(v, {{}}, scale)"
    declaration = f"const {upper}_REAL {{name}} = {{value}};"
    return Dialect(f"{upper}_C({{}})", f"{upper}_M({{}})", sign, declaration, "the C header")


@dataclass(frozen=True)
class DriveTerm:
    """One friction coefficient of one drive.

    Attributes:
        drive: Number of the drive.
        column: Its column in the standard parameters.
        part: Name of the friction part.
        symbol: Its symbol.
        value: Its value.
        expression: What it is multiplied with, in C.
    """

    drive: int
    column: int
    part: str
    symbol: str
    value: float
    expression: str

    def uses(self, name: str) -> bool:
        """Say whether the expression reads a variable."""
        return re.search(rf"\b{name}\b", self.expression) is not None


def drive_terms(model: DynamicModel, theta: Array, spelt: Dialect) -> tuple[DriveTerm, ...]:
    """Return every friction coefficient with its expression, drive by drive.

    Args:
        model: The model.
        theta: Standard parameters, shape (p,).
        spelt: The language.

    Raises:
        BadOption: A part whose formula the export does not know.
    """
    parts = [(part, k) for part in model.friction for k in range(len(part.coefficients))]
    found = []
    for position, (drive, column) in enumerate(zip(*model.terms, strict=True)):
        part, k = parts[int(column)]
        name = FRICTION.name_of(part)
        if name not in TERMS:
            step = f"{spelt.target} knows {', '.join(sorted(TERMS))}; export to json, which holds every part"
            raise BadOption("friction", name, step)
        place = model.inertial_count + position
        text = _filled(TERMS[name][k], part, spelt)
        found.append(
            DriveTerm(int(drive), place, name, part.coefficients[k].symbol, float(np.asarray(theta)[place]), text)
        )
    return tuple(found)


def _filled(term: str, part: Friction, spelt: Dialect) -> str:
    numbers = {key: float(value) for key, value in vars(part).items() if isinstance(value, float | int)}
    words = {name: spelt.function(call) for name, call in _CALLS.items()}
    words |= {"ONE": spelt.constant(1.0), "TWO": spelt.constant(2.0), "ZERO": spelt.constant(0.0)}
    words |= {key: spelt.constant(value) for key, value in numbers.items()}
    words["SIGN"] = spelt.sign.format(spelt.constant(numbers.get("width", 0.0)))
    share = f"{words['ABS']}(v) / {words.get('velocity', '')}"
    whole = {1.0: f"({share})", 2.0: f"({share}) * ({share})"}
    exponent = numbers.get("exponent", 1.0)
    words["POWER"] = whole.get(exponent, f"{words['POW']}({share}, {spelt.constant(exponent)})")
    return term.format(**words)


_CALLS: Final = {
    "ABS": "fabs",
    "COS": "cos",
    "EXP": "exp",
    "MAX": "fmax",
    "MIN": "fmin",
    "POW": "pow",
    "SIN": "sin",
}


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
