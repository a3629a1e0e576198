"""A fit whose bodies are the known ones, as far as they are known, and what it leaves.

The interval of a cause is that of rows that hang together and of the bodies' errors; where errors of the model make the
rows' part wider (:mod:`dynident.diagnosis.causes.model_error`), it is that. Errors of link frames are not in it: bodies
take in most of what they do, alike in the log behind an estimate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.diagnosis.causes.cause_columns import CauseRows
from dynident.diagnosis.causes.cause_figures import STEPS
from dynident.diagnosis.causes.cause_search import Blame, Cause, CauseSearch
from dynident.diagnosis.causes.flange_load import TEN, TOLD, carried, ends, load_columns, own_inertia
from dynident.diagnosis.causes.known_bodies import LEAST, KnownBodies, NominalBodies
from dynident.diagnosis.causes.model_error import FitErrors
from dynident.diagnosis.causes.trends import CURVED, STRETCH, ZERO, Trends
from dynident.diagnosis.causes.weighted_fit import PASSES, RIDGE, Solved
from dynident.model.lapack import inverse_positive

#: Relative standard deviations of a robot model at first and at most, passes that look for them at most, the relative
#: change of these and of the variances at which they are found; share of its way that a step makes at least.
FIRST, LARGEST, SEARCHED, SETTLED, SHORTEST = 0.1, 1e3, 30, 1e-2, 0.1

#: Share of a step to the straight lines of a load about new values that is gone, as they turn.
HALF = 0.5

#: Causes that have no meaning against bodies: friction may be another one. Name and joint of the scale of all torques.
LEFT_OUT, OF_ALL = ("friction curve",), ("torque scale", "")

#: Where a fit begins: residual variances, deviations of the bodies and load.
Begin: TypeAlias = tuple[Array, Array, Array]


class Anchored(CauseSearch):
    """A search in which some columns have a prior; rows count as often as they are independent in the plain fit.

    In the products of columns those of the bodies are those of their independent combinations.
    """

    def __init__(
        self,
        rows: CauseRows,
        causes: Sequence[Cause],
        known: KnownBodies,
        factors: Array,
        errors: Callable[[], FitErrors] | None = None,
    ) -> None:
        """Make the products.

        Args:
            rows: The rows.
            causes: The causes.
            known: The bodies.
            factors: Rows of each joint for each that is independent, shape (n,).
            errors: Makes the errors of the model that rows have; None where they have none.
        """
        self._errors = errors
        kept = rows.shared.copy()
        kept[known.places] = True
        super().__init__(rows, causes, kept)
        self._taken = np.array([len(own) - kept[own].sum() for own in rows.columns])
        self._known, self._factors = replace(known, places=np.cumsum(kept)[known.places] - 1), factors
        self._mean = known.factor @ known.values
        self.columns = replace(self.columns, grams=self.columns.grams.copy(), sides=self.columns.sides.copy())
        self._inverse = np.linalg.inv(known.factor)
        _turn(self.columns.grams, self.columns.sides, self._known.places, self._inverse)
        self._found = dict[tuple[int, ...], Begin]()  # where the fit with one cause more begins

    def fitted(self, chosen: Sequence[int]) -> Solved:
        solved, found = self._fitted(chosen, np.zeros(TEN))
        slot, more = self._load(chosen), list[tuple[Solved, Begin]]()
        if chosen and (self.causes[chosen[-1]].name, self.causes[chosen[-1]].joint) == OF_ALL:
            more.append(self._fitted(chosen, np.zeros(TEN), afresh=True))  # a load and errors are others beside a scale
        if slot is not None and solved.beta[slot[TOLD - 1]] < 0.0:  # the sign of the moments of inertia may hold it
            begin = found[2].copy()
            begin[TOLD - 1] *= -1.0
            more.append(self._fitted(chosen, begin))
        for other, place in more:
            if self._deviance(other) < self._deviance(solved):
                solved, found = other, place
        self._found[tuple(chosen)] = found
        return solved

    def _deviance(self, solved: Solved) -> float:
        return float((self.rows.counts / self._factors) @ np.log(solved.variances)) + solved.surprise

    def _fitted(self, chosen: Sequence[int], load: Array, afresh: bool = False) -> tuple[Solved, Begin]:
        """Return the fit, and residual variances, deviations of the bodies and load where the next one begins.

        Args:
            chosen: Causes that are fitted, by their numbers.
            load: Where a load at the flange begins, if it is the last of them.
            afresh: Whether nothing of the fit without the last of them is taken over.
        """
        products, slot, scale = self.products(chosen), self._load(chosen), self._scale(chosen)
        known, held = self._known, self._known.places
        counts, squares, floors = self.rows.counts, self.columns.squares, self.floors
        start = (self.columns.whole / counts + floors, np.full(2, FIRST), load)
        afresh |= bool(chosen) and self.causes[chosen[-1]].hidden > 0  # a load, which the bodies have taken in before
        variances, shares, load = start if afresh else self._found.get(tuple(chosen[:-1]), start)
        off = weights = prior = sizes = left = np.zeros(0)
        scaled = inverse = turn = np.zeros((0, 0))
        own, beta = 1.0, np.zeros(len(products[1][0]))
        free, last, slope = np.setdiff1d(np.arange(len(beta)), held), np.zeros((2, 2)), np.ones(2)
        for _ in range(SEARCHED if slot is not None or isinstance(known, NominalBodies) else PASSES):
            before, (grams, sides) = np.concatenate([variances, shares]), products
            if slot is not None:
                turn, own = carried(load), own_inertia(load) ** 2
                grams, sides = grams.copy(), sides.copy()
                _turn(grams, sides, slot, turn)
            times = max(abs(1.0 + float(beta[scale].sum())), LEAST)  # bodies in other units, and their errors with them
            weights, prior = 1.0 / (variances * self._factors), known.variances(shares) * times**2
            gram = (weights @ grams.reshape(len(grams), -1)).reshape(grams.shape[1:])
            side = weights @ sides
            gram[held, held] += 1.0 / prior
            side[held] += self._mean / prior
            if slot is not None:
                gram[slot[TOLD:], slot[TOLD:]] += 1.0 / own
            sizes = np.sqrt(np.maximum(np.diag(gram), 0.0))
            sizes[sizes == 0.0] = 1.0
            scaled = gram / sizes / sizes[:, None]
            scaled[free, free] += RIDGE
            inverse = inverse_positive(scaled)
            beta = (inverse @ (side / sizes)) / sizes
            variances = np.maximum(squares - 2 * sides @ beta + (grams @ beta) @ beta, 0.0) / counts + floors
            off, left = beta[held] - self._mean, np.diag(inverse)[held] / sizes[held] ** 2
            place = np.stack([np.log(shares), np.log(known.likelier(shares, prior, off, left) / shares)])
            if slot is None and last.any():  # a load, which moves too, makes other slopes
                np.divide(last[1] - place[1], place[0] - last[0], out=slope, where=place[0] != last[0])
            step = place[1] / np.clip(slope, SHORTEST, 1.0)
            shares, last = np.exp(np.clip(place[0] + step, np.log(LEAST), np.log(LARGEST))), place
            moved = np.zeros(0) if slot is None else beta[slot] - load
            if np.all(np.abs(np.log(np.concatenate([variances, shares]) / before)) < SETTLED) and np.all(
                np.abs(moved[:TOLD]) < SETTLED * np.abs(load[:TOLD]).max(initial=0.0)
            ):
                break
            load = load if slot is None else load + (HALF if load.any() else 1.0) * moved
        information = scaled * sizes * sizes[:, None]
        fitted = np.linalg.slogdet(information[: self.size, : self.size])[1] + self._taken @ np.log(weights)
        surprise = known.surprise(prior, off, float(fitted))
        if slot is not None:
            surprise += float(beta[slot[TOLD:]] @ beta[slot[TOLD:]]) / own
            beta[slot] = turn @ beta[slot]
        score, freedom = float(np.sum(np.log(variances))), known.freedom(prior, left)
        return Solved(beta, variances, score, information, surprise, freedom), (variances, shares, load)

    def _slot(self, chosen: Sequence[int], which: int) -> IntArray:
        """Return where the coefficients of one of the chosen causes stand in the fit."""
        lengths = [len(self._places[k]) for k in chosen]
        end = self.size + sum(lengths[: which % len(chosen) + 1]) if chosen else 0
        return np.arange(end - lengths[which], end) if chosen else np.zeros(0, np.int64)

    def _load(self, chosen: Sequence[int]) -> IntArray | None:
        """Return where the load at the flange stands in the fit; None where it is not chosen."""
        found = [which for which, k in enumerate(chosen) if self.causes[k].hidden]
        return self._slot(chosen, found[0]) if found else None

    def _scale(self, chosen: Sequence[int]) -> IntArray:
        """Return where the scale of all torques stands in the fit, nowhere where it is not chosen."""
        found = [which for which, k in enumerate(chosen) if (self.causes[k].name, self.causes[k].joint) == OF_ALL]
        return self._slot(chosen, found[0]) if found else np.zeros(0, np.int64)

    def worths(self, fits: Sequence[Sequence[int]]) -> list[tuple[Array, float]]:
        return [(self.rows.counts / self._factors, 1.0)] * len(fits)

    def _blame(self, before: Solved, after: Solved, chosen: Sequence[int], counted: tuple[Array, float]) -> Blame:
        blame = super()._blame(before, after, chosen, counted)
        roots = np.sqrt(self._widenings(after, chosen))
        covariance = blame.covariance * np.outer(roots, roots)
        told = self._slot(chosen, -1)[: blame.cause.told]
        share = _share_of_bodies(after, np.setdiff1d(np.arange(len(after.beta)), self._known.places), told)
        by_moments = self._by_moments(after, chosen)
        return replace(blame, covariance=covariance + by_moments, freedom=after.freedom / share**2)

    def _by_moments(self, after: Solved, chosen: Sequence[int]) -> float:
        """Return the variance of a rotor inertia, the last cause, by errors of the moments of inertia of the bodies.

        Weights tell the deviations of the prior from masses and first moments, which may be far better.
        """
        if self.causes[chosen[-1]].name != "rotor inertia":
            return 0.0
        slot, (_, shares, _) = self._slot(chosen, -1)[0], self._found[tuple(chosen)]
        by_mean = after.covariance[slot, self._known.places] / self._known.variances(shares)
        return float(np.sum((by_mean @ self._known.moment_errors()) ** 2))

    def blames(self) -> tuple[Blame, ...]:
        """Return the causes that are sure, with their figures beside all others where known bodies tell them."""
        found = super().blames()
        numbers = [next(k for k, one in enumerate(self.causes) if one is blame.cause) for blame in found]
        return tuple(self._beside_all(blame, k, numbers) for blame, k in zip(found, numbers, strict=True))

    def _beside_all(self, blame: Blame, k: int, numbers: Sequence[int]) -> Blame:
        """Return one of the causes found, number k, with its figures beside all the others.

        Against a robot model a rotor inertia alone: other causes take errors of its few bodies in. A zero or scale of a
        position moves the bodies themselves: where these contradict an estimate even so, its interval is wider (Birge
        1932).
        """
        if isinstance(self._known, NominalBodies) and blame.cause.name != "rotor inertia":
            return blame
        last = blame if k == numbers[-1] else self.beside(numbers, k)[0]
        times = 1.0
        if blame.cause.name in (ZERO, STRETCH):
            after, held = self.fit([*(other for other in numbers if other != k), k]), self._known.places
            told = len(held) - float(np.diag(after.covariance)[held].sum())
            times = max(after.surprise / max(told, 1.0), 1.0)
        return replace(blame, values=last.values, covariance=times * last.covariance, freedom=last.freedom)

    def beside(self, numbers: Sequence[int], k: int) -> tuple[Blame, float]:
        """Return a cause beside others, by their numbers, and the relative standard deviation of the bodies then."""
        others = [other for other in numbers if other != k]
        before, after, chosen = self.fit(others), self.fit([*others, k]), [*others, k]
        blame = self._blame(before, after, chosen, self.worths([chosen])[0])
        return blame, float(np.linalg.norm(self._found[tuple(chosen)][1]))

    def distinct(self, after: Solved, chosen: Sequence[int]) -> float:
        # a quasi-likelihood: logarithms of likelihoods count less by as much (McCullagh and Nelder 1989, chapter 9)
        return super().distinct(after, chosen) * float(np.mean(self._widenings(after, chosen)))

    def _widenings(self, after: Solved, chosen: Sequence[int]) -> Array:
        """Return by how much errors of the model widen the variances of the told coefficients of the last cause."""
        told = self.causes[chosen[-1]].told
        if self._errors is None:
            return np.ones(told)
        errors = self._errors()
        return np.array([self._widening(after, chosen, place, errors) for place in range(told)])

    def _widening(self, after: Solved, chosen: Sequence[int], place: int, errors: FitErrors) -> float:
        """Return the variance of a coefficient of the last cause with errors of the model over that without them."""
        slot, weights, every = self._load(chosen), 1.0 / (after.variances * self._factors), errors.model.every
        along = after.covariance[:, self._slot(chosen, -1)[place]].copy()
        whole = float(along[self._slot(chosen, -1)[place]])
        if slot is not None:
            along[slot] = carried(self._found[tuple(chosen)][2]) @ along[slot]
        full = np.zeros(self.columns.grams.shape[1])
        full[self.used(chosen)] = along
        full[self._known.places] = self._inverse @ full[self._known.places]
        rows, influences = 0.0, []
        for joint, weight, deviation in zip(self.columns.joints, weights, errors.deviations, strict=True):
            influence = weight * (full[joint.places[:-1]] @ joint.columns[:-1])
            rows += float(influence @ influence) / weight
            influences.append(every * deviation * influence[::every])
        return (max(rows, errors.variance(influences)) + whole - rows) / whole

    def judged_again(self, chosen: list[int], found: dict[int, Blame]) -> list[int]:
        return []  # each fit looks for the errors of the bodies, which takes long

    def candidates(self, before: Solved, chosen: Sequence[int]) -> dict[int, float]:
        """Return all of them, as errors of the bodies may hide any; but no load beside another one."""
        is_loaded = self._load(chosen) is not None
        return {k: np.inf for k in self._left(chosen) if not (is_loaded and self.causes[k].hidden)}


def _turn(grams: Array, sides: Array, slot: IntArray, turn: Array) -> None:
    """Replace the columns ``slot`` of products (n, k, k) and (n, k) by mixtures of them, ``turn``, in place."""
    grams[:, :, slot] = grams[:, :, slot] @ turn
    grams[:, slot] = turn.T @ grams[:, slot]
    sides[:, slot] = sides[:, slot] @ turn


def _share_of_bodies(solved: Solved, rest: IntArray, told: IntArray) -> float:
    """Return the share of the variances of coefficients ``told`` (k,) that is from errors of the bodies, above 0.

    Where it is small the rows make the interval, and these are many (Satterthwaite 1946).
    """
    certain = np.diag(np.linalg.pinv(solved.information[np.ix_(rest, rest)], hermitian=True))
    shares = 1.0 - certain[np.searchsorted(rest, told)] / np.diag(solved.covariance)[told]
    return float(np.clip(np.mean(shares), 1e-6, 1.0))


class AgainstBodies:
    """What the torques leave where the bodies are the known ones, as far as they are known.

    Attributes:
        fit: The quick fit, whose bodies are free.
        known: The bodies.
    """

    def __init__(self, trends: Trends, known: KnownBodies) -> None:
        self.fit, self._trends, self.known = trends.fit, trends, known

    @cached_property
    def _looked(self) -> tuple[Anchored, tuple[Blame, ...]]:
        """The search and what it has found: what acts on the motion about bodies of an estimate at its own figures.

        Columns that are straight lines about fitted bodies, which another zero has wrong, hold for small figures alone.
        Errors of a robot model's bodies pass for positions of another scale, which free bodies tell.
        """
        left_out = (*LEFT_OUT, STRETCH) if isinstance(self.known, NominalBodies) else LEFT_OUT
        causes = [cause for cause in self._trends.causes if cause.name not in left_out]
        search, known = self._search(causes), dict[tuple[str, str], Blame]()
        found, beta = search.blames(), self.fit.plain.beta.copy()
        beta[self.known.places] = self.known.values
        for _ in range(0 if isinstance(self.known, NominalBodies) else STEPS):
            curved = {(one.cause.name, one.cause.joint): one for one in found if one.cause.name in CURVED}
            if all(key in known and np.allclose(one.values, known[key].values, SETTLED) for key, one in curved.items()):
                break
            known = curved
            values = [one.values for one in curved.values()]
            made = self._trends.made_again([one.cause for one in curved.values()], beta, values)
            again = dict(zip(curved, made, strict=True))
            causes = [again.get((one.name, one.joint), one) for one in causes]
            search = self._search(causes)
            found = search.blames()
        return search, found

    @property
    def search(self) -> Anchored:
        """The search among the causes."""
        return self._looked[0]

    @property
    def blames(self) -> tuple[Blame, ...]:
        """The causes that are sure, the one that explains most first."""
        return self._looked[1]

    def _search(self, causes: Sequence[Cause]) -> Anchored:
        """Return a search among causes, a load at the flange and the scale of all torques.

        A load has ten parameters: of as few combinations of bodies of a robot model it explains whatever errors.
        """
        fit, causes = self.fit, [*causes]
        if len(self.known.places) > TEN or not isinstance(self.known, NominalBodies):
            for joint, link in ends(fit).items():
                causes.append(Cause("load at the flange", joint, load_columns(fit, link), hidden=TEN - TOLD))
        causes.append(Cause(*OF_ALL, self.bodies[None]))
        factors = fit.counts / fit.independent_rows
        return Anchored(self._trends.rows, causes, self.known, factors, lambda: self._trends.errors)

    @property
    def is_loaded(self) -> bool:
        """Whether a load at the flange explains more than any other cause, another unit of all torques among them."""
        return bool(self.blames) and self.blames[0].cause.name == "load at the flange"

    @cached_property
    def scale_of_all(self) -> tuple[Blame, float]:
        """The scale of all torques beside the causes found, sure or not, and the relative error of the bodies then."""
        keys = [(cause.name, cause.joint) for cause in self.search.causes]
        found = [keys.index((blame.cause.name, blame.cause.joint)) for blame in self.blames]
        return self.search.beside(found, keys.index(OF_ALL))

    @cached_property
    def masses(self) -> Array:
        """Mass of each link by the robot model, in kg; infinite where it states none."""
        theta, count = self.fit.model.nominal(), self.fit.model.inertial_count
        return (
            np.full(count // TEN, np.inf) if theta is None or not theta[:count].any() else theta[TEN - 1 : count : TEN]
        )

    def error_of_end(self, joint: str) -> float:
        """Return the standard deviation of the mass of a link in kg, whose errors no log tells from a load there."""
        return FIRST * float(self.masses[ends(self.fit)[joint]]) if isinstance(self.known, NominalBodies) else 0.0

    @cached_property
    def bodies(self) -> Array:
        """Torque of the known bodies, shape (N, n)."""
        fit, rows = self.fit, self.fit.rows
        beta = np.zeros(fit.base.count)
        beta[self.known.places] = self.known.values
        return np.stack([block @ beta[own] for block, own in zip(rows.blocks, rows.columns, strict=True)], axis=1)
