"""Many candidate friction columns over the same logs, read once: every choice of them is a part of one Gram matrix.

Comparing friction models means solving the same linear problem over many sets of columns. All columns go through the
filter once; each block of rows leaves one matrix of inner products, and a fit or a held-out score of any set of columns
is a solution of its sub-matrix. Estimates are never made this way: squares of condition numbers are good enough to
compare residuals, and columns that depend on each other are told apart by a ridge at the rounding.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TypeAlias

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.preprocessing import Prepared
from dynident.data.preprocessing._local_polynomials import fractional_shift
from dynident.identification.problem.problem import counting_rows
from dynident.identification.problem.regressor_stream import RegressorStream, RowSegment
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.base import Coefficient, Friction, Inputs, Motion, Number, State
from dynident.model.lapack import solve_positive
from dynident.model.robot import Robot

#: Ridge in units of a column's square: far above rounding of the products, far below what data say.
RIDGE = 1e-11

#: Bytes that rows of friction columns may take between two pools.
KEPT = 2**28

#: Rows of the columns of a friction part in a log, by segment and joint.
FrictionRows: TypeAlias = list[list[Array]]

#: Share of a joint's rows that are not among its fastest.
FASTEST = 0.8


@dataclass(frozen=True)
class PartCandidate(Friction):
    """A friction part under a label of its own, so that several of a kind can stand side by side."""

    part: Friction
    label: str

    @property
    def coefficients(self) -> tuple[Coefficient, ...]:  # type: ignore[override]
        """Those of the part, with symbols of their own."""
        each = (tuple(getattr(c, f.name) for f in fields(c)) for c in self.part.coefficients)
        return tuple(Coefficient(f"{symbol} {self.label}", *rest) for symbol, *rest in each)

    @property
    def states(self) -> tuple[State, ...]:
        """Those of the part."""
        return self.part.states

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        """Return those of the part."""
        return self.part.terms(at)

    def update(self, at: Inputs) -> tuple[Number, ...]:
        """Return that of the part."""
        return self.part.update(at)

    def states_along(self, motion: Motion, step: float, first: Array | None = None) -> Array:
        """Return those of the part, by its own loop."""
        return self.part.states_along(motion, step, first)


@dataclass(frozen=True)
class ColumnPool:
    """Inner products of all columns and the torque, by block of rows and joint.

    Attributes:
        parts: The candidate parts.
        shared: Number of columns that every fit has: those of the bodies, and of the delay where it is free.
        columns: Positions of the columns of part p at drive j: ``columns[p][j]``.
        products: [W, tau]' [W, tau] of each joint in each block, shape (B, n, c + 1, c + 1).
        rows: Rows of each joint in each block, shape (B, n).
        nonnegative: Which columns have coefficients that physics wants >= 0, shape (c,).
        fast: Products of the rows in which a joint is among the fastest of its own, shape (n, c + 1, c + 1).
        fast_rows: Number of them, shape (n,).
        views: Of each delay that is compared, which rows of the products are those of the columns and the torque,
            shape (c + 1,). The first is that of the logs as they are; the others have products of their own behind it.
    """

    parts: tuple[Friction, ...]
    shared: int
    columns: tuple[tuple[IntArray, ...], ...]
    products: Array
    rows: IntArray
    nonnegative: BoolArray
    fast: Array
    fast_rows: IntArray
    views: tuple[IntArray, ...]

    def weighted(self, weights: Array) -> Array:
        """Return the products of each block over all joints, their rows times the weights (n,): (B, c + 1, c + 1)."""
        return np.einsum("i,bikl->bkl", weights**2, self.products)

    def by_delay(self, products: Array) -> tuple[Array, ...]:
        """Return products of all columns (..., e, e) once for each delay, shape (..., c + 1, c + 1)."""
        return tuple(products[..., own[:, None], own] for own in self.views)

    def chosen(self, sets: Sequence[Sequence[int]]) -> IntArray:
        """Return the columns of a model whose drive j has the parts ``sets[j]``."""
        friction = [self.columns[p][j] for j, own in enumerate(sets) for p in own]
        return np.concatenate([np.arange(self.shared), *friction]).astype(np.int64)

    def possible(self, whole: Array, keep: IntArray, always: IntArray) -> IntArray:
        """Return the columns ``keep`` without those beside ``always`` whose coefficients would have a wrong sign.

        ``whole`` are the products of all rows, shape (c + 1, c + 1).
        """
        while (wrong := (fit(whole, keep) < 0) & self.nonnegative[keep] & ~np.isin(keep, always)).any():
            keep = keep[~wrong]
        return keep

    def weights(self, sets: Sequence[Sequence[int]], passes: int = 4) -> Array:
        """Return the weight of each joint's rows by its own residual in a fit of all blocks, shape (n,)."""
        total, rows = self.by_delay(self.products.sum(axis=0))[0], np.maximum(self.rows.sum(axis=0), 1)
        keep = self.chosen(sets)
        weights = np.ones(self.products.shape[1])
        for _ in range(passes):
            beta = fit(np.einsum("i,ikl->kl", weights**2, total), keep)
            squares = np.array([loss(each, keep, beta) for each in total])
            weights = np.sqrt(rows / np.maximum(squares, 1e-20 * total[:, -1, -1] + 1e-300))
        return weights


def beyond(whole: Array, fast: Array, keep: IntArray, shared: int) -> float:
    """Return the sum of squared residuals of the fastest rows, by friction that is fitted to all the others.

    The ``shared`` first columns of ``keep`` stay at their fit of all rows: what is asked is how friction goes on beyond
    the speeds it is fitted to. ``whole`` and ``fast`` are products of all and of the fastest rows, (c + 1, c + 1).
    """
    beta, slow = fit(whole, keep), without(whole, fast)
    friction = keep[shared:]
    if len(friction):
        left = slow.copy()
        left[:, -1] -= slow[:, keep[:shared]] @ beta[:shared]
        beta[shared:] = fit(left, friction)
    return loss(fast, keep, beta)


class PooledLogs:
    """Logs whose rows of the bodies are made once, for many pools of friction columns.

    A list of parts is not to earn by what a late torque does, nor another one lose by it: with ``delay_is_free`` every
    fit has a column more, the derivative of the torque by a delay of all logs. That is a straight line; where a delay
    of many samples may be none at all, the torque stands there under several ``shares`` of it.

    Args:
        model: The robot; its friction is left aside.
        logs: Preprocessed logs.
        blocks: Into how many stretches all rows are cut, at least one a log. Rows within a period of the filter of a
            cut belong to none.
        load: Standard inertial parameters (10 l,) whose torque loads the drives; None where no part asks.
        delay_is_free: Whether the delay of the torque is free.
        shares: Shares of the delay of each log that are compared where it is free, that of the logs as they are first.
        made: Rows of friction parts of the same logs and load, as earlier pools have left them there.
    """

    def __init__(
        self,
        model: DynamicModel,
        logs: Sequence[Prepared],
        blocks: int = 1,
        load: Array | None = None,
        delay_is_free: bool = False,
        shares: Sequence[float] = (1.0,),
        made: dict[Friction, list[FrictionRows]] | None = None,
    ) -> None:
        self._robot, self._delay_is_free, self._shares = model.robot, delay_is_free, shares if delay_is_free else (1.0,)
        bare = DynamicModel(model.robot)
        self._rigid = base_parameters(bare)
        self._start = None if load is None else self._rigid.from_standard(load)
        self._bodies = RegressorStream(bare, self._rigid)
        self._made = {} if made is None else made
        speeds = [np.abs(np.asarray(log.log.dq)[log.keep]) for log in logs]
        limits = np.quantile(np.concatenate(speeds), FASTEST, axis=0)
        total = sum(len(log.keep) for log in logs)
        self._logs = [
            _PooledLog(
                log,
                _blocks_of(log, mask, max(1, round(blocks * len(log.keep) / total))),
                mask,
                own > limits,
                self._shared_rows(log),
            )
            for log, own in zip(logs, speeds, strict=True)
            for mask in [counting_rows(bare, log)]
        ]

    def _shared_rows(self, log: Prepared) -> list[RowSegment]:
        """Return the rows of the columns that every fit has, and of the torque."""
        if not self._delay_is_free:
            return list(self._bodies.segments(log))
        torque = np.asarray(log.log.torque)
        slopes = -np.gradient(torque, 1.0 / log.log.rate, axis=0)  # by a delay
        lags = [(1.0 - share) * log.delay_s * log.log.rate for share in self._shares]
        each = [[fractional_shift(signal, lag, log.keep) for signal in (slopes, torque)] for lag in lags]

        def rows_of(part: slice, i: int, rows: Array) -> Array:
            known = rows[-1] - torque[log.keep][part, i]  # less what is known of the torque
            return np.vstack([rows[:-1], *((slope[part, i], own[part, i] + known) for slope, own in each)])

        return [
            (part, tuple(rows_of(part, i, rows) for i, rows in enumerate(segment)))
            for part, segment in self._bodies.segments(log)
        ]

    def pool(self, parts: Sequence[Friction]) -> ColumnPool:
        """Return the products with the columns of all candidate parts on all drives; several may be of a kind."""
        whole, rigid, later = _labelled(self._robot, parts), self._rigid, self._delay_is_free
        shared, last = rigid.count + later, rigid.count + later + len(whole.terms[0])
        size = last + 1 + 2 * (len(self._shares) - 1)
        behind = np.arange(last, size)
        views = [np.arange(last + 1)]
        for slope in behind[1::2]:
            views.append(views[0].copy())
            views[-1][[rigid.count, last]] = slope, slope + 1
        columns = tuple(tuple(shared + own for own in each) for each in _by_drive(whole))
        places = [
            (
                np.concatenate([own, [rigid.count] * later, behind]).astype(np.int64),
                np.concatenate([behind[:0], *(each[j] for each in columns for j in np.flatnonzero(row))]),
            )
            for own, row in zip(self._bodies.columns, np.asarray(self._robot.coupling).T, strict=True)
        ]
        made = self._rows_of(parts)
        found = [log.products([own[k] for own in made], places, size) for k, log in enumerate(self._logs)]
        products, rows, fast, fast_rows = (list(each) for each in zip(*found, strict=True))
        signs = [rigid.parameters[k].nonnegative for k in rigid.independent] + [False] * later
        return ColumnPool(
            tuple(parts),
            shared,
            columns,
            np.concatenate(products),
            np.concatenate(rows),
            np.array(signs + [own.nonnegative for own in whole.parameters[whole.inertial_count :]]),
            np.sum(fast, axis=0),
            np.sum(fast_rows, axis=0),
            tuple(views),
        )

    def _rows_of(self, parts: Sequence[Friction]) -> list[list[FrictionRows]]:
        """Return the rows of each part in each log; those of earlier pools stay as long as all take little."""
        asked, made = [replace(part, choose=None, vary=None) for part in parts], self._made
        if missing := [part for part in dict.fromkeys(asked) if part not in made]:
            whole = _labelled(self._robot, missing)
            stream, places = self._stream(whole), [np.concatenate(own) for own in _by_drive(whole)]
            columns = [own - self._rigid.count for own in stream.columns]
            split = [[np.flatnonzero(np.isin(each, own)) for each in columns] for own in places]
            made |= {part: [] for part in missing}
            for log in self._logs:
                segments = [blocks for _, blocks in stream.segments(log.log)]
                for part, each in zip(missing, split, strict=True):
                    rows = [[block[own] for block, own in zip(blocks, each, strict=True)] for blocks in segments]
                    made[part].append(rows)
        found = [made[part] for part in asked]
        sizes = {part: sum(one.nbytes for log in own for each in log for one in each) for part, own in made.items()}
        for part in [part for part in made if part not in asked]:
            if sum(sizes.values()) > KEPT:
                del made[part], sizes[part]
        return found

    def _stream(self, whole: DynamicModel) -> RegressorStream:
        """Return what makes the rows of the friction of a model."""
        rigid = self._rigid
        independent = np.concatenate([rigid.independent, np.arange(whole.inertial_count, len(whole.parameters))])
        count = len(independent)
        unused = np.zeros((count, len(whole.parameters)))
        base = BaseParameters(
            whole.parameters, independent.astype(np.int64), unused, unused.astype(bool), np.ones(count)
        )
        start = None if self._start is None else np.append(self._start, np.zeros(count - rigid.count))
        return RegressorStream(whole, base, start, only="friction")


def _labelled(robot: Robot, parts: Sequence[Friction]) -> DynamicModel:
    """Return a model that has all the parts, several of which may be of a kind."""
    return DynamicModel(robot, [PartCandidate(part, str(k), joints=part.joints) for k, part in enumerate(parts)])


def _by_drive(model: DynamicModel) -> list[list[IntArray]]:
    """Return the places among all friction coefficients of those of part p at drive j: ``[p][j]``."""
    drive, column = model.terms
    starts = np.cumsum([0, *(len(part.coefficients) for part in model.friction)])
    return [
        [np.flatnonzero((drive == j) & (column >= first) & (column < last)) for j in range(model.robot.dof)]
        for first, last in itertools.pairwise(starts)
    ]


@dataclass(frozen=True)
class _PooledLog:
    """A log with the rows that every pool has.

    Attributes:
        log: The log.
        block: Block of each kept row, -1 for none, shape (N,).
        mask: Which of the rows count for each joint, shape (N, n).
        fast: In which of them a joint is among the fastest of its own, shape (N, n).
        segments: The rows of the shared columns and the torque.
    """

    log: Prepared
    block: IntArray
    mask: BoolArray
    fast: BoolArray
    segments: list[RowSegment]

    def products(
        self, friction: Sequence[FrictionRows], places: Sequence[tuple[IntArray, IntArray]], size: int
    ) -> tuple[Array, IntArray, Array, IntArray]:
        """Return products and rows of each block, and those of the fastest rows.

        Args:
            friction: Rows of each friction part in the same segments.
            places: By joint, the positions of the shared columns with the torque, and of the friction columns.
            size: Number of all columns, that of the torque among them.
        """
        counts, joints = int(self.block.max()) + 1, len(places)
        found, fast = np.zeros((counts, joints, size, size)), np.zeros((joints, size, size))
        rows, fast_rows = np.zeros((counts, joints), dtype=np.int64), np.zeros(joints, dtype=np.int64)
        for k, (part, shared) in enumerate(self.segments):
            for i, (own, extra) in enumerate(places):
                values = np.vstack([shared[i], *(rows[k][i] for rows in friction)])
                columns = np.concatenate([own, extra])
                place = np.ix_(columns, columns)
                for b in range(counts):
                    counted = (self.block[part] == b) & self.mask[part, i]
                    chosen = values[:, counted]
                    found[b, i][place] += chosen @ chosen.T
                    rows[b, i] += chosen.shape[1]
                    chosen = values[:, counted & self.fast[part, i]]
                    fast[i][place] += chosen @ chosen.T
                    fast_rows[i] += chosen.shape[1]
        return found, rows, fast, fast_rows


def without(whole: Array, part: Array) -> Array:
    """Return the products of the rows that are not in a part, both shape (..., c + 1, c + 1).

    A column all of whose rows are in the part has none left; what the difference leaves of it is rounding, of any sign.
    """
    left = whole - part
    size, all_rows = (np.diagonal(each, axis1=-2, axis2=-1) for each in (left, whole))
    stays = size > RIDGE * all_rows
    return left * (stays[..., :, None] & stays[..., None, :])


def fit(products: Array, keep: IntArray) -> Array:
    """Return the least-squares coefficients of the columns ``keep`` from inner products (c + 1, c + 1)."""
    gram, right = products[np.ix_(keep, keep)], products[keep, -1]
    size = np.sqrt(np.diag(gram))
    scale = np.where(size > 0, size, 1.0)
    ridged = gram / np.outer(scale, scale)
    ridged.flat[:: len(keep) + 1] += RIDGE + (size == 0)
    found = solve_positive(ridged, right / scale)
    return np.linalg.lstsq(gram, right)[0] if found is None else found / scale


def loss(products: Array, keep: IntArray, beta: Array) -> float:
    """Return the sum of squared residuals of coefficients of the columns ``keep``, from inner products."""
    gram, right = products[np.ix_(keep, keep)], products[keep, -1]
    return float(beta @ gram @ beta - 2.0 * beta @ right + products[-1, -1])


def held_out(held: Array, rest: Array, rows: IntArray, keep: IntArray) -> Array:
    """Return the mean squared residual of each block by the columns ``keep`` in a fit of the others, shape (B,).

    Args:
        held: Products of each block, shape (B, c + 1, c + 1).
        rest: Those of all others together, of the same shape.
        rows: Rows of each block, shape (B,).
        keep: Columns of the fit.
    """
    squares = [loss(own, keep, fit(other, keep)) for own, other in zip(held, rest, strict=True)]
    return np.array(squares) / np.maximum(rows, 1)


def _blocks_of(log: Prepared, mask: BoolArray, blocks: int) -> IntArray:
    """Return the block of each kept row, -1 for those near a cut, shape (N,): as many rows that count in each."""
    passed = np.cumsum(mask.sum(axis=1))
    place = np.minimum((passed - 1).clip(min=0) * blocks // max(passed[-1], 1), blocks - 1)
    bandwidth = log.how.filter.bandwidth()
    if blocks == 1 or bandwidth is None:
        return place
    near = log.log.rate / log.every / bandwidth
    cuts = np.append(np.flatnonzero(np.diff(place)) + 1.0, np.inf)
    away = np.min(np.abs(np.arange(len(place))[:, None] - cuts), axis=1)
    return np.where(away < min(near, 0.1 * len(place) / blocks), -1, place)
