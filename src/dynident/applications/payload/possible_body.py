"""The possible body nearest to ten parameters that were found with a covariance."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.errors import SolverFailed
from dynident.model.inertia import PSEUDO_BASIS, Inertia

#: Weight of the pull towards the prior body; a datum of one standard deviation weighs 1.
PULL = 0.01

#: The pull is lowered to its weight in such steps from where Newton's method is sure to converge.
LOWERED, HIGHEST = 10.0, 1e6

#: Newton steps for one weight at most, decrement below which they end, and one that no noise tells from 0.
STEPS, DONE, FAIR = 100, 1e-13, 0.1

#: Least share of the prior that the start has along each direction.
THIN = 1e-3


def possible_body(ten: Array, information: Array, prior: Inertia) -> Inertia:
    """Return the body with min (x - ten)' information (x - ten) / 2 + PULL D(P(x), P(prior)) among all with P > 0.

    D is the entropic divergence tr(P0^-1 P) - log det(P0^-1 P) - 4 (Lee, Wensing and Park 2020): a barrier at the edge
    of what is possible, and where the data say nothing the prior. Newton's method along falling weights of D.

    Args:
        ten: Found parameters in the order of TEN, shape (10,).
        information: Inverse covariance, zero in directions that are not determined, shape (10, 10).
        prior: A possible body.

    Raises:
        SolverFailed: Newton's method did not converge.
    """
    found = _BodyObjective(ten, information, prior)
    x, weight = found.start(), HIGHEST
    while weight > PULL:
        x = found.nearest(x, weight, sure=False)
        weight /= LOWERED
    return Inertia.from_vector(found.nearest(x, PULL, sure=True))


class _BodyObjective:
    """The objective in coordinates in which the prior is the unit matrix."""

    def __init__(self, ten: Array, information: Array, prior: Inertia) -> None:
        self.ten, self.information = ten, information
        self.root = np.linalg.cholesky(prior.pseudo)
        inverse = np.linalg.inv(self.root)
        self.basis = inverse @ PSEUDO_BASIS @ inverse.T
        self.linear = np.trace(self.basis, axis1=1, axis2=2)
        self.size = np.sqrt(np.einsum("kij,kij->k", self.basis, self.basis))

    def start(self) -> Array:
        """Return the ten with the eigenvalues of their pseudo-inertia lifted above zero."""
        values, vectors = np.linalg.eigh(np.einsum("k,kij->ij", self.ten, self.basis))
        lifted = self.root @ (vectors * np.maximum(values, THIN)) @ vectors.T @ self.root.T
        return Inertia.from_pseudo(lifted).vector

    def value(self, x: Array, pull: float) -> float:
        """Return the objective; infinite where x is no possible body."""
        values = np.linalg.eigvalsh(np.einsum("k,kij->ij", x, self.basis))
        if values[0] <= 0:
            return np.inf
        away = x - self.ten
        return float(0.5 * away @ self.information @ away + pull * (self.linear @ x - np.sum(np.log(values))))

    def nearest(self, x: Array, pull: float, sure: bool) -> Array:
        """Return the minimum for one weight of D from a start inside."""
        now, decrement = self.value(x, pull), np.inf
        for _ in range(STEPS):
            inside = np.linalg.inv(np.einsum("k,kij->ij", x, self.basis))
            parts = inside @ self.basis
            slope = self.information @ (x - self.ten) + pull * (self.linear - np.trace(parts, axis1=1, axis2=2))
            bend = self.information + pull * np.einsum("iab,jba->ij", parts, parts)
            step = -np.linalg.solve(bend / self.size / self.size[:, None], slope / self.size) / self.size
            decrement = float(-slope @ step)
            if decrement <= DONE * max(1.0, abs(now)):
                return x
            length = 1.0
            while not self.value(x + length * step, pull) <= now - 1e-4 * length * decrement and length > 1e-12:
                length *= 0.5
            if length <= 1e-12:
                return x  # the objective cannot tell anything smaller
            x = x + length * step
            now = self.value(x, pull)
        if sure and not decrement <= FAIR:
            evidence = f"a decrement of {decrement:.2g} is left"
            raise SolverFailed("the possible payload", evidence, "check the units of the log")
        return x
