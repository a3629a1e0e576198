"""Rows beside a triangle: the Gram matrix of [R; A] R^-1 = [I; W], at the speed of a product of large matrices.

Panels of some ten columns and a thousand rows are too thin for a BLAS, which packs its arguments anew for each of them.
Here rows lie as they come, the samples of a column together, and several samples go through one instruction. Both loops
work on tiles of four columns; where the columns are no multiple of four the last tile overlaps the one before.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any

import numpy as np

from dynident.arrays import Array, address
from dynident.model.kernels.compiled import kept, lanes, machine_code

#: Columns of a tile.
_TILE = 4


class Preconditioned:
    """Makes Gram matrices of rows divided by a triangle; keeps its working memory, so one for each thread."""

    def __init__(self) -> None:
        self._lanes, self._fewest = lanes(), lanes() * _steps(lanes())
        self._engine, self._call = kept(("preconditioned", self._lanes), _machine)  # the function lives in the engine
        self._room = np.empty(0)

    def takes(self, rows: Array) -> bool:
        """Return whether rows, shape (m, k), are enough and wide enough on this processor."""
        return len(rows) >= self._fewest and rows.shape[1] >= _TILE

    def gram(self, factor: Array, rows: Array) -> Array:
        """Return I + W'W with W = A R^-1, its upper triangle, shape (k, k); below it stand numbers, no more.

        The quotient has a small backward error entry by entry, |A - W R| <= k eps |W| |R| (Higham 2002, theorem 8.5).
        A triangle that cannot be divided by gives infinities or NaN. The interpreter's lock is not held.

        Args:
            factor: R, shape (k, k), float64 in Fortran order; what stands below its diagonal is not read.
            rows: A, shape (m, k), float64 in Fortran order, as :meth:`takes` says.

        Raises:
            ValueError: Another shape, type or order.
        """
        count, size = rows.shape
        if factor.shape != (size, size) or not self.takes(rows):
            raise ValueError(f"a factor R of shape {factor.shape} does not fit rows of {rows.shape}")
        for array in (factor, rows):
            if not (array.flags.f_contiguous and array.dtype == np.float64):
                raise ValueError("factor and rows must be float64 arrays in Fortran order")
        whole = -(-count // self._lanes) * self._lanes
        if len(self._room) < size * whole:
            self._room = np.empty(size * whole)
        if whole > count:
            self._room[: size * whole].reshape(size, whole)[:, count:] = 0.0
        gram = np.zeros((size, size), order="F")
        self._call(size, count, whole, address(rows.T), address(factor.T), address(self._room), address(gram.T))
        return gram


def _steps(width: int) -> int:
    """Return how many vectors of samples a tile of the division holds: what the registers have room for."""
    return 4 if width == 8 else 2


def _machine() -> tuple[Any, Any]:
    """Return an engine with the machine code, and the function in it."""
    engine = machine_code("\n".join(_Assembly(lanes()).module()) + "\n")
    kind = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 3, *[ctypes.c_void_p] * 4)
    return engine, kind(engine.get_function_address("preconditioned"))


class _Assembly:
    """Writes LLVM assembly of ``void preconditioned(size, count, whole, rows, factor, quotient, gram)``.

    ``quotient`` has ``whole`` samples in a row, ``rows`` has ``count``.
    """

    def __init__(self, width: int) -> None:
        self.width, self.steps = width, _steps(width)
        self.real = f"<{width} x double>"

    def module(self) -> Iterator[str]:
        yield f"declare double @llvm.vector.reduce.fadd.v{self.width}f64(double, {self.real})"
        yield "define void @preconditioned(i64 %size, i64 %count, i64 %whole, ptr noalias %rows, ptr noalias %factor,"
        yield "                      ptr noalias %quotient, ptr noalias %gram) nounwind {"
        yield "entry:"
        yield f"  %lasttile = sub i64 %size, {_TILE}"
        yield f"  %laststrip = sub i64 %count, {self.width * self.steps}"
        yield "  br label %strip"
        yield from self._division()
        yield from self._products()
        yield "exit:"
        yield "  ret void"
        yield "}"

    def _division(self) -> Iterator[str]:
        """Solve X R = A for some samples, four columns at a time."""
        tile, steps = range(_TILE), range(self.steps)
        yield "strip:"
        yield "  %s = phi i64 [0, %entry], [%s.next, %strip.end]"
        yield "  br label %solve"
        yield "solve:"
        yield "  %j = phi i64 [0, %strip], [%j.next, %solve.end]"
        for c in tile:
            yield f"  %j{c} = add i64 %j, {c}"
            yield from self._at(f"a{c}", "rows", f"%j{c}", "%count", "%s")
            yield from self._at(f"x{c}", "quotient", f"%j{c}", "%whole", "%s")
            yield from self._at(f"r{c}", "factor", f"%j{c}", "%size", "0")
            for v in steps:
                yield from self._load(f"own{c}v{v}", f"%a{c}", v * self.width)
        yield "  %first = icmp eq i64 %j, 0"
        yield "  br i1 %first, label %diagonal, label %before"
        yield from self._columns_before()
        yield from self._own_columns()
        yield "  br label %solve.end"
        yield "solve.end:"
        yield from self._next("j", _TILE, "%lasttile", "solve", "strip.end")
        yield "strip.end:"
        yield from self._next("s", self.width * self.steps, "%laststrip", "strip", "column")

    def _columns_before(self) -> Iterator[str]:
        """Subtract the columns left of the tile, one at a time."""
        tile, steps, real = range(_TILE), range(self.steps), self.real
        yield "before:"
        yield "  %i = phi i64 [0, %solve], [%i.next, %before]"
        for c in tile:
            for v in steps:
                yield f"  %left{c}v{v} = phi {real} [%own{c}v{v}, %solve], [%less{c}v{v}, %before]"
        yield from self._at("xi", "quotient", "%i", "%whole", "%s")
        for v in steps:
            yield from self._load(f"xi.v{v}", "%xi", v * self.width)
        for c in tile:
            yield from self._spread(f"ri{c}", f"%r{c}", "%i")
            for v in steps:
                yield from self._subtract(f"%less{c}v{v}", f"%left{c}v{v}", f"%ri{c}", f"%xi.v{v}")
        yield "  %i.next = add i64 %i, 1"
        yield "  %i.more = icmp slt i64 %i.next, %j"
        yield "  br i1 %i.more, label %before, label %diagonal"

    def _own_columns(self) -> Iterator[str]:
        """Solve within the tile."""
        tile, steps, real = range(_TILE), range(self.steps), self.real
        yield "diagonal:"
        for c in tile:
            for v in steps:
                yield f"  %rest{c}c0v{v} = phi {real} [%own{c}v{v}, %solve], [%less{c}v{v}, %before]"
        for c in tile:
            yield f"  %pivot{c}.at = getelementptr double, ptr %r{c}, i64 %j{c}"
            yield f"  %pivot{c} = load double, ptr %pivot{c}.at, align 8"
            yield f"  %inverse{c}.one = fdiv double 1.0, %pivot{c}"
            yield from self._everywhere(f"inverse{c}")
            for v in steps:
                yield f"  %done{c}v{v} = fmul {real} %rest{c}c{c}v{v}, %inverse{c}"
                yield from self._store(f"%done{c}v{v}", f"%x{c}", v * self.width)
            for d in range(c + 1, _TILE):
                yield from self._spread(f"r{d}c{c}", f"%r{d}", f"%j{c}")
                for v in steps:
                    yield from self._subtract(
                        f"%rest{d}c{c + 1}v{v}", f"%rest{d}c{c}v{v}", f"%r{d}c{c}", f"%done{c}v{v}"
                    )

    def _products(self) -> Iterator[str]:
        """Write I + X'X, two tiles of columns at a time over all samples; samples beyond ``count`` are zero."""
        tile, real = range(_TILE), self.real
        yield "column:"
        yield "  %m = phi i64 [0, %strip.end], [%m.next, %column.end]"
        yield "  br label %row"
        yield "row:"
        yield "  %l = phi i64 [0, %column], [%l.next, %row.end]"
        for side in "lm":
            for c in tile:
                yield f"  %{side}{c} = add i64 %{side}, {c}"
                yield from self._at(f"{side}{c}.x", "quotient", f"%{side}{c}", "%whole", "0")
        yield "  br label %dot"
        yield "dot:"
        yield "  %t = phi i64 [0, %row], [%t.next, %dot]"
        pairs = [(a, b) for a in tile for b in tile]
        for a, b in pairs:
            yield f"  %sum{a}b{b} = phi {real} [zeroinitializer, %row], [%more{a}b{b}, %dot]"
        for side in "lm":
            for c in tile:
                yield from self._load(f"{side}{c}.v", f"%{side}{c}.x", "%t")
        for a, b in pairs:
            yield f"  %product{a}b{b} = fmul contract {real} %l{a}.v, %m{b}.v"
            yield f"  %more{a}b{b} = fadd contract {real} %sum{a}b{b}, %product{a}b{b}"
        yield f"  %t.next = add i64 %t, {self.width}"
        yield "  %t.more = icmp slt i64 %t.next, %whole"
        yield "  br i1 %t.more, label %dot, label %row.end"
        yield "row.end:"
        yield "  %diagonal.tile = icmp eq i64 %l, %m"
        yield "  %one = select i1 %diagonal.tile, double 1.0, double 0.0"
        for b in tile:
            yield from self._at(f"g{b}", "gram", f"%m{b}", "%size", "%l")
            for a in tile:
                call = f"call reassoc double @llvm.vector.reduce.fadd.v{self.width}f64"
                start = "%one" if a == b else "0.0"
                yield f"  %whole{a}b{b} = {call}(double {start}, {real} %more{a}b{b})"
                yield f"  %g{b}a{a} = getelementptr double, ptr %g{b}, i64 {a}"
                yield f"  store double %whole{a}b{b}, ptr %g{b}a{a}, align 8"
        yield from self._next("l", _TILE, "%m", "row", "column.end")
        yield "column.end:"
        yield from self._next("m", _TILE, "%lasttile", "column", "exit")

    def _next(self, counter: str, by: int, last: str, again: str, then: str) -> Iterator[str]:
        """Close a loop whose last step begins at ``last`` and may overlap the one before."""
        yield f"  %{counter}.after = add i64 %{counter}, {by}"
        yield f"  %{counter}.over = icmp sgt i64 %{counter}.after, {last}"
        yield f"  %{counter}.next = select i1 %{counter}.over, i64 {last}, i64 %{counter}.after"
        yield f"  %{counter}.done = icmp eq i64 %{counter}, {last}"
        yield f"  br i1 %{counter}.done, label %{then}, label %{again}"

    def _at(self, name: str, array: str, line: str, stride: str, entry: str) -> Iterator[str]:
        yield f"  %{name}.line = mul i64 {line}, {stride}"
        yield f"  %{name}.entry = add i64 %{name}.line, {entry}"
        yield f"  %{name} = getelementptr double, ptr %{array}, i64 %{name}.entry"

    def _load(self, name: str, pointer: str, offset: int | str) -> Iterator[str]:
        yield f"  %{name}.at = getelementptr double, ptr {pointer}, i64 {offset}"
        yield f"  %{name} = load {self.real}, ptr %{name}.at, align 8"

    def _store(self, value: str, pointer: str, offset: int) -> Iterator[str]:
        yield f"  {value}.at = getelementptr double, ptr {pointer}, i64 {offset}"
        yield f"  store {self.real} {value}, ptr {value}.at, align 8"

    def _spread(self, name: str, pointer: str, entry: str) -> Iterator[str]:
        """Load one number into all lanes."""
        yield f"  %{name}.at = getelementptr double, ptr {pointer}, i64 {entry}"
        yield f"  %{name}.one = load double, ptr %{name}.at, align 8"
        yield from self._everywhere(name)

    def _everywhere(self, name: str) -> Iterator[str]:
        yield f"  %{name}.put = insertelement {self.real} poison, double %{name}.one, i32 0"
        mask = f"<{self.width} x i32> zeroinitializer"
        yield f"  %{name} = shufflevector {self.real} %{name}.put, {self.real} poison, {mask}"

    def _subtract(self, name: str, value: str, left: str, right: str) -> Iterator[str]:
        yield f"  {name}.product = fmul contract {self.real} {left}, {right}"
        yield f"  {name} = fsub contract {self.real} {value}, {name}.product"
