"""A C header compiled into a library that tests call sample by sample."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from dynident.arrays import Array

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")

needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler on the path")

_OBSERVER = """
static arm_observer state;
void reset(void) { arm_observer_reset(&state); }
void observe(const double *q, const double *dq, const double *tau, const double *gain, const double *dt, double *out)
{
    int i;
    arm_observer_step(&state, q, dq, tau, gain, dt[0]);
    for (i = 0; i < ARM_JOINTS; ++i) out[i] = state.residual[i];
}
"""


class Header:
    """The functions of a header with the prefix ``arm``, in double, without temperatures."""

    def __init__(
        self, path: Path, functions: Sequence[tuple[str, int]], observer: bool = False, more: str = ""
    ) -> None:
        assert COMPILER is not None
        lines = [f'#include "{path.name}"']
        for name, inputs in functions:
            takes = ", ".join(f"const double *a{i}" for i in range(inputs))
            passes = ", ".join(f"a{i}" for i in range(inputs))
            lines.append(f"void {name}({takes}, double *out) {{ arm_{name}({passes}, out); }}")
        source, library = path.with_suffix(".c"), path.with_suffix(".so")
        source.write_text("\n".join(lines) + (_OBSERVER if observer else "\n") + more, encoding="ascii")
        command = [COMPILER, "-std=c99", "-O1", "-shared", "-fPIC", "-o", str(library), str(source), "-lm"]
        subprocess.run(command, check=True, timeout=120)
        self.library = ctypes.CDLL(str(library))

    def call(self, name: str, size: int, *arrays: Array) -> Array:
        """Return what a function writes for one sample."""
        held = [np.ascontiguousarray(array, dtype=float) for array in arrays]
        out = np.full(size, np.nan)
        getattr(self.library, name)(*(ctypes.c_void_p(array.ctypes.data) for array in (*held, out)))
        return out

    def rows(self, name: str, size: int, *arrays: Array) -> Array:
        """Return what a function writes for each sample."""
        return np.array([self.call(name, size, *row) for row in zip(*arrays, strict=True)])
