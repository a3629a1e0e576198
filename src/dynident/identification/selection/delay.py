"""The delay of a log's torque behind its positions, from the log itself.

A delay d turns the model into tau(t) = Y(t - d) theta. The derivative of the torque by d is minus its derivative by
time, so d is one more column of the linear problem: Gauss and Newton's method on the problem in which the linear
parameters are eliminated (Golub and Pereyra 1973), with one column for each joint of each log.

The joints of a log have one clock. By what their delays differ beyond chance, friction differs from the model, which
counts in the deviation of their mean (DerSimonian and Laird 1986). Where they differ so, or where the rows away from
reversals say something else (Hausman 1978), these rows alone count: the friction of a drive that sticks turns before
its speed does, which passes for a torque that runs ahead. These rows may be few. Where all rows ask for a longer lag,
which is nothing that such drives feign, the data decide: both are tried on parts of the logs that the fit has not seen
(Stone 1974), and the one with the smaller error is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.preprocessing import LONGEST_DELAY, Prepared, thinned
from dynident.identification.problem.choices import DelayRecord
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.residuals.covariance import correlation_factors
from dynident.identification.residuals.quantiles import chi_square_tail, normal_share, student_quantile
from dynident.identification.selection.delay_rows import (
    MOST,
    PARTS,
    RANGE,
    DelayRows,
    Share,
    dense_rows,
    shares_of,
    together,
)
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.presliding import Presliding
from dynident.model.reduction import Triangle, least_squares, reduce, without_own

#: A step below this share of a sample ends the search.
SETTLED = 0.02

#: Steps at most, and the longest one in s: what a straight line through the torque may be asked to bridge.
STEPS, LONGEST_STEP = 25, 0.05

#: A delay that is not this many of its standard deviations away from zero is none; more, by Student's t, where its
#: joints do not agree.
SIGNIFICANT = 2.0

#: Lengths in rad or m of elements of friction that remembers, beside which a delay is found as well, and the share of
#: the mean square on parts not seen that these leave at most where they have passed for a delay.
LENGTHS, LEFT = (1e-3, 4e-3, 1.6e-2, 5e-2), 0.5

#: Shares of the delay without such friction at which the search beside it may begin.
STARTS = (0.0, 0.2, 0.4, 0.7, 1.0)

#: Joints whose delays would differ as much by chance in fewer than this share of logs do not agree.
CHANCE = 0.05


def find_delays(
    model: DynamicModel,
    base: BaseParameters,
    plain: Sequence[Prepared],
    within: Sequence[float] = (),
    may_lag: bool = True,
) -> tuple[tuple[DelayRecord, ...], tuple[Prepared, ...]]:
    """Return the delay of each log, and the logs with their motion shifted by it.

    Friction that builds up over a distance lags, as a late torque does: beside it a delay lies between none and that
    which is found without it. What it asks for beyond these is the shape of the friction, not a delay. Where a model
    cannot have such friction and that explains most of what model and delay leave of parts not seen, it counts.

    Args:
        model: A model whose friction does not depend on the load.
        base: Its base parameters.
        plain: Preprocessed logs, joints in the order of the robot, motion and torque as they came.
        within: The delays in s without friction that remembers, where the model has some; else none.
        may_lag: Whether the model has friction that remembers, or is yet to be compared with one that has.

    Raises:
        LogMismatch: A log is too short.
    """
    search = _DelaySearch(RegressorStream(model, base), plain)
    found = search.delays
    if not (may_lag or model.lags) and any(delay.applied > 0.0 for delay in found):
        memory = tuple(Presliding(length=length, element=k, damping=True) for k, length in enumerate(LENGTHS, 1))
        beside = replace(model, friction=(*model.friction, *memory))
        other = _DelaySearch(RegressorStream(beside, base_parameters(beside)), plain, search)
        within = [delay.applied for delay in found]
        starts = [tuple(replace(one, applied=share * one.applied) for one in found) for share in STARTS]
        other.move_to(np.array([delay.applied for delay in min(starts, key=other.unseen)]), other.beta)
        beside_it = _asked_by_all_rows(other)
        found = beside_it if other.unseen(beside_it) < search.unseen(found) + np.log(LEFT) else found
    if within:
        pairs = [(one, *sorted((0.0, end))) for one, end in zip(found, within, strict=True)]
        found = tuple(replace(one, applied=min(max(one.applied, low), high)) for one, low, high in pairs)
    parts = zip(plain, found, strict=True)
    return found, tuple(thinned(log.log, log.how, delay.applied) if delay.applied else log for log, delay in parts)


def common_delay(delays: Sequence[DelayRecord]) -> float:
    """Return the delay in s to be expected of another log of the same robot: the mean, the surest counting most."""
    weights = np.array([1.0 / min(max(delay.std, 1e-9), 1e9) ** 2 for delay in delays])
    return float(weights @ [delay.applied for delay in delays] / weights.sum())


def _asked_by_all_rows(search: _DelaySearch) -> tuple[DelayRecord, ...]:
    """Return the delays that leave the least of all rows, the joints' friction taken for that of the model."""
    step = search.settled(pooled=True)
    return _significant(search, step.deviation, SIGNIFICANT)


def _away_from_reversals(search: _DelaySearch) -> tuple[DelayRecord, ...]:
    """Return the delays that the joints agree about, without the rows near reversals where these say something else."""
    step = search.settled()
    away = search.step(np.ones(len(search.rows), bool))
    doubt = np.sqrt(np.maximum(np.minimum(away.deviation, 1e9) ** 2 - np.minimum(step.deviation, 1e9) ** 2, 0.0))
    biased = ~step.agree | (np.abs(away.seconds) > SIGNIFICANT * doubt)
    if biased.any():
        step = search.settled(biased)
    degrees = np.where(step.agree, np.inf, max(search.regressor.model.robot.dof - 1, 1))
    return _significant(search, step.deviation, student_quantile(normal_share(SIGNIFICANT), degrees))


def _significant(search: _DelaySearch, deviation: Array, bound: Array | float) -> tuple[DelayRecord, ...]:
    """Return delays, of which those within ``bound`` deviations of zero are not applied."""
    applied = np.where(np.abs(search.seconds) > bound * deviation, search.seconds, 0.0)
    table = np.stack([search.seconds, deviation, applied], axis=1).tolist()
    return tuple(DelayRecord(log.log.name, *own) for log, own in zip(search.prepared, table, strict=True))


@dataclass(frozen=True)
class _Step:
    """A step of Gauss and Newton.

    Attributes:
        beta: Base parameters, shape (b,).
        seconds: By how much the delay of each log changes, in s, shape (L,).
        deviation: Standard deviations of the delays, in s, shape (L,).
        agree: Whether the joints of each log agree about it, shape (L,).
    """

    beta: Array
    seconds: Array
    deviation: Array
    agree: BoolArray


class _DelaySearch:
    """The delays as far as they are known, and the rows of the logs."""

    def __init__(
        self, regressor: RegressorStream, plain: Sequence[Prepared], before: _DelaySearch | None = None
    ) -> None:
        self.regressor = regressor
        self.prepared = [dense_rows(log) for log in plain] if before is None else before.prepared
        self.part = -(-sum(len(log.keep) for log in self.prepared) // MOST)
        known = [None] * len(plain) if before is None else before.rows
        pairs = zip(self.prepared, known, strict=True)
        self.rows = [DelayRows(regressor, log, -RANGE, RANGE, self.part, own) for log, own in pairs]
        self._made: dict[int | tuple[bool, ...], list[Share]] = {}
        self.seconds: Array = np.zeros(len(plain))
        self.beta = _weighted_fit(
            regressor.base.count, self._triangles(np.zeros(len(plain), bool), self._torques(self.seconds))
        )

    @cached_property
    def delays(self) -> tuple[DelayRecord, ...]:
        """Those away from reversals, or of all rows where they lag more and predict parts not seen better."""
        whole, careful = _asked_by_all_rows(self), _away_from_reversals(self)
        asked = tuple(max(pair, key=lambda one: one.applied) for pair in zip(careful, whole, strict=True))
        pairs = zip(asked, careful, self.rows, strict=True)
        is_apart = any(abs(one.applied - other.applied) * log.rate >= SETTLED for one, other, log in pairs)
        return asked if is_apart and self.unseen(asked) < self.unseen(careful) else careful

    def settled(self, away: BoolArray | None = None, *, pooled: bool = False) -> _Step:
        """Take steps until they are short, and return the last; arguments as of :meth:`step`."""
        away = np.zeros(len(self.rows), bool) if away is None else away
        step = self.step(away, pooled=pooled)
        for left in reversed(range(STEPS)):
            bounded = np.clip(step.seconds, -LONGEST_STEP, LONGEST_STEP)
            self.move_to(np.clip(self.seconds + bounded, -LONGEST_DELAY, LONGEST_DELAY), step.beta)
            if not left or np.all(np.abs(bounded) * [log.rate for log in self.rows] < SETTLED):
                break
            step = self.step(away, pooled=pooled)
        return step

    def step(self, away: BoolArray, *, pooled: bool = False) -> _Step:
        """Return the step from here.

        Args:
            away: Logs of which only rows away from reversals count, shape (L,).
            pooled: Whether what the joints differ by counts as noise of their rows, not as a doubt of its own.
        """
        masks = self._masks(away)
        torques = self._torques(self.seconds)
        predicted = [log.predicted(self.beta) for log in self.rows]
        residuals = [torque - model for torque, model in zip(torques, predicted, strict=True)]
        squares = sum(np.sum(np.where(mask, r, 0.0) ** 2, axis=0) for mask, r in zip(masks, residuals, strict=True))
        weights = _weights(np.asarray(squares), np.sum([mask.sum(axis=0) for mask in masks], axis=0))
        size, joints, logs = self.regressor.base.count, self.regressor.model.robot.dof, len(self.rows)
        slopes, ends = np.zeros((joints, sum(map(len, predicted)), logs)), np.cumsum([0, *map(len, predicted)])
        for k, (log, model) in enumerate(zip(self.rows, predicted, strict=True)):  # a column for each log
            slopes[:, ends[k] : ends[k + 1], k] = -log.slope(model).T
        places = size + np.arange(joints * logs).reshape(logs, joints)
        triangles = self._triangles(away, torques, slopes, places)
        reduced = reduce(triangles, size + joints * logs, weights)
        solution = least_squares(reduced)
        # Rows that hang together count once, each joint's by how its own do.
        factors = correlation_factors(residuals, masks)
        factors = np.full(joints, factors.mean()) if pooled else factors
        worth = np.sqrt(np.tile(factors, len(self.rows)) * reduced.rest / max(reduced.rows, 1))
        covariance = solution.unscaled_covariance[size:, size:] * np.outer(worth, worth)
        parts = [slice(k * joints, (k + 1) * joints) for k in range(len(self.rows))]
        means = [_common(solution.beta[size:][part], covariance[part, part], pooled) for part in parts]
        seconds, deviation, agree = (np.array(each) for each in zip(*means, strict=True))
        return _Step(solution.beta[:size], seconds, deviation, agree)

    def unseen(self, delays: Sequence[DelayRecord]) -> float:
        """Return how badly fits under delays predict parts of the logs that they leave out.

        That is the joints' mean logarithm of the mean square.
        """
        torques = self._torques(np.array([delay.applied for delay in delays]))
        parts = [_of_shares(self._part(k), torques) for k in range(PARTS)]
        squares, rows = np.zeros(self.regressor.model.robot.dof), np.zeros(self.regressor.model.robot.dof)
        for k, left_out in enumerate(parts):
            seen = list(zip(*parts[:k], *parts[k + 1 :], strict=True))
            shared, count, completed = without_own(seen, self.regressor.base.count)
            beta = completed(_weighted_fit(count, shared))
            squares += [triangle.residual_square(beta) for triangle in left_out]
            rows += [triangle.rows for triangle in left_out]
        return float(np.average(np.log(np.maximum(squares, np.finfo(float).tiny) / np.maximum(rows, 1)), weights=rows))

    def move_to(self, seconds: Array, beta: Array) -> None:
        """Go on from delays (L,) and base parameters (b,)."""
        self.seconds, self.beta = seconds, beta
        for k, (log, delay) in enumerate(zip(self.rows, seconds.tolist(), strict=True)):
            if not log.low <= delay <= log.high:
                low, high = min(log.low, delay - RANGE), max(log.high, delay + RANGE)
                self.rows[k] = DelayRows(self.regressor, self.prepared[k], low, high, self.part)
                self._made.clear()

    def _torques(self, seconds: Array) -> list[Array]:
        """Return the torques (N, n) that belong to the rows of each log under delays (L,)."""
        return [log.torque(delay) for log, delay in zip(self.rows, seconds.tolist(), strict=True)]

    def _masks(self, away: BoolArray) -> list[BoolArray]:
        """Return the rows of each log that count, shape (N, n); of the logs ``away`` (L,) those away from reversals."""
        return [log.away if only else log.counting for log, only in zip(self.rows, away, strict=True)]

    def _triangles(
        self, away: BoolArray, torques: Sequence[Array], more: Array | None = None, places: IntArray | None = None
    ) -> list[Triangle]:
        """Return the triangle of each joint of the rows of :meth:`_masks`; those of all rows are those of their parts.

        Args:
            away: Logs of which only rows away from reversals count, shape (L,).
            torques: Of each log, shape (N, n).
            more: More columns of each joint, shape (n, N, k); None for none.
            places: Their positions in beta, shape (k, n).
        """
        name = tuple(away.tolist())
        if name not in self._made:
            parts = () if away.any() else zip(*map(self._part, range(PARTS)), strict=True)
            self._made[name] = list(map(together, parts)) or shares_of(self.rows, self._masks(away))
        return _of_shares(self._made[name], torques, more, places)

    def _part(self, number: int) -> list[Share]:
        """Return the rows that count of each joint in one of the parts of the logs."""
        if number not in self._made:
            masks = [log.counting & (log.part == number)[:, None] for log in self.rows]
            self._made[number] = shares_of(self.rows, masks)
        return self._made[number]


def _of_shares(
    shares: Sequence[Share], torques: Sequence[Array], more: Array | None = None, places: IntArray | None = None
) -> list[Triangle]:
    """Return the triangle of each joint with torques (N, n) of each log; and more columns, if given."""
    torque = np.concatenate(torques)
    if more is None or places is None:
        return [share.triangle(torque[:, i]) for i, share in enumerate(shares)]
    return [share.triangle(torque[:, i], more[i], places[:, i].tolist()) for i, share in enumerate(shares)]


def _common(delays: Array, covariance: Array, pooled: bool) -> tuple[float, float, bool]:
    """Return the mean of the joints' delays (n,), its standard deviation, and whether they agree.

    What they differ by beyond their covariance is a variance of its own, by the method of moments (DerSimonian and
    Laird 1986) for estimates that depend on each other.
    """
    telling = np.diag(covariance) > 0
    if not telling.any():
        return 0.0, np.inf, True
    delays, covariance = delays[telling], covariance[np.ix_(telling, telling)]
    ones, weights = np.ones(len(delays)), np.linalg.pinv(covariance, hermitian=True)
    total = float(ones @ weights @ ones)
    mean = float(ones @ weights @ delays) / total
    excess = float((delays - mean) @ weights @ (delays - mean)) - (len(delays) - 1)
    scale = float(np.trace(weights) - ones @ weights @ weights @ ones / total)
    if not pooled and len(delays) > 1 and excess > 0 and scale > 0:
        weights = np.linalg.pinv(covariance + excess / scale * np.eye(len(delays)), hermitian=True)
        total = float(ones @ weights @ ones)
        mean = float(ones @ weights @ delays) / total
    agree = len(delays) < 2 or chi_square_tail(excess + len(delays) - 1, len(delays) - 1) > CHANCE
    return mean, float(1.0 / np.sqrt(total)), bool(agree)


def _weights(squares: Array, rows: Array) -> Array:
    """Return the weights of the joints from their sums of squared residuals (n,), shape (n,)."""
    mean = squares / np.maximum(rows, 1)
    return 1.0 / np.sqrt(np.maximum(mean, 1e-24 * mean.max() + 1e-300))


def _weighted_fit(size: int, triangles: Sequence[Triangle]) -> Array:
    """Return beta (size,) of triangles, one per joint, each weighted by its own residual."""
    weights, beta = np.ones(len(triangles)), np.zeros(size)
    for _ in range(3):
        beta = least_squares(reduce(triangles, size, weights)).beta
        squares = np.array([triangle.residual_square(beta) for triangle in triangles])
        weights = _weights(squares, np.array([triangle.rows for triangle in triangles]))
    return beta
