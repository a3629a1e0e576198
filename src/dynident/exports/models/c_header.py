"""A C99 and C++ header for real-time control: unrolled, without allocation, for double and float."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from dynident.exports.c_compiler import NoCompilerRuns, find_compiler
from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.proving.c_proof import run_header
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet
from dynident.exports.models.writing.c_text import check_names, header_text, prefix_of
from dynident.exports.models.writing.document import base_torque

#: Largest difference of a torque in float, relative to the largest of the joint.
SINGLE = 1e-3


@dataclass(frozen=True)
class CHeader(ModelExporter):
    """C99/C++ header: dynamics, friction, regressor, feed-forward, compensation, momentum observer; double and float.

    Attributes:
        prefix: What every name begins with, small letters, digits and '_'; empty for the name of the file.
        velocity_scale: Speed in rad/s (or m/s) over which the sign of compensated Coulomb friction turns, at least.
        regressor: Whether the regressor of the base parameters is in it.
    """

    prefix: str = ""
    velocity_scale: float = 0.05
    regressor: bool = True

    suffix: ClassVar[str] = ".h"
    proof: ClassVar[str] = "everything by a C compiler: whole, as the sum of its parts, by the regressor, in float"
    remembers: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_names(self.prefix, self.velocity_scale)

    def content(self, subject: Identified, path: Path) -> ModelContent:
        prefix = prefix_of(self.prefix, path)
        text = header_text(subject, prefix, self.velocity_scale, self.regressor)
        own = [
            f"names begin with {prefix}_; define {prefix.upper()}_FLOAT before the header for float, "
            f"{prefix.upper()}_SELF_TEST for a main that checks it",
            f"feed-forward, compensation and observer have smooth signs, tanh(dq / {self.velocity_scale:g}) or wider",
        ]
        return ModelContent({path: text.encode("ascii")}, (), tuple(own))

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: StateSet) -> Iterator[Reloaded]:
        compiler = find_compiler()
        if compiler is None:
            yield Reloaded("C compiler", why_not="none of cc, gcc, clang is on the path; set CC to name another")
            return
        path = next(iter(content.files))
        try:
            found = run_header(compiler, folder, path.name, prefix_of(self.prefix, path), states, self.regressor)
        except NoCompilerRuns as error:
            yield Reloaded(compiler.name, why_not=str(error))
            return
        motion = states.motion
        expected = subject.model.torque(motion, subject.theta)
        yield Reloaded(compiler.name, "inverse dynamics", found.torque, expected)
        yield Reloaded(compiler.name, "M ddq + Coriolis + gravity + friction", found.parts, expected)
        if self.regressor:
            by_base = base_torque(subject.estimate, subject.estimate.beta, motion)
            yield Reloaded(compiler.name, "regressor times base parameters", found.regressor, by_base)
        yield Reloaded(compiler.name, "inverse dynamics in float", found.single, expected, largest=SINGLE)
