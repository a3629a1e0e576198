"""A Python module that builds CasADi functions of an identified model, for optimal control."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet
from dynident.exports.models.writing.casadi_text import casadi_text
from dynident.exports.names_in_files import module_notes


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
