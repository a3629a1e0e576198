"""Covariance of an estimate from triangles of stretches of time, where the rows themselves are gone.

The scores of a stretch, X_s' e_s, are sums over all that hangs together within it, in time and between joints;
stretches are far longer than residuals remember. So B = sum_s g_s g_s' (Liang and Zeger 1986). The fit takes more of
the residual where a stretch decides much, hence g_s = X_s' (I - X_s A^-1 X_s')^-1/2 e_s (Bell and McCaffrey 2002). All
of it can be said with the triangle of the stretch in place of its rows.
"""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.identification.residuals.covariance import FEWEST_FREE
from dynident.identification.streaming.digest import Digest
from dynident.model.reduction import Triangle, reduce


class StretchStatistics:
    """What a problem whose rows are gone still knows about them; see :class:`LeftOver` in the problem's file.

    Attributes:
        samples: Number of time samples in all logs.
        accelerations: Root mean square acceleration of each joint, shape (n,).
    """

    def __init__(self, digest: Digest) -> None:
        self._digest = digest
        self.samples = digest.samples
        self.accelerations: Array = np.sqrt(digest.states.accelerations / max(digest.states.samples, 1))

    def factors(self, beta: Array) -> Array:
        """Return how much the rows of each joint hang together at ``beta``, shape (n,), >= 1.

        The variance of the sums of stretches over that of as many independent rows.
        """
        found = []
        for joint in self._digest.joints:
            vector = np.append(-beta[joint.columns], 1.0)
            sums = joint.sums @ vector
            mean = sums.sum() / max(joint.counts.sum(), 1)
            square = joint.triangle.residual_square(beta) - joint.counts.sum() * mean**2
            used = np.count_nonzero(joint.counts)
            apart = np.sum((sums - mean * joint.counts) ** 2) * used / max(used - 1, 1)
            found.append(max(1.0, apart / square) if square > 0 else 1.0)
        return np.array(found)

    def uncertainty(self, inverse: Array, weights: Array, beta: Array) -> tuple[Array, Array]:
        """Return the covariance of a fit and the degrees of freedom of its variances.

        Args:
            inverse: (X'X)^-1 of the weighted rows, with what a prior adds to X'X where there is one, shape (b, b).
            weights: Weight of each joint's rows, shape (n,).
            beta: The estimate, shape (b,).

        Returns:
            Shapes (b, b) and (b,) (Satterthwaite 1946).
        """
        size, joints = len(beta), self._digest.joints
        covariance, total, doubt = np.zeros((size, size)), np.zeros(size), np.zeros(size)
        for s in range(len(joints[0].counts)):
            parts = [Triangle(joint.columns, joint.factors[s], int(joint.counts[s])) for joint in joints]
            rows = reduce(parts, size, weights)
            left = np.eye(size) - rows.r @ inverse @ rows.r.T
            values, vectors = np.linalg.eigh(0.5 * (left + left.T))
            root = (vectors / np.sqrt(np.maximum(values, FEWEST_FREE))) @ vectors.T
            score = inverse @ (rows.r.T @ (root @ (rows.z - rows.r @ beta)))
            covariance += np.outer(score, score)
            share = np.sum((rows.r @ inverse) ** 2, axis=0)
            total += share
            doubt += share**2
        return covariance, np.maximum(total**2 / np.maximum(doubt, 1e-300) - 1.0, 1.0)
