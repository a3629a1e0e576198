"""The proof of a C header: compiled by the C compiler of this machine, run on the states of a proof."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from dynident.arrays import Array
from dynident.results.model_exporters.subject.states import States

#: Names under which C compilers are looked for, after the environment's CC.
COMPILERS: Final = ("cc", "gcc", "clang")

#: Seconds that a compiler and a program may take.
PATIENCE = 300

#: Flags of a proof; the library of mathematics comes last.
FLAGS: Final = ("-std=c99", "-O1")

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
    if (count != 3 || !(from = fopen(names[1], "rb")) || !(to = fopen(names[2], "wb"))) {
        return 2;
    }
    while (fread(in, sizeof(double), INPUTS * N, from) == INPUTS * N) {
        for (k = 0; k < INPUTS; ++k) {
            for (i = 0; i < N; ++i) {
                inf_[k][i] = (float)in[k][i];
            }
        }
        @LOWER@_inverse_dynamics(in[0], in[1], in[2], @TEMP@out[0]);
        @LOWER@_inverse_dynamicsf(inf_[0], inf_[1], inf_[2], @TEMPF@outf_);
        @LOWER@_mass_matrix(in[0], mass);
        @LOWER@_friction(in[0], in[1], in[2], @TEMP@out[1]);
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
            @LOWER@_regressor(in[0], in[1], in[2], @TEMP@y);
            @LOWER@_known_torque(in[2], out[3]);
            for (i = 0; i < N; ++i) {
                for (j = 0; j < B; ++j) {
                    out[3][i] += y[B * i + j] * beta[j];
                }
            }
        }"""


@dataclass(frozen=True)
class Compiler:
    """A C compiler.

    Attributes:
        command: How it is called.
        name: Its name with its version.
    """

    command: tuple[str, ...]
    name: str


@dataclass(frozen=True)
class Run:
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


class NoCompilerRuns(Exception):
    """The compiler cannot build and run the smallest program here; the message says why."""


def find_compiler() -> Compiler | None:
    """Return the C compiler that the environment's CC names, or the first of cc, gcc, clang; None where none is."""
    for text in (os.environ.get("CC", ""), *COMPILERS):
        words = tuple(shlex.split(text))
        if words and shutil.which(words[0]):
            return Compiler(words, _version(words))
    return None


def _version(command: tuple[str, ...]) -> str:
    try:
        found = subprocess.run([*command, "--version"], capture_output=True, timeout=PATIENCE, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return command[0]
    first = found.stdout.decode("ascii", "replace").split("\n", 1)[0]
    return " ".join("".join(sign if sign.isprintable() else "_" for sign in first).split())[:60] or command[0]


def run_header(compiler: Compiler, folder: Path, header: str, prefix: str, states: States, regressor: bool) -> Run:
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
    }
    for name, value in values.items():
        text = text.replace(f"@{name}@", value)
    source = folder / "dynident_driver.c"
    source.write_text(text, encoding="ascii")
    program = _built(compiler, folder, source, "driver")
    inputs = [motion.q, motion.dq, motion.ddq, *([motion.temperature] if motion.temperature is not None else [])]
    given, taken = folder / "states.bin", folder / "torques.bin"
    np.stack(inputs, axis=1).astype(np.float64).tofile(given)
    _run([str(program), str(given), str(taken)], folder)
    test = folder / "dynident_self_test.c"
    test.write_text(f'#define {prefix.upper()}_SELF_TEST\n#include "{copy.name}"\n', encoding="ascii")
    _run([str(_built(compiler, folder, test, "self_test"))], folder)
    found = np.fromfile(taken).reshape(-1, 4, motion.q.shape[1])
    if len(found) != len(motion.q):
        raise ValueError(f"the compiled header gave {len(found)} of {len(motion.q)} states")
    return Run(found[:, 0], found[:, 1], found[:, 2], found[:, 3])


def build_library(compiler: Compiler, folder: Path, source: str, library: str) -> None:
    """Compile one source of a folder into a shared library beside it; only what it exports is seen from outside.

    Raises:
        NoCompilerRuns: Not even the smallest program can be built here.
        ValueError: The source does not compile.
    """
    position = () if sys.platform == "win32" else ("-fPIC",)
    flags = ("-std=c99", "-O2", "-shared", *position, "-fvisibility=hidden")
    _check_built(compiler, folder, _compile(compiler, folder, Path(source), Path(library), flags))


def _built(compiler: Compiler, folder: Path, source: Path, name: str) -> Path:
    """Return the program made of a source."""
    program = folder / f"{name}.exe"
    _check_built(compiler, folder, _compile(compiler, folder, source, program))
    return program


def _check_built(compiler: Compiler, folder: Path, found: str) -> None:
    """Refuse what the compiler has said of a source; where it builds nothing at all, that is the reason."""
    if found:
        least = folder / "least.c"
        least.write_text("#include <math.h>\n#include <stdio.h>\nint main(void) { return 0; }\n", encoding="ascii")
        if why := _compile(compiler, folder, least, folder / "least.exe"):
            raise NoCompilerRuns(f"it cannot build the smallest program ({why})")
        raise ValueError(f"the C compiler refuses it: {found}")


def _compile(compiler: Compiler, folder: Path, source: Path, program: Path, flags: tuple[str, ...] = FLAGS) -> str:
    """Return why a source does not compile; empty where it does."""
    command = [*compiler.command, *flags, "-o", str(program), str(source), "-lm"]
    try:
        found = subprocess.run(command, capture_output=True, timeout=PATIENCE, check=False, cwd=folder)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NoCompilerRuns(f"it does not run ({type(error).__name__})") from error
    return "" if found.returncode == 0 else found.stderr.decode("utf-8", "replace")[:300] or "no message"


def _run(command: list[str], folder: Path) -> None:
    try:
        found = subprocess.run(command, capture_output=True, timeout=PATIENCE, check=False, cwd=folder)
    except OSError as error:
        raise NoCompilerRuns(f"programs cannot be run in '{folder}' ({error.strerror})") from error
    if found.returncode:
        told = found.stdout.decode("ascii", "replace")
        raise ValueError(f"{Path(command[0]).stem} ends with {found.returncode}: {told}")
