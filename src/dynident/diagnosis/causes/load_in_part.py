"""A load at the flange in some spells of a log: a part that is gripped and let go, a tool that is changed.

A body at the last link from one time to another adds columns to the fit, its first moments and mass times whether it
is there. With the columns of the fit taken out (Frisch and Waugh 1933) their products are sums over windows of time, so
that all pairs of start and end cost one small system each; spells are put on or taken off, the best first, while they
explain enough of what is left.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.diagnosis.causes.flange_load import TOLD, ends, load_columns
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.weighted_fit import EXACT, RIDGE

#: Windows of a first look and of the search, shortest of them in s, windows of a spell at least, and spells at most.
LOOK, WINDOWS, SHORTEST_S, LEAST, SPELLS = 40, 120, 0.25, 2, 8

#: Share of the weighted squares that a first spell explains for the search to go on, and of those that are left that
#: each further change of spells does (right logs: 0.16 at most of the first).
FIRST, FURTHER = 0.1, 0.1

#: Pull to none, as a share of the squares of a column: one that the fit takes in stays there.
TINY = 1e-6


@dataclass(frozen=True)
class LoadInPart:
    """A load in some spells of a log.

    Attributes:
        joint: Last joint that moves the link that carries it; empty for a robot with one end.
        there: The rows with it, shape (N,).
        mass: Its mass in kg.
        std: Standard deviation of that in kg, rows that hang together counted once.
        fall: Times by which the residual variance is smaller with it, over the joints.
        fall_of_offsets: The same with an offset of each joint's torque in those spells in its place.
        left: Root mean square residual with it in those spells over that at other times, the largest of the joints.
    """

    joint: str
    there: BoolArray
    mass: float
    std: float
    fall: float
    fall_of_offsets: float
    left: float


def load_in_part(fit: QuickFit) -> LoadInPart | None:
    """Return the load that explains most in some spells of a log; None where none explains enough."""
    found: list[LoadInPart] = []
    for joint, link in ends(fit).items():
        columns = load_columns(fit, link)[:TOLD]
        floors = (EXACT * np.sqrt(np.mean(fit.rows.torque**2, axis=0))) ** 2
        variances = np.maximum(fit.plain.variances, floors)
        look = _Spells(fit, columns, variances, LOOK)
        if look.best(np.zeros(look.count, bool))[1] < FIRST:
            continue
        spells = _Spells(fit, columns, variances, WINDOWS)
        after = np.maximum(spells.variances(spells.found()), floors)
        spells = _Spells(fit, columns, after, WINDOWS)  # rows that the load had spoiled had weighed too little
        on = spells.found()
        mass, variance = spells.last_value(on)
        if mass < 0.0:  # without it from here to there: the fit takes a load that is always there for its link
            on, mass = ~on, -mass
        offsets = _Spells(fit, _offsets(fit), after, WINDOWS)
        falls = [_fall(fit, variances, np.maximum(one.variances(on), floors)) for one in (spells, offsets)]
        left = spells.left(on)
        factor = float(np.max(fit.counts / np.maximum(fit.independent_rows, 1.0)))
        found.append(LoadInPart(joint, on[spells.windows], mass, np.sqrt(variance * factor), falls[0], falls[1], left))
    return max(found, key=lambda one: one.fall, default=None)


def _offsets(fit: QuickFit) -> Array:
    """Return an offset of each joint's torque, shape (n, N, n)."""
    joints, rows = fit.model.robot.dof, len(fit.rows.torque)
    return np.repeat(np.eye(joints)[:, None, :], rows, axis=1)


def _fall(fit: QuickFit, before: Array, after: Array) -> float:
    return float(np.exp(np.mean(np.where(fit.moves, np.log(before / after), 0.0))))


class _Spells:
    """Columns (k, N, n) that are there in some windows of a log and not in others, beside those of a fit."""

    def __init__(self, fit: QuickFit, columns: Array, variances: Array, most: int) -> None:
        rows = fit.rows
        time = np.asarray(rows.prepared.kept.time)
        step = max(SHORTEST_S, (time[-1] - time[0]) / most)
        self.windows: IntArray = np.unique(np.floor((time - time[0]) / step), return_inverse=True)[1]
        self.count = int(self.windows[-1]) + 1
        self.fit, self._columns = fit, columns
        starts = np.searchsorted(self.windows, np.arange(self.count + 1))
        size, k = fit.base.count, len(columns)
        self._across, self._own = np.zeros((self.count, size, k)), np.zeros((self.count, k, k))
        self._sides, left = np.zeros((self.count, k)), np.zeros(size)
        self._half = _whitener(fit, variances)
        self._squares = 0.0
        for i, (block, own, mask) in enumerate(zip(rows.blocks, rows.columns, rows.masks.T, strict=True)):
            weight = mask / np.sqrt(variances[i])
            shown, added = block * weight[:, None], (columns[:, :, i] * weight).T
            residual = fit.residual[:, i] * weight
            left[own] += residual @ shown
            self._squares += float(residual @ residual)
            for j, (first, last) in enumerate(pairwise(starts)):
                here = added[first:last]
                self._across[j][own] += shown[first:last].T @ here
                self._own[j] += here.T @ here
                self._sides[j] += residual[first:last] @ here
        self._across = self._half @ self._across
        self._sides -= (self._half @ left) @ self._across
        self._size = np.sqrt(np.maximum(np.diag(self._own.sum(axis=0)), 1e-300))

    def found(self) -> BoolArray:
        """Return the windows with the columns, shape (W,)."""
        on, explained = np.zeros(self.count, bool), 0.0
        for _ in range(2 * SPELLS):
            tried, share = self.best(on)
            if share - explained < FURTHER * (1.0 - explained) or np.sum(np.diff(tried.astype(int)) > 0) > SPELLS:
                break
            on, explained = tried, share
        return on

    def best(self, on: BoolArray) -> tuple[BoolArray, float]:
        """Return windows that differ from these in one spell, shape (W,), and the share of squares they explain."""
        first, last = np.triu_indices(self.count + 1, LEAST)
        sign = np.where(on, -1.0, 1.0)

        def of_each(sums: Array) -> Array:
            signs = sign.reshape(-1, *np.ones(sums.ndim - 1, int))
            steps = np.concatenate([np.zeros((1, *sums.shape[1:])), np.cumsum(signs * sums, axis=0)])
            return sums[on].sum(axis=0) + steps[last] - steps[first]

        gains = self._gains(of_each(self._across), of_each(self._own), of_each(self._sides))
        place = int(np.argmax(gains))
        changed = on.copy()
        changed[first[place] : last[place]] ^= True
        return changed, float(gains[place]) / max(self._squares, 1e-300)

    def solved(self, on: BoolArray) -> Array:
        """Return the values of the columns in these windows, shape (k,)."""
        across, own, sides = (sums[on].sum(axis=0) for sums in (self._across, self._own, self._sides))
        return np.linalg.solve(self._beyond(across, own), sides / self._size) / self._size

    def last_value(self, on: BoolArray) -> tuple[float, float]:
        """Return the value of the last column, and its variance for independent rows.

        Windows in which it begins or ends have values of their own, but where too few are left.
        """
        inner = _inner(on)
        groups = [inner, (on & ~inner) | (~on & ~_inner(~on))] if inner.sum() >= LEAST else [on]
        across = np.concatenate([self._across[group].sum(axis=0) for group in groups], axis=1)
        sides = np.concatenate([self._sides[group].sum(axis=0) for group in groups])
        k, own = len(self._size), np.zeros((len(sides), len(sides)))
        for place, group in enumerate(groups):
            own[place * k : (place + 1) * k, place * k : (place + 1) * k] = self._own[group].sum(axis=0)
        sizes = np.tile(self._size, len(groups))
        inverse = np.linalg.inv((own - across.T @ across) / np.outer(sizes, sizes) + TINY * np.eye(len(sizes)))
        inverse /= np.outer(sizes, sizes)
        return float(inverse[k - 1] @ sides), float(inverse[k - 1, k - 1])

    def variances(self, on: BoolArray) -> Array:
        """Return the residual variance of each joint with the columns in these windows, shape (n,)."""
        return np.sum(self._residual(on) ** 2, axis=0) / self.fit.counts

    def left(self, on: BoolArray) -> float:
        """Return the residual with the columns where they are there, over that elsewhere, the largest of the joints.

        Windows in which they begin or end are left out, but where these are all.
        """
        residual, masks, inner = self._residual(on), self.fit.rows.masks, _inner(on)
        there, elsewhere = (inner if inner.any() else on)[self.windows], ~on[self.windows]
        inside, outside = (
            np.sum(residual[part] ** 2, axis=0) / np.maximum(masks[part].sum(axis=0), 1) for part in (there, elsewhere)
        )
        known = self.fit.moves & (masks[there].sum(axis=0) > 0) & (outside > 0.0)
        return float(np.sqrt(np.max(inside[known] / outside[known], initial=0.0)))

    def _residual(self, on: BoolArray) -> Array:
        """Return the residual with the columns in these windows, 0 of rows that do not count, shape (N, n)."""
        values = self.solved(on)
        change = -self._half.T @ (self._across[on].sum(axis=0) @ values)
        rows, there = self.fit.rows, on[self.windows]
        left = self.fit.residual_of(rows, self.fit.plain.beta + change)
        left -= np.where(there[:, None], np.tensordot(values, self._columns, axes=1), 0.0)
        return np.where(rows.masks, left, 0.0)

    def _beyond(self, across: Array, own: Array) -> Array:
        """Return products (..., k, k) of the columns beyond those of the fit, in sizes of the columns."""
        found = (own - np.swapaxes(across, -1, -2) @ across) / np.outer(self._size, self._size)
        return found + TINY * np.eye(len(self._size))

    def _gains(self, across: Array, own: Array, sides: Array) -> Array:
        """Return the squares that the columns explain, shape (P,)."""
        scaled = sides / self._size
        values = np.linalg.solve(self._beyond(across, own), scaled[..., None])[..., 0]
        return np.sum(scaled * values, axis=1)


def _inner(on: BoolArray) -> BoolArray:
    """Return the windows whose neighbours are like them, of those that are on, shape (W,)."""
    changes = np.diff(on.astype(int), prepend=on[:1], append=on[-1:]) != 0
    return on & ~changes[:-1] & ~changes[1:]


def _whitener(fit: QuickFit, variances: Array) -> Array:
    """Return what makes orthonormal columns of those of a weighted fit, shape (rank, b)."""
    stacked = []
    for (own, factor), variance in zip(fit.triangles, variances, strict=True):
        rows = np.zeros((len(factor), fit.base.count))
        rows[:, own] = factor[:, : len(own)] / np.sqrt(variance)
        stacked.append(rows)
    whole = np.concatenate(stacked)
    norms = np.maximum(np.linalg.norm(whole, axis=0), 1e-300)
    _, sizes, right = np.linalg.svd(whole / norms, full_matrices=False)
    kept = sizes**2 > RIDGE * sizes[0] ** 2
    return right[kept] / sizes[kept, None] / norms
