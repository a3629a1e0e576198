"""A traced expression as one line of C or Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from dynident.model.kernels.trace import TracedProgram

_SIGNS: Final = {"add": "+", "sub": "-", "mul": "*", "div": "/"}

#: Operations by the names of their functions in C.
_CALLS: Final = {
    "sin": "sin",
    "cos": "cos",
    "exp": "exp",
    "tanh": "tanh",
    "abs": "fabs",
    "max": "fmax",
    "min": "fmin",
    "pow": "pow",
}


@dataclass(frozen=True)
class Dialect:
    """How a language writes what friction needs; ``{}`` stands for the content.

    Attributes:
        number: A constant.
        call: A function of the mathematical library.
        sign: The sign of ``{value}`` that turns over a width.
        sharp: The sign without a width.
        variable: A declaration, ``{name}`` and ``{value}``.
        states: The array of the states of friction, those of a drive side by side.
        target: What is exported, for messages.
        names: Functions with other names than in C.
    """

    number: str
    call: str
    sign: str
    sharp: str
    variable: str
    states: str
    target: str
    names: Mapping[str, str] = field(default_factory=dict)

    def constant(self, value: float) -> str:
        """Return a number, to the last bit."""
        return self.number.format(repr(float(value) + 0.0))

    def function(self, name: str) -> str:
        """Return a function by its name in C."""
        return self.call.format(self.names.get(name, name))

    def expression(self, program: TracedProgram, names: Mapping[str, Sequence[str]]) -> str:
        """Return the one output of a program; ``names`` are those of its inputs, entry by entry of each array."""
        terms: list[str] = []
        for node in program.nodes:
            operands = [terms[k] for k in node.operands]
            if node.source is not None:
                text = names[node.source.array][node.source.entry]
            elif node.operation == "const":
                text = self.constant(node.value)
            elif node.operation in _SIGNS:
                text = f"({operands[0]} {_SIGNS[node.operation]} {operands[1]})"
            elif node.operation == "neg":
                text = f"(-{operands[0]})"
            elif node.operation in ("turn", "sign"):
                form = self.sign if node.value else self.sharp
                text = form.format(value=operands[0], width=self.constant(node.value))
            elif node.operation == "greater":
                text = f"({operands[0]} > {operands[1]})"
            else:
                options = [self.constant(node.value)] if node.operation == "pow" else []
                text = f"{self.function(_CALLS[node.operation])}({', '.join([*operands, *options])})"
            terms.append(text)
        text = terms[program.outputs[0]]
        return text[1:-1] if text.startswith("(") and _closes_at_end(text) else text


def _closes_at_end(text: str) -> bool:
    """Say whether the bracket that opens a text is closed by its last character."""
    depth = 0
    for place, letter in enumerate(text):
        depth += {"(": 1, ")": -1}.get(letter, 0)
        if depth == 0:
            return place == len(text) - 1
    return False
