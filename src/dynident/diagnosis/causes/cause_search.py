"""Which of many possible causes explains what a fit leaves: columns that are added to it one after another.

Each cause (a spring, a tilt) is a few columns more of the linear problem. Of those that chance would hardly make
(likelihood ratio, Wilks 1938, all causes counted) the one by which the likelihood grows most beyond what its columns
earn (Schwarz 1978) is taken in, then the next, until none is sure; those that the log does not tell from it are rivals.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, islice

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.diagnosis.causes.cause_columns import CauseRows, SharedColumns
from dynident.diagnosis.causes.noise_spectrum import NoiseSpectrum
from dynident.diagnosis.causes.weighted_fit import EXACT, RIDGE, Solved, weighted_products
from dynident.identification.residuals.quantiles import (
    chi_square_tail,
    normal_quantile,
    student_quantile,
    student_share,
)

#: Chance that a log without any cause has one told in a round, rows that hang together counted once.
CHANCE = 1e-4

#: Share of a joint's residual variance from which a cause matters, and false ones among those told that matter.
MATTERS, FALSE = 0.1, 1e-3

#: Chance, all causes counted, up to which one that explains as much as a sure one is told beside it.
RIVAL_CHANCE = 0.05

#: Difference of two criteria of Schwarz below which the log does not tell two causes apart (Kass and Raftery 1995:
#: beyond 6 the evidence is strong), and rivals that are told at most.
CLOSE, RIVALS = 6.0, 2

#: Causes that are taken in at most, and rounds of taking in and judging again.
MOST, ROUNDS = 12, 3

#: Candidates of a round that are fitted with weights of their own at most, and how many before those that may be near.
FITTED, FIRST = 6, 2

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
        hidden: How many coefficients, the last ones, have a prior about what the others make them, and are not told.
        is_filtered: Whether the columns are filtered as the torques are, and stand at the kept rows.
        is_positive: Whether its one coefficient has to be above zero, as an inertia.
        cycles: Cycles a turn of one that is periodic over the position, and their standard deviation.
        load: Largest torque in N m or N on what yields in proportion to it.
    """

    name: str
    joint: str
    columns: Array
    likelier: float = 1.0
    hidden: int = 0
    is_filtered: bool = False
    is_positive: bool = False
    cycles: tuple[float, float] = (0.0, 0.0)
    load: float = 0.0

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
        taken: Root mean square that it took off the residual of each joint, shape (n,), less what others could take.
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


class CauseSearch:
    """Products of columns of a fit and of causes, made once; a fit with some of the causes is a choice of entries."""

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
        self.columns = SharedColumns.of_rows(rows, [cause.columns for cause in causes], kept)
        self.size = self.columns.size
        ends = self.size + np.cumsum([len(cause.columns) for cause in causes], dtype=np.int64)
        self._places = [np.arange(end - len(cause.columns), end) for end, cause in zip(ends, causes, strict=True)]
        self.floors = np.maximum(EXACT**2 * self.columns.whole / rows.counts, 1e-300)
        self._fits: dict[tuple[int, ...], Solved] = {}
        self._worths: dict[tuple[int, ...], tuple[Array, float]] = {}

    def fit(self, chosen: Sequence[int]) -> Solved:
        """Return the fit with some of the causes, by their numbers; made once."""
        key = tuple(chosen)
        if key not in self._fits:
            self._fits[key] = self.fitted(chosen)
        return self._fits[key]

    def fitted(self, chosen: Sequence[int]) -> Solved:
        """Make the fit with some of the causes, by their numbers; those in another order are the same fit."""
        if (ordered := sorted(chosen)) != [*chosen]:
            same, order = self.fit(ordered), np.searchsorted(self.used(ordered), self.used(chosen))
            return replace(same, beta=same.beta[order], information=same.information[np.ix_(order, order)])
        counts, start = self.rows.counts, self.columns.whole / self.rows.counts + self.floors
        return weighted_products(*self.products(chosen), self.columns.squares, counts, self.floors, start)

    def used(self, chosen: Sequence[int]) -> IntArray:
        """Return the columns of the fit with some of the causes, by their numbers among all columns."""
        return np.concatenate([np.arange(self.size), *(self._places[k] for k in chosen)])

    def products(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """Return W_i' W_i (n, k, k) and W_i' tau_i (n, k) of each joint with the columns of some of the causes."""
        use, grams = self.used(chosen), self.columns.grams
        places = use[:, None] * grams.shape[1] + use
        return grams.reshape(len(grams), -1).take(places, axis=1), self.columns.sides[:, use]

    @cached_property
    def spectrum(self) -> NoiseSpectrum:
        """How the noise of neighbouring rows hangs together."""
        plain, roots = self.fit([]), []
        for joint, variance in zip(self.columns.joints, plain.variances, strict=True):
            mine = joint.places[joint.places < self.size]
            squares, directions = np.linalg.eigh(plain.covariance[np.ix_(mine, mine)])
            root = directions * np.sqrt(np.maximum(squares, 0.0) / variance)
            roots.append(np.concatenate([joint.alone, root.T @ joint.columns[: len(mine)]]))
        return NoiseSpectrum.of_fit(roots, self.rows.counts, self.rows.oversampling)

    @cached_property
    def _transforms(self) -> list[Array]:
        """Fourier transforms of the columns of each joint: those of residuals are sums of them."""
        return [self.spectrum.transformed(joint.columns) for joint in self.columns.joints]

    def worths(self, fits: Sequence[Sequence[int]]) -> list[tuple[Array, float]]:
        """Return how many independent rows each joint has, (n,), for the last of the causes of each fit, made once.

        Beside it stands the variance of the coefficients over that of independent rows; ``fits`` are numbers of causes.
        """
        missing = [chosen for chosen in dict.fromkeys(map(tuple, fits)) if chosen not in self._worths]
        if missing:
            self._worths |= dict(zip(missing, self._counted(missing), strict=True))
        return [self._worths[tuple(chosen)] for chosen in fits]

    def _counted(self, fits: Sequence[tuple[int, ...]]) -> Iterator[tuple[Array, float]]:
        """Yield the same; residuals and columns of all fits are one product with the transforms of each joint."""
        solved, total = [self.fit(chosen) for chosen in fits], self.columns.grams.shape[1]
        residuals, own = np.zeros((len(fits), total + 1)), []
        for k, (chosen, after) in enumerate(zip(fits, solved, strict=True)):
            use, size = self.used(chosen), len(self._places[chosen[-1]])
            residuals[k, use], residuals[k, -1] = -after.beta, 1.0
            left = np.zeros((size, total + 1))  # of the last columns once all others have explained them
            left[:, use[:-size]] = after.last_of_others(size)
            left[:, use[-size:]] = np.eye(size)
            own.append(left)
        mixed, ends = np.concatenate([residuals, *own]), np.cumsum([0, *map(len, own)])
        power, noisy = np.zeros((2, len(self.columns.joints), ends[-1]))
        for i, joint in enumerate(self.columns.joints):
            series = mixed[:, joint.places] @ self._transforms[i]
            power[i], noisy[i] = self.spectrum.sums(i, series[: len(fits)], series[len(fits) :], ends)
        for after, begin, end in zip(solved, ends[:-1], ends[1:], strict=True):
            sizes = np.maximum((1.0 / after.variances) @ power[:, begin:end], 1e-300)
            powers = (power[:, begin:end] / sizes).sum(axis=1)
            factors = (noisy[:, begin:end] / sizes).sum(axis=1) / np.maximum(powers, 1e-300)
            factors, weights = np.maximum(factors, 1.0), powers / after.variances
            yield self.rows.counts / factors, float(factors @ weights / max(weights.sum(), 1e-300))

    def blames(self) -> tuple[Blame, ...]:
        """Return the causes that are sure, the one that explains most first.

        Stepwise (Efroymson 1960): causes are taken in one after another; then each is judged again beside all others,
        where another one may take its place, or none is sure any more; then two at once; last those that are likely.
        """
        chosen: list[int] = []
        found: dict[int, Blame] = {}
        for _ in range(ROUNDS):
            self._take_in(chosen, found)
            hidden = self.judged_again(chosen, found)
            if not hidden:
                break
            chosen += hidden
        self._take_in(chosen, found, likely=True)
        return tuple(found[k] for k in chosen if k in found)

    def _take_in(self, chosen: list[int], found: dict[int, Blame], likely: bool = False) -> None:
        """Take one cause after another in, in place, while one is sure, or ``likely``."""
        most = min(MOST, len(self.causes))
        while len(chosen) < most and (step := self._next(self.fit(chosen), chosen, likely)) is not None:
            chosen.append(step[0])
            found[step[0]] = step[2]

    def judged_again(self, chosen: list[int], found: dict[int, Blame]) -> list[int]:
        """Judge each of the chosen causes beside all others, in place; return two that are sure beside each other."""
        for k in tuple(chosen) if len(chosen) > 1 else ():
            place = chosen.index(k)
            rest = chosen[:place] + chosen[place + 1 :]
            if (step := self._next(self.fit(rest), rest)) is not None:
                found[step[0]] = step[2]
            chosen[place : place + 1] = [] if step is None else [step[0]]
        return self._pair(chosen)

    def candidates(self, before: Solved, chosen: Sequence[int]) -> dict[int, float]:
        """Return the causes that are worth a fit, by their numbers, the most promising first, with their merit at most.

        Twice the straight line of a cause is beyond the logarithm of the squares that it takes off.
        """
        rest = self._left(chosen)
        alone = self.falls(before, chosen, [(k,) for k in rest]) / self.rows.oversampling
        rows = float(np.log(self.rows.counts.sum() / self.rows.oversampling))
        falls = dict(zip(rest, alone.tolist(), strict=True))
        merits, most = (
            {k: self.causes[k].likelier * (own * line - len(self._places[k]) * rows) for k, own in falls.items()}
            for line in (1.0, 2.0)
        )
        level = FALSE * (1 + len(chosen))
        best = (k for k in sorted(rest, key=lambda k: -merits[k]) if self._may_be_sure(falls[k], rest[k], k, level))
        return {k: most[k] for k in islice(best, FITTED)}

    def _may_be_sure(self, ratio: float, tried: int, k: int, level: float) -> bool:
        """Return whether a cause may be sure in a fit of its own, by what its straight line is at most."""
        return bool(tried * chi_square_tail(2.0 * ratio, self.causes[k].told) < level)

    def _left(self, chosen: Sequence[int]) -> dict[int, int]:
        """Return the other causes, and for how many looks each counts: all kinds of causes for as many.

        So chance has a cause of the whole arm told as seldom as one of any of its joints (Genovese et al. 2006).
        """
        kinds = {k: (cause.name, bool(cause.joint)) for k, cause in enumerate(self.causes) if k not in chosen}
        counts = Counter(kinds.values())
        return {k: len(counts) * counts[kind] for k, kind in kinds.items()}

    def falls(self, before: Solved, chosen: Sequence[int], more: Sequence[Sequence[int]]) -> Array:
        """Return by how much the weighted squares fall where each of m sets of causes is fitted as well, shape (m,).

        It is 0 where a coefficient has to be positive and is not. Weights follow from the fit ``before`` with the
        ``chosen`` ones: its own are those of a pass earlier, which nearly dependent columns do not forgive.
        """
        columns, use, weights = self.columns, self.used(chosen), 1.0 / before.variances
        every, known = np.concatenate([use, np.arange(self.size, columns.sides.shape[1])]), len(use)
        gram = np.tensordot(weights, columns.grams, 1)[every[:, None], every]
        side, sizes = (weights @ columns.sides)[every], np.diag(gram).copy()
        gram += np.diag(RIDGE * np.where(sizes > 0, sizes, 1.0))
        along = np.linalg.solve(gram[:known, :known], gram[:known, known:])
        beyond = gram[known:, known:] - gram[known:, :known] @ along + np.diag(1e-9 * sizes[known:] + 1e-300)
        rest, found = side[known:] - along.T @ side[:known], np.zeros(len(more))
        positive = np.concatenate([np.full(len(cause.columns), cause.is_positive) for cause in self.causes])
        spans = [tuple((own - self.size).tolist()) for own in self._places]
        places = [sum((spans[k] for k in causes), ()) for causes in more]
        for length in {len(own) for own in places}:
            which = [k for k, own in enumerate(places) if len(own) == length]
            own = np.array([places[k] for k in which], dtype=np.int64)
            solved = np.linalg.solve(beyond[own[:, :, None], own[:, None, :]], rest[own][:, :, None])[:, :, 0]
            found[which] = np.sum(rest[own] * solved, axis=1) * ~np.any(positive[own] & (solved < 0.0), axis=1)
        return found

    def _next(self, before: Solved, chosen: list[int], likely: bool = False) -> tuple[int, Solved, Blame] | None:
        """Return the likeliest of the causes that are sure, its fit, and what is said of it; None where none is.

        A cause is sure where hardly any log has one by chance; ``likely`` takes one that matters, where the false ones
        among those told are few (Benjamini and Gavrilov 2009).
        """
        tried: list[tuple[float, int, Solved, tuple[Array, float]]] = []
        sure: dict[int, float] = {}
        promising, left = list(self.candidates(before, chosen).items()), self._left(chosen)
        for part in (promising[:FIRST], promising[FIRST:]):
            least = max(sure.values(), default=-np.inf) - CLOSE
            near = [k for k, most in part if most > least]
            for k, counted in zip(near, self.worths([(*chosen, k) for k in near]), strict=True):
                after, columns = self.fit([*chosen, k]), self.causes[k].told
                ratio = self._ratio(before, after, k, counted[0])
                merit = self.causes[k].likelier * (ratio - columns * float(np.log(counted[0].sum())))
                chance = left[k] * chi_square_tail(ratio, columns)
                if chance < RIVAL_CHANCE:
                    tried.append((merit, k, after, counted))
                matters = float(np.max(1.0 - after.variances / before.variances)) > MATTERS
                level = FALSE * (1 + len(chosen)) if likely and matters else CHANCE
                if chance < level:
                    sure[k] = merit
        if not sure:
            return None
        likeliest = max(sure, key=lambda k: sure[k])
        ((best, k, after, counted),) = [each for each in tried if each[1] == likeliest]
        far, others = self.distinct(after, [*chosen, k]), sorted((e for e in tried if e[1] != k), key=lambda e: -e[0])
        close = [each for each in others if best - each[0] < far][:RIVALS]
        rivals = tuple(self._blame(before, solved, [*chosen, other], own) for _, other, solved, own in close)
        return k, after, replace(self._blame(before, after, [*chosen, k], counted), rivals=rivals)

    def distinct(self, after: Solved, chosen: Sequence[int]) -> float:
        """Return the difference of the criteria from which the last cause of a fit is told from another one."""
        return CLOSE

    def _pair(self, chosen: list[int]) -> list[int]:
        """Return two causes that are sure beside each other, where none is alone; nothing where there are none.

        Two that pull a torque to opposite sides hide each other. Tried are those by which the residual falls most
        beyond what either of them takes off alone, with the weights as they are.
        """
        rest = self._left(chosen)
        pairs = list(combinations(rest, 2))
        falls = self.falls(self.fit(chosen), chosen, [*pairs, *((k,) for k in rest)]).tolist()
        alone = dict(zip(rest, falls[len(pairs) :], strict=True))
        together = dict(zip(pairs, falls, strict=False))
        beside = {
            pair: (fall - max(alone[k] for k in pair)) / self.rows.oversampling for pair, fall in together.items()
        }
        for a, b in sorted(pairs, key=lambda pair: -beside[pair])[:FITTED]:
            if not all(self._may_be_sure(beside[a, b], len(pairs), k, CHANCE) for k in (a, b)):
                continue
            chances, orders = [], ((a, b), (b, a))
            counted = self.worths([(*chosen, *order) for order in orders])
            for (one, other), (worth, _) in zip(orders, counted, strict=True):
                ratio = self._ratio(self.fit([*chosen, one]), self.fit([*chosen, one, other]), other, worth)
                chances.append(len(pairs) * chi_square_tail(ratio, self.causes[other].told))
            if max(chances) < CHANCE:
                return [a, b]
        return []

    def _blame(self, before: Solved, after: Solved, chosen: Sequence[int], counted: tuple[Array, float]) -> Blame:
        (worth, times), cause, size = counted, self.causes[chosen[-1]], len(self._places[chosen[-1]])
        values, covariance = after.beta[-size:], after.covariance[-size:, -size:] * times
        own, whole = self.rows.mean_size(np.tensordot(values, cause.columns, 1)), self.rows.measured_size
        values, covariance = values[: cause.told], covariance[: cause.told, : cause.told]
        size_of_all = max(float(np.linalg.norm(whole)), 1e-300)
        return Blame(
            cause,
            values,
            covariance,
            float(np.sqrt(max(self._ratio(before, after, chosen[-1], worth), 0.0))),
            before.score - after.score,
            float(np.max(1.0 - after.variances / before.variances)),
            float(np.max(own / np.maximum(whole, 1e-300)) if cause.joint else np.linalg.norm(own) / size_of_all),
            own,
            np.sqrt(np.maximum(before.variances - after.variances, 0.0)),
            freedom=after.freedom,
        )

    def _ratio(self, before: Solved, after: Solved, k: int, worth: Array) -> float:
        """Return twice the logarithm of the likelihood ratio of fits without and with a cause, of ``worth`` (n,) rows.

        It is 0 where the coefficient is none that the cause may have.
        """
        fall = float(worth @ np.log(before.variances / after.variances)) + before.surprise - after.surprise
        return fall if after.beta[-1] > 0.0 or not self.causes[k].is_positive else 0.0
