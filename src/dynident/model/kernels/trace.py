"""A scalar tracer: run a formula once on traced scalars and keep what it computes as a short straight program.

Every operation is numbered by its value (the same operation on the same operands is the same node), constants fold, and
factors 0, 1 and -1 vanish; what no output needs is never part of the program. Source of value numbering: Cocke 1970; of
the reverse mode: Linnainmaa 1976.

Bodies need sums, products, sines and cosines, which alone become compiled kernels; friction needs the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from dynident.arrays import Array
from dynident.model.kernels.operations import SIZES, VALUED, VALUES, Rules


class InputSource(NamedTuple):
    """Where an input stands: an array of the caller and the entry in it."""

    array: str
    entry: int


class Node(NamedTuple):
    """One operation of ``operations.py``, ``const`` or ``input``; ``value`` is that of a constant, or an option."""

    operation: str
    left: int = -1
    right: int = -1
    value: float = 0.0
    source: InputSource | None = None

    @property
    def operands(self) -> tuple[int, ...]:
        """The nodes that the operation reads."""
        return tuple(k for k in (self.left, self.right) if k >= 0)


class Trace:
    """The operations met so far. Build scalars with :meth:`input`; take programs out with :meth:`program`."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._numbers: dict[Node, int] = {}

    def node(self, operation: str, left: int = -1, right: int = -1, value: float = 0.0) -> Scalar:
        """Return the scalar of an operation, the known one where the operation has been met before."""
        return self._numbered(Node(operation, left, right, value))

    def input(self, array: str, entry: int) -> Scalar:
        """Return the scalar that stands for one entry of an array of the caller."""
        return self._numbered(Node("input", source=InputSource(array, entry)))

    def program(self, outputs: Mapping[int, Number]) -> TracedProgram:
        """Return the program of some outputs, by slot; outputs that are exactly zero are left out."""
        ends = {slot: self._node_of(value) for slot, value in outputs.items() if not is_zero(value)}
        keep = self.needed(ends.values())
        place = {old: new for new, old in enumerate(keep)}
        nodes = [self.nodes[k] for k in keep]
        moved = (n._replace(left=place.get(n.left, -1), right=place.get(n.right, -1)) for n in nodes)
        return TracedProgram(tuple(moved), {slot: place[k] for slot, k in ends.items()})

    def needed(self, ends: Iterable[int]) -> list[int]:
        """Return the nodes that some nodes need, operands first."""
        found: set[int] = set()
        ahead = list(ends)
        while ahead:
            k = ahead.pop()
            if k not in found:
                found.add(k)
                ahead += self.nodes[k].operands
        return sorted(found)

    def constant(self, value: float) -> Scalar:
        """Return a constant as a node of the trace."""
        return self.node("const", value=float(value))

    def _node_of(self, value: Number) -> int:
        return value.number if isinstance(value, Scalar) else self.constant(value).number

    def _numbered(self, node: Node) -> Scalar:
        number = self._numbers.get(node)
        if number is None:
            number = self._numbers[node] = len(self.nodes)
            self.nodes.append(node)
        return Scalar(self, number)


class Scalar:
    """A value that is known only when the program runs; constants beside it are plain floats."""

    __slots__ = ("number", "trace")

    def __init__(self, trace: Trace, number: int) -> None:
        self.trace, self.number = trace, number

    @property
    def _node(self) -> Node:
        return self.trace.nodes[self.number]

    def _other(self, other: Number) -> Scalar:
        return other if isinstance(other, Scalar) else self.trace.constant(other)

    def __neg__(self) -> Scalar:
        node = self._node
        if node.operation == "neg":
            return Scalar(self.trace, node.left)
        if node.operation == "sub":
            return self.trace.node("sub", node.right, node.left)
        return self.trace.node("neg", self.number)

    def __add__(self, other: Number) -> Scalar:
        if is_zero(other):
            return self
        other = self._other(other)
        for one, two in ((self, other), (other, self)):
            if two._node.operation == "neg":  # a + (-b)
                return self.trace.node("sub", one.number, two._node.left)
        return self.trace.node("add", *sorted((self.number, other.number)))

    __radd__ = __add__

    def __sub__(self, other: Number) -> Number:
        if is_zero(other):
            return self
        other = self._other(other)
        if other.number == self.number:
            return 0.0
        if other._node.operation == "neg":
            return self + Scalar(self.trace, other._node.left)
        if self._node.operation == "neg":  # -a - b
            return -(Scalar(self.trace, self._node.left) + other)
        return self.trace.node("sub", self.number, other.number)

    def __rsub__(self, other: float) -> Number:
        return -self + other

    def __mul__(self, other: Number) -> Number:
        if not isinstance(other, Scalar):
            if other in (0.0, 1.0, -1.0):
                return {0.0: 0.0, 1.0: self, -1.0: -self}[other]
            if other < 0:  # one constant for both signs
                return -(self * -other)
            other = self.trace.constant(other)
        if self._node.operation == "neg":
            return -(Scalar(self.trace, self._node.left) * other)
        if other._node.operation == "neg":
            return -(self * Scalar(self.trace, other._node.left))
        return self.trace.node("mul", *sorted((self.number, other.number)))

    __rmul__ = __mul__

    def __truediv__(self, other: Number) -> Number:
        return self if not isinstance(other, Scalar) and other == 1.0 else self._divided(self._other(other))

    def __rtruediv__(self, other: float) -> Number:
        return 0.0 if other == 0.0 else self._other(other)._divided(self)

    def _divided(self, other: Scalar) -> Number:
        if self._node.operation == "neg":
            return -self.trace.node("div", self._node.left, other.number)
        return self.trace.node("div", self.number, other.number)

    def __pow__(self, exponent: float) -> Number:
        return power(self, exponent)

    def __abs__(self) -> Scalar:
        return self.trace.node("abs", self.number)


Number: TypeAlias = Scalar | float


def is_zero(value: Number) -> bool:
    """Say whether a value is zero whatever the inputs are."""
    return not isinstance(value, Scalar) and value == 0.0


def sine(angle: Number) -> Number:
    """Return the sine of a scalar or of a constant."""
    return _applied("sin", angle)


def cosine(angle: Number) -> Number:
    """Return the cosine of a scalar or of a constant."""
    return _applied("cos", angle)


def exponential(value: Number) -> Number:
    """Return e to the power of a value."""
    return _applied("exp", value)


def tangent_hyperbolic(value: Number) -> Number:
    """Return the hyperbolic tangent of a value."""
    return _applied("tanh", value)


def sign(value: Number) -> Number:
    """Return -1, 0 or 1."""
    return _applied("sign", value)


def smooth_sign(value: Number, width: float) -> Number:
    """Return tanh(value / width), a sign that turns over some width; the sharp sign for a width of 0.

    It is an operation of its own, so that who runs a program may turn the sign over another width.
    """
    return _applied("turn", value, width)


def power(base: Number, exponent: float) -> Number:
    """Return a base >= 0 to a constant power; of any sign for the powers 1, 2 and 3."""
    if exponent in (1.0, 2.0, 3.0):
        return base if exponent == 1.0 else base * base if exponent == 2.0 else base * base * base
    return _applied("pow", base, exponent)


def larger(one: Number, other: Number) -> Number:
    """Return the larger one of two values."""
    return _compared("max", one, other)


def smaller(one: Number, other: Number) -> Number:
    """Return the smaller one of two values."""
    return _compared("min", one, other)


def _applied(operation: str, value: Number, option: float = 0.0) -> Number:
    if isinstance(value, Scalar):
        return value.trace.node(operation, value.number, value=float(option))
    return float(VALUES[operation](value, *([option] if operation in VALUED else [])))


def _compared(operation: str, one: Number, other: Number) -> Number:
    trace = next((value.trace for value in (one, other) if isinstance(value, Scalar)), None)
    if trace is None:
        return float(VALUES[operation](one, other))
    left, right = (value if isinstance(value, Scalar) else trace.constant(value) for value in (one, other))
    return trace.node(operation, left.number, right.number)


@dataclass(frozen=True)
class TracedProgram:
    """Operations in an order in which they can run.

    Attributes:
        nodes: The operations; operands stand before the operations that read them.
        outputs: Node by slot of the output; slots that are left out are zero.
    """

    nodes: tuple[Node, ...]
    outputs: Mapping[int, int]

    @cached_property
    def operations(self) -> int:
        """Number of arithmetic operations of one sample; a sine and its cosine count as two."""
        return sum(node.operation not in ("input", "const") for node in self.nodes)

    @property
    def arrays(self) -> tuple[str, ...]:
        """Names of the arrays that the program reads, sorted."""
        return tuple(sorted({node.source.array for node in self.nodes if node.source is not None}))

    def evaluate(self, inputs: Mapping[str, Array]) -> dict[int, Array]:
        """Return the outputs by slot, computed with NumPy.

        Args:
            inputs: The arrays by name; an entry is taken along the first axis, the rest are samples.
        """
        return self._run(inputs, VALUES)

    def rounding_only(self, inputs: Mapping[str, Array]) -> set[int]:
        """Return the slots that are zero but for rounding at all given samples.

        An output such as sin q cos q - cos q sin q is not seen to be zero by the trace. It counts as zero where it is
        never above 1e-15 of the terms that make it up.
        """
        values, sizes = self._run(inputs, VALUES), self._run(inputs, SIZES)
        return {slot for slot, value in values.items() if np.all(np.abs(value) <= 1e-15 * sizes[slot])}

    def _run(self, inputs: Mapping[str, Array], rules: Rules) -> dict[int, Array]:
        found: list[Array] = []
        for node in self.nodes:
            if node.source is not None:
                found.append(rules["input"](inputs[node.source.array][node.source.entry]))
            elif node.operation == "const":
                found.append(rules["input"](np.float64(node.value)))
            else:
                options = (node.value,) if node.operation in VALUED else ()
                found.append(rules[node.operation](*(found[k] for k in node.operands), *options))
        return {slot: found[k] for slot, k in self.outputs.items()}


def gradient(
    trace: Trace, outputs: Mapping[int, Number], weights: Mapping[int, Number], inputs: Iterable[Scalar]
) -> list[Number]:
    """Return d(sum of weight times output)/d(input), by reverse accumulation over the trace.

    Args:
        trace: The trace that holds the outputs.
        outputs: Values by slot.
        weights: Their weights by slot.
        inputs: The inputs to differentiate by.
    """
    adjoint: dict[int, Number] = {}
    for slot, value in outputs.items():
        if isinstance(value, Scalar):
            adjoint[value.number] = adjoint.get(value.number, 0.0) + weights[slot]
    for k in reversed(trace.needed(list(adjoint))):
        node, above = trace.nodes[k], adjoint.get(k, 0.0)
        for operand, slope in _slopes(trace, node):
            adjoint[operand] = adjoint.get(operand, 0.0) + above * slope
    return [adjoint.get(scalar.number, 0.0) for scalar in inputs]


def _slopes(trace: Trace, node: Node) -> list[tuple[int, Number]]:
    """Return the derivative of an operation by each of its operands; 0 at a jump, and where two sides are equal."""
    left, right = node.left, node.right
    one, other = Scalar(trace, left), Scalar(trace, right)

    def itself() -> Scalar:
        return trace.node(node.operation, left, right, node.value)

    rules: dict[str, Callable[[], list[tuple[int, Number]]]] = {
        "add": lambda: [(left, 1.0), (right, 1.0)],
        "sub": lambda: [(left, 1.0), (right, -1.0)],
        "mul": lambda: [(left, other), (right, one)],
        "div": lambda: [(left, 1.0 / other), (right, -itself() / other)],
        "neg": lambda: [(left, -1.0)],
        "sin": lambda: [(left, trace.node("cos", left))],
        "cos": lambda: [(left, -trace.node("sin", left))],
        "exp": lambda: [(left, itself())],
        "tanh": lambda: [(left, 1.0 - itself() * itself())],
        "turn": lambda: [(left, (1.0 - itself() * itself()) / node.value if node.value else 0.0)],
        "abs": lambda: [(left, trace.node("sign", left))],
        "pow": lambda: [(left, node.value * _lowered(trace, node, itself()))],
        "max": lambda: [(left, trace.node("greater", left, right)), (right, trace.node("greater", right, left))],
        "min": lambda: [(left, trace.node("greater", right, left)), (right, trace.node("greater", left, right))],
    }
    return rules[node.operation]() if node.operation in rules else []


def _lowered(trace: Trace, node: Node, power_of: Scalar) -> Number:
    """Return a power less one; 0 for a base of 0 where it would be infinite though the power itself is not."""
    base = Scalar(trace, node.left)
    if 0.0 < node.value < 1.0:
        return trace.node("ratio", power_of.number, node.left)
    return power_of / base if node.value < 0.0 else power(base, node.value - 1.0)
