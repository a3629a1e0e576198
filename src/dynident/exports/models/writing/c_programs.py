"""The functions of a C header that are unrolled: traced for one robot, its parameters folded in as constants.

Friction of the drives is one expression a coefficient, at the motion of each motor, in C or Python.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, SolverFailed
from dynident.exports.models.writing.expressions import Dialect
from dynident.identification.estimate.estimate import Estimate
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Friction
from dynident.model.kernels import batched
from dynident.model.kernels.recursion import TracedChain
from dynident.model.kernels.trace import Number, TracedProgram, gradient

#: Operations of all functions together above which no header is written: compilers take minutes for more.
LARGEST = 120_000

#: Largest difference of a torque, relative to the largest, with which base parameters stand for the bodies.
SAME = 1e-10

_SIGNS: Final = {"add": "+", "sub": "-", "mul": "*"}


def folded(model: DynamicModel, theta: Array) -> Array:
    """Return inertial parameters (10 l,) with the same torques and as many zeros as there can be.

    They are the base parameters of the bodies alone, so that the torque of bodies and of drives stay apart. Where axes
    that were meant to be parallel are not quite, the two differ and the parameters stay as they are.
    """
    own = np.asarray(theta, dtype=float)[: model.inertial_count]
    try:
        base = base_parameters(replace(model, friction=()), inertial_only=True)
    except SolverFailed:
        return own
    short = base.to_standard(base.from_standard(own))
    motion, chain = model.random_motion(50, seed=3), model.robot.chain
    full, found = (batched.inverse_dynamics(chain, values, motion.q, motion.dq, motion.ddq) for values in (own, short))
    away, size = np.abs(found - full).max(axis=0), np.abs(full).max(axis=0)
    return short if np.all(away <= SAME * np.maximum(size, 1e-9 * size.max(initial=0.0))) else own


def programs_of(model: DynamicModel, theta: Array, estimate: Estimate | None) -> dict[str, TracedProgram]:
    """Return the traced functions by name.

    ``rigid``: M ddq + c + g with the rotors. ``gravity``, ``coriolis``: parts of it. ``mass_matrix``: M, row-major.
    ``momentum``: M dq, then C' dq = 1/2 d(dq' M dq)/dq. ``bodies``: inertial columns of the regressor, row-major in
    all b columns; only with an estimate.

    Args:
        model: The model.
        theta: Standard parameters, shape (p,).
        estimate: Whose base parameters the regressor has; None for no regressor.

    Raises:
        BadOption: The functions are too long.
    """
    if len(model.robot.links) > 60:
        raise _too_long(f"{len(model.robot.links)} links")
    chain, inertial = model.robot.chain, folded(model, theta)
    floating = replace(chain, gravity=np.zeros(3))
    rotors = rotor_matrix(model, theta)
    size = chain.joints

    rigid = TracedChain(chain, inertial)
    gravity = TracedChain(chain, inertial, {"dq": "", "ddq": ""})
    coriolis = TracedChain(floating, inertial, {"ddq": ""})
    mass = TracedChain(floating, inertial)
    entries = mass.mass()
    for slot, value in enumerate(rotors.ravel().tolist()):
        entries[slot] = entries.get(slot, 0.0) + value
    found = {
        "rigid": rigid.trace.program(_with_rotors(rigid, rigid.torque(), rotors, "ddq")),
        "gravity": gravity.trace.program(gravity.torque()),
        "coriolis": coriolis.trace.program(coriolis.torque()),
        "mass_matrix": mass.trace.program(entries),
        "momentum": _momentum(TracedChain(floating, inertial, {"dq": "", "ddq": "dq"}), rotors),
    }
    if estimate is not None:
        columns = estimate.base.independent
        bodies, count = TracedChain(chain), estimate.base.count
        place = {int(column): k for k, column in enumerate(columns)}
        values = bodies.regressor([int(c) for c in columns if c < model.inertial_count])
        wide = 10 * len(model.robot.links)
        slots = {(slot // wide) * count + place[slot % wide]: value for slot, value in values.items()}
        found["bodies"] = bodies.trace.program(slots)
    total = sum(program.operations for program in found.values())
    if total > LARGEST:
        raise _too_long(f"{total} operations a call of each function")
    assert all(slot < size for slot in found["rigid"].outputs)
    return found


def variables_of(
    program: TracedProgram, constant: str, call: Mapping[str, str]
) -> tuple[list[str], list[tuple[str, str]]]:
    """Return the term of each node of a program, and the name and the expression of each variable, ``v<number>``.

    Args:
        program: Of sums, products, sines and cosines.
        constant: How a number is written.
        call: What ``sin`` and ``cos`` are called.
    """
    terms: list[str] = []
    made: list[tuple[str, str]] = []
    for number, node in enumerate(program.nodes):
        if node.operation == "const":
            terms.append(constant.format(repr(node.value)))
            continue
        operands = [terms[k] for k in node.operands]
        if node.source is not None:
            term = f"{node.source.array}[{node.source.entry}]"
        elif node.operation in _SIGNS:
            term = f"{operands[0]} {_SIGNS[node.operation]} {operands[1]}"
        else:
            term = f"-{operands[0]}" if node.operation == "neg" else f"{call[node.operation]}({operands[0]})"
        made.append((f"v{number}", term))
        terms.append(f"v{number}")
    return terms, made


def rotor_matrix(model: DynamicModel, theta: Array) -> Array:
    """Return what rotors, known and identified, add to the mass matrix, shape (n, n)."""
    coupling = np.asarray(model.robot.coupling)
    return model.robot.reflected_inertia + coupling.T @ (model.rotors(theta)[:, None] * coupling)


def _with_rotors(traced: TracedChain, torque: Mapping[int, Number], rotors: Array, array: str) -> dict[int, Number]:
    found = dict(torque)
    for (i, j), value in np.ndenumerate(rotors):
        if value:
            found[i] = found.get(i, 0.0) + float(value) * traced.trace.input(array, j)
    return found


def _momentum(traced: TracedChain, rotors: Array) -> TracedProgram:
    """Return M dq and, behind it, C' dq, which is the slope of the kinetic energy (De Luca and Mattone 2003)."""
    size = len(rotors)
    speeds = {k: traced.trace.input("dq", k) for k in range(size)}
    bodies = traced.torque()
    slopes = gradient(traced.trace, bodies, speeds, [traced.trace.input("q", k) for k in range(size)])
    rates = {size + k: 0.5 * slope for k, slope in enumerate(slopes)}
    return traced.trace.program({**_with_rotors(traced, bodies, rotors, "dq"), **rates})


def _too_long(size: str) -> BadOption:
    step = "the unrolled functions would be too long for a compiler; export to urdf and use a library of dynamics"
    return BadOption("robot", size, step)


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
