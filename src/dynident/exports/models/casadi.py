"""A Python module that builds CasADi functions of an identified model, unrolled from the trace, for optimal control."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from dynident.arrays import Array
from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet, takes_time
from dynident.exports.models.writing.c_programs import (
    StateUpdate,
    combination,
    drive_terms,
    motor_lines,
    programs_of,
    state_updates,
    variables_of,
)
from dynident.exports.models.writing.expressions import Dialect
from dynident.exports.names_in_files import module_notes
from dynident.model.kernels.trace import TracedProgram


def _states_along(space: Mapping[str, Any], start: Array, q: Array, time: Sequence[float]) -> Array:
    """Return the states of friction that the module finds along positions (N, n), a row a sample."""
    found = [start]
    for before, here in pairwise(q):
        found.append(np.array(space["_next_state"](np, found[-1], before, here, *time)))
    return np.array(found)


@dataclass(frozen=True)
class Casadi(ModelExporter):
    """Python module that builds CasADi functions: inverse and forward dynamics, gravity, Coriolis, mass, friction."""

    suffix: ClassVar[str] = ".py"
    proof: ClassVar[str] = "inverse dynamics by NumPy; inverse and forward dynamics by CasADi"
    remembers: ClassVar[bool] = True

    def content(self, subject: Identified, path: Path) -> ModelContent:
        notes = ["it needs the package casadi; build() returns its functions by name"]
        if "torque" in subject.model.needs:
            notes.append("forward_dynamics is left out: friction depends on the load, so on the acceleration")
        notes += module_notes(path, "casadi")
        return ModelContent({path: casadi_text(subject).encode("ascii")}, (), tuple(notes))

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: StateSet) -> Iterator[Reloaded]:
        path = folder / next(iter(content.files)).name
        space: dict[str, Any] = {"__name__": "dynident_export"}
        exec(compile(path.read_bytes(), str(path.name), "exec"), space)  # what was just written, names as literals
        motion = states.motion
        heated = [] if motion.temperature is None else [motion.temperature]
        expected = subject.model.torque(motion, subject.theta)
        rows = [values.T for values in (motion.q, motion.dq, motion.ddq, *heated)]
        if motion.state is not None:
            time = [] if states.step is None else [states.step]
            rows.append(_states_along(space, motion.state[0].ravel(), motion.q, time).T)
        found = np.stack(np.broadcast_arrays(*space["_inverse_dynamics"](np, *rows)), axis=1)
        yield Reloaded(f"NumPy {np.__version__}", "formulas of inverse dynamics", found, expected)
        if find_spec("casadi") is None:
            yield Reloaded("CasADi", why_not="not installed")
            return
        casadi: Any = importlib.import_module("casadi")
        functions, name = space["build"](), f"CasADi {casadi.__version__}"
        torque = np.asarray(functions["inverse_dynamics"].map(len(motion.q))(*rows)).T
        yield Reloaded(name, "inverse dynamics", torque, expected)
        if "forward_dynamics" in functions:
            back = functions["forward_dynamics"].map(len(motion.q))(rows[0], rows[1], torque.T, *rows[3:])
            yield Reloaded(name, "forward dynamics, accelerations", np.asarray(back).T, motion.ddq)


#: Functions of CasADi and NumPy go by the same names.
_PYTHON: Final = Dialect(
    "{}",
    "m.{}",
    "_sign(m, {value}, {width}, scale)",
    "_sign(m, {value}, 0.0, scale)",
    "{name} = {value}",
    "state",
    "the CasADi module",
    {"pow": "power"},
)

#: Traced functions and what they read.
_TRACED: Final = {"rigid": ("q", "dq", "ddq"), "gravity": ("q",), "coriolis": ("q", "dq"), "mass_matrix": ("q",)}

_SOURCE: Final = '''"""Dynamics of an identified robot arm as CasADi functions; written by dynident.

SI units; q, dq, ddq, tau are columns of @JOINTS@ in the order of JOINTS.

    functions = build()
    functions["inverse_dynamics"](q, dq, ddq@MORE@)  torque of the drives: M ddq + c + g + friction
    functions["forward_dynamics"](q, dq, tau@MORE@)  acceleration@LOAD_NOTE@
    functions["friction"](q, dq, ddq@MORE@)          torque of friction and offsets
    functions["gravity"](q), ["coriolis"](q, dq)  parts of the torque, without friction
    functions["mass_matrix"](q)                   M, rotors included
@STATE_NOTE@
build(scale) turns signs of Coulomb friction over a speed of at least ``scale``, in rad/s or m/s: optimisers want them
smooth. The formulas under an underscore take any module with the functions of NumPy.
"""

JOINTS = @NAMES@


def _sign(m, v, width, scale):
    width = max(width, scale)
    return m.tanh(v / width) if width > 0 else m.sign(v)


@FUNCTIONS@

def _friction(m, q, dq, rigid@MORE@, scale=0.0):
@FRICTION@


def _inverse_dynamics(m, q, dq, ddq@MORE@, scale=0.0):
    rigid = _rigid(m, q, dq, ddq)
    return [a + b for a, b in zip(rigid, _friction(m, q, dq, rigid@MORE@, scale))]


@NEXT_STATE@def build(scale=0.0, symbol=None):
    """Return the CasADi functions by name; symbol is casadi.SX.sym or casadi.MX.sym."""
    import casadi as m

    n, sym = len(JOINTS), symbol or m.SX.sym
    q, dq, ddq, tau = (sym(name, n) for name in ("q", "dq", "ddq", "tau"))
@STEP_SYMBOL@    more = [@SYMBOLS@]
    words = [@WORDS@]
    col = lambda values: m.vertcat(*values)
    mass = m.reshape(col(_mass_matrix(m, q)), n, n)
    asked = ["q", "dq", "ddq", *words]
    found = [
        m.Function("inverse_dynamics", [q, dq, ddq, *more], [col(_inverse_dynamics(m, q, dq, ddq, *more, scale))],
                   asked, ["tau"]),
        m.Function("friction", [q, dq, ddq, *more],
                   [col(_friction(m, q, dq, _rigid(m, q, dq, ddq), *more, scale))], asked, ["tau"]),
        m.Function("gravity", [q], [col(_gravity(m, q))], ["q"], ["tau"]),
        m.Function("coriolis", [q, dq], [col(_coriolis(m, q, dq))], ["q", "dq"], ["tau"]),
        m.Function("mass_matrix", [q], [mass], ["q"], ["mass_matrix"]),
@STATE_FUNCTION@@FORWARD@    ]
    return {function.name(): function for function in found}
'''

_FORWARD: Final = """        m.Function("forward_dynamics", [q, dq, tau, *more],
                   [m.solve(mass, tau - col(_inverse_dynamics(m, q, dq, [0.0] * n, *more, scale)))],
                   ["q", "dq", "tau", *words], ["ddq"]),
"""

_STATE_NOTE: Final = """    functions["next_state"](state, before, q@DT@)     states at q@LATER@, from those before

state is a column of @STATES@ for each joint, at the first sample @STARTS@ for each.
"""

_STATE_FUNCTION: Final = """        m.Function("next_state", [more[-1], dq, q@STEP@],
                   [col(_next_state(m, more[-1], dq, q@STEP@))],
                   ["state", "before", "q"@DT_WORD@], ["state_next"]),
"""


def casadi_text(subject: Identified) -> str:
    """Return the source of the module.

    Raises:
        BadOption: Friction or a robot that the module cannot hold.
    """
    model = subject.model
    loaded, states = "torque" in model.needs, state_updates(model, _PYTHON)
    timed = takes_time(model)
    more = {"temperature": "n"} if "temperature" in model.needs else {}
    more |= {"state": f"{len(states)} * n"} if states else {}
    programs = programs_of(model, subject.theta, None)
    size = model.robot.dof
    functions = [
        "\n".join(_python_function(programs[name], name, arrays, size * size if name == "mass_matrix" else size))
        for name, arrays in _TRACED.items()
    ]
    values = {
        "JOINTS": str(size),
        "NAMES": f"({', '.join(ascii(name) for name in model.robot.joint_names)},)",
        "FUNCTIONS": "\n\n".join(functions),
        "FRICTION": "\n".join(f"    {line}" for line in _friction_lines(subject)),
        "FORWARD": "" if loaded else _FORWARD,
        "LOAD_NOTE": ": left out, friction depends on the load" if loaded else ", from M ddq = tau - c - g - friction",
        "MORE": "".join(f", {name}" for name in more),
        "SYMBOLS": ", ".join(f'sym("{name}", {size})' for name, size in more.items()),
        "WORDS": ", ".join(f'"{name}"' for name in more),
        "STATE_NOTE": _STATE_NOTE if states else "",
        "STATE_FUNCTION": _STATE_FUNCTION if states else "",
        "NEXT_STATE": "\n".join([*_next_state_lines(subject, states), "", "", ""]) if states else "",
        "DT_WORD": ', "dt"' if timed else "",
        "STEP": ", step" if timed else "",
        "STEP_SYMBOL": '    step = sym("dt")\n' if timed else "",
        "DT": ", dt" if timed else "",
        "LATER": " dt s later" if timed else "",
        "STATES": str(len(states)),
        "STARTS": ", ".join(repr(state.start) for state in states),
    }
    text = _SOURCE
    for name, value in values.items():
        text = text.replace(f"@{name}@", value)
    return text


def _python_function(program: TracedProgram, name: str, arrays: Sequence[str], width: int) -> Iterator[str]:
    """Yield the lines of one traced function; it returns a list."""
    yield f"def _{name}(m, {', '.join(arrays)}):"
    terms, variables = variables_of(program, "{}", {"sin": "m.sin", "cos": "m.cos"})
    yield from (f"    {own} = {term}" for own, term in variables)
    ends = program.outputs
    yield f"    return [{', '.join(terms[ends[k]] if k in ends else '0.0' for k in range(width))}]"
    yield ""


def _next_state_lines(subject: Identified, states: Sequence[StateUpdate]) -> Iterator[str]:
    """Yield the lines of the function that moves on what friction remembers."""
    size, coupling = len(states), np.asarray(subject.model.robot.coupling)
    yield f"def _next_state(m, state, before, q{', dt' if takes_time(subject.model) else ''}):"
    yield "    found = []"
    for drive, row in enumerate(coupling):
        yield f"    moved = {combination(row, 'q', _PYTHON)} - ({combination(row, 'before', _PYTHON)})"
        for k in range(size):
            yield f"    z{k} = state[{size * drive + k}]"
        yield f"    found += [{', '.join(state.expression for state in states)}]"
    yield "    return found"


def _friction_lines(subject: Identified) -> Iterator[str]:
    model = subject.model
    size, coupling = model.robot.dof, np.asarray(model.robot.coupling)
    terms = drive_terms(model, subject.theta, _PYTHON)
    yield f"motor = [0.0] * {size}"
    for drive in range(size):
        own = [t for t in terms if t.drive == drive and not t.is_inertia and t.value]
        yield from motor_lines(model, drive, own, _PYTHON)
        for term in own:
            yield f"motor[{drive}] = motor[{drive}] + {term.value!r} * ({term.expression})  # {term.symbol}"
    bias = model.robot.bias.tolist()
    rows = [f"{combination(coupling[:, i], 'motor', _PYTHON)} - {bias[i]!r}" for i in range(size)]
    yield f"return [{', '.join(rows)}]"
