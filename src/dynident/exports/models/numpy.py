"""A Python module that needs NumPy only: inverse dynamics, gravity, Coriolis, mass matrix, friction, a self-test."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.subject.drives import drives_of
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import PACE, StateSet, states_of, takes_time
from dynident.exports.models.writing.c_programs import drive_terms, state_updates
from dynident.exports.models.writing.expressions import Dialect
from dynident.exports.names_in_files import module_notes, template_parts
from dynident.model.chain import PRISMATIC
from dynident.model.friction import FRICTION

_NUMPY: Final = Dialect(
    "{}",
    "np.{}",
    "np.tanh({value} / {width})",
    "np.sign({value})",
    "",
    "",
    "the NumPy module",
    {"pow": "power", "fmax": "maximum", "fmin": "minimum"},
)

#: Inputs of the expressions by the arrays that hold them.
_READINGS: Final = {"x": "at", "v": "speed", "load": "loads", "warm": "temperature"}

#: Friction that remembers, and the module that it is put into.
MEMORY, SOURCE = template_parts("numpy_module.template")

#: Samples of the self-test.
REFERENCES = 5


@dataclass(frozen=True)
class Numpy(ModelExporter):
    """Python module that needs NumPy only: inverse dynamics, gravity, Coriolis, mass matrix, friction, a self-test."""

    suffix: ClassVar[str] = ".py"
    proof: ClassVar[str] = "everything by NumPy, as a whole and as the sum of its parts"
    remembers: ClassVar[bool] = True

    def content(self, subject: Identified, path: Path) -> ModelContent:
        model = subject.model
        more = [name for name, signal in (("temperature", "temperature"), ("state", "state")) if signal in model.needs]
        chain = model.robot.chain
        moments = np.array([body.first_moment for body in subject.bodies])
        values: dict[str, Any] = {
            **_memory(subject),
            "JOINTS": model.robot.dof,
            "NAMES": f"({', '.join(ascii(name) for name in model.robot.joint_names)},)",
            "GRAVITY": _text(chain.gravity),
            "PARENT": _text(chain.parent),
            "SLIDES": str([bool(kind == PRISMATIC) for kind in chain.kind]),
            "COLUMN": _text(chain.joint),
            "MULTIPLIER": _text(chain.multiplier),
            "OFFSET": _text(chain.offset),
            "ROTATION": _text(chain.rotation),
            "TRANSLATION": _text(chain.translation),
            "AXIS": _text(chain.axis),
            "MASS": _text(np.array([body.mass for body in subject.bodies])),
            "MOMENT": _text(moments),
            "TENSOR": _text(np.array([body.rotational for body in subject.bodies])),
            "COUPLING": _text(np.asarray(model.robot.coupling)),
            "ARMATURE": _text(drives_of(subject).armature),
            "BIAS": _text(model.robot.bias),
            "MORE": "".join(f", {name}" for name in more),
            "FRICTION": "\n".join(_friction(subject)) or "    # The model has none.",
            "REFERENCE": _reference(subject),
        }
        text = SOURCE
        for name, value in values.items():
            text = text.replace(f"@{name}@", str(value))
        return ModelContent({path: text.encode("ascii")}, (), module_notes(path, "numpy"))

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: StateSet) -> Iterator[Reloaded]:
        path = folder / next(iter(content.files)).name
        space: dict[str, Any] = {"__name__": "dynident_export"}
        exec(compile(path.read_bytes(), str(path.name), "exec"), space)  # what was just written, names as literals
        motion = states.motion
        more = [] if motion.temperature is None else [motion.temperature]
        step = [] if states.step is None else [states.step]
        more += [] if motion.state is None else [space["states_along"](motion.q, *step)]
        found = space["inverse_dynamics"](motion.q, motion.dq, motion.ddq, *more)
        expected = subject.model.torque(motion, subject.theta)
        yield Reloaded(f"NumPy {np.__version__}", "everything", found, expected)
        few = replace(motion, q=motion.q[:50], dq=motion.dq[:50], ddq=motion.ddq[:50])
        parts = np.einsum("nij,nj->ni", space["mass_matrix"](few.q), few.ddq) + space["gravity"](few.q)
        parts = parts + space["coriolis"](few.q, few.dq)
        parts = parts + space["friction"](few.q, few.dq, few.ddq, *(values[:50] for values in more))
        yield Reloaded(f"NumPy {np.__version__}", "M ddq + Coriolis + gravity + friction", parts, expected[:50])


def _friction(subject: Identified) -> Iterator[str]:
    """Yield the lines that add the friction of each part."""
    model = subject.model
    terms, first = drive_terms(model, subject.theta, _NUMPY), 0
    columns = np.asarray(model.terms[1])
    for part in model.friction:
        drives = list(model.drives_of(part))
        own = [
            [t for t, c in zip(terms, columns, strict=True) if c == first + k] for k in range(len(part.coefficients))
        ]
        first += len(own)
        own = [each for each in own if each and not each[0].is_inertia]
        if not own:
            continue
        yield f"    # {FRICTION.name_of(part)}: {', '.join(each[0].symbol for each in own)}"
        for name, array in _READINGS.items():
            if any(each[0].uses(name) for each in own):
                yield f"    {name} = {array}[:, {drives}]"
        for k in range(sum(len(part.states) for part in model.friction)):
            if any(each[0].uses(f"z{k}") for each in own):
                yield f"    z{k} = state[:, {drives}, {k}]"
        for each in own:
            values = _text(np.array([term.value for term in each]))
            yield f"    torque[:, {drives}] += np.array({values}) * ({each[0].expression})"


def _text(values: Array | IntArray) -> str:
    """Return numbers as Python writes them, to the last bit."""
    return repr((np.asarray(values) + 0).tolist())


def _memory(subject: Identified) -> dict[str, str]:
    """Return what the module has of friction that remembers; all empty where none does."""
    states = state_updates(subject.model, _NUMPY)
    dt = ", dt" if takes_time(subject.model) else ""
    lines = [f"            z{k} = self.state[:, {k}]" for k in range(len(states))]
    lines += [f"            self.state = np.stack([{', '.join(state.expression for state in states)}], axis=1)"]
    values = {
        "MEMORY": MEMORY,
        "MEMORY_ABOUT": f"    Memory().step(q{dt}), states_along(q{dt})  its state, (@JOINTS@, @STATES@) a sample\n",
        "STATE_ROWS": f"    state = np.asarray(state, dtype=float).reshape(-1, len(JOINTS), {len(states)})\n",
        "WALKED": f"    more_.append(states_along(q_{', ' + repr(PACE) if dt else ''}))\n",
    }
    return {name: text if states else "" for name, text in values.items()} | {
        "DT": dt,
        "LATER": " dt s later" if dt else "",
        "STARTS": repr([state.start for state in states]),
        "STATES": str(len(states)),
        "UPDATES": "\n".join(lines),
    }


def _reference(subject: Identified) -> str:
    whole = states_of(subject.model).motion.rows(slice(0, REFERENCES))
    torque = subject.model.torque(whole, subject.theta)
    rows = [whole.q, whole.dq, whole.ddq, *([] if whole.temperature is None else [whole.temperature]), torque]
    return "[\n" + "".join(f"    {_text(np.asarray(row))},\n" for row in rows) + "]"
