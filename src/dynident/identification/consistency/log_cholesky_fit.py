"""Gauss-Newton over log-Cholesky forms of the links: always possible robots, and no minimum on the boundary.

P_i = U_i U_i' with ten free numbers each (Rucker and Wensing 2022, (12)). Where the best possible robot has a link with
a singular pseudo-inertia, no values of the ten reach it: exponents run to minus infinity, and far from it as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.identification.consistency.conditions import stack_vectors
from dynident.identification.consistency.program import Program
from dynident.model.inertia import PSEUDO_BASIS, Inertia
from dynident.model.lapack import solve_upper
from dynident.model.reduction import triangle_of

CONVERGED, BOUNDARY, UNFINISHED = "converged", "optimum on the boundary of the possible", "not converged"

#: Smallest eigenvalue of a scaled pseudo-inertia, as a share of its trace (or of 1), below which a link is singular.
SINGULAR = 1e-6

#: Predicted fall of the objective, as a share of f + 1/2, that ends the search.
_ENOUGH = 1e-9

#: Fall over some iterations below which the search crawls, over how many, and how near the proven optimum that ends it.
_CRAWL, _WINDOW, _NEAR = 1e-3, 5, 0.01

#: Smallest exponent of the diagonal of U: beyond it a link is singular to rounding, and the ten are lost in it.
_LEAST = -11.0

_TO_TEN = np.linalg.inv(stack_vectors(PSEUDO_BASIS).T)
_OFF = ((0, 1), (1, 2), (0, 2))


@dataclass(frozen=True)
class Descent:
    """Where the search ended.

    Attributes:
        phi: Scaled standard parameters, shape (p,).
        objective: f there.
        verdict: ``CONVERGED``, ``BOUNDARY`` or ``UNFINISHED``.
        iterations: Steps taken.
        singular: Names of the links that ended on the boundary.
    """

    phi: Array
    objective: float
    verdict: str
    iterations: int
    singular: tuple[str, ...]


def descend(program: Program, most: int, best: float) -> Descent:
    """Minimise a quadratic program over log-Cholesky forms and bounded coefficients, from the prior.

    Levenberg-Marquardt with the exact Jacobian on the triangle; coefficients at their bound whose gradient points out
    are held there.

    Args:
        program: Without entropic prior, equations or stated inequalities; its links' margin is not used.
        most: Largest number of steps.
        best: The objective of the proven optimum, without which a crawl far from it would look like the boundary.
    """
    links, size = program.links, program.data.shape[1]
    quadratic = np.vstack([program.data, program.pull])
    target = np.concatenate([program.target, program.pull_target])
    whole = triangle_of(np.column_stack([quadratic, target]))
    root, aim = whole[:, :size], whole[:, size]
    lower = np.full(size, -np.inf)
    if len(program.conditions.sign):
        lower[np.argmax(program.conditions.sign, axis=1)] = 0.0
    lower[: 10 * links].reshape(links, 10)[:, :4] = _LEAST
    x = program.start.copy()
    for i in range(links):
        x[10 * i : 10 * i + 10] = Inertia.from_vector(program.start[10 * i : 10 * i + 10]).log_cholesky
    damping, trace = 1e-3, [_cost(root, aim, x, links)]
    verdict, steps = UNFINISHED, 0
    while steps < most:
        steps += 1
        phi, slope = bodies_of(x, links)
        rest, jacobian = root @ phi - aim, root @ slope
        held = (x <= lower) & (jacobian.T @ rest > 0.0)
        x, damping, fall = _step(root, aim, x, links, jacobian, rest, (lower, held), damping)
        trace.append(_cost(root, aim, x, links))
        level = trace[-1] + 0.5
        phi = bodies_of(x, links)[0]
        singular = _singular(program, phi)
        ends = fall <= _ENOUGH * level
        if program.objective(phi) <= best + _NEAR * (best + 0.5):
            verdict = BOUNDARY if singular else CONVERGED if ends else UNFINISHED
            ends |= bool(singular) and len(trace) > _WINDOW and trace[-1 - _WINDOW] - trace[-1] < _CRAWL * level
        if ends:
            break
    phi = _possible(program, bodies_of(x, links)[0])
    return Descent(phi, program.objective(phi), verdict, steps, _singular(program, phi))


def _possible(program: Program, phi: Array) -> Array:
    """Return phi moved towards the prior by what rounding took from singular links, a millionth at most."""
    for share in (0.0, 1e-12, 1e-10, 1e-8):
        moved = phi.copy()
        inertial = slice(0, 10 * program.links)
        moved[inertial] += share * program.start[inertial]
        bodies = moved[inertial].reshape(-1, 10)
        if all(Inertia.from_vector(body).is_consistent(1e-14) for body in bodies):
            return moved
    return phi + 1e-6 * np.where(np.arange(len(phi)) < 10 * program.links, program.start, 0.0)


def _step(
    root: Array,
    aim: Array,
    x: Array,
    links: int,
    jacobian: Array,
    rest: Array,
    bounds: tuple[Array, BoolArray],
    damping: float,
) -> tuple[Array, float, float]:
    """Return the next point, the next damping, and the fall that the linear model predicted or allowed."""
    lower, held = bounds
    cost = 0.5 * float(rest @ rest)
    columns = np.where(held, 0.0, 1.0) * jacobian
    norms = np.sqrt(np.sum(columns**2, axis=0))
    scale = np.maximum(norms, 1e-8 * max(float(norms.max(initial=0.0)), 1e-300))
    for _ in range(40):
        stacked = np.vstack([columns, np.sqrt(damping) * np.diag(scale)])
        factor = triangle_of(np.column_stack([stacked, np.concatenate([-rest, np.zeros(len(x))])]))
        step = solve_upper(factor[: len(x), :-1], factor[: len(x), -1])
        step[: 10 * links] = np.clip(step[: 10 * links], -2.0, 2.0)  # exponents: no more than e^2 at a time
        moved = np.maximum(x + step, lower)
        predicted = cost - 0.5 * float(np.sum((rest + jacobian @ (moved - x)) ** 2))
        after = _cost(root, aim, moved, links)
        if predicted > 0 and cost - after >= 0.1 * predicted:
            return moved, max(damping / 5.0, 1e-14), predicted
        if 0 <= predicted <= _ENOUGH * (cost + 0.5):
            return x, damping, predicted
        damping = max(damping * 4.0, 1e-12)
    return x, damping, 0.0


def _cost(root: Array, aim: Array, x: Array, links: int) -> float:
    rest = root @ bodies_of(x, links)[0] - aim
    return 0.5 * float(rest @ rest)


def bodies_of(x: Array, links: int) -> tuple[Array, Array]:
    """Return phi and its Jacobian (p, p) at log-Cholesky forms and coefficients x, shape (p,)."""
    phi, slope = x.copy(), np.eye(len(x))
    for i in range(links):
        part = slice(10 * i, 10 * i + 10)
        upper, slopes = _upper(x[part])
        pseudo = upper @ upper.T
        turned = slopes @ upper.T
        tens = stack_vectors(np.concatenate([pseudo[None], turned + turned.transpose(0, 2, 1)])) @ _TO_TEN.T
        phi[part] = tens[0]
        slope[part, part] = tens[1:].T
    return phi, slope


def _upper(eta: Array) -> tuple[Array, Array]:
    """Return U, shape (4, 4), and its derivatives by the ten numbers, shape (10, 4, 4)."""
    size = np.exp(eta[0])
    upper = np.eye(4) * size
    slopes = np.zeros((10, 4, 4))
    for k in range(3):
        upper[k, k] = slopes[1 + k, k, k] = size * np.exp(eta[1 + k])
        upper[_OFF[k]] = size * eta[4 + k]
        slopes[(4 + k, *_OFF[k])] = size
        upper[k, 3] = size * eta[7 + k]
        slopes[7 + k, k, 3] = size
    slopes[0] = upper
    return upper, slopes


def _singular(program: Program, phi: Array) -> tuple[str, ...]:
    if not program.links:
        return ()
    values = np.linalg.eigvalsh(program.inertias(phi))
    thin = values[:, 0] < SINGULAR * np.maximum(values.sum(axis=1), 1.0)
    return tuple(name for name, is_thin in zip(program.conditions.links, thin, strict=True) if is_thin)
