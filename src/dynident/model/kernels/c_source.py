"""A traced program -> one C99 function of one sample, with nothing but sin and cos from the mathematical library."""

from __future__ import annotations

from collections.abc import Sequence

from dynident.model.kernels.trace import Program

_SIGNS = {"add": "+", "sub": "-", "mul": "*"}


def c99_function(program: Program, name: str, arrays: Sequence[str], width: int) -> str:
    """Return the text of ``void name(const double *array, ..., double *out)``.

    Args:
        program: What to compute; its slots are the entries of ``out``.
        name: Name of the function.
        arrays: The arrays that the function takes, in order; at least those that the program reads.
        width: Number of entries of ``out``; those that the program lacks become 0.

    Raises:
        ValueError: The program reads an array that is not in ``arrays``.
    """
    missing = set(program.arrays) - set(arrays)
    if missing:
        raise ValueError(f"the program reads {sorted(missing)}, the function takes {list(arrays)}")
    takes = ", ".join(f"const double *{array}" for array in arrays)
    lines = [f"void {name}({takes}, double *out)", "{"]
    terms: list[str] = []
    for number, node in enumerate(program.nodes):
        if node.operation == "const":
            terms.append(repr(node.value))
            continue
        operands = [terms[k] for k in node.operands]
        if node.source is not None:
            term = f"{node.source.array}[{node.source.entry}]"
        elif node.operation in _SIGNS:
            term = f"{operands[0]} {_SIGNS[node.operation]} {operands[1]}"
        else:
            term = f"-{operands[0]}" if node.operation == "neg" else f"{node.operation}({operands[0]})"
        lines.append(f"    const double v{number} = {term};")
        terms.append(f"v{number}")
    lines += [f"    (void){array};" for array in arrays if array not in program.arrays]
    lines += [
        f"    out[{slot}] = {terms[program.outputs[slot]] if slot in program.outputs else '0.0'};"
        for slot in range(width)
    ]
    return "\n".join([*lines, "}"]) + "\n"
