"""The compiled machine that runs the friction of all drives: traced expressions as rows of numbers, one a sample.

A part's expression is data here, not code, so that one machine, compiled once, simulates every part. Each operation is
made for all drives before the next one.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

from dynident.arrays import Array, IntArray
from dynident.model.kernels.jit import inlined

#: Rows of the memory: position, speed and load of the drives, their temperature and its rise, how far they have moved
#: since the step before, the length of the step, the positions before; then states, constants and results.
Q, DQ, LOAD, TEMPERATURE, RISE, MOVED, STEP, BEFORE, FIRST = range(9)

#: Entries of ``ends``: rows of the torque, of its slopes by load and speed, -1 for one that is always 0; last, 1 where
#: the slope by the load is the same for all loads of a sign.
TORQUE, BY_LOAD, BY_SPEED, IS_STRAIGHT = range(4)

#: Operations, the numbers in this order.
OPERATIONS: Final = (
    "add", "sub", "mul", "div", "neg", "sin", "cos", "exp", "tanh", "turn", "pow",
    "abs", "sign", "side", "max", "min", "greater", "ratio",
)  # fmt: skip
_ADD, _SUB, _MUL, _DIV, _, _SIN, _COS, _EXP, _TANH, _TURN, _POW = range(11)
_ABS, _, _SIDE, _MAX, _MIN, _GREATER, _RATIO = range(11, 18)

#: Passes at most in which the load is found, and the change of it that ends them.
PASSES, SETTLED = 30, 1e-12

#: code (K, 4): operation, row of the result, rows of its operands; memory (m, n); ends (4,); code and rows (s, 2) of
#: the states: where one stands, and where its next value does.
Friction: TypeAlias = tuple[IntArray, Array, IntArray, IntArray, IntArray]


@inlined
def smooth_function(operation: int, x: float, y: float) -> float:
    """Return an operation that is a smooth function."""
    value = -x
    if operation == _TURN:
        value = math.tanh(x / y)
    elif operation == _TANH:
        value = math.tanh(x)
    elif operation == _DIV:
        value = x / y
    elif operation == _EXP:
        value = math.exp(x)
    elif operation == _POW:
        value = math.pow(x, y)
    elif operation == _SIN:
        value = math.sin(x)
    elif operation == _COS:
        value = math.cos(x)
    return value


@inlined
def bent_function(operation: int, x: float, y: float) -> float:
    """Return an operation that has a jump or a bend."""
    value = 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)
    if operation == _ABS:
        value = abs(x)
    elif operation == _SIDE:
        value = 1.0 if x >= 0.0 else -1.0
    elif operation == _MAX:
        value = max(x, y)
    elif operation == _MIN:
        value = min(x, y)
    elif operation == _GREATER:
        value = 1.0 if x > y else 0.0
    elif operation == _RATIO:
        value = x / y if y != 0.0 else 0.0
    return value


@inlined
def execute(code: IntArray, memory: Array) -> None:
    """Run the operations on the memory (m, n)."""
    drives = memory.shape[1]
    for k in range(len(code)):
        operation, to, a, b = code[k, 0], code[k, 1], code[k, 2], code[k, 3]
        if operation == _MUL:
            for j in range(drives):
                memory[to, j] = memory[a, j] * memory[b, j]
        elif operation == _ADD:
            for j in range(drives):
                memory[to, j] = memory[a, j] + memory[b, j]
        elif operation == _SUB:
            for j in range(drives):
                memory[to, j] = memory[a, j] - memory[b, j]
        elif operation < _ABS:
            for j in range(drives):
                memory[to, j] = smooth_function(operation, memory[a, j], memory[b, j])
        else:
            for j in range(drives):
                memory[to, j] = bent_function(operation, memory[a, j], memory[b, j])


@inlined
def lose(friction: Friction, drawn: Array, is_load: bool, lost: Array) -> None:
    """Write the torque (n,) that drives lose whose motion and temperature stand in the memory.

    Args:
        friction: See :data:`Friction`.
        drawn: Torque that each drive gives to friction and load together, or the load itself, (n,); read where friction
            depends on the load.
        is_load: Whether it is the load itself.
        lost: Overwritten. Where the load is to be found it stands in the memory afterwards.
    """
    code, memory, ends = friction[0], friction[1], friction[2]
    drives, torque, by_load = len(lost), ends[TORQUE], ends[BY_LOAD]
    is_found = by_load < 0 or is_load
    for j in range(drives if by_load >= 0 and is_load else 0):
        memory[LOAD, j] = drawn[j]
    for _ in range(1 if is_found else PASSES):
        execute(code, memory)
        moved = 0.0
        for j in range(drives):
            lost[j] = memory[torque, j] if torque >= 0 else 0.0
            if not is_found:
                # load + friction(load) = drawn by Newton's method, from the load of before; friction below the load
                # keeps the slope above 0
                load, slope = memory[LOAD, j], memory[by_load, j]
                change = (load + lost[j] - drawn[j]) / (1.0 + slope)
                memory[LOAD, j] = load - change
                if ends[IS_STRAIGHT] == 1 and load * (load - change) > 0.0:
                    lost[j] -= slope * change
                else:
                    moved = max(moved, abs(change) / (1.0 + abs(drawn[j])))
        if moved <= SETTLED:
            return
    for j in range(drives):
        lost[j] = math.nan  # a load that leaves nothing to give


@inlined
def place(friction: Friction, coupling: Array, q: Array, dq: Array) -> None:
    """Write positions and speeds of the drives into the memory, from those of the joints (n,)."""
    memory = friction[1]
    for j in range(len(q)):
        at, speed = 0.0, 0.0
        for k in range(len(q)):
            at += coupling[j, k] * q[k]
            speed += coupling[j, k] * dq[k]
        memory[Q, j], memory[DQ, j] = at, speed


@inlined
def warm(friction: Friction, goal: Array) -> None:
    """Write the temperatures of the drives into the memory, where a goal (4, n) has them in its last row."""
    for j in range(goal.shape[1] if len(goal) > 3 else 0):
        friction[1][TEMPERATURE, j] = goal[3, j]


@inlined
def begin(friction: Friction) -> None:
    """Take the positions in the memory as those before the first step."""
    memory = friction[1]
    for j in range(memory.shape[1]):
        memory[BEFORE, j] = memory[Q, j]


@inlined
def remember(friction: Friction, step: float) -> None:
    """Carry the states over a step that has led to the motion in the memory."""
    memory, code, rows = friction[1], friction[3], friction[4]
    for j in range(memory.shape[1]):
        memory[MOVED, j], memory[STEP, j] = memory[Q, j] - memory[BEFORE, j], step
        memory[BEFORE, j] = memory[Q, j]
    execute(code, memory)
    for k in range(len(rows)):  # all are made from the states before: the results of the code have rows of their own
        for j in range(memory.shape[1]):
            memory[rows[k, 0], j] = memory[rows[k, 1], j]
