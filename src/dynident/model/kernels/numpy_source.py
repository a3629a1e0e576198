"""A traced program -> one NumPy function over many samples, without a step of an interpreter for each operation."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, Final, TypeAlias

from dynident.arrays import Array
from dynident.model.kernels.operations import VALUED, VALUES
from dynident.model.kernels.trace import TracedProgram

#: From the arrays by name, each a sequence of its entries, to the outputs by slot.
Function: TypeAlias = Callable[[Mapping[str, Any]], dict[int, Array]]

_SIGNS: Final = {"add": "+", "sub": "-", "mul": "*", "div": "/"}


def numpy_function(program: TracedProgram) -> Function:
    """Return a function with the values of :meth:`TracedProgram.evaluate`; constants stay numbers."""
    space: dict[str, Any] = {**VALUES, "inf": math.inf, "nan": math.nan}
    exec("\n".join(_lines(program)), space)  # our own text: names of operations, inputs and numbers
    return space["run"]


def _lines(program: TracedProgram) -> list[str]:
    """Return the source: what is read once stands where it is read, so that NumPy can use its memory again."""
    reads = Counter(k for node in program.nodes for k in node.operands)
    reads.update(program.outputs.values())
    lines, terms = ["def run(arrays):"], []
    for number, node in enumerate(program.nodes):
        operands = [terms[k] for k in node.operands]
        if node.source is not None:
            text = f"arrays[{node.source.array!r}][{node.source.entry}]"
        elif node.operation == "const":
            text = f"({node.value!r})"
        elif node.operation in _SIGNS:
            text = f"({operands[0]} {_SIGNS[node.operation]} {operands[1]})"
        elif node.operation == "neg":
            text = f"(-{operands[0]})"
        elif node.operation == "turn":
            text = f"tanh({operands[0]} / {node.value!r})" if node.value else f"sign({operands[0]})"
        else:
            text = (
                f"{node.operation}({', '.join([*operands, *([repr(node.value)] if node.operation in VALUED else [])])})"
            )
        if reads[number] > 1 and node.operation != "const":
            lines.append(f"    v{number} = {text}")
            text = f"v{number}"
        terms.append(text)
    return [*lines, f"    return {{{', '.join(f'{slot}: {terms[k]}' for slot, k in program.outputs.items())}}}"]
