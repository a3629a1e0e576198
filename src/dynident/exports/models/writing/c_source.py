"""A traced program -> one C99 function of one sample, with nothing but sin and cos from the mathematical library."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dynident.model.kernels.trace import TracedProgram

_SIGNS = {"add": "+", "sub": "-", "mul": "*"}


@dataclass(frozen=True)
class Spelling:
    """How a function is spelt.

    Attributes:
        head: What stands before the name, such as ``static inline void``.
        real: The type of numbers.
        sine: Name of the sine.
        cosine: Name of the cosine.
        constant: What a constant becomes, ``{}`` its digits.
    """

    head: str = "void"
    real: str = "double"
    sine: str = "sin"
    cosine: str = "cos"
    constant: str = "{}"


def c99_function(
    program: TracedProgram, name: str, arrays: Sequence[str], width: int, spelling: Spelling | None = None
) -> str:
    """Return the text of ``void name(const double *array, ..., double *out)``.

    Args:
        program: What to compute; its slots are the entries of ``out``.
        name: Name of the function.
        arrays: The arrays that the function takes, in order; at least those that the program reads.
        width: Number of entries of ``out``; those that the program lacks become 0.
        spelling: Types and names other than those of C99 with double.

    Raises:
        ValueError: The program reads an array that is not in ``arrays``.
    """
    missing = set(program.arrays) - set(arrays)
    if missing:
        raise ValueError(f"the program reads {sorted(missing)}, the function takes {list(arrays)}")
    spelt = spelling or Spelling()
    functions = {"sin": spelt.sine, "cos": spelt.cosine}
    takes = ", ".join(f"const {spelt.real} *{array}" for array in arrays)
    lines = [f"{spelt.head} {name}({takes}, {spelt.real} *out)", "{"]
    terms: list[str] = []
    for number, node in enumerate(program.nodes):
        if node.operation == "const":
            terms.append(spelt.constant.format(repr(node.value)))
            continue
        operands = [terms[k] for k in node.operands]
        if node.source is not None:
            term = f"{node.source.array}[{node.source.entry}]"
        elif node.operation in _SIGNS:
            term = f"{operands[0]} {_SIGNS[node.operation]} {operands[1]}"
        else:
            term = f"-{operands[0]}" if node.operation == "neg" else f"{functions[node.operation]}({operands[0]})"
        lines.append(f"    const {spelt.real} v{number} = {term};")
        terms.append(f"v{number}")
    lines += [f"    (void){array};" for array in arrays if array not in program.arrays]
    zero = spelt.constant.format("0.0")
    lines += [
        f"    out[{slot}] = {terms[program.outputs[slot]] if slot in program.outputs else zero};"
        for slot in range(width)
    ]
    return "\n".join([*lines, "}"]) + "\n"
