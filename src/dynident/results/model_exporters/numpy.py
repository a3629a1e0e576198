"""A Python module that needs NumPy only: inverse dynamics, gravity, Coriolis, mass matrix, friction, a self-test."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.errors import BadOption
from dynident.model.chain import PRISMATIC
from dynident.model.friction import FRICTION, Friction
from dynident.results.model_exporters.base import ModelContent, ModelExporter, Reloaded
from dynident.results.model_exporters.subject.drives import drives_of
from dynident.results.model_exporters.subject.identified import Identified
from dynident.results.model_exporters.subject.states import States, states_of
from dynident.results.model_exporters.writing.numpy_template import SOURCE, TERMS
from dynident.results.names_in_files import module_notes

#: Samples of the self-test.
REFERENCES = 5


@dataclass(frozen=True)
class Numpy(ModelExporter):
    """Python module that needs NumPy only: inverse dynamics, gravity, Coriolis, mass matrix, friction, a self-test."""

    needs_bodies: ClassVar[bool] = True

    def content(self, subject: Identified, path: Path) -> ModelContent:
        model = subject.model
        heated = "temperature" in model.needs
        chain = model.robot.chain
        moments = np.array([body.first_moment for body in subject.bodies])
        values: dict[str, Any] = {
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
            "TEMPERATURE_ARGUMENT": ", temperature" if heated else "",
            "TEMPERATURE_PASSED": ", temperature" if heated else "",
            "FRICTION": "\n".join(_friction(subject)) or "    # The model has none.",
            "REFERENCE": _reference(subject, heated),
        }
        text = SOURCE
        for name, value in values.items():
            text = text.replace(f"@{name}@", str(value))
        return ModelContent({path: text.encode("ascii")}, (), module_notes(path, "numpy"))

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: States) -> Iterator[Reloaded]:
        path = folder / next(iter(content.files)).name
        space: dict[str, Any] = {"__name__": "dynident_export"}
        exec(compile(path.read_bytes(), str(path.name), "exec"), space)  # what was just written, names as literals
        motion = states.motion
        more = () if motion.temperature is None else (motion.temperature,)
        found = space["inverse_dynamics"](motion.q, motion.dq, motion.ddq, *more)
        expected = subject.model.torque(motion, subject.theta)
        yield Reloaded(f"NumPy {np.__version__}", "everything", found, expected)
        few = replace(motion, q=motion.q[:50], dq=motion.dq[:50], ddq=motion.ddq[:50])
        warm = None if motion.temperature is None else motion.temperature[:50]
        parts = np.einsum("nij,nj->ni", space["mass_matrix"](few.q), few.ddq) + space["gravity"](few.q)
        parts = parts + space["coriolis"](few.q, few.dq)
        parts = parts + space["friction"](few.q, few.dq, few.ddq, *(() if warm is None else (warm,)))
        yield Reloaded(f"NumPy {np.__version__}", "M ddq + Coriolis + gravity + friction", parts, expected[:50])


def _friction(subject: Identified) -> Iterator[str]:
    """Yield the lines that add the friction of each part.

    Raises:
        BadOption: A part whose formula the module does not know.
    """
    model = subject.model
    table, column = model.coefficient_table(subject.theta), 0
    for part in model.friction:
        name, drives = FRICTION.name_of(part), list(model.drives_of(part))
        own = table[drives, column : column + len(part.coefficients)]
        column += len(part.coefficients)
        if name not in TERMS:
            step = f"the NumPy module knows {', '.join(sorted(TERMS))}; export to json, which holds every part"
            raise BadOption("friction", name, step)
        if not TERMS[name]:
            continue
        yield f"    # {name}: {', '.join(c.symbol for c in part.coefficients)}"
        yield f"    x, v = at[:, {drives}], speed[:, {drives}]"
        for k, term in enumerate(TERMS[name]):
            yield f"    torque[:, {drives}] += np.array({_text(own[:, k])}) * ({_filled(term, part, drives)})"


def _filled(term: str, part: Friction, drives: list[int]) -> str:
    width = getattr(part, "width", 0.0)
    text = term.replace("@SIGN@", f"np.tanh(v / {float(width)!r})" if width else "np.sign(v)")
    text = text.replace("@DRIVES@", str(drives))
    for name, value in vars(part).items():
        text = text.replace(f"@{name}@", repr(float(value)) if isinstance(value, float | int) else "")
    return text


def _text(values: Array | IntArray) -> str:
    """Return numbers as Python writes them, to the last bit."""
    return repr((np.asarray(values) + 0).tolist())


def _reference(subject: Identified, heated: bool) -> str:
    whole = states_of(subject.model).motion.rows(slice(0, REFERENCES))
    torque = subject.model.torque(whole, subject.theta)
    rows = [whole.q, whole.dq, whole.ddq, *([whole.temperature] if heated else []), torque]
    return "[\n" + "".join(f"    {_text(np.asarray(row))},\n" for row in rows) + "]"
