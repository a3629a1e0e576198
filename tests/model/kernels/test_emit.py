"""Generated machine code: each layout of arrays, sine and cosine to the last bits, and the C text of a program."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import threading
from pathlib import Path

import numpy as np
import pytest
from random_arms import Arm

from dynident.arrays import Array
from dynident.exports.models.writing.c_text import c99_function
from dynident.model.kernels import batched, compiled
from dynident.model.kernels.compiled import Kernel, kernel, lanes
from dynident.model.kernels.emit import Access, Buffer, Layout, llvm_assembly
from dynident.model.kernels.recursion import TracedChain
from dynident.model.kernels.trace import Trace, TracedProgram, cosine, sine


def turning() -> tuple[TracedProgram, Layout]:
    """Sine and cosine of one angle, by row."""
    trace = Trace()
    x = trace.input("x", 0)
    program = trace.program({0: sine(x), 1: cosine(x)})
    row = Buffer("x", Access.BY_ROW)
    return program, Layout((row,), (Buffer("out", Access.BY_ROW),), {0: (0, 0), 1: (0, 1)})


def turned(x: Array) -> Array:
    out = np.empty((2, len(x)))
    Kernel(*turning()).run((np.ascontiguousarray(x[None]),), (out,), len(x))
    return out


@pytest.mark.skipif(np.finfo(np.longdouble).nmant <= 52, reason="no floating-point type here has more digits")
def test_sine_and_cosine_are_good_to_the_last_bit() -> None:
    """Absolute error below 2.5e-16 for |x| < 1e5, near multiples of pi/2 too."""
    random = np.random.default_rng(0)
    wide = 10.0 ** random.uniform(-9, 5, 20_000) * random.choice([-1.0, 1.0], 20_000)
    near = np.pi / 2 * random.integers(-60_000, 60_000, 20_000)
    x = np.concatenate([wide, near, np.nextafter(near, np.inf), [0.0, -0.0, 1e5, -1e5]])
    exact = x.astype(np.longdouble)
    found = turned(x)
    assert np.abs(found[0] - np.sin(exact)).max() < 2.5e-16
    assert np.abs(found[1] - np.cos(exact)).max() < 2.5e-16


def test_angles_out_of_reach_are_not_a_number() -> None:
    x = np.array([np.nan, np.inf, -np.inf, 1e10, -1e300, 1.0, 0.0, 2.0**31])
    found = turned(x)
    assert np.isnan(found[:, :5]).all()
    assert np.allclose(found[:, 5:], [np.sin(x[5:]), np.cos(x[5:])], rtol=0, atol=1e-9)


@pytest.mark.parametrize("width", [1, 3, 8, 11])
@pytest.mark.parametrize("count", [1, 3, 8, 9, 50])
def test_all_layouts_carry_every_entry(width: int, count: int) -> None:
    """x by sample, y by row, z fixed: out[k] = x[k] y[k] + z[k], every third entry absent."""
    trace = Trace()
    slots = [k for k in range(width) if k % 3 != 1]
    values = {k: trace.input("x", k) * trace.input("y", k) + trace.input("z", k) for k in slots}
    program = trace.program(values)
    inputs = (Buffer("x", Access.BY_SAMPLE, width), Buffer("y", Access.BY_ROW), Buffer("z", Access.FIXED))
    random = np.random.default_rng(1)
    x, y, z = random.normal(size=(count, width)), random.normal(size=(width, count)), random.normal(size=width)
    expected = np.where(np.isin(np.arange(width), slots), x * y.T + z, 0.0)
    for access in (Access.BY_SAMPLE, Access.BY_ROW):
        layout = Layout(inputs, (Buffer("out", access, width),), {k: (0, k) for k in slots})
        padded = np.zeros((count + 2, width) if access is Access.BY_SAMPLE else (width, count))
        out = padded[:count] if access is Access.BY_SAMPLE else padded
        Kernel(program, layout).run((x, y, z), (out,), count)
        found = out if access is Access.BY_SAMPLE else out.T
        assert np.allclose(found, expected, rtol=1e-15, atol=1e-15)
        assert not padded[count:].any() or access is Access.BY_ROW  # nothing behind the end


def test_constants_and_copies_are_outputs_too() -> None:
    trace = Trace()
    x = trace.input("x", 0)
    program = trace.program({0: x, 1: 2.5, 2: -x})
    layout = Layout(
        (Buffer("x", Access.BY_SAMPLE, 1),), (Buffer("out", Access.BY_SAMPLE, 3),), {k: (0, k) for k in range(3)}
    )
    out = np.empty((12, 3))
    Kernel(program, layout).run((np.arange(12.0)[:, None],), (out,), 12)
    assert np.array_equal(out, np.stack([np.arange(12.0), np.full(12, 2.5), -np.arange(12.0)], axis=1))


@pytest.mark.parametrize("width", [2, 4, 8])
def test_every_vector_width_computes_the_same(width: int, six: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    motion = six.states(29)
    expected = batched.inverse_dynamics(six.chain, six.theta, *motion)
    monkeypatch.setattr(compiled, "lanes", lambda: width)
    monkeypatch.setattr(compiled, "ready_kernels", compiled.OrderedDict())
    found = batched.inverse_dynamics(six.chain, six.theta, *motion)
    assert np.abs(found - expected).max() < 1e-14 * np.abs(expected).max()


def test_a_kernel_is_made_once_and_the_oldest_goes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []
    monkeypatch.setattr(compiled, "ready_kernels", compiled.OrderedDict())
    monkeypatch.setattr(compiled, "KEPT", 2)

    def make() -> tuple[TracedProgram, Layout]:
        made.append(1)
        return turning()

    threads = [threading.Thread(target=kernel, args=("a", make)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(made) == 1
    first = kernel("a", make)
    assert kernel("none", lambda: None) is None
    assert kernel("a", make) is first
    kernel("b", make)  # "none" is the one used longest ago
    assert kernel("a", make) is first
    assert len(made) == 2


def test_the_assembly_is_plain_text_of_the_program() -> None:
    text = llvm_assembly(*turning(), lanes=4, name="turn")
    assert text.startswith("declare <4 x double> @llvm.fma.v4f64(")
    assert "define void @turn(i64 %count, i64 %stride, ptr %arrays) nounwind {" in text
    assert text.count("store <4 x double>") == 2
    assert lanes() in (4, 8)


def test_the_c_text_computes_the_same(tmp_path: Path, six: Arm) -> None:
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler here")
    traced = TracedChain(six.chain, six.theta)
    text = c99_function(traced.trace.program(traced.torque()), "torque", ("q", "dq", "ddq"), 6)
    source, library = tmp_path / "torque.c", tmp_path / "torque.so"
    source.write_text(f"#include <math.h>\n{text}", encoding="ascii")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-shared", "-fPIC", "-O1"]
    subprocess.run([compiler, *flags, str(source), "-o", str(library), "-lm"], check=True)
    call = ctypes.CDLL(str(library)).torque
    motion, out = six.states(5), np.empty(6)
    expected = batched.inverse_dynamics(six.chain, six.theta, *motion)
    for s in range(5):
        rows = [np.ascontiguousarray(values[s]) for values in motion]
        call(*(ctypes.c_void_p(row.ctypes.data) for row in (*rows, out)))
        assert np.abs(out - expected[s]).max() < 1e-13 * np.abs(expected).max()


def test_the_c_text_names_arrays_that_are_missing(six: Arm) -> None:
    traced = TracedChain(six.chain)
    program = traced.trace.program(traced.mass())
    with pytest.raises(ValueError, match=r"the program reads \['theta'\], the function takes \['q', 'dq'\]"):
        c99_function(program, "mass", ("q", "dq"), 36)
    text = c99_function(program, "mass", ("theta", "q", "dq"), 37)
    assert "    (void)dq;\n" in text
    assert "    out[36] = 0.0;\n}\n" in text
