"""Many candidate friction columns over the same logs, read once: every choice of them is a part of one Gram matrix.

Comparing friction models means solving the same linear problem over many sets of columns. All columns go through the
filter once; each block of rows leaves one matrix of inner products, and a fit or a held-out score of any set of columns
is a solution of its sub-matrix. Estimates are never made this way: squares of condition numbers are good enough to
compare residuals, and columns that depend on each other are told apart by a ridge at the rounding.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.preprocessing import Prepared
from dynident.data.preprocessing._local_polynomials import fractional_shift
from dynident.identification.problem.prior import natural_scale, prior_products
from dynident.identification.problem.problem import counting_rows
from dynident.identification.problem.regressor_stream import RegressorStream, motion_of
from dynident.identification.selection.friction.load import default_load
from dynident.identification.selection.friction.nested_fits import fit
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction, Motion
from dynident.model.robot import Robot

#: Rows in a period of the filter's cut-off that are compared, and bytes that rows of friction columns may take between
#: two pools.
ROWS, KEPT = 8.0, 2**28

#: Share of a joint's rows that are not among its fastest.
FASTEST = 0.8


class SideBySide(DynamicModel):
    """Friction parts that are compared: several may be of a kind, with coefficients of one name."""

    def _check_names(self) -> None:
        pass


@dataclass(frozen=True)
class ColumnPool:
    """Inner products of all columns and the torque, by block of rows and joint.

    Attributes:
        parts: The candidate parts.
        shared: Number of columns that every fit has: those of the bodies, and of the delay where it is free.
        columns: Positions of the columns of part p at drive j: ``columns[p][j]``.
        size: Number of all columns, c, and the torque; more where further delays are compared.
        places: Which of these columns are at each joint, shape (k_i,).
        products: Their products of each joint in each block, shape (B, k_i, k_i).
        rows: Rows of each joint in each block, shape (B, n).
        nonnegative: Which columns of friction have coefficients that physics wants >= 0, shape (c,).
        fast: Products of the rows in which a joint is among the fastest of its own, shape (1, k_i, k_i).
        fast_rows: Number of them, shape (n,).
        views: Of each delay that is compared, which rows of the products are those of the columns and the torque,
            shape (V, c + 1). The first is that of the logs as they are; what the others have of their own is behind.
        bodies: Products of a prior of the bodies, shape (b + 1, b + 1).
    """

    parts: tuple[Friction, ...]
    shared: int
    columns: tuple[tuple[IntArray, ...], ...]
    size: int
    places: tuple[IntArray, ...]
    products: tuple[Array, ...]
    rows: IntArray
    nonnegative: BoolArray
    fast: tuple[Array, ...]
    fast_rows: IntArray
    views: IntArray
    bodies: Array

    @cached_property
    def totals(self) -> tuple[Array, ...]:
        """The products of each joint in all blocks, shape (1, k_i, k_i)."""
        return tuple(each.sum(axis=0, keepdims=True) for each in self.products)

    def weighted(self, weights: Array, products: Sequence[Array] | None = None) -> Array:
        """Return the products of each block over all joints, their rows times the weights (n,): (B, c + 1, c + 1).

        Of ``fast`` rows alone, or in total, they are those of one block.
        """
        products = self.products if products is None else products
        found = np.zeros((len(products[0]), self.size, self.size))
        for weight, own, each in zip(weights, self.places, products, strict=True):
            found[:, own[:, None], own] += weight**2 * each
        return found

    def by_delay(self, products: Array) -> Array:
        """Return products of all columns (..., e, e) once for each delay, shape (..., V, c + 1, c + 1)."""
        return products[..., self.views[:, :, None], self.views[:, None, :]]

    def chosen(self, sets: Sequence[Sequence[int]]) -> IntArray:
        """Return the columns of a model whose drive j has the parts ``sets[j]``."""
        friction = [self.columns[p][j] for j, own in enumerate(sets) for p in own]
        return np.concatenate([np.arange(self.shared), *friction]).astype(np.int64)

    def lists(self, sets: Sequence[Sequence[Sequence[int]]]) -> BoolArray:
        """Return which columns models have whose drives have the parts ``sets[k][drive]``, shape (m, c)."""
        return np.stack([np.isin(np.arange(len(self.nonnegative)), self.chosen(own)) for own in sets])

    def weights(self, sets: Sequence[Sequence[int]]) -> Array:
        """Return the weight of each joint's rows by its own residual in a fit of all blocks, shape (n,)."""
        keep, rows = self.chosen(sets), np.maximum(self.rows.sum(axis=0), 1)
        among = np.full(self.size, -1)
        among[np.append(keep, self.views[0][-1])] = np.arange(len(keep) + 1)
        total = np.zeros((len(self.places), len(keep) + 1, len(keep) + 1))
        for whole, own, (each,) in zip(total, self.places, self.totals, strict=True):
            there = np.flatnonzero(among[own] >= 0)
            at = among[own[there]]
            whole[at[:, None], at] = each[there[:, None], there]
        weights, own = np.ones(len(total)), np.arange(len(keep))
        for _ in range(4):
            mixed = np.append(fit(np.tensordot(weights**2, total, 1), own), -1.0)
            weights = np.sqrt(rows / np.maximum((total @ mixed) @ mixed, 1e-20 * total[:, -1, -1] + 1e-300))
        return weights


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
        shared: Rows of the same logs and load, as earlier pools have left them there.
    """

    def __init__(
        self,
        model: DynamicModel,
        logs: Sequence[Prepared],
        blocks: int = 1,
        load: Array | None = None,
        delay_is_free: bool = False,
        shares: Sequence[float] = (1.0,),
        shared: SharedRows | None = None,
    ) -> None:
        self._robot, self._delay_is_free, self._shares = model.robot, delay_is_free, shares if delay_is_free else (1.0,)
        self._shared = SharedRows(model.robot, logs) if shared is None else shared
        self._rigid = self._shared.bodies.base
        self._start = None if load is None else self._rigid.from_standard(load)
        self._moving = [np.flatnonzero(row).tolist() for row in np.asarray(model.robot.coupling).T]
        masks = [counting_rows(self._shared.bodies.model, log) for log in logs]
        speeds, first = np.concatenate([np.abs(np.asarray(log.log.dq)[log.keep]) for log in logs]), 0
        total, rows, numbers = len(speeds), list[list[Array]](), list[IntArray]()
        for k, (log, mask, place) in enumerate(zip(logs, masks, places := self._shared.places(logs), strict=True)):
            block = _blocks_of(log, mask, max(1, round(blocks * len(log.keep) / total)))
            numbers.append(np.where((block < 0)[:, None] | ~mask, -1, block[:, None] + first))
            first += int(block.max()) + 1
            plain = np.asarray(self._shared.plain[k].log.torque)[log.keep]
            rows.append(self._shared_rows(log, plain, [each[:, place] for each in self._shared.rows[k]]))
        before = itertools.accumulate((len(log.keep) for log in self._shared.plain), initial=0)
        there = np.concatenate([np.arange(own.start, own.stop) + k for own, k in zip(places, before, strict=False)])
        number, fast = np.concatenate(numbers), speeds > np.quantile(speeds, FASTEST, axis=0)
        groups = np.where(number < 0, -1, 2 * number + fast).T
        each = [np.concatenate(own, axis=1) for own in zip(*rows, strict=True)]
        self._joints = [_JointRows.of(*own, there, 2 * first) for own in zip(groups, each, strict=True)]

    def _shared_rows(self, log: Prepared, plain: Array, bodies: Sequence[Array]) -> list[Array]:
        """Return the rows of each joint that every fit has, and its torque; of ``bodies`` they are under ``plain``."""
        torque, rate = np.asarray(log.log.torque), log.log.rate
        each = [[torque[log.keep]]]
        if self._delay_is_free:
            slopes = -np.gradient(torque, 1.0 / rate, axis=0)  # by a delay
            lags = [(1.0 - share) * log.delay_s * rate for share in self._shares]
            each = [[fractional_shift(signal, lag, log.keep) for signal in (slopes, torque)] for lag in lags]
        known = np.stack([rows[-1] for rows in bodies], axis=1) - plain  # of the torque: it is taken off
        signals = [signal for *slope, own in each for signal in (*slope, own + known)]
        return [np.vstack([rows[:-1], *(signal[:, i] for signal in signals)]) for i, rows in enumerate(bodies)]

    def pool(self, parts: Sequence[Friction]) -> ColumnPool:
        """Return the products with the columns of all candidate parts on all drives; several may be of a kind."""
        rigid, later, drives = self._rigid, self._delay_is_free, range(self._robot.dof)
        shared, acts = rigid.count + later, [self._shared.bodies.model.drives_of(part) for part in parts]
        has = [part.coefficients if j in on else () for j in drives for part, on in zip(parts, acts, strict=True)]
        ends = shared + np.cumsum([0, *map(len, has)], dtype=np.int64)
        last, cuts = int(ends[-1]), [np.arange(*pair) for pair in itertools.pairwise(ends)]
        columns = tuple(tuple(cuts[p :: len(parts)]) for p in range(len(parts)))
        size = last + 1 + 2 * (len(self._shares) - 1)
        behind = np.arange(last, size)
        views = np.tile(np.arange(last + 1), (len(self._shares), 1))
        views[1:, [rigid.count, last]] = behind[1:].reshape(-1, 2)
        places = [
            (
                np.concatenate([own, [rigid.count] * later, behind]).astype(np.int64),
                np.concatenate([behind[:0], *(each[j] for each in columns for j in moving)]),
            )
            for own, moving in zip(self._shared.bodies.columns, self._moving, strict=True)
        ]
        made, stated = self._rows_of(parts), [joint.drive.reflected_inertia > 0 for joint in self._robot.active]
        signs = [False] * shared
        beside = [stated[j] and any(part.is_inertia) for j in drives for part in parts]  # a stated one: may be < 0
        signs += [c.nonnegative and not is_rest for each, is_rest in zip(has, beside, strict=True) for c in each]
        products, fast = zip(*map(_JointRows.products, self._joints, made), strict=True)
        rows = np.stack([np.diff(joint.ends).reshape(-1, 2) for joint in self._joints], axis=1)
        return ColumnPool(
            tuple(parts),
            shared,
            columns,
            size,
            tuple(np.concatenate(own) for own in places),
            products,
            rows.sum(axis=2),
            np.array(signs, dtype=bool),
            fast,
            rows[:, :, 1].sum(axis=0),
            views,
            self._shared.bodies_known,
        )

    def _rows_of(self, parts: Sequence[Friction]) -> list[Array]:
        """Return the rows (k, m) of all parts at each joint; those of earlier pools stay as long as all take little."""
        asked, made = [replace(part, choose=None, vary=None) for part in parts], self._shared.friction
        if missing := [part for part in dict.fromkeys(asked) if part not in made]:
            whole, base = SideBySide(self._robot, missing), self._rigid  # columns are made by their places alone
            independent = np.append(base.independent, whole.inertial_count + np.arange(len(whole.terms[0])))
            stream = RegressorStream(whole, replace(base, independent=independent), only="friction")
            part_of = np.repeat(np.arange(len(missing)), [len(own.coefficients) for own in missing])[whole.terms[1]]
            motions = self._shared.motions(self._start if "torque" in whole.needs else None)
            logs = [stream.rows(log, own) for log, own in zip(self._shared.plain, motions, strict=True)]
            joints = [np.concatenate([rows[:-1] for rows in own], axis=1) for own in zip(*logs, strict=True)]
            of = [part_of[own - self._rigid.count] for own in stream.columns]
            for p, part in enumerate(missing):
                made[part] = [rows[own == p] for rows, own in zip(joints, of, strict=True)]
            self._shared.size += sum(rows.nbytes for rows in joints)
            for part in list(itertools.filterfalse(set(asked).__contains__, made)):
                if self._shared.size > KEPT:
                    self._shared.size -= sum(one.nbytes for one in made.pop(part))
        found = []
        for i, joint in enumerate(self._joints):
            found.append(rows := np.empty((sum(len(made[part][i]) for part in asked), len(joint.order))))
            for out, own in zip(rows, (row for part in asked for row in made[part][i]), strict=True):
                np.take(own, joint.order, out=out, mode="clip")
        return found


class SharedRows:
    """Rows of logs whose delays differ from choice to choice: the torque moves against the motion, whose rows stay.

    The load of the drives is that of the first choice.

    Attributes:
        plain: The logs as they came.
        friction: Their rows of friction parts at each joint, as choices have left them, of ``size`` bytes.
    """

    def __init__(self, robot: Robot, plain: Sequence[Prepared]) -> None:
        bare = DynamicModel(robot)
        self.bodies, self.plain = RegressorStream(bare, base_parameters(bare)), tuple(plain)
        self.friction, self.size = dict[Friction, list[Array]](), 0
        self._load: Array | None = None
        self._motions = [motion_of(log.log) for log in self.plain]

    @cached_property
    def rows(self) -> list[tuple[Array, ...]]:
        """Rows of the bodies and the torque in each log, of each joint."""
        return [self.bodies.rows(log) for log in self.plain]

    def motions(self, load: Array | None) -> list[Motion]:
        """Return the motion of each log, with the torque of base parameters (b,) that loads the drives if given."""
        if load is not None and self._motions[0].torque is None:
            loads = [self.bodies.predict(log.log, load) + self.bodies.model.robot.bias for log in self.plain]
            self._motions = [replace(own, torque=each) for own, each in zip(self._motions, loads, strict=True)]
        return self._motions

    @cached_property
    def bodies_known(self) -> Array:
        """Products (b + 1, b + 1) of a prior of the bodies, whose rows count as rows that hang together do."""
        pairs = [(np.asarray(log.log.torque), np.asarray(log.log.ddq)) for log in self.plain]
        sizes = (np.sqrt(np.mean(np.concatenate(own) ** 2, axis=0)) for own in zip(*pairs, strict=True))
        bands = [2.0 * (log.how.filter.bandwidth() or np.inf) * log.every / log.log.rate for log in self.plain]
        return prior_products(self.bodies.base, natural_scale(self.bodies.model, *sizes)) / min(1.0, np.mean(bands))

    def under(self, logs: Sequence[Prepared]) -> list[Prepared]:
        """Return the logs with the delays of preprocessed ones."""
        pairs = zip(self.plain, logs, strict=True)
        return [plain.with_earlier_torque(log.delay_s - plain.delay_s) for plain, log in pairs]

    def places(self, logs: Sequence[Prepared]) -> list[slice]:
        """Return which rows those of the logs under delays are, which leave some out at one of the ends."""
        starts = [int(np.searchsorted(plain.keep, log.keep[0])) for plain, log in zip(self.plain, logs, strict=True)]
        return [slice(start, start + len(log.keep)) for start, log in zip(starts, logs, strict=True)]

    def load(self, model: DynamicModel, logs: Sequence[Prepared]) -> Array:
        """Return the standard parameters (10 l,) whose torque loads the drives."""
        self._load = default_load(model, logs) if self._load is None else self._load
        return self._load


@dataclass(frozen=True)
class _JointRows:
    """The rows of a joint that count, one block after another, in each the fastest behind the others.

    Attributes:
        order: Which of the rows of all logs they are, shape (m,).
        ends: Where those of each block and its fastest begin, and the end, shape (2 B + 1,).
        shared: Rows of the columns that every pool has, and of the torque, shape (k, m).
    """

    order: IntArray
    ends: IntArray
    shared: Array

    @classmethod
    def of(cls, group: IntArray, shared: Array, places: IntArray, groups: int) -> _JointRows:
        """Return the rows whose ``group`` (N,) is not -1, of ``shared`` ones (k, N) that have these places (N,)."""
        order = np.argsort(group, kind="stable")[np.sum(group < 0) :]
        return cls(places[order], np.searchsorted(group[order], np.arange(groups + 1)), shared[:, order])

    @cached_property
    def _known(self) -> Array:
        """The products of the shared columns, shape (2 B, k, k)."""
        return np.stack([own @ own.T for own in np.split(self.shared, self.ends[1:-1], axis=1)])

    def products(self, friction: Array) -> tuple[Array, Array]:
        """Return the products of each block, and of the fastest rows, with friction (f, m): (B or 1, k_i, k_i)."""
        known = len(self.shared)
        found = np.empty((len(self._known), known + len(friction), known + len(friction)))
        found[:, :known, :known] = self._known
        for each, (first, stop) in zip(found, itertools.pairwise(self.ends.tolist()), strict=True):
            own = friction[:, first:stop]
            np.matmul(own, self.shared[:, first:stop].T, out=each[known:, :known])
            np.matmul(own, own.T, out=each[known:, known:])
        found[:, :known, known:] = found[:, known:, :known].transpose(0, 2, 1)
        return found[::2] + found[1::2], found[1::2].sum(axis=0, keepdims=True)


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
