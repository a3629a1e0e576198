"""What differs from bodies that are known: those of an earlier estimate, or of the robot model, as a prior of the fit.

Friction is another one on another day and stays free. Base parameters of the earlier estimate and of the quick fit are
told apart by their maps, so that gravity, rotors and friction may differ: what both know counts, the rest is free.

An estimate has a covariance. The errors of a robot model are not stated: they are normal with relative standard
deviations, which the log tells by the marginal likelihood (MacKay 1992, section 2.4), and count in the intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.case.evidence.torques import body_errors
from dynident.diagnosis.causes.cause_columns import CauseRows
from dynident.diagnosis.causes.cause_search import Blame, Cause, CauseSearch
from dynident.diagnosis.causes.flange_load import TEN, TOLD, carried, load_columns, own_inertia
from dynident.diagnosis.causes.quick_fit import OVERSAMPLING
from dynident.diagnosis.causes.trends import Trends
from dynident.diagnosis.causes.weighted_fit import PASSES, RIDGE, Solved
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.residuals.quantiles import chi_square_tail
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.lapack import inverse_positive
from dynident.model.robot import Robot

#: A map of base parameters whose rest is below this share of it is the same.
SAME = 1e-6

#: Deviations of the earlier estimate below this share of its largest, all with unit columns, are rounding.
SMALLEST = 1e-6

#: Chance of so large a difference below which an earlier estimate contradicts the robot model.
CONTRADICTS = 1e-3

#: Relative standard deviations of a robot model at first, at least and at most, passes that look for them at most, the
#: relative change of these and of the variances at which they are found; share of its way that a step makes at least.
FIRST, LEAST, LARGEST, SEARCHED, SETTLED, SHORTEST = 0.1, 1e-5, 1e3, 30, 1e-2, 0.1

#: Share of a step to the straight lines of a load about new values that is gone, as they turn.
HALF = 0.5

#: Causes that have no meaning against bodies: friction may be another one. Name and joint of the scale of all torques.
LEFT_OUT, OF_ALL = ("friction curve",), ("torque scale", "")


@dataclass(frozen=True)
class KnownBodies:
    """A normal prior of some of the columns of a fit.

    Attributes:
        places: Positions in beta, shape (s,).
        factor: Combinations of the bodies whose errors are independent of each other, shape (s, s); an estimate knows
            each with a standard deviation of 1.
        values: The mean, shape (s,).
    """

    places: IntArray
    factor: Array
    values: Array

    def agrees(self, beta: Array) -> bool:
        """Return whether it does not contradict other values of beta."""
        squares = float(np.sum((self.factor @ (beta[self.places] - self.values)) ** 2))
        return bool(chi_square_tail(squares, len(self.places)) > CONTRADICTS)

    def variances(self, shares: Array) -> Array:
        """Return the variances of the combinations, shape (s,); ``shares`` are those of :class:`NominalBodies`."""
        return np.ones(len(self.places))

    def likelier(self, shares: Array, variances: Array, off: Array, left: Array) -> Array:
        """Return standard deviations that explain a fit better; those of an estimate are stated."""
        return shares

    def surprise(self, variances: Array, off: Array, fitted: float) -> float:
        """Return twice the fall of the log-likelihood by ``off`` (s,), the combinations less what is known of them."""
        return float(off @ (off / variances))

    def freedom(self, variances: Array, left: Array) -> float:
        """Return how many errors of the bodies the torques tell, from which their deviations were found."""
        return np.inf


@dataclass(frozen=True)
class NominalBodies(KnownBodies):
    """Bodies of a robot model, whose errors the log tells.

    Attributes:
        places: Positions in beta, shape (s,).
        factor: Combinations of the bodies whose errors are independent of each other, shape (s, s): those of the single
            parameters and those that all ten parameters of a link have in common alike.
        values: The mean, shape (s,).
        common: Variance of the combinations for relative errors of one that links have in common, shape (s,); that for
            relative errors of one of the single parameters is 1.
    """

    common: Array

    def variances(self, shares: Array) -> Array:
        return shares[0] ** 2 * self.common + shares[1] ** 2

    def likelier(self, shares: Array, variances: Array, off: Array, left: Array) -> Array:
        """Return a step to the largest marginal likelihood (MacKay 1992, by components of the variance).

        Args:
            shares: Standard deviations of the common and of the single errors.
            variances: Of the combinations with these, shape (s,).
            off: The fitted combinations less the nominal ones, shape (s,).
            left: Their variances after the fit, shape (s,).
        """
        parts = np.stack([self.common, np.ones(len(left))])
        squares, counts = parts @ (off / variances) ** 2, parts @ ((1.0 - left / variances) / variances)
        return np.maximum(shares * np.sqrt(squares / np.maximum(counts, 1e-300)), LEAST)

    def surprise(self, variances: Array, off: Array, fitted: float) -> float:
        """Return the same for the marginal likelihood; ``fitted`` is the log determinant of all that was fitted."""
        return float(off @ (off / variances) + fitted + np.log(variances).sum())

    def freedom(self, variances: Array, left: Array) -> float:
        """Return the effective number of parameters (MacKay 1992); ``left`` are variances after the fit, shape (s,)."""
        return max(len(left) - float(np.sum(left / variances)), 1.0)


def known_bodies(estimate: Estimate, model: DynamicModel, base: BaseParameters) -> KnownBodies | None:
    """Return what an estimate knows of the bodies among the base parameters of a model; None where it is nothing."""
    if not np.all(np.isfinite(estimate.covariance)):
        return None  # of a method without intervals
    theirs = {parameter.name: k for k, parameter in enumerate(estimate.base.parameters)}
    bodies = estimate.base.independent < estimate.model.inertial_count
    rows = estimate.base.matrix[bodies]
    rotors = _rotors(estimate.model.robot)
    places, maps, added = [], [], []
    for k in np.flatnonzero(base.independent < model.inertial_count):
        wanted, offset, sound = np.zeros(rows.shape[1]), 0.0, True
        for column in np.flatnonzero(base.matters[k]):
            parameter, share = base.parameters[column], float(base.matrix[k, column])
            if parameter.name in theirs:
                wanted[theirs[parameter.name]] = share
            elif parameter.kind == "rotor":
                offset += share * rotors.get(parameter.owner, 0.0)
            else:
                sound = False
        mix = np.linalg.lstsq(rows.T, wanted, rcond=None)[0]
        if sound and np.linalg.norm(rows.T @ mix - wanted) < SAME * np.linalg.norm(wanted):
            places.append(k)
            maps.append(mix)
            added.append(offset)
    if not places:
        return None
    mixing = np.array(maps)
    factor = _root_of_inverse(mixing @ estimate.covariance[np.ix_(bodies, bodies)] @ mixing.T)
    return KnownBodies(np.array(places, dtype=np.int64), factor, mixing @ estimate.beta[bodies] + np.array(added))


def nominal_bodies(model: DynamicModel, base: BaseParameters, robot: Robot, rotors_known: bool) -> NominalBodies | None:
    """Return the bodies of a robot model as known up to relative errors; None where it states none that count.

    All ten parameters of a link are off by a common share, and each by one of its own: the mass by a share of it, the
    first moments of mass times size, the moments of inertia of mass times size squared; the size is the radius of
    gyration about the origin of the link's frame. All shares are independent, with one standard deviation for the
    common and one for the single ones. Rotor inertias that are not known leave the base parameters that hold them free.

    Args:
        model: The model of the quick fit.
        base: Its base parameters.
        robot: The robot with its stated rotor inertias.
        rotors_known: Whether these count; else they are to be identified.
    """
    theta = model.nominal()
    if theta is None:
        return None
    count = model.inertial_count
    bodies = theta[:count].reshape(-1, TEN)
    if not np.any(bodies[:, -1] > 0):
        return None
    errors = body_errors(bodies)
    rotor = np.array([parameter.kind == "rotor" for parameter in model.parameters])
    held = base.independent < count
    if not rotors_known:
        held &= ~np.any(base.matters[:, rotor], axis=1)
    places = np.flatnonzero(held)
    if not len(places):
        return None
    mixing = base.matrix[places]
    whole = np.stack([mixing[:, TEN * i : TEN * (i + 1)] @ body for i, body in enumerate(bodies)], axis=1)
    single = (mixing[:, :count] * errors**2) @ mixing[:, :count].T
    root = _root_of_inverse(single)
    directions, sizes, _ = np.linalg.svd(root @ whole)
    common = np.zeros(len(places))
    common[: len(sizes)] = sizes**2
    return NominalBodies(places, directions.T @ root, mixing @ with_rotors(theta, model, robot), common)


def _root_of_inverse(covariance: Array) -> Array:
    """Return F with F' F the inverse of a covariance, its smallest deviations bounded."""
    sizes = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    squares, directions = np.linalg.eigh(covariance / np.outer(sizes, sizes))
    return (directions / np.sqrt(np.maximum(squares, SMALLEST**2 * squares[-1]))).T / sizes


def with_rotors(theta: Array, model: DynamicModel, robot: Robot) -> Array:
    """Return standard parameters (p,) of a model with the rotor inertias that a robot states."""
    rotors, filled = _rotors(robot), np.array(theta)
    for k, parameter in enumerate(model.parameters):
        if parameter.kind == "rotor":
            filled[k] = rotors.get(parameter.owner, 0.0)
    return filled


def _rotors(robot: Robot) -> dict[str, float]:
    """Return the rotor inertia of each joint, behind its gear, by name."""
    return dict(zip(robot.joint_names, np.diag(robot.reflected_inertia).tolist(), strict=True))


class Anchored(CauseSearch):
    """A search in which some columns have a prior; rows count as often as they are independent in the plain fit.

    In the products of columns those of the bodies are those of their independent combinations.
    """

    def __init__(self, rows: CauseRows, causes: Sequence[Cause], known: KnownBodies, factors: Array) -> None:
        kept = rows.shared.copy()
        kept[known.places] = True
        super().__init__(rows, causes, kept)
        self._taken = np.array([len(own) - kept[own].sum() for own in rows.columns])
        self._known, self._factors = replace(known, places=np.cumsum(kept)[known.places] - 1), factors
        self._mean = known.factor @ known.values
        self.columns = replace(self.columns, grams=self.columns.grams.copy(), sides=self.columns.sides.copy())
        _turn(self.columns.grams, self.columns.sides, self._known.places, np.linalg.inv(known.factor))
        self._found = dict[tuple[int, ...], tuple[Array, Array, Array]]()  # where the fit with one cause more begins

    def fitted(self, chosen: Sequence[int]) -> Solved:
        solved, found = self._fitted(chosen, np.zeros(TEN))
        slot = self._load(chosen)
        if slot is not None and solved.beta[slot[TOLD - 1]] < 0.0:  # the sign of the moments of inertia may hold it
            begin = found[2].copy()
            begin[TOLD - 1] *= -1.0
            other, turned = self._fitted(chosen, begin)
            if self._deviance(other) < self._deviance(solved):
                solved, found = other, turned
        self._found[tuple(chosen)] = found
        return solved

    def _deviance(self, solved: Solved) -> float:
        return float((self.rows.counts / self._factors) @ np.log(solved.variances)) + solved.surprise

    def _fitted(self, chosen: Sequence[int], load: Array) -> tuple[Solved, tuple[Array, Array, Array]]:
        """Return the fit, and residual variances, deviations of the bodies and load where the next one begins.

        Args:
            chosen: Causes that are fitted, by their numbers.
            load: Where a load at the flange begins, if it is the last of them.
        """
        products, slot, scale = self.products(chosen), self._load(chosen), self._scale(chosen)
        known, held = self._known, self._known.places
        counts, squares, floors = self.rows.counts, self.columns.squares, self.floors
        start = (self.columns.whole / counts + floors, np.full(2, FIRST), load)
        is_load = bool(chosen) and self.causes[chosen[-1]].hidden > 0  # which the bodies have taken in before: afresh
        variances, shares, load = start if is_load else self._found.get(tuple(chosen[:-1]), start)
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
        told = self._slot(chosen, -1)[: self.causes[chosen[-1]].told if chosen else 0]
        share = _share_of_bodies(information, np.diag(inverse) / sizes**2, free, told)
        score, freedom = float(np.sum(np.log(variances))), known.freedom(prior, left) / share**2
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

    def judged_again(self, chosen: list[int], found: dict[int, Blame]) -> list[int]:
        return []  # each fit looks for the errors of the bodies, which takes long

    def candidates(self, before: Solved, chosen: Sequence[int]) -> dict[int, float]:
        return dict.fromkeys(self._left(chosen), np.inf)  # errors of the bodies may hide any of them


def _turn(grams: Array, sides: Array, slot: IntArray, turn: Array) -> None:
    """Replace the columns ``slot`` of products (n, k, k) and (n, k) by mixtures of them, ``turn``, in place."""
    grams[:, :, slot] = grams[:, :, slot] @ turn
    grams[:, slot] = turn.T @ grams[:, slot]
    sides[:, slot] = sides[:, slot] @ turn


def _share_of_bodies(information: Array, variances: Array, rest: IntArray, told: IntArray) -> float:
    """Return the share of the variances (k,) of coefficients that is from errors of the bodies, above 0, 1 for none.

    Where it is small the rows make the interval, and these are many (Satterthwaite 1946).
    """
    if not len(told):
        return 1.0
    certain = np.diag(np.linalg.pinv(information[np.ix_(rest, rest)], hermitian=True))[np.searchsorted(rest, told)]
    return float(np.clip(np.mean(1.0 - certain / variances[told]), 1e-6, 1.0))


class AgainstBodies:
    """What the torques leave where the bodies are the known ones, as far as they are known.

    Attributes:
        fit: The quick fit, whose bodies are free.
    """

    def __init__(self, trends: Trends, known: KnownBodies) -> None:
        self.fit, self._trends, self._known = trends.fit, trends, known

    @cached_property
    def search(self) -> Anchored:
        """The products of all columns."""
        fit, rows = self.fit, self.fit.rows
        target = rows.torque - rows.known
        found = CauseRows(rows.blocks, rows.columns, fit.base.count, target, rows.torque, rows.masks, OVERSAMPLING)
        causes = [cause for cause in self._trends.causes if cause.name not in LEFT_OUT]
        load = Cause("load at the flange", "", load_columns(fit), hidden=TEN - TOLD)
        causes += [load, Cause(*OF_ALL, self.bodies[None])]
        return Anchored(found, causes, self._known, fit.counts / fit.independent_rows)

    @cached_property
    def masses(self) -> Array:
        """Mass of each link by the robot model, in kg; infinite where it states none."""
        theta, count = self.fit.model.nominal(), self.fit.model.inertial_count
        return (
            np.full(count // TEN, np.inf) if theta is None or not theta[:count].any() else theta[TEN - 1 : count : TEN]
        )

    @property
    def last_link(self) -> float:
        """Standard deviation of the mass of the last link in kg, whose errors no log tells from a load."""
        return FIRST * float(self.masses[-1]) if isinstance(self._known, NominalBodies) else 0.0

    @cached_property
    def bodies(self) -> Array:
        """Torque of the known bodies, shape (N, n)."""
        fit, rows = self.fit, self.fit.rows
        beta = np.zeros(fit.base.count)
        beta[self._known.places] = self._known.values
        return np.stack([block @ beta[own] for block, own in zip(rows.blocks, rows.columns, strict=True)], axis=1)
