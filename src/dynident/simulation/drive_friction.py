"""Friction of the drives of a robot with numbers, from the expressions of its parts, as all simulations take it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Friction, Motion
from dynident.model.friction.base import Inputs, Number, State
from dynident.model.kernels.compiled import kept
from dynident.model.kernels.operations import VALUED
from dynident.model.kernels.trace import Scalar, Trace, TracedProgram, gradient
from dynident.simulation.friction_machine import DQ, FIRST, LOAD, MOVED, OPERATIONS, RISE, STEP, TEMPERATURE, Q

#: Speeds at which friction is looked at: up to the fastest, finest at standstill, in rad/s or m/s; how many intervals.
FINEST, FASTEST, INTERVALS = 1e-3, 1e4, 4096

#: Positions at which friction that depends on them is looked at.
LOOKS = 8

#: Temperature of drives that do not warm up, in degrees Celsius.
ROOM = 25.0

_ROWS = {"q": Q, "dq": DQ, "load": LOAD, "temperature": TEMPERATURE, "rise": RISE, "moved": MOVED, "step": STEP}


class _Sharp(Trace):
    """A trace in which signs turn at once; standing still they are those of forward motion."""

    def node(self, operation: str, left: int = -1, right: int = -1, value: float = 0.0) -> Scalar:
        return super().node("side", left) if operation == "turn" else super().node(operation, left, right, value)


@dataclass(frozen=True)
class DriveFriction:
    """Friction of n drives with numbers, without rotor inertia.

    Attributes:
        parts: The parts, each with its coefficients, shape (n, k).
        start: Temperature of the drives, or the first one, shape (n,), in degrees Celsius.
        per_kelvin: By which share friction that does not repeat with position grows a degree.
        bristles: Whether dry friction is kept apart, for bristles.
    """

    parts: tuple[tuple[Friction, Array], ...]
    start: Array
    per_kelvin: float = 0.0
    bristles: bool = False

    @property
    def drives(self) -> int:
        """Number of drives, n."""
        return len(self.start)

    @cached_property
    def states(self) -> tuple[State, ...]:
        """States of all parts."""
        return tuple(state for part, _ in self.parts for state in part.states)

    @cached_property
    def reads(self) -> frozenset[str]:
        """Inputs that the friction depends on."""
        return frozenset(self._program(False).arrays) | frozenset(self._program(True).arrays)

    def sharpness(self) -> Array:
        """Return one over the least width over which a sign of each drive turns, shape (n,); 0 without signs."""
        found = np.zeros(self.drives)
        for part, block in self.parts:
            for program, values in zip(part.expression.programs, block.T, strict=True):
                widths = [node.value for node in program.nodes if node.operation == "turn"]
                if widths:
                    found = np.where(values != 0, np.maximum(found, 1.0 / min(widths)), found)
        return found

    def steepest(self, q: Array, fastest: Array) -> Array:
        """Return the steepest rise of the smooth torque over speed, shape (n,), in N m s/rad.

        Args:
            q: Positions of the drives, shape (N, n), some of which are looked at where the torque depends on them.
            fastest: Speeds up to which it is looked at, shape (n,).
        """
        return np.max(
            [self._within(np.abs(self._rises(at)), fastest, 0.0).max(axis=0) for at in self._places(q)], axis=0
        )

    def gentlest(self, q: Array, fastest: Array) -> Array:
        """Return the least rise of the smooth torque over speed, 0 or more; see :meth:`steepest`."""
        found = [self._within(self._rises(at), fastest, np.inf).min(axis=0) for at in self._places(q)]
        return np.maximum(np.min(found, axis=0), 0.0)

    def least_dry(self, q: Array, fastest: Array) -> Array:
        """Return the least dry friction that is kept apart, shape (n,), in N m or N; see :meth:`steepest`."""
        sizes = (
            np.minimum(*(np.abs(self._torque(speed, at, dry=True)) for speed in _intervals())) for at in self._places(q)
        )
        return np.min([self._within(size, fastest, np.inf).min(axis=0) for size in sizes], axis=0)

    def _places(self, q: Array) -> Array:
        """Return the positions (P, n) that are looked at: one if no torque depends on position and speed at once."""
        both = any({"q", "dq"} <= reads for part, _ in self.parts for reads in part.expression.reads)
        return q[np.linspace(0, len(q) - 1, LOOKS).astype(int)] if both else np.zeros((1, self.drives))

    def _rises(self, q: Array) -> Array:
        """Return the rise of the smooth torque over speed in each interval at positions (n,), shape (S, n)."""
        left, right = _intervals()
        return (self._torque(right, q) - self._torque(left, q)) / (right - left)[:, None]

    def _within(self, values: Array, fastest: Array, other: float) -> Array:
        """Return values of the intervals (S, n), ``other`` where these lie beyond the speeds (n,)."""
        left, right = _intervals()
        return np.where(np.minimum(np.abs(left), np.abs(right))[:, None] <= fastest, values, other)

    def breakaway(self) -> Array:
        """Return the dry friction at the least speed, the mean of both directions, shape (n,)."""
        forth, back = self._torque(np.array([1e-12, -1e-12]), np.zeros(self.drives), dry=True)
        return 0.5 * (forth - back)

    def load_slopes(self, motion: Motion) -> Array:
        """Return the derivative of the torque of each drive by its load, shape (N, n); the motion is that of drives."""
        program = kept((*self._key(False), "load"), lambda: self._traced(False, 1))
        inputs: dict[str, Any] = {"q": (motion.q,), "dq": (motion.dq,), "load": (motion.torque,)}
        inputs |= {"temperature": (self.start if motion.temperature is None else motion.temperature,)}
        inputs |= {"start": (self.start,), "rise": (0.0,), "state": ()}
        inputs["coefficient"] = np.concatenate([block.T for _, block in self.parts])
        return np.broadcast_to(program.evaluate(inputs).get(1, 0.0), motion.dq.shape)

    def machine(self, slopes: bool = False, dry: bool = False) -> tuple[Any, ...]:
        """Return the arrays that run it; see :data:`dynident.simulation.friction_machine.Friction`.

        Args:
            slopes: Whether the slope over speed is asked for.
            dry: Whether it is the friction kept apart.
        """
        layout = kept((*self._key(dry), slopes), lambda: _Layout(self, self._traced(dry, 2 if slopes else 1)))
        return layout.filled(self)

    def _key(self, dry: bool) -> tuple[Any, ...]:
        """Return what tells its programs from those of other friction."""
        each = tuple((type(part), repr(part), np.any(block, axis=0).tobytes()) for part, block in self.parts)
        return "friction", each, self.drives, self.per_kelvin, self.bristles, dry

    def _program(self, dry: bool) -> TracedProgram:
        """Return the torque of the smooth or of the dry friction; no output where it is zero."""
        return kept(self._key(dry), lambda: self._traced(dry, 0))

    def _traced(self, dry: bool, order: int) -> TracedProgram:
        """Return the torque of the smooth or of the dry friction, with its slopes by load and by speed up to an order.

        Slopes that are zero, and a torque that is, have no output.
        """
        trace = _Sharp() if dry else Trace()
        at = Inputs.of(trace, len(self.states))
        torque = self._sum(trace, at, dry)
        if self.per_kelvin and _varies(torque):
            still = replace(at, load=trace.constant(0.0), temperature=trace.input("start", 0))
            torque = torque + self.per_kelvin * trace.input("rise", 0) * self._sum(trace, still, dry, at_rest=True)
        slopes = gradient(trace, {0: torque}, {0: 1.0}, [at.load, at.dq])[:order] if _varies(torque) else []
        return trace.program(dict(enumerate([torque, *slopes])))

    def _sum(self, trace: Trace, at: Inputs, dry: bool, at_rest: bool = False) -> Number:
        """Return the torque of the smooth or the dry columns; at rest of those alone that do not read the position."""
        total: Number = 0.0
        column, first = 0, 0
        for part, block in self.parts:
            count = len(part.states)
            own = replace(at, state=at.state[first : first + count])
            first += count
            for k, term in enumerate(part.terms(own)):
                apart = self.bristles and _turns(part, k)
                reads_place = at_rest and "q" in part.expression.reads[k]
                if apart is dry and not part.is_inertia[k] and np.any(block[:, k]) and not reads_place:
                    total = trace.input("coefficient", column) * term + total
                column += 1
        return total

    def update(self) -> TracedProgram:
        """Return the states after a step; slot: state."""
        trace = Trace()
        at = Inputs.of(trace, len(self.states))
        found: list[Number] = []
        for part, _ in self.parts:
            own = at.state[len(found) : len(found) + len(part.states)]
            found += part.update(replace(at, state=own))
        # A state that stays as it is needs a row of its own as well: x + 0 would vanish.
        kept = {k: value if isinstance(value, Scalar) else trace.constant(value) for k, value in enumerate(found)}
        return trace.program(kept)

    def _torque(self, speed: Array, q: Array, dry: bool = False) -> Array:
        """Return the torque without load at speeds (S,) of all drives at positions (n,), shape (S, n)."""
        shape = (len(speed), self.drives)
        each = {"q": q, "load": 0.0, "rise": 0.0, "moved": 0.0, "step": 0.0}
        inputs: dict[str, Any] = {name: (np.full(shape, value),) for name, value in each.items()}
        inputs |= {"dq": (speed[:, None] + np.zeros(shape),), "temperature": (self.start,), "start": (self.start,)}
        inputs["coefficient"] = np.concatenate([block.T for _, block in self.parts]) if self.parts else ()
        inputs["state"] = [np.full(shape, state.start) for state in self.states]
        found = self._program(dry).evaluate(inputs)
        return np.broadcast_to(found.get(0, 0.0), shape).astype(float)


def _varies(value: Number) -> bool:
    """Say whether a torque is more than a constant."""
    return isinstance(value, Scalar)


class _Layout:
    """Where a machine has inputs, states, constants, coefficients and results, for any coefficients."""

    def __init__(self, friction: DriveFriction, program: TracedProgram) -> None:
        self._values = [0.0] * FIRST + [state.start for state in friction.states]
        self._known: dict[tuple[str, float], int] = {}
        self._code, ends = self._operations(program)
        self._update, rows = self._operations(friction.update())
        rows_of = [ends.get(slot, -1) for slot in range(3)]
        self._ends = np.array([*rows_of, int(_is_straight(program))], dtype=np.int64)
        self._states = np.array([[FIRST + k, rows[k]] for k in sorted(rows)], dtype=np.int64).reshape(-1, 2)

    def filled(self, friction: DriveFriction) -> tuple[Any, ...]:
        """Return the machine with the coefficients and temperatures of some friction; its arrays may be changed."""
        memory = np.repeat(np.array(self._values)[:, None], friction.drives, axis=1)
        memory[TEMPERATURE] = friction.start
        coefficients = [column for _, block in friction.parts for column in block.T]
        for (name, entry), row in self._known.items():
            if name:
                memory[row] = friction.start if name == "start" else coefficients[int(entry)]
        return self._code.copy(), memory, self._ends.copy(), self._update.copy(), self._states.copy()

    def _operations(self, program: TracedProgram) -> tuple[Any, dict[int, int]]:
        """Return the operations of a program, (K, 4), and the rows of its outputs."""
        lines, at = [], []
        for node in program.nodes:
            if node.source is not None:
                at.append(self._input(node.source.array, node.source.entry))
            elif node.operation == "const":
                at.append(self._fixed("", node.value, node.value))
            else:
                operands = [at[k] for k in node.operands]
                operands += [self._fixed("", node.value, node.value)] if node.operation in VALUED else []
                at.append(self._new(0.0))
                lines.append([OPERATIONS.index(node.operation), at[-1], operands[0], operands[-1]])
        code = np.array(lines, dtype=np.uint32).reshape(-1, 4)
        return code, {slot: at[k] for slot, k in program.outputs.items()}

    def _input(self, array: str, entry: int) -> int:
        if array in _ROWS:
            return _ROWS[array]
        return FIRST + entry if array == "state" else self._fixed(array, entry, 0.0)

    def _fixed(self, name: str, entry: float, value: float) -> int:
        if (name, entry) not in self._known:
            self._known[name, entry] = self._new(value)
        return self._known[name, entry]

    def _new(self, value: float) -> int:
        self._values.append(value)
        return len(self._values) - 1


def drive_friction(
    model: DynamicModel,
    theta: Array,
    start: Array | None = None,
    per_kelvin: float = 0.0,
    bristles: bool = False,
    remedy: str = "simulate with a width, such as 0.01 rad/s",
) -> DriveFriction:
    """Return the friction of a model with the parameters theta (p,).

    Args:
        model: Robot and friction.
        theta: All its parameters, shape (p,).
        start: Temperature of the drives, or the first one, shape (n,), in degrees Celsius; None for 25.
        per_kelvin: By which share friction grows a degree, beside what the parts say.
        bristles: Whether dry friction is kept apart, for bristles.
        remedy: What is to be done about a sharp sign, for the message.

    Raises:
        BadOption: A sharp sign without bristles, or a part whose torque depends on the acceleration other than that of
            a rotor inertia.
    """
    table, column, parts = model.coefficient_table(theta), 0, []
    for part in model.friction:
        block = table[:, column : column + len(part.coefficients)]
        column += len(part.coefficients)
        used = np.any(block, axis=0)
        for k, program in enumerate(part.expression.programs):
            if used[k] and not part.is_inertia[k] and "ddq" in program.arrays:
                step = "a torque that depends on the acceleration cannot be simulated; leave the part out"
                raise BadOption("friction", FRICTION.name_of(part), step)
            jumps = any(node.operation in ("turn", "sign") and node.value == 0 for node in program.nodes)
            if used[k] and jumps and not bristles:
                raise BadOption("width", 0.0, f"a sharp sign cannot be integrated; {remedy}")
        if (np.any(block) or part.states) and not all(part.is_inertia):
            parts.append((part, block))
    at = np.full(model.robot.dof, ROOM) if start is None else start
    return DriveFriction(tuple(parts), at, per_kelvin, bristles)


def _is_straight(program: TracedProgram) -> bool:
    """Say whether the slope by the load (slot 1) depends on the sign of the load alone."""
    ahead, found = [program.outputs[1]] if 1 in program.outputs else [], True
    while ahead:
        node = program.nodes[ahead.pop()]
        found = found and (node.source is None or node.source.array != "load")
        ahead += [] if node.operation == "sign" else node.operands
    return found


def _turns(part: Friction, column: int) -> bool:
    """Say whether a column is dry friction: it has a sign that turns."""
    return any(node.operation == "turn" for node in part.expression.programs[column].nodes)


def _intervals() -> tuple[Array, Array]:
    """Return the speeds at both ends of the intervals, (INTERVALS,) each; none is exactly 0.

    The ends at standstill lie on the side of their interval, where a jump of the torque belongs to neither.
    """
    size = 2.0 * math.asinh(FASTEST / FINEST) / INTERVALS
    edges = FINEST * np.sinh((np.arange(INTERVALS + 1) - INTERVALS // 2) * size)
    left, right = edges[:-1].copy(), edges[1:].copy()
    left[INTERVALS // 2], right[INTERVALS // 2 - 1] = 1e-12, -1e-12
    return left, right
