"""The consistent fit as a convex program, and the check of a solution from the program's own data.

minimise    f(phi) = |A phi - y|^2 / 2 + |B phi - c|^2 / 2 + w sum_i (tr Q_i - log det Q_i - 4)
subject to  the conditions; Q_i = V_i P_i(phi) V_i' with V_i P_i(prior) V_i' = I

A, y: the weighted triangle in units of its residual. B, c: a quadratic prior. w: the entropic prior of Lee, Wensing and
Park 2020, (17), in whitened form; 0 for none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.identification.consistency.conditions import Conditions, vector_rows
from dynident.model.inertia import PSEUDO_BASIS
from dynident.model.lapack import solve_upper
from dynident.model.reduction import triangle_of


@dataclass(frozen=True)
class Program:
    """See the module; p scaled parameters, l links.

    Attributes:
        data: A, shape (b, p).
        target: y, shape (b,).
        pull: B, shape (k, p).
        pull_target: c, shape (k,).
        weight: w, of the entropic prior; 0 for none.
        whitening: V_i, shape (l, 4, 4); used where w > 0.
        conditions: What must hold.
        start: Scaled parameters of the prior, shape (p,).
    """

    data: Array
    target: Array
    pull: Array
    pull_target: Array
    weight: float
    whitening: Array
    conditions: Conditions
    start: Array

    @property
    def links(self) -> int:
        """Number of links, l."""
        return len(self.conditions.links)

    def on(self, data: Array, target: Array, share: float) -> Program:
        """Return the program with other data; ``share``: rows behind these over rows behind the others."""
        pull, aim = np.sqrt(share) * self.pull, np.sqrt(share) * self.pull_target
        return replace(self, data=data, target=target, pull=pull, pull_target=aim, weight=share * self.weight)

    def inertias(self, phi: Array) -> Array:
        """Return P_i(phi), shape (l, 4, 4)."""
        return np.einsum("lk,kij->lij", phi[: 10 * self.links].reshape(-1, 10), PSEUDO_BASIS)

    def objective(self, phi: Array) -> float:
        """Return f(phi); infinite where the entropic prior has no value."""
        value = 0.5 * float(
            np.sum((self.data @ phi - self.target) ** 2) + np.sum((self.pull @ phi - self.pull_target) ** 2)
        )
        if self.weight == 0.0:
            return value
        whitened = self.whitening @ self.inertias(phi) @ self.whitening.transpose(0, 2, 1)
        sizes = np.linalg.eigvalsh(whitened)
        if np.min(sizes) <= 0:
            return float("inf")
        return value + self.weight * float(np.sum(sizes - np.log(sizes) - 1.0))

    def gradient(self, phi: Array) -> Array:
        """Return the gradient of f, shape (p,)."""
        found = self.data.T @ (self.data @ phi - self.target) + self.pull.T @ (self.pull @ phi - self.pull_target)
        if self.weight:
            centre = self.whitening.transpose(0, 2, 1) @ self.whitening  # the inverse of P_i(prior)
            found[: 10 * self.links] += self.weight * along_basis(centre - np.linalg.inv(self.inertias(phi)))
        return found

    def curvature(self, phi: Array) -> Array:
        """Return rows J with J'J the Hessian of f at phi, shape (b + k (+ 10 l), p)."""
        rows = [self.data, self.pull]
        if self.weight:
            rows.append(
                np.sqrt(self.weight) * whitened_rows(np.linalg.cholesky(self.inertias(phi)), self.data.shape[1])
            )
        return np.vstack(rows)


@dataclass(frozen=True)
class Multipliers:
    """The prices of the conditions: what the objective would fall by where a condition gave way.

    Attributes:
        zero: Of the equations, shape (z,).
        sign: Of the inequalities, shape (k,).
        cones: Of the links, shape (l, 4, 4).
    """

    zero: Array
    sign: Array
    cones: Array

    def projected(self) -> Multipliers:
        """Return the nearest multipliers that are possible: sign >= 0, cones positive semidefinite."""
        values, vectors = np.linalg.eigh(self.cones)
        cones = np.einsum("lij,lj,lkj->lik", vectors, np.maximum(values, 0.0), vectors)
        return Multipliers(self.zero, np.maximum(self.sign, 0.0), cones)


@dataclass(frozen=True)
class Optimality:
    """How far a point may be from the optimum, from the program's own data.

    Attributes:
        objective: f at the point.
        gap: No point that meets the conditions has an objective lower by more than this share of f + 1/2, which is
            half the residual square and the prior's part in units of the residual square of the free fit.
        complementarity: Part of the gap that multipliers times slacks make.
        stationarity: Part of the gap that the gradient less the multipliers' part makes.
        shortfall: By how much the worst condition is broken, in natural sizes.
    """

    objective: float
    gap: float
    complementarity: float
    stationarity: float
    shortfall: float


def optimality(program: Program, phi: Array, multipliers: Multipliers) -> Optimality:
    """Return the conditions of Karush, Kuhn and Tucker at a point as one proven gap.

    With the residual r = grad f - (multipliers' part) and the Hessian H = J'J, every phi' that meets the conditions has

        f(phi') >= f(phi) - sum z s - h(|J^-T r|),   h(x) = x^2 / 2

    since f is a convex quadratic; with the entropic prior h(x) = w (-t - log(1 - t)), t = x / sqrt(w), since f / w is
    self-concordant (Nesterov 2018, (5.1.35)).

    Args:
        program: The program.
        phi: The point, shape (p,).
        multipliers: Any; the nearest possible ones are used.
    """
    rules, prices = program.conditions, multipliers.projected()
    objective, shortfall = program.objective(phi), rules.shortfall(phi)
    bad = Optimality(objective, np.inf, np.inf, np.inf, shortfall)
    if not np.isfinite(objective):
        return bad
    residual = program.gradient(phi) - rules.zero.T @ prices.zero - rules.sign.T @ prices.sign
    residual[: 10 * program.links] -= along_basis(prices.cones, rules.bases)
    slack = float(prices.sign @ np.maximum(rules.signs(phi), 0.0)) + float(np.sum(prices.cones * rules.pseudo(phi)))
    slack += float(np.abs(prices.zero) @ np.abs(rules.equations(phi)))
    factor = triangle_of(program.curvature(phi))
    try:
        distance = float(np.linalg.norm(solve_upper(factor, residual, transposed=True)))
    except (np.linalg.LinAlgError, ValueError):
        return bad
    if program.weight:
        t = distance / np.sqrt(program.weight)
        curved = program.weight * float(-t - np.log1p(-t)) if t < 1 else np.inf
    else:
        curved = distance**2 / 2
    size = objective + 0.5
    return Optimality(objective, (abs(slack) + curved) / size, abs(slack) / size, curved / size, shortfall)


def along_basis(matrices: Array, bases: Array = PSEUDO_BASIS) -> Array:
    """Return <M_i, B_k> for symmetric matrices (l, 4, 4) and ten basis matrices, (10, 4, 4) or (l, 10, 4, 4)."""
    return (bases.reshape(-1, 10, 16) @ matrices.reshape(-1, 16, 1)).ravel()


def whitened_rows(roots: Array, size: int, bases: Array = PSEUDO_BASIS) -> Array:
    """Return the rows svec(L_i^-1 B_k L_i^-T) for lower roots L_i (l, 4, 4), shape (10 l, size), blocks by link.

    Their square is the Hessian of -log det at P_i = L_i L_i'. The matrices B_k are those of :func:`along_basis`.
    """
    inverse = np.linalg.inv(roots)[:, None]
    return vector_rows(inverse @ bases @ inverse.transpose(0, 1, 3, 2), size)
