"""A C99 and C++ header for real-time control: unrolled, without allocation, for double and float."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from dynident.errors import BadOption
from dynident.results.model_exporters._c_proof import NoCompilerRuns, find_compiler, run_header
from dynident.results.model_exporters._c_text import header_text
from dynident.results.model_exporters._document import base_torque
from dynident.results.model_exporters._identified import Identified
from dynident.results.model_exporters._states import States
from dynident.results.model_exporters.base import ModelContent, ModelExporter, Reloaded

_PREFIX = re.compile(r"[a-z][a-z0-9]*(?:_[a-z0-9]+)*")

#: Longest prefix: with it every name stays within the 63 signs that C99 compilers tell apart.
LONGEST = 30

#: Largest difference of a torque in float, relative to the largest of the joint.
SINGLE = 1e-3


@dataclass(frozen=True)
class CHeader(ModelExporter):
    """C99/C++ header: dynamics, friction, regressor, feed-forward, compensation, momentum observer; double and float.

    Attributes:
        prefix: What every name begins with, small letters, digits and '_'; empty for the name of the file.
        velocity_scale: Speed in rad/s (or m/s) over which the sign of compensated dry friction turns, at least.
        regressor: Whether the regressor of the base parameters is in it.
    """

    prefix: str = ""
    velocity_scale: float = 0.05
    regressor: bool = True

    needs_bodies: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.prefix and (not _PREFIX.fullmatch(self.prefix) or len(self.prefix) > LONGEST):
            step = f"give small letters, digits and single '_', a letter first, {LONGEST} signs at most"
            raise BadOption("prefix", self.prefix, step)
        if not 1e-6 <= self.velocity_scale <= 1e3:
            raise BadOption("velocity_scale", self.velocity_scale, "give a speed in rad/s from 1e-6 to 1000")

    def content(self, subject: Identified, path: Path) -> ModelContent:
        prefix = self._prefix_of(path)
        text = header_text(subject, prefix, self.velocity_scale, self.regressor)
        own = [
            f"names begin with {prefix}_; define {prefix.upper()}_FLOAT before the header for float, "
            f"{prefix.upper()}_SELF_TEST for a main that checks it",
            f"feed-forward, compensation and observer have smooth signs, tanh(dq / {self.velocity_scale:g}) or wider",
        ]
        return ModelContent({path: text.encode("ascii")}, (), tuple(own))

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: States) -> Iterator[Reloaded]:
        compiler = find_compiler()
        if compiler is None:
            yield Reloaded("C compiler", why_not="none of cc, gcc, clang is on the path; set CC to name another")
            return
        path = next(iter(content.files))
        try:
            found = run_header(compiler, folder, path.name, self._prefix_of(path), states, self.regressor)
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

    def _prefix_of(self, path: Path) -> str:
        """Return the prefix that was asked for, or one made of the file's name."""
        if self.prefix:
            return self.prefix
        word = "_".join(re.findall(r"[a-z0-9]+", path.stem.lower()))[:LONGEST].rstrip("_")
        return word if word[:1].isalpha() else f"arm_{word}".rstrip("_")[:LONGEST]
