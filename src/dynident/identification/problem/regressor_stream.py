"""The rows of a log: the base observation matrix joint by joint, in chunks, and their triangles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.log import Log, measured_torque
from dynident.data.preprocessing import Prepared
from dynident.errors import LogMismatch
from dynident.identification.problem.thinned_rows import stretch_of, stretches, thinned_rows
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.kernels.batched import JointColumns
from dynident.model.reduction import CHUNK, Triangle, absorb, absorber
from dynident.model.threads import in_order, one_blas_thread, threads_that_pay

#: A slice of the kept rows, and [W_i, tau_i]' of each joint there; some of them, one after another.
RowSegment: TypeAlias = tuple[slice, tuple[Array, ...]]
Segments: TypeAlias = Iterable[RowSegment]

#: Rows of a part of a log that nothing filters, and threads at most that reduce parts: each holds one.
PART, THREADS = 128 * CHUNK, 4


class RegressorStream:
    """Streams a log into the rows of the base observation matrix, joint by joint, in chunks that stay in the cache.

    Where friction depends on the load, ``load`` (b,) are the base parameters whose torque without friction it is.
    Robots that differ in their gravity alone share code where ``any_gravity`` is stated. With ``only`` the rows have
    the columns of friction alone, or those of them that depend on the load.
    """

    def __init__(
        self,
        model: DynamicModel,
        base: BaseParameters,
        load: Array | None = None,
        any_gravity: bool = False,
        only: Literal["", "friction", "load"] = "",
    ) -> None:
        self.model, self.base, self.load = model, base, load
        inertial = base.independent[base.independent < model.inertial_count]
        self._kernel = JointColumns(model.robot.chain, inertial, any_gravity)
        friction = base.independent[base.independent >= model.inertial_count] - model.inertial_count
        self._drive, self._coefficient = (found[friction] for found in model.terms)
        self._term = self._coefficient * model.robot.dof + self._drive
        self._inertial, self._any_gravity, self._only = len(inertial), any_gravity, only
        needing = [("torque" in part.needs) for part in model.friction for _ in part.coefficients]
        wanted = np.array(needing, dtype=bool)[self._coefficient] | (only != "load")
        coupling = np.asarray(model.robot.coupling)
        self._own: list[IntArray] = []
        columns: list[IntArray] = []
        for i in range(model.robot.dof):
            own = np.flatnonzero((coupling[self._drive, i] != 0) & wanted)
            heads = self._kernel.columns[i][:0] if only else self._kernel.columns[i]
            self._own.append(own)
            columns.append(np.concatenate([heads, len(inertial) + own]).astype(np.int64))
        self.columns: tuple[IntArray, ...] = tuple(columns)

    def of_load(self) -> RegressorStream:
        """Return what makes the columns that depend on the load alone, in the same segments."""
        return RegressorStream(self.model, self.base, self.load, self._any_gravity, only="load")

    def rows(self, prepared: Prepared, motion: Motion | None = None) -> tuple[Array, ...]:
        """Return [W_i, tau_i]' of each joint over the kept rows, both sides filtered, shape (K_i + 1, N)."""
        parts = [blocks for _, blocks in self.segments(prepared, motion)]
        return tuple(np.concatenate(joint, axis=1) for joint in zip(*parts, strict=True))

    def predict(self, log: Log, beta: Array) -> Array:
        """Return the torque of the model at ``beta`` (b,), with the known torque, not filtered, shape (N, n)."""
        return self.model.torque(remembered_motion(self.model, log), self.base.to_standard(beta))

    def triangles(
        self, prepared: Prepared, mask: BoolArray, parts: Sequence[Segments] | None = None
    ) -> tuple[Triangle, ...]:
        """Return the triangle of each joint over the kept rows in ``mask`` (N, n); no row is kept.

        Parts of the log are reduced side by side and merged in their order, so that the number of processors changes
        no bit.

        Args:
            prepared: The log.
            mask: Which of the kept rows count.
            parts: Its rows, of :meth:`parts`, where they are there already; they stay as they are.
        """
        made = self.parts(prepared) if parts is None else parts
        everything = bool(mask.all())

        def reduced(part: Segments) -> list[Array]:
            own: list[Array] = [np.zeros((len(columns) + 1, len(columns) + 1), order="F") for columns in self.columns]
            take = absorber(len(mask))
            for rows, blocks in part:
                for i, block in enumerate(blocks):
                    chosen = block if everything else block[:, mask[rows, i]]
                    for start in range(0, chosen.shape[1], CHUNK):
                        cut = chosen[:, start : start + CHUNK]
                        panel = np.ascontiguousarray(cut) if parts is None else cut.copy()
                        own[i] = take(own[i], panel.T)
            return own

        factors: list[Array] = []
        with one_blas_thread():
            for own in in_order(reduced, made, min(len(made), threads_that_pay(THREADS))):
                later = (np.asfortranarray(np.triu(each)) for each in own)
                factors = [absorb(*pair) for pair in zip(factors, later, strict=True)] if factors else own
        return tuple(
            Triangle(columns, np.triu(factor), int(mask[:, i].sum()))
            for i, (columns, factor) in enumerate(zip(self.columns, factors, strict=True))
        )

    def segments(self, prepared: Prepared, motion: Motion | None = None) -> Iterator[RowSegment]:
        """Yield slices of the kept rows and the filtered rows of each joint there, in constant memory."""
        for part in self.parts(prepared, motion):
            yield from part

    def parts(self, prepared: Prepared, motion: Motion | None = None) -> list[Segments]:
        """Return the segments in parts that can be made side by side; a motion may have the load of the drives.

        A filter looks ``reach`` samples to either side, so parts overlap by that much.
        """
        log, keep = prepared.log, prepared.keep
        reach, motion = prepared.how.filter.reach(log.rate), remembered_motion(self.model, log, motion)
        if not reach:
            starts = range(0, len(keep), PART)
            return [self._plain(prepared, motion, slice(k, min(k + PART, len(keep)))) for k in starts]
        torque = target_torque(self.model, prepared)
        pieces = stretches(log.samples, reach, prepared.thinning is not None)
        inner = ((own, slice(*np.searchsorted(keep, [own.start, own.stop]))) for own in pieces)
        return [
            self._filtered(prepared, motion, own, wanted, torque) for own, wanted in inner if wanted.start < wanted.stop
        ]

    def _plain(self, prepared: Prepared, motion: Motion, part: slice) -> Iterator[RowSegment]:
        """Yield kept rows where nothing is to be filtered: only they are ever computed."""
        measured = measured_torque(prepared.log)
        known = _has_known_torque(self.model)
        for start in range(part.start, part.stop, CHUNK):
            own = slice(start, min(start + CHUNK, part.stop))
            rows = stretch_of(prepared.keep[own])
            cut, torque = motion.rows(rows), measured[rows]
            torque = torque - self.model.known_torque(cut) if known else torque
            yield own, self._block(cut, slice(0, len(torque)), torque, self.load)

    def _filtered(
        self, prepared: Prepared, motion: Motion, inner: slice, wanted: slice, torque: Array
    ) -> Iterator[RowSegment]:
        """Yield the kept rows ``wanted`` of the samples ``inner``, filtered; the torque is that already."""
        log, keep = prepared.log, prepared.keep
        if prepared.thinning is not None:
            own, sizes = keep[wanted], [len(columns) for columns in self.columns]

            def make(part: slice, blocks: Sequence[Array]) -> None:
                self._block(motion, part, load=self.load, blocks=blocks)

            found = thinned_rows(make, sizes, log.samples, own, prepared.thinning)
            yield wanted, tuple(np.vstack([rows, torque[own, i]]) for i, rows in enumerate(found))
            return
        reach = prepared.how.filter.reach(log.rate)
        outer = slice(max(0, inner.start - reach), min(log.samples, inner.stop + reach))
        blocks = self._block(motion, outer, torque, self.load)
        for block in blocks:
            block[:-1] = prepared.smooth(block[:-1])
        inside = keep[wanted] - outer.start
        yield wanted, tuple(block[:, inside] for block in blocks)

    def _block(
        self,
        motion: Motion,
        part: slice,
        torque: Array | None = None,
        load: Array | None = None,
        blocks: Sequence[Array] | None = None,
    ) -> tuple[Array, ...]:
        """Return [W_i, tau_i]' of each joint over a slice of the samples, not filtered; in ``blocks`` if given."""
        cut = motion.rows(part)
        blocks = blocks or [np.empty((len(columns) + 1, len(cut.q))) for columns in self.columns]
        heads = [block[: len(found)] for block, found in zip(blocks, self._kernel.columns, strict=True)]
        loaded = load is not None and cut.torque is None and "torque" in self.model.needs
        if self._only and loaded:
            heads = [np.empty((len(found), len(cut.q))) for found in self._kernel.columns]
        if loaded or not self._only:
            self._kernel.evaluate(cut.q, cut.dq, cut.ddq, out=heads)
        if load is not None and loaded:
            cut = replace(cut, torque=self._without_friction(cut, heads, load))
        by_term = self.model.friction_values(cut).T.reshape(-1, len(cut.q))
        coupling, coupled = np.asarray(self.model.robot.coupling), self.model.robot.is_coupled
        for i, (block, own) in enumerate(zip(blocks, self._own, strict=True)):
            tail = block[len(block) - 1 - len(own) : -1]
            np.take(by_term, self._term[own], axis=0, out=tail, mode="clip")  # no copy between, as other modes make
            if coupled:
                tail *= coupling[self._drive[own], i, None]
            block[-1] = 0.0 if torque is None else torque[part, i]
        return tuple(blocks)

    def _without_friction(self, motion: Motion, heads: Sequence[Array], beta: Array) -> Array:
        """Return the torque of links and rotors at ``beta``, shape (N, n), from the inertial rows of each joint."""
        rigid = [beta[own] @ head for own, head in zip(self._kernel.columns, heads, strict=True)]
        is_inertia = np.array([own for part in self.model.friction for own in part.is_inertia], dtype=bool)
        rotor, terms = np.zeros(self.model.robot.dof), np.flatnonzero(is_inertia[self._coefficient])
        rotor[self._drive[terms]] = beta[self._inertial + terms]
        return np.stack(rigid, axis=1) + self.model.rotor_torque(motion, rotor)


def motion_of(log: Log) -> Motion:
    """Return the motion of a preprocessed log.

    Raises:
        LogMismatch: The log has no velocities or accelerations yet.
    """
    if log.dq is None or log.ddq is None:
        raise LogMismatch(log.name, "no velocities and accelerations", "preprocess the log first")
    return Motion(log.q, log.dq, log.ddq, temperature=log.temperature)


def remembered_motion(model: DynamicModel, log: Log, motion: Motion | None = None) -> Motion:
    """Return the motion of a preprocessed log with the states of friction, which go on from what was before it."""
    first = log.before
    if isinstance(first, Log):
        state = remembered_motion(model, first).state
        first = None if state is None else state[-1]
    return model.with_states(motion or motion_of(log), 1.0 / log.rate, first)


def target_torque(model: DynamicModel, prepared: Prepared) -> Array:
    """Return the measured torque less the known one (rotor inertias, bias), filtered alike, shape (N, n), all rows.

    Raises:
        LogMismatch: The log has no torques.
    """
    log = prepared.log
    torque = measured_torque(log)
    if not _has_known_torque(model):
        return torque
    return torque - prepared.smooth(model.known_torque(motion_of(log)).T).T


def _has_known_torque(model: DynamicModel) -> bool:
    return bool(np.any(model.robot.reflected_inertia) or np.any(model.robot.bias))


def rows_in_time(
    regressor: RegressorStream, prepared: Prepared, mask: BoolArray, size: int
) -> Iterator[tuple[slice, Array, Array]]:
    """Yield successive kept rows with their matrices W (m, n, b) and torques (m, n), at most ``size`` at a time.

    Args:
        regressor: What makes the rows.
        prepared: The log.
        mask: Which kept rows count for each joint, shape (N, n); the others are 0.
        size: Most samples at a time.
    """
    count = len(regressor.columns)
    for part, blocks in regressor.segments(prepared):
        for start in range(0, part.stop - part.start, size):
            samples = min(size, part.stop - part.start - start)
            matrix = np.zeros((samples, count, regressor.base.count))
            torque = np.empty((samples, count))
            for i, (columns, block) in enumerate(zip(regressor.columns, blocks, strict=True)):
                matrix[:, i, columns] = block[:-1, start : start + samples].T
                torque[:, i] = block[-1, start : start + samples]
            inside = slice(part.start + start, part.start + start + samples)
            matrix[~mask[inside]], torque[~mask[inside]] = 0.0, 0.0
            yield inside, matrix, torque
