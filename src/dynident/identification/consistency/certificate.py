"""Why no robot meets all conditions: a certificate of Farkas, checked and put into words.

The deepest point inside all conditions, max t with every slack >= t, is a conic program that always has a solution. Its
multipliers z >= 0 with sum z = 1 and (rows)' z = 0 prove the depth: every point has sum z slack = sum z offset <= t. A
depth that is not positive is a contradiction among the conditions with z > 0 (Boyd and Vandenberghe 2004, 5.8).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.errors import ContradictoryConstraints
from dynident.identification.consistency.conditions import IDENTITY_VECTOR, Conditions
from dynident.identification.consistency.conic import cone_rows, run_clarabel, sign_cone, split_duals
from dynident.identification.consistency.program import Multipliers, along_basis

#: Depth in natural sizes below which the conditions leave no room.
ROOM = 1e-9

#: Share of the largest multiplier from which a condition belongs to the contradiction.
_COUNTS = 1e-3

#: What the rows' combination may leave over before it proves nothing.
_LEFT_OVER = 1e-6


@dataclass(frozen=True)
class Depth:
    """The point deepest inside all conditions, and the proof that none is deeper.

    Attributes:
        phi: Shape (p,).
        depth: Smallest slack there, in natural sizes, 1 at most; not positive where the conditions leave no room.
        bound: No point is deeper than this, by the multipliers.
        left_over: Size of (rows)' z, which is 0 in a proof.
        multipliers: z, of sum 1.
    """

    phi: Array
    depth: float
    bound: float
    left_over: float
    multipliers: Multipliers


def deepest(conditions: Conditions) -> Depth:
    """Return the point deepest inside the conditions; equations are kept."""
    inside, offset, cones = cone_rows(conditions)
    size, equations = conditions.size, len(conditions.zero)
    lower = np.concatenate(
        [np.zeros(equations), np.ones(len(conditions.sign)), np.tile(IDENTITY_VECTOR, len(conditions.links))]
    )
    matrix = np.vstack([np.column_stack([inside, lower]), np.append(np.zeros(size), 1.0)])  # the last one: t <= 1
    cones = [*cones, sign_cone(1)]
    found = run_clarabel(
        np.zeros((size + 1, size + 1)), np.r_[np.zeros(size), -1.0], matrix, np.append(offset, 1.0), cones
    )
    phi = np.array(found.x)[:size]
    raw = split_duals(conditions, np.array(found.z)[:-1]).projected()
    total = float(np.sum(raw.sign) + np.trace(raw.cones.sum(axis=0) if len(raw.cones) else np.zeros((4, 4))))
    prices = Multipliers(*(part / max(total, 1e-300) for part in (raw.zero, raw.sign, raw.cones)))
    combined = conditions.sign.T @ prices.sign + conditions.zero.T @ prices.zero
    combined[: 10 * len(conditions.links)] += along_basis(prices.cones, conditions.bases)
    bound = float(prices.sign @ conditions.sign_offset + prices.zero @ conditions.zero_offset)
    bound -= conditions.margin * float(np.einsum("lii->", prices.cones))
    slack = np.append(conditions.signs(phi), np.linalg.eigvalsh(conditions.pseudo(phi)))
    return Depth(phi, float(np.min(slack, initial=np.inf)), bound, float(np.max(np.abs(combined), initial=0.0)), prices)


def check_room(conditions: Conditions) -> Depth | None:
    """Refuse conditions that no robot can meet together; return the deepest point where there is room.

    Returns:
        The deepest point, or None where neither room nor a contradiction could be proven.

    Raises:
        ContradictoryConstraints: A checked certificate shows which conditions clash.
    """
    clash = _clashing_equations(conditions)
    if not clash:
        found = deepest(conditions)
        if found.depth > ROOM:
            return found
        if found.left_over > _LEFT_OVER or found.bound > ROOM + _LEFT_OVER:
            return None
        clash = _words(conditions, found)
    raise ContradictoryConstraints("; ".join(clash), "they cannot hold together: drop or change one of them")


def _clashing_equations(conditions: Conditions) -> list[str]:
    """Return equations that contradict each other by themselves: y with E'y = 0 and y'e != 0 is what they miss."""
    if not len(conditions.zero):
        return []
    best = np.linalg.lstsq(conditions.zero, -conditions.zero_offset)[0]
    missed = conditions.equations(best)
    if np.max(np.abs(missed)) <= 1e-9 * (1.0 + np.max(np.abs(conditions.zero_offset))):
        return []
    largest = np.max(np.abs(missed))
    chosen = [words for words, m in zip(conditions.zero_words, missed, strict=True) if abs(m) > _COUNTS * largest]
    return list(dict.fromkeys(chosen))


def _words(conditions: Conditions, found: Depth) -> list[str]:
    """Return the conditions that the certificate is made of, stated ones first, each with what it falls short by."""
    prices = found.multipliers
    traces = np.einsum("lii->l", prices.cones) if len(prices.cones) else np.zeros(0)
    least = _COUNTS * max(float(np.max(part, initial=0.0)) for part in (prices.sign, np.abs(prices.zero), traces))
    missing = max(-found.depth, 0.0)
    words = [w for w, z in zip(conditions.zero_words, prices.zero, strict=True) if abs(z) > least]
    for text, price, (size, unit) in zip(conditions.sign_words, prices.sign, conditions.sign_sizes, strict=True):
        if price > least:
            amount = missing * size
            words.append(f"{text} (short by {amount:.3g} {unit} at best)" if unit and missing > ROOM else text)
    words += [w for w, trace in zip(conditions.cone_words, traces, strict=True) if trace > least]
    return list(dict.fromkeys(words))
