"""A C99 and C++ header for real-time control: unrolled, without allocation, for double and float.

Its proof: compiled by the C compiler of this machine, run on the states of a proof.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.exports.c_compiler import Compiler, NoCompilerRuns, build_program, find_compiler, run_program
from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet
from dynident.exports.models.writing.c_text import check_names, header_text, prefix_of
from dynident.exports.models.writing.document import base_torque
from dynident.exports.names_in_files import template_parts

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


def _memory(prefix: str, remembers: bool, step: float | None) -> dict[str, str]:
    """Return how the program keeps what friction remembers, in double and in float; all empty where none does."""
    dt = "" if step is None else f", {step!r}"
    values = {
        "BEGIN": f"    static {prefix}_memory memory;\n    static {prefix}_memoryf memoryf;\n"
        f"    {prefix}_memory_reset(&memory);\n    {prefix}_memory_resetf(&memoryf);\n",
        "STEP": f"        {prefix}_memory_step(&memory, in[0]{dt});\n"
        f"        {prefix}_memory_stepf(&memoryf, inf_[0]{dt and f'{dt}f'});\n",
        "MEMORY": "&memory, ",
        "MEMORYF": "&memoryf, ",
    }
    return {name: text if remembers else "" for name, text in values.items()}


@dataclass(frozen=True)
class HeaderRun:
    """What the compiled header gave, each (N, n).

    Attributes:
        torque: Inverse dynamics.
        parts: M ddq + Coriolis + gravity + friction.
        single: Inverse dynamics in float.
        regressor: Regressor times base parameters, and the known torque; zero without a regressor.
    """

    torque: Array
    parts: Array
    single: Array
    regressor: Array


def run_header(
    compiler: Compiler, folder: Path, header: str, prefix: str, states: StateSet, regressor: bool
) -> HeaderRun:
    """Compile a header, run its self-test, and evaluate it on states.

    Args:
        compiler: The compiler.
        folder: Where the header lies; programs are written there.
        header: Name of its file.
        prefix: Prefix of its names.
        states: The states.
        regressor: Whether it has the regressor.

    Raises:
        NoCompilerRuns: Not even the smallest program can be built and run here.
        ValueError: The header does not compile, or its self-test fails.
    """
    motion = states.motion
    heated = motion.temperature is not None
    copy = folder / "dynident_header.h"  # the user's name of the file may hold what no #include takes
    copy.write_bytes((folder / header).read_bytes())
    text, of_regressor = template_parts("header_driver.c")
    text = text.replace("@REGRESSOR@", of_regressor.removesuffix("\n") if regressor else "")
    values = {
        "HEADER": copy.name,
        "UPPER": prefix.upper(),
        "LOWER": prefix,
        "INPUTS": "4" if heated else "3",
        "TEMPF": "inf_[3], " if heated else "",
        "TEMP": "in[3], " if heated else "",
        **_memory(prefix, motion.state is not None, states.step),
    }
    for name, value in values.items():
        text = text.replace(f"@{name}@", value)
    source = folder / "dynident_driver.c"
    source.write_text(text, encoding="ascii", newline="\n")
    program = build_program(compiler, folder, source, "driver")
    inputs = [motion.q, motion.dq, motion.ddq, *([motion.temperature] if motion.temperature is not None else [])]
    given, taken = folder / "states.bin", folder / "torques.bin"
    np.stack(inputs, axis=1).astype(np.float64).tofile(given)
    run_program([str(program), str(given), str(taken)], folder)
    test = folder / "dynident_self_test.c"
    test.write_text(f'#define {prefix.upper()}_SELF_TEST\n#include "{copy.name}"\n', encoding="ascii", newline="\n")
    run_program([str(build_program(compiler, folder, test, "self_test"))], folder)
    found = np.fromfile(taken).reshape(-1, 4, motion.q.shape[1])
    if len(found) != len(motion.q):
        raise ValueError(f"the compiled header gave {len(found)} of {len(motion.q)} states")
    return HeaderRun(found[:, 0], found[:, 1], found[:, 2], found[:, 3])
