"""Second-order sections run along signals side by side, as machine code that a process loads in milliseconds.

The recursion of one signal waits for its own last result at every sample; the same step of many signals fills vector
registers, and a section works on a sample while the one after it works on the sample before.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any

import numpy as np

from dynident.arrays import Array, address
from dynident.model.kernels.compiled import kept, lanes, machine_code

#: Vectors of signals that are filtered side by side.
_VECTORS = 2


class Recurrence:
    """Second-order sections b0, b1, b2, 1, a1, a2, shape (S, 6); their state after a constant of one is ``settled``."""

    def __init__(self, sections: Array, settled: Array) -> None:
        self.width, count = _VECTORS * lanes(), len(sections)
        self._engine, self._call = kept(("recurrence", lanes(), count), lambda: _machine(count))
        self._sections, self._settled = np.ascontiguousarray(sections), settled[:, :, None]

    def state_of(self, values: Array) -> Array:
        """Return the state of signals that have always had these values, shape (width,)."""
        return self._settled * values

    def run(self, signals: Array, state: Array, backwards: bool = False) -> None:
        """Filter signals (N, width) in place, from the last sample to the first ``backwards``; the state goes on.

        The interpreter's lock is not held.

        Raises:
            ValueError: Another shape, type or order.
        """
        for array, shape in ((signals, (len(signals), self.width)), (state, (len(self._sections), 2, self.width))):
            if array.shape != shape or not array.flags.c_contiguous or array.dtype != np.float64:
                raise ValueError(f"signals and state must be float64 in C order of shape {shape}, not {array.shape}")
        if len(signals):
            step, first = (-self.width, signals[-1]) if backwards else (self.width, signals[0])
            self._call(len(signals), step, *map(address, (first, self._sections, state)))


def _machine(sections: int) -> tuple[Any, Any]:
    """Return an engine with the machine code, and the function in it."""
    engine = machine_code("\n".join(_SectionLoop(lanes(), sections).module()) + "\n")
    kind = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 2, *[ctypes.c_void_p] * 3)
    return engine, kind(engine.get_function_address("recurrence"))


class _SectionLoop:
    """Writes LLVM assembly of ``void recurrence(samples, step, signals, sections, state)``.

    The sections are in transposed direct form II.
    """

    def __init__(self, width: int, sections: int) -> None:
        self.width, self.real = width, f"<{width} x double>"
        self.states = [(s, i, v) for s in range(sections) for i in range(2) for v in range(_VECTORS)]
        self.sections = range(sections)

    def module(self) -> Iterator[str]:
        """Yield the lines."""
        yield "define void @recurrence(i64 %samples, i64 %step, ptr noalias %signals, ptr noalias %sections,"
        yield "                        ptr noalias %state) nounwind {"
        yield "entry:"
        for s in self.sections:
            for k in (0, 1, 2, 4, 5):
                yield from self._everywhere(f"c{s}k{k}", 6 * s + k)
        for s, i, v in self.states:
            yield from self._load(f"begin{s}i{i}v{v}", "%state", (2 * s + i) * _VECTORS + v)
        yield "  br label %sample"
        yield "sample:"
        yield "  %t = phi i64 [0, %entry], [%t.next, %sample]"
        yield "  %at = phi ptr [%signals, %entry], [%at.next, %sample]"
        for s, i, v in self.states:
            yield f"  %state{s}i{i}v{v} = phi {self.real} [%begin{s}i{i}v{v}, %entry], [%next{s}i{i}v{v}, %sample]"
        for v in range(_VECTORS):
            yield from self._load(f"x0v{v}", "%at", v)
            for s in self.sections:
                x, y, c = f"%x{s}v{v}", f"%x{s + 1}v{v}", f"%c{s}k"
                yield from self._plus(y, f"{c}0", x, f"%state{s}i0v{v}")
                yield from self._plus(f"%carry{s}v{v}", f"{c}1", x, f"%state{s}i1v{v}")
                yield from self._minus(f"%next{s}i0v{v}", f"%carry{s}v{v}", f"{c}4", y)
                yield f"  %late{s}v{v} = fmul {self.real} {c}2, {x}"
                yield from self._minus(f"%next{s}i1v{v}", f"%late{s}v{v}", f"{c}5", y)
            yield f"  %x0v{v}.out = getelementptr double, ptr %at, i64 {v * self.width}"
            yield f"  store {self.real} %x{len(self.sections)}v{v}, ptr %x0v{v}.out, align 8"
        yield "  %at.next = getelementptr double, ptr %at, i64 %step"
        yield "  %t.next = add i64 %t, 1"
        yield "  %more = icmp slt i64 %t.next, %samples"
        yield "  br i1 %more, label %sample, label %exit"
        yield "exit:"
        for s, i, v in self.states:
            yield f"  store {self.real} %next{s}i{i}v{v}, ptr %begin{s}i{i}v{v}.at, align 8"
        yield "  ret void"
        yield "}"

    def _load(self, name: str, pointer: str, vector: int) -> Iterator[str]:
        yield f"  %{name}.at = getelementptr double, ptr {pointer}, i64 {vector * self.width}"
        yield f"  %{name} = load {self.real}, ptr %{name}.at, align 8"

    def _everywhere(self, name: str, entry: int) -> Iterator[str]:
        """Load one number into all lanes."""
        yield f"  %{name}.at = getelementptr double, ptr %sections, i64 {entry}"
        yield f"  %{name}.one = load double, ptr %{name}.at, align 8"
        yield f"  %{name}.put = insertelement {self.real} poison, double %{name}.one, i32 0"
        mask = f"<{self.width} x i32> zeroinitializer"
        yield f"  %{name} = shufflevector {self.real} %{name}.put, {self.real} poison, {mask}"

    def _plus(self, name: str, left: str, right: str, added: str) -> Iterator[str]:
        yield f"  {name}.product = fmul contract {self.real} {left}, {right}"
        yield f"  {name} = fadd contract {self.real} {name}.product, {added}"

    def _minus(self, name: str, value: str, left: str, right: str) -> Iterator[str]:
        yield f"  {name}.product = fmul contract {self.real} {left}, {right}"
        yield f"  {name} = fsub contract {self.real} {value}, {name}.product"
