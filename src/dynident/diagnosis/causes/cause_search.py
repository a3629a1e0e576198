"""Which of many possible causes explains what a fit leaves: columns that are added to it one after another.

Each cause (a spring, a tilt, a load) is a few columns more of the linear problem. Of those that chance would hardly
make (likelihood ratio, Wilks 1938, all causes counted) the one by which the likelihood grows most beyond what its
columns earn (Schwarz 1978) is taken in, then the next, until none is sure: one fault is told once and not in the words
of its neighbours. Where the log does not tell it from others, these are its rivals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.diagnosis.causes.noise_spectrum import NoiseSpectrum
from dynident.diagnosis.causes.weighted_fit import EXACT, RIDGE, Solved, weighted_products
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

#: Causes that are taken in at most, and rounds of taking in and judging again.
MOST, ROUNDS = 8, 3

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

    def torque(self, values: Array, added: Sequence[Cause]) -> Array:
        """Return the torque of beta followed by the coefficients of the added causes, shape (N, n)."""
        own = [block @ values[places] for block, places in zip(self.blocks, self.columns, strict=True)]
        extra = np.concatenate([cause.columns for cause in added]) if added else np.zeros((0, *self.target.shape))
        return np.stack(own, axis=1) + np.tensordot(values[self.size :], extra, 1)


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
        self._fits: dict[tuple[int, ...], Solved] = {}

    def fit(self, chosen: Sequence[int]) -> Solved:
        """Return the fit with some of the causes, by their numbers; made once."""
        key = tuple(chosen)
        if key not in self._fits:
            self._fits[key] = self.fitted(chosen)
        return self._fits[key]

    def fitted(self, chosen: Sequence[int]) -> Solved:
        """Make the fit with some of the causes, by their numbers."""
        return weighted_products(*self.products(chosen), self.squares, self.rows.counts, self.floors)

    def products(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """Return W_i' W_i (n, k, k) and W_i' tau_i (n, k) of each joint with the columns of some of the causes."""
        use = np.concatenate([np.arange(self.size), *(self._places[k] for k in chosen)])
        return self._grams[:, use][:, :, use], self._sides[:, use]

    @cached_property
    def spectrum(self) -> NoiseSpectrum:
        """How the noise of neighbouring rows hangs together."""
        plain = self.fit([])
        squares, directions = np.linalg.eigh(plain.covariance)
        root, rows = directions * np.sqrt(np.maximum(squares, 0.0)), self.rows
        roots = [
            block @ root[own] / np.sqrt(variance)
            for block, own, variance in zip(rows.blocks, rows.columns, plain.variances, strict=True)
        ]
        return NoiseSpectrum.of_fit(roots, rows.masks, rows.oversampling)

    def worth(self, after: Solved, chosen: Sequence[int]) -> tuple[Array, float]:
        """Return how many independent rows each joint has for the last of the causes, and what its variance is times.

        Args:
            after: The fit with all of them.
            chosen: The causes, by their numbers.

        Returns:
            Shape (n,), and the variance of the coefficients over that of independent rows.
        """
        rows, added = self.rows, [self.causes[k] for k in chosen]
        size = len(added[-1].columns)
        spread = after.covariance[-size:, -size:]
        mixed = -np.linalg.solve(spread, after.covariance[-size:, :-size])
        own = np.stack([
            column - rows.torque(mix, added[:-1]) for column, mix in zip(added[-1].columns, mixed, strict=True)
        ])  # fmt: skip
        sizes = np.einsum("kin,kin,n->k", own, np.where(rows.masks, own, 0.0), 1.0 / after.variances)
        own /= np.sqrt(np.maximum(sizes, 1e-300))[:, None, None]
        factors, power = self.spectrum.factors(rows.target - rows.torque(after.beta, added), own)
        power /= after.variances
        return rows.counts / factors, float(factors @ power / max(power.sum(), 1e-300))

    def blames(self) -> tuple[Blame, ...]:
        """Return the causes that are sure, the one that explains most first.

        Stepwise (Efroymson 1960): causes are taken in one after another; then each is judged again beside all others,
        where another one may take its place, or none is sure any more; then two at once.
        """
        chosen: list[int] = []
        found: dict[int, Blame] = {}
        for _ in range(ROUNDS):
            while len(chosen) < min(MOST, len(self.causes)):
                step = self._next(self.fit(chosen), chosen)
                if step is None:
                    break
                chosen.append(step[0])
                found[step[0]] = step[2]
            hidden = self.judged_again(chosen, found)
            if not hidden:
                break
            chosen += hidden
        return tuple(found[k] for k in chosen if k in found)

    def judged_again(self, chosen: list[int], found: dict[int, Blame]) -> list[int]:
        """Judge each of the chosen causes beside all others, in place; return two that are sure beside each other."""
        for k in tuple(chosen) if len(chosen) > 1 else ():
            place = chosen.index(k)
            rest = chosen[:place] + chosen[place + 1 :]
            step = self._next(self.fit(rest), rest)
            chosen[place : place + 1] = [] if step is None else [step[0]]
            if step is not None:
                found[step[0]] = step[2]
        return self._pair(chosen)

    def candidates(self, before: Solved, chosen: Sequence[int]) -> list[int]:
        """Return the causes that are worth a fit, by their numbers."""
        fall = self._falls(before, chosen)
        falls = {k: fall(k) / self.rows.oversampling for k in self._left(chosen)}
        rows = float(np.log(self.rows.counts.sum() / self.rows.oversampling))
        merits = {k: self.causes[k].likelier * (own - len(self._places[k]) * rows) for k, own in falls.items()}
        likely = [k for k, own in falls.items() if self._may_be_sure(own, len(self.causes), k)]
        return sorted(likely, key=lambda k: -merits[k])[:FITTED]

    def _may_be_sure(self, ratio: float, tried: int, k: int) -> bool:
        """Return whether a cause may be sure in a fit of its own; twice its straight line is beyond the logarithm."""
        return bool(tried * chi_square_tail(2.0 * ratio, self.causes[k].told) < CHANCE)

    def _left(self, chosen: Sequence[int]) -> list[int]:
        return [k for k in range(len(self.causes)) if k not in chosen]

    def _falls(self, before: Solved, chosen: Sequence[int]) -> Callable[..., float]:
        """Return by how much the weighted squares fall where some more causes are fitted, with the weights as they are.

        Weights follow from the fit before: its own are those of a pass earlier, which nearly dependent columns do not
        forgive.
        """
        use = np.concatenate([np.arange(self.size), *(self._places[k] for k in chosen)])
        new = np.arange(self.size, self._sides.shape[1])
        every, weights = np.concatenate([use, new]), 1.0 / before.variances
        gram = np.tensordot(weights, self._grams[:, every][:, :, every], 1)
        side = weights @ self._sides[:, every]
        sizes = np.diag(gram)
        gram = gram + np.diag(RIDGE * np.where(sizes > 0, sizes, 1.0))
        along = np.linalg.solve(gram[: len(use), : len(use)], gram[: len(use), len(use) :])
        beyond = gram[len(use) :, len(use) :] - gram[len(use) :, : len(use)] @ along
        beyond += np.diag(1e-9 * sizes[len(use) :] + 1e-300)
        rest = side[len(use) :] - along.T @ side[: len(use)]

        def fall(*causes: int) -> float:
            own = np.concatenate([self._places[k] for k in causes]) - self.size
            return float(rest[own] @ np.linalg.solve(beyond[np.ix_(own, own)], rest[own]))

        return fall

    def _next(self, before: Solved, chosen: list[int]) -> tuple[int, Solved, Blame] | None:
        sure: list[tuple[float, int, Solved, tuple[Array, float]]] = []
        for k in self.candidates(before, chosen):
            after, columns = self.fit([*chosen, k]), self.causes[k].told
            counted = self.worth(after, [*chosen, k])
            ratio = _ratio(before, after, counted[0])
            if len(self.causes) * chi_square_tail(ratio, columns) < CHANCE:
                merit = self.causes[k].likelier * (ratio - columns * float(np.log(counted[0].sum())))
                sure.append((merit, k, after, counted))
        if not sure:
            return None
        (best, k, after, counted), *others = sorted(sure, key=lambda each: -each[0])
        close = [each for each in others if best - each[0] < CLOSE][:RIVALS]
        rivals = tuple(self._blame(before, solved, other, own) for _, other, solved, own in close)
        return k, after, replace(self._blame(before, after, k, counted), rivals=rivals)

    def _pair(self, chosen: list[int]) -> list[int]:
        """Return two causes that are sure beside each other, where none is alone; nothing where there are none.

        Two that pull a torque to opposite sides hide each other. Tried are those by which the residual falls most
        beyond what either of them takes off alone, with the weights as they are.
        """
        rest, fall = self._left(chosen), self._falls(self.fit(chosen), chosen)
        pairs, alone = list(combinations(rest, 2)), {k: fall(k) for k in rest}
        beside = {pair: (fall(*pair) - max(alone[k] for k in pair)) / self.rows.oversampling for pair in pairs}
        for a, b in sorted(pairs, key=lambda pair: -beside[pair])[:FITTED]:
            if not (self._may_be_sure(beside[a, b], len(pairs), a) and self._may_be_sure(beside[a, b], len(pairs), b)):
                continue
            chances = []
            for one, other in ((a, b), (b, a)):
                after = self.fit([*chosen, one, other])
                ratio = _ratio(self.fit([*chosen, one]), after, self.worth(after, [*chosen, one, other])[0])
                chances.append(len(pairs) * chi_square_tail(ratio, self.causes[other].told))
            if max(chances) < CHANCE:
                return [a, b]
        return []

    def _blame(self, before: Solved, after: Solved, k: int, counted: tuple[Array, float]) -> Blame:
        worth, times = counted
        cause, size = self.causes[k], len(self._places[k])
        values = after.beta[-size:]
        covariance = after.covariance[-size:, -size:] * times
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
