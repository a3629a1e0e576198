"""An identified model -> the text of a C header, whose names all begin with one prefix."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from dynident.arrays import Array, vector_text
from dynident.errors import BadOption
from dynident.exports.models.subject.drives import drives_of, rigid_torque
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import PACE, states_of, takes_time
from dynident.exports.models.writing.c_programs import (
    DriveTerm,
    c_dialect,
    combination,
    drive_terms,
    motor_lines,
    programs_of,
    rotor_matrix,
    state_updates,
    variables_of,
)
from dynident.exports.models.writing.document import document
from dynident.exports.models.writing.expressions import Dialect
from dynident.exports.names_in_files import comment_text, shown_names, template_parts
from dynident.model.kernels import batched
from dynident.model.kernels.trace import TracedProgram

#: The header less what is traced; what friction remembers stands in it where friction does.
HEAD, MEMORY_TYPE, MEMORY_FUNCTIONS, FUNCTIONS, REGRESSOR, TAIL = template_parts("c_header.h")

#: Random states of the self-test.
REFERENCES = 5

#: What the self-test compares.
CHECKS = ("inverse dynamics", "gravity", "Coriolis", "M ddq", "friction")

#: Traced functions: name in C, arrays, entries per joint, comment.
_TRACED: Mapping[str, tuple[str, tuple[str, ...], str]] = {
    "rigid": ("rigid", ("q", "dq", "ddq"), "Torque without friction, rotors included: M ddq + c + g."),
    "gravity": ("gravity", ("q",), "Torque that holds the bodies against gravity."),
    "coriolis": ("coriolis", ("q", "dq"), "Torque of speed alone, without friction: c."),
    "mass_matrix": ("mass_matrix", ("q",), "M, rotors included, row-major; of the bodies and so symmetric."),
    "momentum": ("momentum_", ("q", "dq"), "M dq, and behind it C' dq with dM/dt = C + C'."),
    "bodies": ("bodies_", ("q", "dq", "ddq"), "The columns of the regressor that belong to bodies; the others are 0."),
}


def header_text(subject: Identified, prefix: str, scale: float, regressor: bool) -> str:
    """Return the header.

    Args:
        subject: The model.
        prefix: Begins every name; a plain word of small letters, digits and ``_``.
        scale: Velocity over which the sign turns where friction is compensated, in rad/s or m/s.
        regressor: Whether the regressor is in it.

    Raises:
        BadOption: Friction or a robot that the header cannot hold.
    """
    model, upper = subject.model, prefix.upper()
    spelt = c_dialect(upper)
    terms = drive_terms(model, subject.theta, spelt)
    programs = programs_of(model, subject.theta, subject.estimate if regressor else None)
    size, count = model.robot.dof, subject.estimate.base.count
    widths = {"mass_matrix": size * size, "momentum": 2 * size, "bodies": size * count}
    spelling = Spelling("static inline void", f"{upper}_REAL", f"{upper}_M(sin)", f"{upper}_M(cos)", f"{upper}_C({{}})")
    traced = []
    for name, program in programs.items():
        function, arrays, comment = _TRACED[name]
        text = c99_function(program, f"{upper}_F({function})", arrays, widths.get(name, size), spelling)
        traced.append(f"/* {comment} */\n{text}\n")
    memory = _memory(subject, spelt, upper)
    parts = [HEAD, *traced, *([MEMORY_FUNCTIONS] if memory["MEMORY"] else []), FUNCTIONS]
    parts += [*([REGRESSOR] if regressor else []), TAIL]
    values = memory | _facts(subject, prefix, scale) | _friction_values(subject, terms, spelt, upper)
    values |= _self_test(subject) | (_base_values(subject, terms, spelt) if regressor else {})
    text = "".join(parts)
    for name, value in values.items():
        text = text.replace(f"@{name}@", value)
    return text


def _facts(subject: Identified, prefix: str, scale: float) -> dict[str, str]:
    robot = subject.model.robot
    shown, _ = shown_names((robot.name, *robot.joint_names))
    digest = json.dumps(document(subject, drives_of(subject)), indent=1, allow_nan=False) + "\n"
    names = [
        f" *   {i}: {name} ({joint.kind})" for i, (name, joint) in enumerate(zip(shown[1:], robot.active, strict=True))
    ]
    return {
        "UPPER": prefix.upper(),
        "LOWER": prefix,
        "VERSION": version("dynident"),
        "ROBOT": shown[0],
        "METHOD": comment_text(subject.estimate.estimator),
        "ORIGIN": subject.origin,
        "DIGEST": hashlib.sha256(digest.encode("ascii")).hexdigest(),
        "NAMES": "\n".join(names),
        "GRAVITY": vector_text(robot.gravity),
        "JOINTS": str(robot.dof),
        "PARAMETERS": str(subject.estimate.base.count),
        "SCALE": repr(float(scale)),
    }


def _friction_values(subject: Identified, terms: Sequence[DriveTerm], spelt: Dialect, upper: str) -> dict[str, str]:
    heated, loaded = ("temperature" in subject.model.needs, "torque" in subject.model.needs)
    reading = f"const {upper}_REAL *"
    return {
        "IN": reading,
        "TEMP_IN": f"{reading}temperature, " if heated else "",
        "TEMP": "temperature, " if heated else "",
        "TEMP_ZERO": "still, " if heated else "",
        "TEMP_ROW": "in[3], " if heated else "",
        "TEMP_VOID": "\n    (void)temperature;" if heated else "",
        "RIGID_FOR_FRICTION": f"{upper}_F(rigid)(q, dq, ddq, rigid);" if loaded else "(void)ddq;",
        "DRIVES": "\n".join(_drive_lines(subject, terms, spelt, upper)),
    }


def _memory(subject: Identified, spelt: Dialect, upper: str) -> dict[str, str]:
    """Return what the header has of friction that remembers; all empty where none does."""
    states, coupling = state_updates(subject.model, spelt), np.asarray(subject.model.robot.coupling)
    size, indent, timed = len(states), " " * 12, takes_time(subject.model)
    given = f", {upper}_C({PACE!r})" if timed else ""
    lines = [f"const {upper}_REAL z{k} = memory->state[{size} * i + {k}];" for k in range(size)]
    lines += [f"memory->state[{size} * i + {k}] = {state.expression};" for k, state in enumerate(states)]
    begin = f"\n    {upper}_F(memory) memory;\n    {upper}_F(memory_reset)(&memory);"
    values = {
        "MEMORY_TYPE": MEMORY_TYPE,
        "MEMORY_IN": f"const {upper}_F(memory) *memory, ",
        "MEMORY": "memory, ",
        "MEMORY_ZERO": "&memory, ",
        "MEMORY_BEGIN": begin,
        "MEMORY_STEP": f"        {upper}_F(memory_step)(&memory, in[0]{given});\n",
        "MEMORY_VOID": "\n    (void)memory;",
        "OBSERVER_FIELD": f"\n    {upper}_F(memory) memory;",
        "OBSERVER_BEGIN": f"\n    {upper}_F(memory_reset)(&observer->memory);",
        "OBSERVER_STEP": f"    {upper}_F(memory_step)(&observer->memory, q{', dt' if timed else ''});\n",
        "OBSERVER_MEMORY": "&observer->memory, ",
    }
    return {name: text if states else "" for name, text in values.items()} | {
        "TIME": "dt is the time since the step before, in s." if timed else "It needs no time.",
        "DT_IN": f", {upper}_REAL dt" if timed else "",
        "STATES_OF_DRIVE": str(size),
        "STATE_STARTS": ", ".join(spelt.constant(state.start) for state in states),
        "MOTORS": "\n".join(f"    motor[{i}] = {combination(row, 'q', spelt)};" for i, row in enumerate(coupling)),
        "UPDATES": "\n".join(f"{indent}{line}" for line in lines),
    }


def _drive_lines(subject: Identified, terms: Sequence[DriveTerm], spelt: Dialect, upper: str) -> Iterator[str]:
    """Yield the body of the function that adds the friction of all drives."""
    model = subject.model
    size = model.robot.dof
    yield f"    {upper}_REAL motor[{size}] = {{0}};"
    names = shown_names(model.robot.joint_names)[0]
    for drive in range(size):
        own = [t for t in terms if t.drive == drive and not t.is_inertia and t.value]
        if not own:
            continue
        yield f"    {{ /* {names[drive]} */"
        yield from (f"        {line}" for line in motor_lines(model, drive, own, spelt))
        for term in own:
            yield f"        /* {term.symbol} */"
            yield f"        motor[{drive}] += {spelt.constant(term.value)} * ({term.expression});"
        yield "    }"
    coupling = np.asarray(model.robot.coupling)
    for joint, bias in enumerate(model.robot.bias.tolist()):
        less = f" - {spelt.constant(bias)}" if bias else ""
        yield f"    tau[{joint}] = {combination(coupling[:, joint], 'motor', spelt)}{less};"
    more = [name for name, signal in (("temperature", "temperature"), ("memory", "state")) if signal in model.needs]
    yield from (f"    (void){name};" for name in ("q", "dq", "rigid", *more, "scale"))


def _base_values(subject: Identified, terms: Sequence[DriveTerm], spelt: Dialect) -> dict[str, str]:
    model, estimate = subject.model, subject.estimate
    place = {int(column): k for k, column in enumerate(estimate.base.independent)}
    count, coupling = estimate.base.count, np.asarray(model.robot.coupling)
    columns: list[str] = []
    for drive in range(model.robot.dof):
        own = [t for t in terms if t.drive == drive and t.column in place]
        if not own:
            continue
        columns += ["    {", *(f"        {line}" for line in motor_lines(model, drive, own, spelt))]
        for term in own:
            for joint in np.flatnonzero(coupling[drive]).tolist():
                share = float(coupling[drive, joint])
                factor = "" if share == 1.0 else f"{spelt.constant(share)} * "
                columns.append(f"        y[{joint * count + place[term.column]}] = {factor}({term.expression});")
        columns.append("    }")
    names = [f" *   {k}: {comment_text(name)}" for k, name in enumerate(estimate.base.names)]
    beta = [f"    beta[{k}] = {spelt.constant(value)};" for k, value in enumerate(estimate.beta.tolist())]
    known = []
    for joint, row in enumerate(model.robot.reflected_inertia):
        bias = float(model.robot.bias[joint])
        less = f" - {spelt.constant(bias)}" if bias else ""
        known.append(f"    tau[{joint}] = {combination(row, 'ddq', spelt)}{less};")
    return {
        "BETA_NAMES": "\n".join(names),
        "BETA": "\n".join(beta),
        "KNOWN": "\n".join([*known, "    (void)ddq;"]),
        "COLUMNS": "\n".join(columns),
    }


def _self_test(subject: Identified) -> dict[str, str]:
    """Return the reference vectors, computed by this package."""
    model = subject.model
    motion = states_of(model).motion.rows(slice(0, REFERENCES))
    still = np.zeros_like(motion.q)
    chain, theta = model.robot.chain, subject.theta[: model.inertial_count]

    def bodies(dq: Array, ddq: Array) -> Array:
        return batched.inverse_dynamics(chain, theta, motion.q, dq, ddq)

    gravity = bodies(still, still)
    rotors = motion.ddq @ rotor_matrix(model, subject.theta)
    whole = model.torque(motion, subject.theta)
    checks = (
        whole,
        gravity,
        bodies(motion.dq, still) - gravity,
        bodies(still, motion.ddq) - gravity + rotors,
        whole - rigid_torque(subject, motion) - rotors,
    )
    heated = [] if motion.temperature is None else [motion.temperature]
    inputs = [motion.q, motion.dq, motion.ddq, *heated]
    names = ["q", "dq", "ddq", *(["temperature"] if heated else []), *CHECKS]
    rows = np.stack([*inputs, *checks], axis=1)
    return {
        "STATES": str(REFERENCES),
        "ROWS": ", ".join(names),
        "COUNT": str(rows.shape[1]),
        "INPUTS": str(len(inputs)),
        "CHECKS": str(len(CHECKS)),
        "CHECK_NAMES": ", ".join(f'"{name}"' for name in CHECKS),
        "REFERENCE": ",\n".join(
            "    {" + ",\n     ".join("{" + ", ".join(repr(v + 0.0) for v in row) + "}" for row in state) + "}"
            for state in rows.tolist()
        ),
    }


_PREFIX = re.compile(r"[a-z][a-z0-9]*(?:_[a-z0-9]+)*")

#: Longest prefix: with it every name stays within the 63 signs that C99 compilers tell apart.
LONGEST = 30


def check_names(prefix: str, velocity_scale: float) -> None:
    """Refuse options that no C source can have.

    Raises:
        BadOption: A prefix that is no name, or a speed that is none.
    """
    if prefix and (not _PREFIX.fullmatch(prefix) or len(prefix) > LONGEST):
        step = f"give small letters, digits and single '_', a letter first, {LONGEST} signs at most"
        raise BadOption("prefix", prefix, step)
    if not 1e-6 <= velocity_scale <= 1e3:
        raise BadOption("velocity_scale", velocity_scale, "give a speed in rad/s from 1e-6 to 1000")


def prefix_of(asked: str, path: Path) -> str:
    """Return the prefix that was asked for, or one made of the name of a file."""
    if asked:
        return asked
    word = "_".join(re.findall(r"[a-z0-9]+", path.stem.lower()))[:LONGEST].rstrip("_")
    return word if word[:1].isalpha() else f"arm_{word}".rstrip("_")[:LONGEST]


@dataclass(frozen=True)
class Spelling:
    """How a function is spelt.

    Attributes:
        head: What stands before the name, such as ``static inline void``.
        real: The type of numbers.
        sine: Name of the sine.
        cosine: Name of the cosine.
        constant: What a constant becomes, ``{}`` its digits.
    """

    head: str = "void"
    real: str = "double"
    sine: str = "sin"
    cosine: str = "cos"
    constant: str = "{}"


def c99_function(
    program: TracedProgram, name: str, arrays: Sequence[str], width: int, spelling: Spelling | None = None
) -> str:
    """Return the text of ``void name(const double *array, ..., double *out)``.

    Args:
        program: What to compute; its slots are the entries of ``out``.
        name: Name of the function.
        arrays: The arrays that the function takes, in order; at least those that the program reads.
        width: Number of entries of ``out``; those that the program lacks become 0.
        spelling: Types and names other than those of C99 with double.

    Raises:
        ValueError: The program reads an array that is not in ``arrays``.
    """
    missing = set(program.arrays) - set(arrays)
    if missing:
        raise ValueError(f"the program reads {sorted(missing)}, the function takes {list(arrays)}")
    spelt = spelling or Spelling()
    takes = ", ".join(f"const {spelt.real} *{array}" for array in arrays)
    lines = [f"{spelt.head} {name}({takes}, {spelt.real} *out)", "{"]
    terms, variables = variables_of(program, spelt.constant, {"sin": spelt.sine, "cos": spelt.cosine})
    lines += [f"    const {spelt.real} {own} = {term};" for own, term in variables]
    lines += [f"    (void){array};" for array in arrays if array not in program.arrays]
    zero = spelt.constant.format("0.0")
    lines += [
        f"    out[{slot}] = {terms[program.outputs[slot]] if slot in program.outputs else zero};"
        for slot in range(width)
    ]
    return "\n".join([*lines, "}"]) + "\n"
