"""HarmonicSum: a function of joint motion as a sum of powers times exp(i k q), a form that is unique.

Entries of the regressor of rigid bodies are polynomials in speeds, accelerations and positions of slides, and in sines
and cosines of angles. In this form sin q2 cos q3 + cos q2 sin q3 is sin(q2 + q3) by itself, and terms that cancel are
gone, without a search for simplifications.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from dynident.errors import BadOption
from dynident.model.kernels.trace import Node, TracedProgram

#: Decimals that a frequency keeps: followers of a joint turn with any ratio.
_DECIMALS = 12


class Harmonic(NamedTuple):
    """What a coefficient multiplies: exp(i frequencies . q) times the powers of the variables."""

    frequencies: tuple[float, ...]
    powers: tuple[int, ...]


@dataclass(frozen=True)
class HarmonicSum:
    """Coefficients by term; the terms with opposite frequencies have conjugate ones, since values are real.

    Attributes:
        terms: Coefficient of each term; zero where a term is left out.
    """

    terms: Mapping[Harmonic, complex]

    def __add__(self, other: HarmonicSum) -> HarmonicSum:
        found = dict(self.terms)
        for term, value in other.terms.items():
            found[term] = found.get(term, 0.0) + value
        return HarmonicSum(found)

    def __neg__(self) -> HarmonicSum:
        return HarmonicSum({term: -value for term, value in self.terms.items()})

    def __mul__(self, other: HarmonicSum) -> HarmonicSum:
        found: dict[Harmonic, complex] = {}
        for one, value in self.terms.items():
            for two, factor in other.terms.items():
                turned = (a + b for a, b in zip(one.frequencies, two.frequencies, strict=True))
                powers = (a + b for a, b in zip(one.powers, two.powers, strict=True))
                term = Harmonic(tuple(round(k, _DECIMALS) + 0.0 for k in turned), tuple(powers))
                found[term] = found.get(term, 0.0) + value * factor
        return HarmonicSum(found)

    def without(self, share: float) -> HarmonicSum:
        """Return the sum without coefficients below a share of the largest."""
        floor = share * max(map(abs, self.terms.values()), default=0.0)
        return HarmonicSum({term: value for term, value in self.terms.items() if abs(value) > floor})

    def count_below(self, share: float) -> int:
        """Return how many coefficients are below a share of the largest."""
        floor = share * max(map(abs, self.terms.values()), default=0.0)
        return sum(abs(value) < floor for value in self.terms.values())


class HarmonicEvaluator:
    """Runs traced programs of a robot with n joints over harmonic sums; variables are q, dq and ddq of all joints.

    Attributes:
        joints: n.
    """

    ARRAYS = ("q", "dq", "ddq")

    def __init__(self, joints: int) -> None:
        self.joints = joints
        self._still = (0.0,) * joints
        self._plain = (0,) * (len(self.ARRAYS) * joints)

    def run(self, program: TracedProgram) -> dict[int, HarmonicSum]:
        """Return the outputs of a program by slot.

        Raises:
            BadOption: An operation that rigid bodies do not have.
        """
        found: list[HarmonicSum] = []
        for node in program.nodes:
            found.append(self._value(node, [found[k] for k in node.operands]))
        return {slot: found[k] for slot, k in program.outputs.items()}

    def _value(self, node: Node, operands: list[HarmonicSum]) -> HarmonicSum:
        if node.source is not None:
            place = self.ARRAYS.index(node.source.array) * self.joints + node.source.entry
            powers = tuple(int(k == place) for k in range(len(self._plain)))
            return HarmonicSum({Harmonic(self._still, powers): 1.0})
        if node.operation == "const":
            return self._constant(node.value)
        if node.operation in ("sin", "cos"):
            ahead, back = self._turning(operands[0])
            weights = (0.5, 0.5) if node.operation == "cos" else (-0.5j, 0.5j)
            return ahead * self._constant(weights[0]) + back * self._constant(weights[1])
        if node.operation not in _RULES:
            raise BadOption("symbolic", node.operation, "only the equations of rigid bodies have this form")
        return _RULES[node.operation](*operands)

    def _constant(self, value: complex) -> HarmonicSum:
        return HarmonicSum({Harmonic(self._still, self._plain): value})

    def _turning(self, angle: HarmonicSum) -> tuple[HarmonicSum, HarmonicSum]:
        """Return exp(i angle) and exp(-i angle) of an angle that is a constant and multiples of positions."""
        shift, rates = 0.0, list(self._still)
        for term, value in angle.terms.items():
            if term.powers == self._plain:
                shift += value.real
            else:
                rates[term.powers.index(1)] += value.real
        both = []
        for sign in (1.0, -1.0):
            turned = tuple(round(sign * rate, _DECIMALS) + 0.0 for rate in rates)
            both.append(HarmonicSum({Harmonic(turned, self._plain): complex(np.exp(1j * sign * shift))}))
        return both[0], both[1]


_RULES: Final[dict[str, Callable[..., HarmonicSum]]] = {
    "add": lambda one, other: one + other,
    "sub": lambda one, other: one + -other,
    "mul": lambda one, other: one * other,
    "neg": lambda one: -one,
}
