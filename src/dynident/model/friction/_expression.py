"""The expressions of a friction part, traced: programs of its columns, of their derivatives and of its states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.model.kernels.numpy_source import Function, numpy_function
from dynident.model.kernels.trace import InputSource, Number, Scalar, Trace, TracedProgram, gradient

#: Arrays that the programs read, of one entry each; ``state`` has one for each state.
INPUTS = ("q", "dq", "ddq", "load", "temperature", "moved", "step")


@dataclass(frozen=True)
class Inputs:
    """What the expressions of a part may read: scalars of one drive (its motor) at one sample.

    Attributes:
        q: Position, in rad or m.
        dq: Velocity, in rad/s or m/s.
        ddq: Acceleration, in rad/s^2 or m/s^2.
        load: Torque of the model without friction, in N m or N.
        temperature: Temperature of the drive, in degrees Celsius.
        state: What the part remembers.
        moved: How far the drive has moved since the sample before, in rad or m; for the update of a state.
        step: Time since the sample before, in s; for the update of a state.
    """

    q: Scalar
    dq: Scalar
    ddq: Scalar
    load: Scalar
    temperature: Scalar
    state: tuple[Scalar, ...]
    moved: Scalar
    step: Scalar

    @classmethod
    def of(cls, trace: Trace, states: int = 0, first: int = 0) -> Inputs:
        """Return the inputs as scalars of a trace; ``states`` of its array ``state``, from the entry ``first`` on."""
        q, dq, ddq, load, temperature, moved, step = (trace.input(name, 0) for name in INPUTS)
        state = tuple(trace.input("state", first + k) for k in range(states))
        return cls(q, dq, ddq, load, temperature, state, moved, step)


Expressions = Callable[[Inputs], tuple[Number, ...]]


class Expression:
    """What a part states of a drive, in programs whose arrays have one entry each but for ``state``."""

    def __init__(self, terms: Expressions, update: Expressions, coefficients: int, states: int) -> None:
        self._trace, self._count, self._update = Trace(), coefficients, update
        self._inputs = Inputs.of(self._trace, states)
        self.terms = tuple(terms(self._inputs))
        if len(self.terms) != coefficients:
            raise ValueError(f"terms() returns {len(self.terms)} expressions for {coefficients} coefficients")

    @cached_property
    def columns(self) -> Function:
        """The columns; slot: coefficient."""
        return numpy_function(self._trace.program(self._slots(self.terms)))

    @cached_property
    def slopes(self) -> Function:
        """The derivatives of the columns; slot: coefficient, and k more by dq, 2 k more by ddq."""
        at = (self._inputs.q, self._inputs.dq, self._inputs.ddq)
        found: dict[int, Number] = {}
        for k, term in enumerate(self.terms):
            slopes = gradient(self._trace, {0: term}, {0: 1.0}, at)
            found |= {order * self._count + k: slope for order, slope in enumerate(slopes)}
        return numpy_function(self._trace.program(found))

    @cached_property
    def update(self) -> Function:
        """The states at the next sample; slot: state."""
        return numpy_function(self._trace.program(self._slots(self._update(self._inputs))))

    def is_input(self, term: Number, name: str) -> bool:
        """Say whether an expression is an input as it stands."""
        return isinstance(term, Scalar) and self._trace.nodes[term.number].source == InputSource(name, 0)

    def _slots(self, values: tuple[Number, ...]) -> dict[int, Scalar]:
        """Return values by slot, as nodes: a program would leave out those that are 0."""
        return {
            k: value if isinstance(value, Scalar) else self._trace.constant(value) for k, value in enumerate(values)
        }

    @cached_property
    def programs(self) -> tuple[TracedProgram, ...]:
        """The program of each coefficient alone; slot: 0."""
        return tuple(self._trace.program(self._slots((term,))) for term in self.terms)

    @cached_property
    def updates(self) -> tuple[TracedProgram, ...]:
        """The program of each state at the next sample alone; slot: 0."""
        return tuple(self._trace.program(self._slots((value,))) for value in self._update(self._inputs))

    @cached_property
    def reads(self) -> tuple[frozenset[str], ...]:
        """The inputs that the expression of each coefficient reads."""
        needed = (self._trace.needed([own.number]) for own in self._slots(self.terms).values())
        return tuple(frozenset(one.array for k in own if (one := self._trace.nodes[k].source)) for own in needed)


def stacked(values: Sequence[Any], shape: tuple[int, ...]) -> Array:
    """Return values of samples and drives, or constants, side by side, shape (N, n, k)."""
    if len(values) == 1 and np.shape(values[0]) == shape:
        return values[0][..., None]
    if not any(map(np.shape, values)):  # no memory for them
        return np.broadcast_to(np.array(values, dtype=np.float64), (*shape, len(values)))
    found: Array = np.zeros((len(values), *shape))
    for k, value in enumerate(values):
        if np.shape(value) or value:
            found[k] = value
    return found.transpose(1, 2, 0)
