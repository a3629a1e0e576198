"""Which of many possible causes explains what a fit leaves: columns that are added to it one after another.

Each cause (a spring, a tilt, a load) is a few columns more of the linear problem. Of those that chance would hardly
make (likelihood ratio, Wilks 1938, all causes counted) the one by which the likelihood grows most beyond what its
columns earn (Schwarz 1978) is taken in, then the next, until none is sure: one fault is told once and not in the words
of its neighbours. Where the log does not tell it from others, these are its rivals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.diagnosis.causes.weighted_fit import EXACT, RIDGE, Solved, weighted_products
from dynident.identification.residuals.covariance import correlation_factors
from dynident.identification.residuals.quantiles import (
    chi_square_tail,
    normal_quantile,
    student_quantile,
    student_share,
)
from dynident.model.reduction import triangle_of

#: Chance that a log without any cause has one told in a round, rows that hang together counted once.
CHANCE = 1e-4

#: Difference of two criteria of Schwarz below which the log does not tell two causes apart (Kass and Raftery 1995:
#: beyond 6 the evidence is strong), and rivals that are told at most.
CLOSE, RIVALS = 6.0, 2

#: Causes that are taken in at most.
MOST = 4

#: Candidates of a round that are fitted with weights of their own.
FITTED = 6

#: Degrees of freedom that pass for infinitely many.
MANY = 1e6


@dataclass(frozen=True)
class Cause:
    """A possible cause of a residual.

    Attributes:
        name: Of the finding.
        joint: Name of the joint it belongs to; empty for the whole arm.
        columns: The torque at all joints for one unit of each coefficient, shape (k, N, n).
        likelier: Factor on its merit, above 1 for a cause that is likelier beforehand than one with the same torque.
        hidden: How many of the coefficients, the last ones, have a prior about what the others make them, and are not
            told.
    """

    name: str
    joint: str
    columns: Array
    likelier: float = 1.0
    hidden: int = 0

    @property
    def told(self) -> int:
        """How many coefficients are told."""
        return len(self.columns) - self.hidden


@dataclass(frozen=True)
class Blame:
    """A cause that explains.

    Attributes:
        cause: The cause.
        values: Its coefficients, shape (k,).
        covariance: Of them, rows that hang together counted once, shape (k, k).
        certainty: Root of the likelihood ratio against a fit without it.
        gain: By how much the sum of the log variances fell.
        share: Largest share of a joint's residual variance that it took away.
        size: Its torque as a share of the measured one, root mean squares: of its joint, or of all joints together.
        torque: Root mean square of its torque at each joint, shape (n,).
        taken: Root mean square that it took off the residual of each joint, shape (n,); what the other columns could
            have taken in is not in it.
        rivals: Causes that explain it about as well in its place.
        freedom: Degrees of freedom behind the covariance; infinite where rows alone make it.
    """

    cause: Cause
    values: Array
    covariance: Array
    certainty: float
    gain: float
    share: float
    size: float
    torque: Array
    taken: Array
    rivals: tuple[Blame, ...] = ()
    freedom: float = np.inf

    @property
    def deviations(self) -> Array:
        """Standard deviations of the coefficients, shape (k,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def half_widths(self) -> Array:
        """Half of the 95 % intervals of the coefficients, by Student's distribution, shape (k,)."""
        return self.deviations * float(student_quantile(0.975, min(self.freedom, MANY)))

    def score(self, t: float) -> float:
        """Return the normal deviate that is as unlikely as this number of standard deviations."""
        return -float(normal_quantile(student_share(-t, min(self.freedom, MANY))))


@dataclass(frozen=True)
class CauseRows:
    """Rows of a fit to which causes are added.

    Attributes:
        blocks: Observation matrix of each joint, shape (N, K_i).
        columns: Positions in beta of its columns, shape (K_i,) each.
        size: Length of beta.
        target: What is fitted, shape (N, n).
        measured: The torque that sizes are compared with, shape (N, n).
        masks: Which rows count, shape (N, n).
        oversampling: Rows for each that is independent where noise is white before the filter.
    """

    blocks: Sequence[Array]
    columns: Sequence[IntArray]
    size: int
    target: Array
    measured: Array
    masks: BoolArray
    oversampling: float = 1.0

    @cached_property
    def counts(self) -> Array:
        """Rows of each joint that count, shape (n,), at least 1."""
        return np.maximum(self.masks.sum(axis=0), 1).astype(float)

    def residual(self, values: Array, added: Sequence[Cause]) -> Array:
        """Return the residual at beta followed by the coefficients of the added causes, shape (N, n)."""
        predicted = [block @ values[own] for block, own in zip(self.blocks, self.columns, strict=True)]
        extra = np.concatenate([cause.columns for cause in added]) if added else np.zeros((0, *self.target.shape))
        return self.target - np.stack(predicted, axis=1) - np.tensordot(values[self.size :], extra, 1)


class CauseSearch:
    """Products of rows and columns of causes, made once; a fit with some of the causes is a choice of their entries."""

    def __init__(self, rows: CauseRows, causes: Sequence[Cause], kept: BoolArray | None = None) -> None:
        """Make the products.

        Args:
            rows: The rows.
            causes: The causes.
            kept: Columns of beta, shape (size,), that a fit has; the others, which one joint alone has, are taken out
                of all rows, so that residuals are the same. None for all columns.
        """
        self.rows, self.causes = rows, tuple(causes)
        kept = np.ones(rows.size, bool) if kept is None else kept
        self.size, places = int(kept.sum()), np.cumsum(kept) - 1
        lengths = [len(cause.columns) for cause in causes]
        ends = self.size + np.cumsum(lengths, dtype=np.int64)
        self._places = [np.arange(end - length, end) for end, length in zip(ends, lengths, strict=True)]
        total = self.size + int(sum(lengths))
        extra = np.concatenate([cause.columns for cause in causes]) if causes else np.zeros((0, *rows.target.shape))
        joints = rows.target.shape[1]
        self._grams, self._sides = np.zeros((joints, total, total)), np.zeros((joints, total))
        self.squares, self.whole = np.zeros((2, joints))  # less what the columns that are taken out explain, and all
        for i, (block, own) in enumerate(zip(rows.blocks, rows.columns, strict=True)):
            mine, target = kept[own], rows.target[:, i]
            every = np.concatenate([places[own[mine]], np.arange(self.size, total)])
            order = np.concatenate([np.flatnonzero(~mine), np.flatnonzero(mine)])
            full = triangle_of(np.column_stack([block[:, order], extra[:, :, i].T, target])[rows.masks[:, i]])
            self.whole[i] = full[:, -1] @ full[:, -1]
            full = full[np.sum(~mine) :, np.sum(~mine) :]
            product = full.T @ full
            self._grams[i][np.ix_(every, every)] = product[:-1, :-1]
            self._sides[i][every] = product[:-1, -1]
            self.squares[i] = product[-1, -1]
        self.floors = np.maximum(EXACT**2 * self.whole / rows.counts, 1e-300)

    def fit(self, chosen: Sequence[int]) -> Solved:
        """Return the fit with some of the causes, by their numbers."""
        return weighted_products(*self.products(chosen), self.squares, self.rows.counts, self.floors)

    def products(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """Return W_i' W_i (n, k, k) and W_i' tau_i (n, k) of each joint with the columns of some of the causes."""
        use = np.concatenate([np.arange(self.size), *(self._places[k] for k in chosen)])
        return self._grams[:, use][:, :, use], self._sides[:, use]

    def factors(self, solved: Solved, chosen: Sequence[int]) -> Array:
        """Return by how much the rows of each joint hang together under a fit, shape (n,)."""
        residual = self.rows.residual(solved.beta, [self.causes[k] for k in chosen])
        return correlation_factors([residual], [self.rows.masks])

    def blames(self) -> tuple[Blame, ...]:
        """Return the causes that are sure, the one that explains most first."""
        chosen: list[int] = []
        found: list[Blame] = []
        solved = self.fit(chosen)
        while len(chosen) < min(MOST, len(self.causes)):
            step = self._next(solved, chosen)
            if step is None:
                break
            k, after, blame = step
            chosen.append(k)
            solved = after
            found.append(blame)
        return tuple(found)

    def candidates(self, before: Solved, chosen: Sequence[int]) -> list[int]:
        """Return the causes that are worth a fit, by their numbers."""
        rest = [k for k in range(len(self.causes)) if k not in chosen]
        return sorted(rest, key=lambda k: -self._quick(before, chosen, k))[:FITTED]

    def spread(self, worth: Array) -> float:
        """Return the factor on the covariance of a fit for rows that hang together."""
        return float(np.median(self.rows.counts / worth))

    def _next(self, before: Solved, chosen: list[int]) -> tuple[int, Solved, Blame] | None:
        sure: list[tuple[float, int, Solved, Array]] = []
        for k in self.candidates(before, chosen):
            after, columns = self.fit([*chosen, k]), self.causes[k].told
            worth = self.rows.counts / self.factors(after, [*chosen, k])
            ratio = _ratio(before, after, worth)
            if len(self.causes) * chi_square_tail(ratio, columns) < CHANCE:
                merit = self.causes[k].likelier * (ratio - columns * float(np.log(worth.sum())))
                sure.append((merit, k, after, worth))
        if not sure:
            return None
        (best, k, after, worth), *others = sorted(sure, key=lambda each: -each[0])
        close = [each for each in others if best - each[0] < CLOSE][:RIVALS]
        rivals = tuple(self._blame(before, solved, other, own) for _, other, solved, own in close)
        return k, after, replace(self._blame(before, after, k, worth), rivals=rivals)

    def _quick(self, before: Solved, chosen: Sequence[int], k: int) -> float:
        """Return about how likely one cause is, with the weights as they are: one step of elimination."""
        use = np.concatenate([np.arange(self.size), *(self._places[c] for c in chosen)])
        new, weights = self._places[k], 1.0 / before.variances
        cross = np.tensordot(weights, self._grams[:, use][:, :, new], 1)
        own = np.tensordot(weights, self._grams[:, new][:, :, new], 1)
        along = before.covariance @ cross
        side = weights @ self._sides[:, new] - along.T @ (weights @ self._sides[:, use])
        gram = own - cross.T @ along
        gram += np.diag(1e-9 * np.diag(own) + RIDGE * np.max(np.diag(own), initial=0.0) + 1e-300)
        step = np.linalg.solve(gram, side)
        shift = np.concatenate([-along @ step, step])
        every = np.concatenate([use, new])
        beta = np.concatenate([before.beta, np.zeros(len(new))]) + shift
        grams, sides = self._grams[:, every][:, :, every], self._sides[:, every]
        left = self.squares - 2 * sides @ beta + np.einsum("k,ikl,l->i", beta, grams, beta)
        variances = np.maximum(left, 0.0) / self.rows.counts + self.floors
        worth = self.rows.counts / self.rows.oversampling
        ratio = float(worth @ np.log(before.variances / variances))
        return self.causes[k].likelier * (ratio - len(new) * float(np.log(worth.sum())))

    def _blame(self, before: Solved, after: Solved, k: int, worth: Array) -> Blame:
        cause, size = self.causes[k], len(self._places[k])
        values = after.beta[-size:]
        covariance = after.covariance[-size:, -size:] * self.spread(worth)
        torque = np.tensordot(values, cause.columns, 1)
        values, covariance = values[: cause.told], covariance[: cause.told, : cause.told]
        masks, measured = self.rows.masks, self.rows.measured
        counts = self.rows.counts
        own = np.sqrt(np.sum(np.where(masks, torque, 0.0) ** 2, axis=0) / counts)
        whole = np.sqrt(np.sum(np.where(masks, measured, 0.0) ** 2, axis=0) / counts)
        size_of_all = max(float(np.linalg.norm(whole)), 1e-300)
        return Blame(
            cause,
            values,
            covariance,
            float(np.sqrt(max(_ratio(before, after, worth), 0.0))),
            before.score - after.score,
            float(np.max(1.0 - after.variances / before.variances)),
            float(np.max(own / np.maximum(whole, 1e-300)) if cause.joint else np.linalg.norm(own) / size_of_all),
            own,
            np.sqrt(np.maximum(before.variances - after.variances, 0.0)),
            freedom=after.freedom,
        )


def _ratio(before: Solved, after: Solved, worth: Array) -> float:
    """Return twice the logarithm of the likelihood ratio of two fits, of ``worth`` (n,) independent rows each."""
    return float(worth @ np.log(before.variances / after.variances)) + before.surprise - after.surprise
