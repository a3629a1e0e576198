"""The proof of a C header: compiled by the C compiler of this machine, run on the states of a proof."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from dynident.arrays import Array
from dynident.exports.c_compiler import Compiler, build_program, run_program
from dynident.exports.models.subject.states import StateSet

_DRIVER: Final = """#include <stdio.h>
#include "@HEADER@"
#define @UPPER@_FLOAT
#include "@HEADER@"

enum { N = @UPPER@_JOINTS, B = @UPPER@_PARAMETERS, INPUTS = @INPUTS@ };

int main(int count, char **names)
{
    static double in[INPUTS][N], out[4][N], mass[N * N], part[N];
    static float inf_[INPUTS][N], outf_[N];
    FILE *from, *to;
    int i, j, k;
@BEGIN@    if (count != 3 || !(from = fopen(names[1], "rb")) || !(to = fopen(names[2], "wb"))) {
        return 2;
    }
    while (fread(in, sizeof(double), INPUTS * N, from) == INPUTS * N) {
        for (k = 0; k < INPUTS; ++k) {
            for (i = 0; i < N; ++i) {
                inf_[k][i] = (float)in[k][i];
            }
        }
@STEP@        @LOWER@_inverse_dynamics(in[0], in[1], in[2], @TEMP@@MEMORY@out[0]);
        @LOWER@_inverse_dynamicsf(inf_[0], inf_[1], inf_[2], @TEMPF@@MEMORYF@outf_);
        @LOWER@_mass_matrix(in[0], mass);
        @LOWER@_friction(in[0], in[1], in[2], @TEMP@@MEMORY@out[1]);
        @LOWER@_gravity(in[0], part);
        for (i = 0; i < N; ++i) {
            out[1][i] += part[i];
            for (j = 0; j < N; ++j) {
                out[1][i] += mass[N * i + j] * in[2][j];
            }
        }
        @LOWER@_coriolis(in[0], in[1], part);
        for (i = 0; i < N; ++i) {
            out[1][i] += part[i];
            out[2][i] = (double)outf_[i];
        }
@REGRESSOR@
        if (fwrite(out, sizeof(double), 4 * N, to) != 4 * N) {
            return 3;
        }
    }
    fclose(from);
    return fclose(to) ? 4 : 0;
}
"""

_REGRESSOR: Final = """        {
            static double y[N * B], beta[B];
            @LOWER@_base_parameters(beta);
            @LOWER@_regressor(in[0], in[1], in[2], @TEMP@@MEMORY@y);
            @LOWER@_known_torque(in[2], out[3]);
            for (i = 0; i < N; ++i) {
                for (j = 0; j < B; ++j) {
                    out[3][i] += y[B * i + j] * beta[j];
                }
            }
        }"""


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
    text = _DRIVER.replace("@REGRESSOR@", _REGRESSOR if regressor else "")
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
