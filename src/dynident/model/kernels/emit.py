"""A traced program -> LLVM assembly that runs it on several samples at once.

The text is straight-line code on vectors of samples in one loop: nothing is left to an optimiser's luck, and a robot
with six joints compiles in a tenth of a second. Sine and cosine: argument reduction by multiples of pi/2 in three
parts (Cody and Waite 1980) with fused multiply-add, then the polynomials of FDLIBM (Sun Microsystems 1993); absolute
error below 2.5e-16 for |x| < 1e5, NaN beyond 2^31.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum

from dynident.model.kernels.trace import Node, TracedProgram

_REDUCTION = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591833e-33)  # pi/2 in three parts
_ROUNDER = 6755399441055744.0  # 1.5 * 2^52: adding it leaves the nearest whole number in the last bits
_SINE = (
    1.58969099521155010221e-10,
    -2.50507602534068634195e-08,
    2.75573137070700676789e-06,
    -1.98412698298579493134e-04,
    8.33333333332248946124e-03,
    -1.66666666666666324348e-01,
)
_COSINE = (
    -1.13596475577881948265e-11,
    2.08757232129817482790e-09,
    -2.75573143513906633035e-07,
    2.48015872894767294178e-05,
    -1.38888888888741095749e-03,
    4.16666666666666019037e-02,
)


class Access(Enum):
    """How an array of the caller is laid out."""

    FIXED = "one set of entries for all samples"
    BY_SAMPLE = "the entries of a sample stand together, (N, width)"
    BY_ROW = "the samples of an entry stand together, (entries, N)"


@dataclass(frozen=True)
class Buffer:
    """An array of the caller: its layout and, where samples are rows, how many entries a sample has."""

    name: str
    access: Access
    width: int = 0


@dataclass(frozen=True)
class Layout:
    """Where a program reads and writes.

    Attributes:
        inputs: The arrays that are read, by the names that the program uses.
        outputs: The arrays that are written.
        places: Index in ``outputs`` and entry in it, by slot of the program's outputs.
    """

    inputs: tuple[Buffer, ...]
    outputs: tuple[Buffer, ...]
    places: Mapping[int, tuple[int, int]]


def llvm_assembly(program: TracedProgram, layout: Layout, lanes: int, name: str = "kernel") -> str:
    """Return LLVM assembly of ``void name(i64 count, i64 stride, ptr arrays)``.

    Args:
        program: What to compute.
        layout: Where to read and write; ``arrays`` holds the addresses of the inputs, then of the outputs.
        lanes: Samples per step; ``count`` must be at least that. ``stride`` is N of the arrays laid out by row.
        name: Name of the function.
    """
    return "\n".join(_CodeAssembly(program, layout, lanes).function(name)) + "\n"


class _CodeAssembly:
    """Writes the lines of one function; ``%v7`` is node 7 of the program."""

    def __init__(self, program: TracedProgram, layout: Layout, lanes: int) -> None:
        self.program, self.layout, self.lanes = program, layout, lanes
        self.real, self.whole = f"<{lanes} x double>", f"<{lanes} x i64>"
        self.temporaries = 0
        self.turned: dict[int, tuple[str, str]] = {}

    def function(self, name: str) -> Iterator[str]:
        """Yield the module: one loop over the samples, whose last step overlaps the one before."""
        yield f"declare {self.real} @llvm.fma.v{self.lanes}f64({self.real}, {self.real}, {self.real})"
        yield f"declare {self.real} @llvm.fabs.v{self.lanes}f64({self.real})"
        yield f"define void @{name}(i64 %count, i64 %stride, ptr %arrays) nounwind {{"
        yield "entry:"
        buffers = (*self.layout.inputs, *self.layout.outputs)
        for k in range(len(buffers)):
            yield f"  %slot{k} = getelementptr ptr, ptr %arrays, i64 {k}"
            yield f"  %base{k} = load ptr, ptr %slot{k}"
        yield f"  %last = sub i64 %count, {self.lanes}"
        yield "  br label %loop"
        yield "loop:"
        yield "  %s = phi i64 [0, %entry], [%next, %loop]"
        for k, buffer in enumerate(self.layout.inputs):
            yield from self._load_all(k, buffer)
        for number, node in enumerate(self.program.nodes):
            yield from self._operation(number, node)
        for index, buffer in enumerate(self.layout.outputs):
            yield from self._store_all(index, buffer)
        yield "  %done = icmp eq i64 %s, %last"
        yield f"  %after = add i64 %s, {self.lanes}"
        yield "  %over = icmp sgt i64 %after, %last"
        yield "  %next = select i1 %over, i64 %last, i64 %after"
        yield "  br i1 %done, label %exit, label %loop"
        yield "exit:"
        yield "  ret void"
        yield "}"

    def _load_all(self, k: int, buffer: Buffer) -> Iterator[str]:
        """Load what the program reads of a buffer into its input nodes."""
        reads = {
            n.source.entry: i for i, n in enumerate(self.program.nodes) if n.source and n.source.array == buffer.name
        }
        if not reads:
            return
        if buffer.access is Access.BY_SAMPLE:  # neighbouring samples in one load, then sorted by entry
            size = self.lanes * buffer.width
            yield f"  %from{k} = mul i64 %s, {buffer.width}"
            yield f"  %at{k} = getelementptr double, ptr %base{k}, i64 %from{k}"
            yield f"  %all{k} = load <{size} x double>, ptr %at{k}, align 8"
        for entry, number in reads.items():
            if buffer.access is Access.BY_SAMPLE:
                picks = ", ".join(f"i32 {lane * buffer.width + entry}" for lane in range(self.lanes))
                whole = f"<{self.lanes * buffer.width} x double>"
                yield (f"  %v{number} = shufflevector {whole} %all{k}, {whole} poison, <{self.lanes} x i32> <{picks}>")
            elif buffer.access is Access.BY_ROW:
                yield from self._row_address(f"in{number}", k, entry)
                yield f"  %v{number} = load {self.real}, ptr %in{number}, align 8"
            else:
                yield f"  %in{number} = getelementptr double, ptr %base{k}, i64 {entry}"
                yield f"  %one{number} = load double, ptr %in{number}, align 8"
                yield f"  %put{number} = insertelement {self.real} poison, double %one{number}, i32 0"
                yield (
                    f"  %v{number} = shufflevector {self.real} %put{number}, {self.real} poison, "
                    f"<{self.lanes} x i32> zeroinitializer"
                )

    def _row_address(self, name: str, k: int, entry: int) -> Iterator[str]:
        yield f"  %{name}r = mul i64 %stride, {entry}"
        yield f"  %{name}s = add i64 %{name}r, %s"
        yield f"  %{name} = getelementptr double, ptr %base{k}, i64 %{name}s"

    def _store_all(self, index: int, buffer: Buffer) -> Iterator[str]:
        """Store what the program gives into an output buffer."""
        k = len(self.layout.inputs) + index
        places, ends = self.layout.places, self.program.outputs
        writes = {places[slot][1]: self._value(number) for slot, number in ends.items() if places[slot][0] == index}
        if buffer.access is Access.BY_ROW:
            for entry, value in writes.items():
                yield from self._row_address(f"out{index}e{entry}", k, entry)
                yield f"  store {self.real} {value}, ptr %out{index}e{entry}, align 8"
            return
        yield f"  %from{k} = mul i64 %s, {buffer.width}"
        yield f"  %at{k} = getelementptr double, ptr %base{k}, i64 %from{k}"
        nothing = self._constant(0.0)
        for start in range(0, buffer.width, self.lanes):  # squares of entries by samples, turned over
            first = max(0, min(start, buffer.width - self.lanes))
            square = [writes.get(first + i, nothing) for i in range(self.lanes)]
            yield from self._store_square(f"at{k}", f"sq{index}e{first}", square, first, buffer.width)

    def _store_square(self, base: str, name: str, square: list[str], first: int, width: int) -> Iterator[str]:
        """Store ``lanes`` neighbouring entries of as many samples, given by entry, sample after sample."""
        lanes, step = self.lanes, 1
        while step < lanes:
            for i in (i for i in range(lanes) if not i & step):
                pair = f"{self.real} {square[i]}, {self.real} {square[i + step]}"
                upper = [j if not j & step else lanes + j - step for j in range(lanes)]
                lower = [j + step if not j & step else lanes + j for j in range(lanes)]
                for k, picks in ((i, upper), (i + step, lower)):
                    mask = ", ".join(f"i32 {pick}" for pick in picks)
                    yield f"  %{name}n{step}k{k} = shufflevector {pair}, <{lanes} x i32> <{mask}>"
                    square[k] = f"%{name}n{step}k{k}"
            step *= 2
        count = min(lanes, width)
        for lane, value in enumerate(square):
            yield f"  %{name}p{lane} = getelementptr double, ptr %{base}, i64 {lane * width + first}"
            if count == lanes:
                yield f"  store {self.real} {value}, ptr %{name}p{lane}, align 8"
                continue
            mask = ", ".join(f"i32 {pick}" for pick in range(count))
            yield f"  %{name}c{lane} = shufflevector {self.real} {value}, {self.real} poison, <{count} x i32> <{mask}>"
            yield f"  store <{count} x double> %{name}c{lane}, ptr %{name}p{lane}, align 8"

    def _operation(self, number: int, node: Node) -> Iterator[str]:
        if node.operation in ("input", "const"):
            return
        left = self._value(node.left)
        if node.operation in ("sin", "cos"):
            if node.left not in self.turned:
                yield from self._sine_and_cosine(node.left)
            chosen = self.turned[node.left][node.operation == "cos"]
            yield f"  %v{number} = bitcast {self.whole} {chosen} to {self.real}"
        elif node.operation == "neg":
            yield f"  %v{number} = fneg nsz {self.real} {left}"
        else:
            right = self._value(node.right)
            yield f"  %v{number} = f{node.operation} contract nsz {self.real} {left}, {right}"

    def _value(self, number: int) -> str:
        node = self.program.nodes[number]
        return self._constant(node.value) if node.operation == "const" else f"%v{number}"

    def _constant(self, value: float) -> str:
        bits = struct.unpack("<Q", struct.pack("<d", value))[0]
        return "<" + ", ".join([f"double 0x{bits:016X}"] * self.lanes) + ">"

    def _whole(self, value: int) -> str:
        return "<" + ", ".join([f"i64 {value}"] * self.lanes) + ">"

    def _sine_and_cosine(self, number: int) -> Iterator[str]:
        """Write sine and cosine of a node; no flag on these lines, each rounding counts."""
        real, whole, x = self.real, self.whole, self._value(number)
        fma, t = f"call {real} @llvm.fma.v{self.lanes}f64", f"%a{number}"

        def polynomial(name: str, coefficients: tuple[float, ...]) -> Iterator[str]:
            value = self._constant(coefficients[0])
            for i, coefficient in enumerate(coefficients[1:]):
                yield f"  {t}{name}{i} = {fma}({real} {value}, {real} {t}z, {real} {self._constant(coefficient)})"
                value = f"{t}{name}{i}"

        yield f"  {t}scaled = fmul {real} {x}, {self._constant(0.6366197723675814)}"
        yield f"  {t}bits = fadd {real} {t}scaled, {self._constant(_ROUNDER)}"
        yield f"  {t}turns = fsub {real} {t}bits, {self._constant(_ROUNDER)}"
        yield f"  {t}quarter = bitcast {real} {t}bits to {whole}"
        rest = x
        for i, part in enumerate(_REDUCTION):
            yield f"  {t}r{i} = {fma}({real} {t}turns, {real} {self._constant(-part)}, {real} {rest})"
            rest = f"{t}r{i}"
        yield f"  {t}size = call {real} @llvm.fabs.v{self.lanes}f64({real} {x})"
        yield f"  {t}far = fcmp ogt {real} {t}size, {self._constant(2.0**31)}"
        yield f"  {t}r = select <{self.lanes} x i1> {t}far, {real} {self._constant(float('nan'))}, {real} {rest}"
        yield f"  {t}z = fmul {real} {t}r, {t}r"
        yield from polynomial("s", _SINE)
        yield f"  {t}cube = fmul {real} {t}z, {t}r"
        yield f"  {t}sine = {fma}({real} {t}s4, {real} {t}cube, {real} {t}r)"
        yield from polynomial("c", _COSINE)
        yield f"  {t}half = fmul {real} {t}z, {self._constant(0.5)}"
        yield f"  {t}w = fsub {real} {self._constant(1.0)}, {t}half"
        yield f"  {t}lost = fsub {real} {self._constant(1.0)}, {t}w"
        yield f"  {t}tail = fsub {real} {t}lost, {t}half"
        yield f"  {t}square = fmul {real} {t}z, {t}z"
        yield f"  {t}more = {fma}({real} {t}c4, {real} {t}square, {real} {t}tail)"
        yield f"  {t}cosine = fadd {real} {t}w, {t}more"
        yield f"  {t}odd = and {whole} {t}quarter, {self._whole(1)}"
        yield f"  {t}swap = icmp ne {whole} {t}odd, {self._whole(0)}"
        ends = []
        for name, plain, other, shift in (("S", "sine", "cosine", 0), ("C", "cosine", "sine", 1)):
            yield f"  {t}{name} = select <{self.lanes} x i1> {t}swap, {real} {t}{other}, {real} {t}{plain}"
            yield f"  {t}{name}q = add {whole} {t}quarter, {self._whole(shift)}"
            yield f"  {t}{name}n = and {whole} {t}{name}q, {self._whole(2)}"
            yield f"  {t}{name}m = shl {whole} {t}{name}n, {self._whole(62)}"
            yield f"  {t}{name}b = bitcast {real} {t}{name} to {whole}"
            yield f"  {t}{name}e = xor {whole} {t}{name}b, {t}{name}m"
            ends.append(f"{t}{name}e")
        self.turned[number] = (ends[0], ends[1])
