"""The second path of the consistent fit: Newton on a log-det barrier.

minimise f(phi) - mu (sum_k log s_k + sum_i log det (P_i(phi) - margin I)) over the equations, for mu falling to zero
(Boyd and Vandenberghe 2004, 11.3 and 11.6). Each Newton step is a least-squares problem in the rows of the Hessian's
root, solved by QR: nothing is squared, so data of any condition pass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.identification.consistency.certificate import deepest
from dynident.identification.consistency.conditions import IDENTITY_VECTOR, stack_vectors
from dynident.identification.consistency.conic import ConicCandidate
from dynident.identification.consistency.program import Multipliers, Program, along_basis, whitened_rows
from dynident.model.lapack import solve_upper
from dynident.model.reduction import triangle_of

#: The gap that ends the descent of mu, as a share of f + 1/2.
TOLERANCE = 1e-9

#: By how much mu falls when its minimum is near.
_FALL = 0.1

#: Squared Newton decrement, in units of mu, below which a minimum is near.
_NEAR = 0.25

_MOST_STEPS = 400


@dataclass(frozen=True)
class _Place:
    """A point inside all conditions with what Newton needs of it.

    Attributes:
        phi: Shape (p,).
        signs: Slack of the inequalities, shape (k,).
        roots: Lower roots of P_i - margin I, shape (l, 4, 4).
        bodies: Lower roots of P_i, shape (l, 4, 4).
    """

    phi: Array
    signs: Array
    roots: Array
    bodies: Array


def solve_barrier(program: Program, start: Array | None = None, tolerance: float = TOLERANCE) -> ConicCandidate:
    """Return the optimum from a point strictly inside all conditions that meets the equations.

    Args:
        program: The program.
        start: Such a point, shape (p,); None for that of :func:`inside`.
        tolerance: Gap that is enough, as a share of f + 1/2.

    Raises:
        ValueError: ``start`` is not inside, or no point is known that is.
    """
    rules, start = program.conditions, inside(program) if start is None else start
    place = None if start is None else _place(program, start)
    if place is None:
        raise ValueError("no point strictly inside the conditions was found")
    free = rules.free
    degree = max(len(rules.sign) + 4 * program.links, 1)
    quadratic = np.vstack([program.data, program.pull])
    whole = triangle_of(np.column_stack([quadratic, np.concatenate([program.target, program.pull_target])]))
    fixed, aim = whole[:, :-1], whole[:, -1]
    level = max(program.objective(place.phi) + 0.5, 1e-12)
    mu = 0.1 * level / degree
    steps, said = 0, "stopped after its most steps"
    while steps < _MOST_STEPS:
        level = program.objective(place.phi) + 0.5
        last = mu * degree <= tolerance * level
        rows, rest = _newton_rows(program, place, mu, fixed, aim)
        step, decrement = _least_squares(rows @ free, rest)
        place, length = _stepped(program, place, free @ step, mu, decrement)
        steps += 1
        if decrement**2 <= (_NEAR if not last else 1e-6) * mu or length == 0.0:
            if last or (length == 0.0 and mu * degree <= 1e-6 * level):
                said = "converged"
                break
            mu *= _FALL
    prices = Multipliers(_equation_prices(program, place, mu), mu / place.signs, _prices(place, mu))
    return ConicCandidate(place.phi, prices, said, steps)


def inside(program: Program) -> Array | None:
    """Return a point strictly inside all conditions, shape (p,): the prior, or the deepest one; None without one."""
    rules, start = program.conditions, program.start
    nudged = start + 1e-3 * (np.abs(rules.sign).sum(axis=0) > 0)
    for phi in () if len(rules.zero) else (start, nudged):
        if _place(program, phi) is not None:
            return phi
    phi = deepest(rules).phi
    return phi if _place(program, phi) is not None and np.all(np.abs(rules.equations(phi)) < 1e-7) else None


def _place(program: Program, phi: Array) -> _Place | None:
    rules = program.conditions
    signs = rules.signs(phi)
    if len(signs) and np.min(signs) <= 0:
        return None
    try:
        return _Place(phi, signs, np.linalg.cholesky(rules.pseudo(phi)), np.linalg.cholesky(program.inertias(phi)))
    except np.linalg.LinAlgError:
        return None


def _newton_rows(program: Program, place: _Place, mu: float, fixed: Array, aim: Array) -> tuple[Array, Array]:
    """Return (J, r) with J'J the Hessian and J'r the gradient of the barrier function."""
    rules = program.conditions
    size = rules.size
    rows, rest = [fixed], [fixed @ place.phi - aim]
    rows += [
        rules.sign / place.signs[:, None] * np.sqrt(mu),
        np.sqrt(mu) * whitened_rows(place.roots, size, rules.bases),
    ]
    rest += [np.full(len(rules.sign), -np.sqrt(mu)), np.tile(-np.sqrt(mu) * IDENTITY_VECTOR, program.links)]
    if program.weight:
        rows.append(np.sqrt(program.weight) * whitened_rows(place.bodies, size))
        turned = program.whitening @ place.bodies
        pulled = stack_vectors(turned.transpose(0, 2, 1) @ turned) - IDENTITY_VECTOR
        rest.append(np.sqrt(program.weight) * pulled.ravel())
    return np.vstack(rows), np.concatenate(rest)


def _least_squares(rows: Array, rest: Array) -> tuple[Array, float]:
    """Return the step s that minimises |rows s + rest| and its size |rows s|, the Newton decrement."""
    width = rows.shape[1]
    factor = triangle_of(np.column_stack([rows, -rest]))
    root, aim = factor[:width, :width], factor[:width, width]
    diagonal = np.abs(np.diag(root))
    if np.min(diagonal, initial=1.0) <= 1e-15 * np.max(diagonal, initial=1.0):  # directions that nothing holds
        return np.linalg.lstsq(root, aim)[0], float(np.linalg.norm(aim))
    return solve_upper(root, aim), float(np.linalg.norm(aim))


def _stepped(program: Program, place: _Place, step: Array, mu: float, decrement: float) -> tuple[_Place, float]:
    """Return the place after a step that stays inside and makes the barrier function fall, and the step's length."""
    length, before = 1.0, _barrier(program, place, mu)
    for _ in range(60):
        after = _place(program, place.phi + length * step)
        if after is not None:
            fall = before - _barrier(program, after, mu)
            rounding = 1e-14 * (abs(before) + program.objective(after.phi))
            if fall >= 0.1 * length * decrement**2 or (length == 1.0 and abs(fall) <= rounding):
                return after, length
        length *= 0.6
    return place, 0.0


def _barrier(program: Program, place: _Place, mu: float) -> float:
    value = program.objective(place.phi) - mu * float(np.sum(np.log(place.signs)))
    return value - 2 * mu * float(np.sum(np.log(np.einsum("lii->li", place.roots))))


def _prices(place: _Place, mu: float) -> Array:
    inverse = np.linalg.inv(place.roots)
    return mu * inverse.transpose(0, 2, 1) @ inverse


def _equation_prices(program: Program, place: _Place, mu: float) -> Array:
    """Return the multipliers of the equations: what is left of the gradient lies in their span."""
    rules = program.conditions
    if not len(rules.zero):
        return np.zeros(0)
    rest = program.gradient(place.phi) - rules.sign.T @ (mu / place.signs)
    rest[: 10 * program.links] -= along_basis(_prices(place, mu), rules.bases)
    return np.linalg.lstsq(rules.zero.T, rest)[0]
