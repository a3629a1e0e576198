"""Gravity in any direction: the rows of a fit are linear in it, so their products are made once for all directions."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.causes.quick_fit import Products, QuickFit

#: First step of the search over the two angles, and the angle to which gravity is told, in rad.
STEP, ANGLE = 0.5, 0.003

#: Cosine of the angle to the stated direction below which an axis is a mounting of its own.
APART = 0.9

#: Cosine of the angle to an axis, or to the stated direction, within which it is returned unless another direction
#: gains this much more.
NEAR, MORE = 0.98, 3.0

#: Pairs of the parts of the rows: without gravity, and with one along each axis.
PAIRS = tuple((a, b) for a in range(4) for b in range(a, 4))


class GravityDirection:
    """The fit with gravity in any direction."""

    def __init__(self, fit: QuickFit) -> None:
        self._fit = fit
        still, *along = (fit.rows_under(regressor) for regressor in fit.gravity_observers)
        joints, size = fit.model.robot.dof, fit.base.count
        self._grams = np.zeros((joints, len(PAIRS), size, size))
        self._sides = np.zeros((joints, 4, size, joints + 1))
        self._squares = np.zeros((joints, joints + 1, joints + 1))
        for i in range(joints):
            kept = still.masks[:, i]
            parts = np.zeros((4, int(kept.sum()), size))
            for part, rows in zip(parts, (still, *along), strict=True):
                part[:, rows.columns[i]] = rows.blocks[i][kept]
            parts[1:] -= parts[0]
            torques = np.column_stack([still.torque, still.known[:, i]])[kept]
            for place, (a, b) in enumerate(PAIRS):
                gram = parts[a].T @ parts[b]
                self._grams[i, place] = gram if a == b else gram + gram.T
            self._sides[i], self._squares[i] = parts.swapaxes(1, 2) @ torques, torques.T @ torques

    def gain(self, gravity: Array) -> float:
        """Return by how much the fit is better with this gravity (3,) in m/s^2, in log variance."""
        pull = np.concatenate([[1.0], gravity])
        grams = np.tensordot(np.array([pull[a] * pull[b] for a, b in PAIRS]), self._grams, (0, 1))
        products = Products(grams, np.tensordot(pull, self._sides, (0, 1)), self._squares)
        return self._fit.plain.score - self._fit.solve(products).score

    def best(self) -> tuple[Array, float]:
        """Return the direction of the stated size that explains the torques best, and its gain.

        A pattern search (Hooke and Jeeves 1961) over the two angles to 0.003 rad, from the stated
        direction and from each axis of the base that is another mounting. Of an axis and a direction near it the axis
        is returned where it explains as much.
        """
        gravity = np.asarray(self._fit.model.robot.gravity)
        size = float(np.linalg.norm(gravity))
        axes = [sign * size * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
        others = [axis for axis in axes if axis @ gravity <= APART * size**2]
        start, gain = max(((axis, self.gain(axis)) for axis in others), key=lambda each: each[1])
        found = [self._refined(gravity, 0.0, size), self._refined(start, gain, size)]
        best, gain = max(found, key=lambda each: each[1])
        plain = [(each, self.gain(each)) for each in (gravity, *axes) if each @ best > NEAR * size**2]
        return max((each for each in plain if each[1] > gain - MORE), key=lambda each: each[1], default=(best, gain))

    def _refined(self, axis: Array, gain: float, size: float) -> tuple[Array, float]:
        best, found, step = axis, gain, STEP
        while step > ANGLE:
            sides = np.linalg.svd(best[None, :])[2][1:]
            tried = [best + sign * size * np.tan(step) * side for side in sides for sign in (1.0, -1.0)]
            tried = [size * each / np.linalg.norm(each) for each in tried]
            gains = [self.gain(each) for each in tried]
            if max(gains) > found:
                best, found = tried[int(np.argmax(gains))], max(gains)
            else:
                step /= 2
        return best, found
