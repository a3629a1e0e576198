"""Adds up the windows of one log to a digest, in constant memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.identification.problem.problem import counting_rows
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.streaming.digest import MOST, SAMPLED, Digest, JointRows, Sampled, States
from dynident.identification.streaming.windows import Window
from dynident.model.reduction import CHUNK, absorb, merged_pairs
from dynident.model.threads import one_blas_thread

#: Time of a stretch to begin with, in s; stretches are merged in pairs when there are too many.
STRETCH = 2.0

#: Fewest rows of a stretch.
_FEWEST = 32

#: Some of the kept rows of a window, and the filtered rows of each joint there.
Segment: TypeAlias = tuple[slice, tuple[Array, ...]]

_SIGNALS = ("time", "q", "dq", "measured", "unfiltered")


class Tally:
    """What has been added up so far.

    Attributes:
        rows: Rows used so far.
        stretch: Rows of a stretch.
        stride: One row in how many is kept as it is.
        states: Where the rows lie; None before the first.
    """

    def __init__(self, regressor: RegressorStream, rate: float, expected: int) -> None:
        """Begin.

        Args:
            regressor: What makes rows from windows.
            rate: Samples a second that are used.
            expected: Rows that will come, about.
        """
        self.rows, self.stretch = 0, max(_FEWEST, round(STRETCH * rate))
        self._regressor, self.stride = regressor, max(1, expected // SAMPLED)
        sizes = [len(columns) + 1 for columns in regressor.columns]
        self._factors: list[list[Array]] = [[] for _ in sizes]
        self._sums: list[list[Array]] = [[] for _ in sizes]
        self._counts: list[list[int]] = [[] for _ in sizes]
        self._resting: list[Array] = [np.zeros((size, size), order="F") for size in sizes]
        self._rested = [0 for _ in sizes]
        self._products: list[Array] = [np.zeros((2, 3, size + 3)) for size in sizes]
        self._sampled: dict[str, list[Array]] = {name: [] for name in _SIGNALS}
        self._sampled_rows: list[list[Array]] = [[] for _ in sizes]
        self.states: States | None = None

    def add(self, window: Window, segments: Sequence[Segment]) -> None:
        """Add the next window and its rows, as :meth:`RegressorStream.segments` makes them."""
        prepared = window.prepared
        self._add_states(window)
        mask = counting_rows(self._regressor.model, prepared)
        kept = prepared.kept
        measured = np.asarray(kept.torque)
        taken = np.asarray(kept.raw_torque) - measured
        with one_blas_thread():
            for part, blocks in segments:
                self._add_rows(blocks, mask[part], measured[part], taken[part])
                self._sample(window, part, blocks)
                self.rows += int(part.stop - part.start)
        if len(self._counts[0]) > 2 * MOST:
            self._halve()

    @classmethod
    def resumed(cls, regressor: RegressorStream, digest: Digest, rows: int, stretch: int, stride: int) -> Tally:
        """Return a tally that goes on where another was when its digest was taken; the figures are its attributes."""
        tally = cls(regressor, 1.0, 1)
        tally.rows, tally.stretch, tally.stride, tally.states = rows, stretch, stride, digest.states
        for i, joint in enumerate(digest.joints):
            tally._factors[i] = [np.asfortranarray(factor) for factor in joint.factors]
            tally._sums[i], tally._counts[i] = list(joint.sums), joint.counts.tolist()
            tally._resting[i], tally._rested[i] = np.asfortranarray(joint.resting), joint.rested
            tally._products[i] = np.array(joint.products)
            tally._sampled_rows[i] = [digest.sampled.rows[i]]
        tally._sampled = {name: [getattr(digest.sampled, name)] for name in _SIGNALS}
        return tally

    def joints(self) -> tuple[JointRows, ...]:
        """Return the rows of each joint."""
        found = []
        for i, columns in enumerate(self._regressor.columns):
            size = len(columns) + 1
            rows = JointRows(
                columns=columns,
                factors=np.array([np.triu(factor) for factor in self._factors[i]]).reshape(-1, size, size),
                sums=np.array(self._sums[i]).reshape(-1, size),
                counts=np.array(self._counts[i], dtype=np.int64),
                resting=np.triu(self._resting[i]),
                rested=self._rested[i],
                products=self._products[i],
            )
            found.append(rows)
        return tuple(found)

    def sampled(self) -> Sampled:
        """Return the rows that are kept as they are."""
        signals: dict[str, Any] = {name: np.concatenate(parts) for name, parts in self._sampled.items()}
        rows = tuple(np.concatenate(parts) for parts in self._sampled_rows)
        return Sampled(**signals, rows=rows, starts=(0,))

    def _add_rows(self, blocks: tuple[Array, ...], mask: BoolArray, measured: Array, taken: Array) -> None:
        """Add rows [W_i, tau_i]' of each joint, shape (K_i + 1, m), which count where ``mask`` (m, n) says so."""
        done = 0
        while done < len(mask):
            number, within = divmod(self.rows + done, self.stretch)
            stop = min(len(mask), done + self.stretch - within)
            part = slice(done, stop)
            for i, block in enumerate(blocks):
                if number == len(self._counts[i]):
                    self._begin(i, len(block))
                own = block[:, part]
                extra = np.stack([np.ones(stop - done), measured[part, i], taken[part, i]])
                keep = mask[part, i]
                for kind, chosen in enumerate((keep, ~keep)):
                    if chosen.any():
                        whole = chosen.all()
                        self._add_joint(i, kind, own if whole else own[:, chosen], extra if whole else extra[:, chosen])
            done = stop

    def _add_joint(self, i: int, kind: int, rows: Array, extra: Array) -> None:
        size = len(rows)
        sums = extra @ rows.T
        self._products[i][kind, :, :size] += sums
        self._products[i][kind, :, size:] += extra @ extra.T
        for start in range(0, rows.shape[1], CHUNK):
            panel = np.array(rows[:, start : start + CHUNK], order="C").T  # it is overwritten
            if kind:
                self._resting[i] = absorb(self._resting[i], panel)
            else:
                self._factors[i][-1] = absorb(self._factors[i][-1], panel)
        if kind:
            self._rested[i] += rows.shape[1]
        else:
            self._sums[i][-1] = self._sums[i][-1] + sums[0]
            self._counts[i][-1] += rows.shape[1]

    def _begin(self, i: int, size: int) -> None:
        self._factors[i].append(np.zeros((size, size), order="F"))
        self._sums[i].append(np.zeros(size))
        self._counts[i].append(0)

    def _halve(self) -> None:
        """Merge stretches in pairs; those to come are twice as long."""
        for i, counts in enumerate(self._counts):
            merged = merged_pairs(np.array([np.triu(factor) for factor in self._factors[i]]))
            self._factors[i] = [np.asfortranarray(factor) for factor in merged]
            starts = np.arange(0, len(counts), 2)
            self._sums[i] = list(np.add.reduceat(np.array(self._sums[i]), starts, axis=0))
            self._counts[i] = np.add.reduceat(counts, starts).tolist()
        self.stretch *= 2

    def _sample(self, window: Window, part: slice, blocks: tuple[Array, ...]) -> None:
        first = (-self.rows) % self.stride
        chosen = np.arange(part.start + first, part.stop, self.stride)
        kept = window.prepared.kept
        signals = {"q": kept.q, "dq": kept.dq, "measured": kept.torque, "unfiltered": kept.raw_torque}
        for name, values in ({"time": window.time} | signals).items():
            self._sampled[name].append(np.asarray(values)[chosen])
        for rows, block in zip(self._sampled_rows, blocks, strict=True):
            rows.append(block[:, chosen - part.start].T.copy())

    def _add_states(self, window: Window) -> None:
        log, own = window.prepared.log, window.inner
        kept, q = window.prepared.kept, log.q[own]
        used = np.concatenate([kept.q, np.asarray(kept.dq), np.asarray(kept.ddq)], axis=1)
        torque = np.asarray(log.torque if log.raw_torque is None else log.raw_torque)[own]
        width = used.shape[1]
        mean = used.mean(axis=0) if len(used) else np.zeros(width)
        fresh = States(
            count=len(used),
            low=used.min(axis=0, initial=np.inf),
            high=used.max(axis=0, initial=-np.inf),
            mean=mean,
            spread=(used - mean).T @ (used - mean),
            far=np.empty((0, width)),
            samples=own.stop - own.start,
            accelerations=np.sum(np.asarray(log.ddq)[own] ** 2, axis=0),
            positions=np.stack([q.min(axis=0), q.max(axis=0)]),
            torques=np.stack([torque.min(axis=0), torque.max(axis=0)]),
        )
        found = fresh if self.states is None else self.states.merged(fresh)
        self.states = replace(found, far=found.furthest(np.concatenate([found.far, used])))
