"""A fit of few rows, and of what the rows would be if a sign, an order or the gravity were another.

Weighted least squares with Coulomb, viscous and offset friction on a thinned log. The rows of each joint are reduced to
a triangle that keeps the torques of all joints as columns, so that a torque with another sign, scale or joint costs no
new rows. Two readings of a log are compared by the sum over the joints of the logarithm of the residual variance, which
is their log-likelihood up to the number of independent rows (Seber and Wild 2003, section 2.1.3).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, Preprocessing, preprocess
from dynident.data.preprocessing._local_polynomials import fractional_shift
from dynident.diagnosis.causes.weighted_fit import (
    EXACT,
    Products,
    Solved,
    Triangles,
    weighted_products,
    weighted_variances,
)
from dynident.errors import DynidentError
from dynident.identification.problem.problem import counting_rows
from dynident.identification.problem.regressor_stream import RegressorStream, motion_of, target_torque
from dynident.identification.residuals.covariance import correlation_factors
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.reduction import triangle_of

#: Rows a second per Hz of the cut-off.
ROWS_PER_HZ = 8.0

#: Rows for each that is independent: a band of f Hz has 2 f values a second.
OVERSAMPLING = ROWS_PER_HZ / 2.0

#: Independent torque values for each base parameter that a fit needs: with fewer, parameters of parts of seven right
#: logs leave a fifth and more of the torque of the whole log; with one, more than half.
ENOUGH = 2.0

#: Rows of a joint below which nothing is said.
FEWEST_ROWS = 30


@dataclass(frozen=True)
class FitRows:
    """The rows of one reading of a log.

    Attributes:
        blocks: Observation matrix of each joint over all kept rows, shape (N, K_i).
        columns: Positions in beta of those columns, shape (K_i,) each.
        torque: Measured torque, filtered, shape (N, n).
        known: Known torque of the drives that is taken off, shape (N, n).
        masks: Which rows count, shape (N, n).
        prepared: The log behind them.
    """

    blocks: tuple[Array, ...]
    columns: tuple[IntArray, ...]
    torque: Array
    known: Array
    masks: BoolArray
    prepared: Prepared

    @property
    def augmented(self) -> Iterator[Array]:
        """[W_i, all torques, known torque] of each joint, the rows that count."""
        for block, known, mask in zip(self.blocks, self.known.T, self.masks.T, strict=True):
            rows = np.concatenate([block.T, self.torque.T, known[None]])  # stays in the order in which blocks are made
            yield (rows if mask.all() else rows[:, mask]).T


@dataclass(frozen=True)
class QuickFit:
    """A log thinned out, and the model that it is fitted with.

    Attributes:
        model: Robot with plain friction.
        base: Its base parameters.
        log: Positions and torques on equal steps, thinned.
        how: How they become rows.
        counting: Which of the rows count, shape (N,); None for all.
        explained: Torque that has another cause than the model and is taken off, shape (N, n); None for none.
        starts: When each of the logs begins that are one here, in s, shape (L,).
        conversion: What turns currents into these torques, N m (or N) per A, shape (n, n); None for logged torques.
        late_s: Delay of the torque in s that is taken off: each row has the torque of so much later.
        made: All rows of the log, which another fit of it has made; None where there are none.
        zeros: Position in rad or m of each joint where its log says 0; empty for 0.
    """

    model: DynamicModel
    base: BaseParameters
    log: Log
    how: Preprocessing
    counting: BoolArray | None = None
    explained: Array | None = None
    starts: Array = field(default_factory=lambda: np.zeros(1))
    conversion: Array | None = None
    late_s: float = 0.0
    made: FitRows | None = None
    zeros: tuple[float, ...] = ()

    def part(self, counting: BoolArray) -> QuickFit:
        """Return the fit of some of its rows, shape (N,)."""
        counting = counting if self.counting is None else counting & self.counting
        return replace(self, counting=counting, made=self._every)

    def explained_by(self, torque: Array) -> QuickFit:
        """Return the fit of what another cause than the model, a torque (N, n), leaves."""
        return replace(self, explained=torque, made=self._every)

    def delayed(self, seconds: float) -> QuickFit:
        """Return the fit with the torque of so many seconds later."""
        late = replace(self, late_s=seconds)
        return replace(late, made=replace(self._every, torque=late._torque(self._every.prepared)))

    def stretched(self, joint: int, factor: float) -> QuickFit:
        """Return the fit with a joint's positions so many times as far from where its log says 0, in the same rows."""
        q, zero = np.array(self.log.q), self.zero_of(joint)
        q[:, joint] = zero + factor * (q[:, joint] - zero)
        log, every = replace(self.log, q=q), self._every
        made = self._rows(preprocess(log, self.how), self.regressor)
        return replace(self, log=log, made=replace(made, masks=every.masks))

    def zero_of(self, joint: int) -> float:
        """Return the position in rad or m of a joint where its log says 0."""
        return self.zeros[joint] if self.zeros else 0.0

    def clock(self, time: Array) -> Array:
        """Return times (N,) in s since their own log began, shape (N,)."""
        return time - self.starts[np.maximum(np.searchsorted(self.starts, time, side="right") - 1, 0)]

    @property
    def effort(self) -> str:
        """What the log has of the drives, ``torque`` or ``current``."""
        return "torque" if self.conversion is None else "current"

    def exchanged(self, order: Sequence[int]) -> Array:
        """Return what torques are multiplied by, shape (n, n), where columns of torques or currents are in an order."""
        plain = in_order(order)
        return plain if self.conversion is None else self.conversion @ plain @ np.linalg.inv(self.conversion)

    @cached_property
    def rows(self) -> FitRows:
        """The rows as the case reads them."""
        rows = self._counted(self._every)
        return rows if self.explained is None else replace(rows, torque=rows.torque - self.explained)

    @cached_property
    def _every(self) -> FitRows:
        return self.made or self._rows(preprocess(self.log, self.how), self.regressor)

    def _counted(self, rows: FitRows) -> FitRows:
        return rows if self.counting is None else replace(rows, masks=rows.masks & self.counting[:, None])

    @cached_property
    def has_rows_enough(self) -> bool:
        """Whether the log is long enough for a fit."""
        return self.values > ENOUGH * self.base.count

    @cached_property
    def values(self) -> float:
        """Independent torque values in motion, of all joints together; 0 of a log that is too short for the filter."""
        try:
            return float(self.rows.masks.sum()) / OVERSAMPLING
        except DynidentError:
            return 0.0

    @cached_property
    def regressor(self) -> RegressorStream:
        """What makes the rows of the robot as the case has it."""
        return RegressorStream(self.model, self.base, any_gravity=True)

    @cached_property
    def gravity_observers(self) -> tuple[RegressorStream, ...]:
        """What makes the rows without gravity, and with one of 1 m/s^2 along each axis: rows are linear in it."""
        robots = [self.model.robot.with_gravity(gravity) for gravity in (np.zeros(3), *np.eye(3))]
        return tuple(RegressorStream(replace(self.model, robot=own), self.base, any_gravity=True) for own in robots)

    def rows_mixed(self, mixing: Array) -> FitRows:
        """Return the same rows with positions mixing @ (logged ones), mixing of shape (n, n): filters are linear."""
        prepared = self.rows.prepared
        moved = {name: np.asarray(getattr(prepared.log, name)) @ mixing.T for name in ("q", "dq", "ddq")}
        mixed = replace(prepared, log=replace(prepared.log, **moved))
        return self._rows(mixed, self.regressor, self.rows.masks)

    def rows_under(self, regressor: RegressorStream) -> FitRows:
        """Return the rows of a robot that differs in its gravity alone."""
        return self._rows(self.rows.prepared, regressor, self.rows.masks)

    def _rows(self, prepared: Prepared, regressor: RegressorStream, masks: BoolArray | None = None) -> FitRows:
        model, masks = self.model, counting_rows(self.model, prepared) if masks is None else masks
        blocks = tuple(np.asarray(part[:-1]).T for part in regressor.rows(prepared))
        known = (np.asarray(prepared.log.torque) - target_torque(model, prepared))[prepared.keep]
        return FitRows(blocks, regressor.columns, self._torque(prepared), known, masks, prepared)

    def _torque(self, prepared: Prepared) -> Array:
        """Return the torque that belongs to each kept row, shape (N, n)."""
        torque = np.asarray(prepared.log.torque)
        if not self.late_s:
            return torque[prepared.keep]
        return fractional_shift(torque, -self.late_s * prepared.log.rate, prepared.keep)

    @cached_property
    def triangles(self) -> Triangles:
        """Triangles of the declared reading."""
        return Triangles(self.rows.columns, tuple(map(triangle_of, self.rows.augmented)), self.base.count)

    def products_of(self, rows: FitRows) -> Products:
        """Return the products of another reading."""
        return Triangles(rows.columns, tuple(rows.augmented), self.base.count).products

    @cached_property
    def shared(self) -> Products:
        """Products of the declared reading for scores and variances: no columns that one joint alone has."""
        return replace(self.triangles.shared.products, whole=self.triangles.products.squares)

    @cached_property
    def plain(self) -> Solved:
        """The fit of the log as the case reads it."""
        return self.solve(self.triangles.products)

    def solve(self, products: Products, mixing: Array | None = None) -> Solved:
        """Return the fit with torques mixing @ (measured ones), mixing of shape (n, n); None for the measured ones."""
        (sides,), (squares,), (floors,) = self._mixed(products, None if mixing is None else mixing[None])
        return weighted_products(products.grams, sides, squares, self.counts, floors)

    def variances(self, products: Products, mixings: Array | None = None) -> Array:
        """Return the residual variances of m fits side by side, shape (m, n).

        Args:
            products: Those of all fits, or columns with products (m, n, size, ...) of each.
            mixings: The torques of each, shape (m, n, n); None for the measured ones.
        """
        sides, squares, floors = self._mixed(products, mixings)
        return weighted_variances(products.grams, sides, squares, self.counts, floors)

    def _mixed(self, products: Products, mixings: Array | None) -> tuple[Array, Array, Array]:
        """Return the products with mixed torques, their squares and the floors of their variances, a fit a row."""
        joints = self.model.robot.dof
        mixings = np.eye(joints)[None] if mixings is None else mixings
        taken = np.concatenate([mixings, np.full((len(mixings), joints, 1), -1.0)], axis=2)  # the known is taken off
        whole = products.squares if products.whole is None else products.whole
        measured = np.einsum("mik,ikl,mil->mi", mixings, whole[:, :-1, :-1], mixings)
        squares = np.einsum("mik,ikl,mil->mi", taken, products.squares, taken)
        sides = (products.sides @ taken[..., None])[..., 0]
        return sides, squares, np.maximum(EXACT**2 * measured / self.counts, 1e-300)

    @cached_property
    def counts(self) -> Array:
        """Rows of each joint that count, shape (n,), at least 1."""
        return np.maximum(self.rows.masks.sum(axis=0), 1).astype(float)

    @property
    def moves(self) -> BoolArray:
        """Which joints have rows enough that something is said of them, shape (n,)."""
        return self.rows.masks.sum(axis=0) >= FEWEST_ROWS

    @cached_property
    def residual(self) -> Array:
        """Measured torque less that of the plain fit, shape (N, n)."""
        return self.residual_of(self.rows, self.plain.beta)

    def residual_of(self, rows: FitRows, beta: Array) -> Array:
        """Return the residual of a reading at beta, shape (N, n)."""
        predicted = [block @ beta[own] for block, own in zip(rows.blocks, rows.columns, strict=True)]
        return rows.torque - rows.known - np.stack(predicted, axis=1)

    @cached_property
    def relative(self) -> Array:
        """Root mean square of the residual over that of the torque less its mean, shape (n,); 0 of few rows."""
        found = np.zeros(len(self.counts))
        for i in np.flatnonzero(self.moves):
            size = float(np.std(self.rows.torque[self.rows.masks[:, i], i]))
            found[i] = np.sqrt(self.plain.variances[i]) / max(size, 1e-300)
        return found

    @property
    def tells_rotors(self) -> bool:
        """Whether motions tell all rotor inertias of the fit from inertia of the links."""
        rotors = {k for k, one in enumerate(self.model.parameters) if one.kind == "rotor"}
        return rotors <= set(self.base.independent.tolist())

    @cached_property
    def independent_rows(self) -> Array:
        """Rows of each joint that count, less those that hang together, shape (n,)."""
        return self.counts / correlation_factors([self.residual], [self.rows.masks])

    def friction_power(self, solved: Solved) -> tuple[Array, Array]:
        """Return the power that friction takes as a share of rms torque times rms speed, and its z-score, (n,) each."""
        robot = self.model.robot
        speed = motion_of(self.rows.prepared.kept).dq @ np.asarray(robot.coupling).T
        share, score = np.zeros(robot.dof), np.zeros(robot.dof)
        meaning = {c.symbol: c.in_simulators for part in self.model.friction for c in part.coefficients}
        for i, name in enumerate(robot.joint_names):
            mask = self.rows.masks[:, i]
            if mask.sum() < FEWEST_ROWS:
                continue
            weights = np.zeros(self.base.count)
            size = np.abs(speed[mask, i])
            shares = {"friction": float(np.mean(size)), "damping": float(np.mean(size**2))}
            for k, index in enumerate(self.base.independent):
                parameter = self.base.parameters[index]
                if parameter.owner == name:
                    weights[k] = shares.get(meaning.get(parameter.symbol, ""), 0.0)
            power = float(weights @ solved.beta[: self.base.count])
            factor = self.counts[i] / max(self.independent_rows[i], 1.0)
            covariance = solved.covariance[: self.base.count, : self.base.count]
            deviation = float(np.sqrt(max(weights @ covariance @ weights * factor, 1e-300)))
            scale = float(np.sqrt(np.mean(self.rows.torque[mask, i] ** 2) * np.mean(speed[mask, i] ** 2)))
            share[i], score[i] = power / max(scale, 1e-300), power / deviation
        return share, score


def in_order(order: Sequence[int]) -> Array:
    """Return the matrix that puts columns in an order, shape (n, n)."""
    return np.eye(len(order))[list(order)]
