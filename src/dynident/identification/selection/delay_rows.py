"""The rows that a search for the delay of a log needs: made and reduced once, then asked for any delay.

A delay moves the torque against the motion, and the filter of both sides is the same at all times, so what stands for
the motion earlier, W(t - d) beta = tau(t), stands for the torque later: W(t) beta = tau(t + d). W, what is at rest and
what is near a reversal stay as they are; W = Q R is made once for each joint, and a delay asks for Q' tau(t + d) alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.preprocessing import Prepared, thinned
from dynident.data.preprocessing._local_polynomials import fractional_shift
from dynident.identification.problem.problem import counting_rows
from dynident.identification.problem.regressor_stream import RegressorStream, motion_of, target_torque
from dynident.model.dynamic_model import DynamicModel
from dynident.model.reduction import Triangle, triangle_of

#: Rows in a period of the cut-off that the search looks at.
ROWS = 8.0

#: Rows nearer to a reversal than this part of the period of the cut-off have a share of what happens there.
REVERSAL = 0.5

#: Parts of each log of which each is left out in turn, and pieces of the log that they are made of in turn.
PARTS, PIECES = 4, 32

#: Delays in s that the rows of a log are made for at first: either end of it loses so much where nothing is trimmed.
RANGE = 0.05

#: Rows that are looked at altogether, and rows of a stretch where that leaves some out.
MOST, STRETCH = 100_000, 1000

#: Weights of the central difference over four rows to either side: exact to the eighth power of time.
_SLOPE = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])


@dataclass(frozen=True)
class Share:
    """Some rows of one joint in all logs, W = Q R.

    Attributes:
        columns: Positions in beta of the columns of W, shape (K,).
        rows: Which of all rows of the logs they are, shape (m,).
        q: Shape (m, min(m, K)).
        r: Shape (min(m, K), K).
    """

    columns: IntArray
    rows: IntArray
    q: Array
    r: Array

    def triangle(self, torque: Array, more: Array | None = None, places: Sequence[int] = ()) -> Triangle:
        """Return the triangle of [W, tau], with more columns before the torque if given.

        Args:
            torque: Of all rows of the logs, shape (N,).
            more: The other columns, shape (N, k).
            places: Their positions in beta.
        """
        values = torque[self.rows, None] if more is None else np.column_stack([more, torque])[self.rows]
        inside = self.q.T @ values
        rest = triangle_of(values - self.q @ inside)
        factor = np.vstack([np.hstack([self.r, inside]), np.hstack([np.zeros((len(rest), self.r.shape[1])), rest])])
        return Triangle(np.append(self.columns, np.array(places, dtype=np.int64)), factor, len(self.rows))


def together(parts: Sequence[Share]) -> Share:
    """Return the rows of several shares of a joint as one."""
    turn, r = np.linalg.qr(np.concatenate([part.r for part in parts]))
    turns = np.split(turn, np.cumsum([len(part.r) for part in parts])[:-1])
    q = np.concatenate([part.q @ own for part, own in zip(parts, turns, strict=True)])
    return Share(parts[0].columns, np.concatenate([part.rows for part in parts]), q, r)


def shares_of(logs: Sequence[DelayRows], masks: Sequence[BoolArray]) -> list[Share]:
    """Return the rows of each joint in some logs that count by ``masks``, shape (N, n) of each log."""
    found = []
    for i, own in enumerate(logs[0].columns):
        block = np.concatenate([log.blocks[i][:, mask[:, i]] for log, mask in zip(logs, masks, strict=True)], axis=1)
        found.append(Share(own, np.flatnonzero(np.concatenate([mask[:, i] for mask in masks])), *np.linalg.qr(block.T)))
    return found


class DelayRows:
    """Rows of one log under the delays of a range.

    Attributes:
        rate: Samples a second of the log.
        low: Shortest delay in s that the rows are there for, 0 or less.
        high: Longest one.
        columns: Positions in beta of the columns of each joint, shape (K_i,).
        blocks: Filtered columns W_i' of each joint, shape (K_i, N).
        counting: Which rows count for each joint, shape (N, n).
        away: Which of these are away from reversals, shape (N, n).
        part: In which of ``PARTS`` parts of the log each row is, shape (N,).
    """

    def __init__(
        self,
        regressor: RegressorStream,
        prepared: Prepared,
        low: float,
        high: float,
        part: int = 1,
        before: DelayRows | None = None,
    ) -> None:
        log, how = prepared.log, prepared.how
        self.rate, self.low, self.high = log.rate, min(low, -how.trim_s), max(high, how.trim_s)
        time, slack = log.time[prepared.keep], 1e-6 / log.rate
        inside = (time >= log.time[0] - self.low - slack) & (time <= log.time[-1] - self.high + slack)
        inside &= np.arange(len(time)) // STRETCH % part == 0
        self._rows = replace(prepared, keep=prepared.keep[inside])
        self.columns, independent = regressor.columns, regressor.base.independent
        self._bodies = independent[independent < regressor.model.inertial_count]
        self._known = (np.asarray(log.torque) - target_torque(regressor.model, prepared))[self._rows.keep]
        self.blocks = [np.zeros((len(own), 0)) for own in regressor.columns]
        if len(self._rows.keep):
            self.blocks = self._made(regressor, before)
        keep = self._rows.keep
        self._steep = np.zeros(len(keep), bool)  # where a slope can be told: no gap is near
        reach, step = len(_SLOPE), self._rows.every
        self._steep[reach:-reach] = keep[2 * reach :] - keep[: -2 * reach] == 2 * reach * step
        self.counting = counting_rows(regressor.model, self._rows) & self._steep[:, None]
        self.away = self.counting & ~_near_reversal(regressor.model, self._rows)
        self.part = np.arange(len(keep)) * PIECES // max(len(keep), 1) % PARTS

    def _made(self, regressor: RegressorStream, before: DelayRows | None) -> list[Array]:
        """Return the columns; where rows ``before`` have those of the same bodies, only those of friction are new."""
        pairs = [] if before is None else [(before._rows.keep, self._rows.keep), (before._bodies, self._bodies)]
        if before is None or not all(np.array_equal(*pair) for pair in pairs):
            return [block[:-1] for block in regressor.rows(self._rows)]
        friction = RegressorStream(regressor.model, regressor.base, only="friction")
        parts = zip(before.blocks, self.columns, friction.columns, friction.rows(self._rows), strict=True)
        return [np.concatenate([old[: len(own) - len(some)], new[:-1]]) for old, own, some, new in parts]

    def torque(self, delay_s: float) -> Array:
        """Return the torque less the known one that belongs to each row under a delay, shape (N, n)."""
        measured = np.asarray(self._rows.log.torque)
        return fractional_shift(measured, -delay_s * self.rate, self._rows.keep) - self._known

    def predicted(self, beta: Array) -> Array:
        """Return the torque of the model less the known one at ``beta`` (b,), filtered, shape (N, n)."""
        pairs = zip(self.columns, self.blocks, strict=True)
        return np.stack([beta[own] @ block for own, block in pairs], axis=1)

    def slope(self, signal: Array) -> Array:
        """Return the derivative by time of a signal (N, n) over the rows; 0 where rows near by are left out."""
        found = np.zeros_like(signal)
        reach = len(_SLOPE)
        for k, weight in enumerate(_SLOPE, start=1):
            found[reach:-reach] += weight * (
                signal[reach + k : len(signal) - reach + k] - signal[reach - k : -reach - k]
            )
        found[~self._steep] = 0.0
        return found * (self.rate / self._rows.every)


def dense_rows(plain: Prepared) -> Prepared:
    """Return a preprocessed log with so many rows in a period of the cut-off that they tell its slopes, and no more."""
    cutoff = plain.how.filter.bandwidth()
    filtered = cutoff is not None and plain.how.filter.reach(plain.log.rate) > 0
    if filtered and plain.log.rate / plain.every < ROWS * float(cutoff or 0.0):
        how = replace(plain.how, rate_hz=None, rows_per_period=ROWS)
        return thinned(plain.log, how)
    return plain.sparser(ROWS)


def _near_reversal(model: DynamicModel, prepared: Prepared) -> BoolArray:
    """Return which of the kept rows the filter mixes with a reversal of one of the joint's drives, shape (N, n)."""
    cutoff = prepared.how.filter.bandwidth()
    speeds = motion_of(prepared.log).dq @ np.asarray(model.robot.coupling).T
    reach = int(np.ceil(REVERSAL / cutoff * prepared.log.rate)) if cutoff else 1
    turning = np.zeros(speeds.shape)
    turning[1:] = speeds[1:] * speeds[:-1] <= 0
    passed = np.pad(np.cumsum(turning, axis=0), ((reach + 1, reach), (0, 0)), mode="edge")
    passed[: reach + 1] = 0.0
    near = (passed[2 * reach + 1 :] - passed[: -2 * reach - 1])[prepared.keep] > 0
    return (near @ (np.asarray(model.robot.coupling) != 0)) > 0
