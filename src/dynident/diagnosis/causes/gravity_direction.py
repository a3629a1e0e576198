"""Gravity in any direction: the rows of a fit are linear in it, so their products are made once for all directions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array, vector_text
from dynident.diagnosis.causes.column_readings import GAIN, Interpretation
from dynident.diagnosis.causes.held_out import ReadRows
from dynident.diagnosis.causes.line_search import Search, run, side_by_side
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.weighted_fit import Products
from dynident.identification.problem.regressor_stream import RegressorStream

#: First step of the search over the two angles, and the angle to which gravity is told, in rad.
STEP, ANGLE = 0.5, 0.003

#: Cosine of the angle to the stated direction below which an axis is a mounting of its own.
APART = 0.9

#: Cosine of the angle to an axis, or to the stated direction, within which it is returned unless another direction
#: gains this much more.
NEAR, MORE = 0.98, 3.0

#: Angle in degrees from which a base is mounted otherwise: a smaller one is a tilt, which the residual tells with its
#: deviation, as if the torques were linear in it.
LEAN = 2.0

#: Factors on the size of gravity between which it is looked for, and precision of their logarithms.
SIZES, SIZE_STEP = np.exp(np.linspace(-4.0, 4.0, 17)), 0.01

#: Factor on gravity from which its size is told: a clock that is less off is a cause beside others.
OTHER_SIZE = 1.5

#: Pairs of the parts of the rows: without gravity, and with one along each axis.
PAIRS = tuple((a, b) for a in range(4) for b in range(a, 4))


class GravityDirection:
    """The fit with gravity in any direction.

    A first axis along the stated gravity carries no weight, so that the base parameters lack its first moments: two
    columns of the first joint stand for them.
    """

    def __init__(self, fit: QuickFit) -> None:
        self._fit = fit
        gravity, (nothing, *axes) = np.asarray(fit.model.robot.gravity), fit.gravity_observers
        most, still = int(np.argmax(np.abs(gravity))), fit.rows_under(nothing)
        along = [fit.rows if k == most else fit.rows_under(axis) for k, axis in enumerate(axes)]
        rest = np.where(np.arange(3) == most, 1.0, -gravity) / gravity[most]  # the stated rows have that of all axes
        self._first = _weight_of_first(fit)
        joints, size = fit.model.robot.dof, fit.base.count + 2
        self._grams = np.zeros((joints, len(PAIRS), size, size))
        self._sides = np.zeros((joints, 4, size, joints + 1))
        self._squares, self._whole = np.zeros((2, joints, joints + 1, joints + 1))
        owners, eliminated = np.bincount(np.concatenate(still.columns), minlength=size), np.zeros(size, bool)
        for i in range(joints):
            kept, own = still.masks[:, i], still.columns[i]
            parts = np.stack([rows.blocks[i][kept] for rows in (still, *along)])
            parts[1:] -= parts[0]
            parts[1 + most] = np.tensordot(rest, parts[1:], 1)
            if i == 0:
                own = np.append(own, [size - 2, size - 1])
                parts = np.concatenate([parts, np.zeros((4, parts.shape[1], 2))], axis=2)
                parts[0, :, -2:] = self._first[kept]
            torques = np.column_stack([still.torque, still.known[:, i]])[kept]
            self._whole[i] = torques.T @ torques
            pulled = parts[1:].any(axis=(0, 1))
            alone = (owners[own] == 1) & parts[0].any(axis=0) & ~pulled  # friction
            basis = np.linalg.qr(parts[0][:, alone])[0]
            torques -= basis @ (basis.T @ torques)
            columns, places = [parts[0]] + [part[:, pulled] for part in parts[1:]], [own] + [own[pulled]] * 3
            columns = [part - basis @ (basis.T @ part) for part in columns]
            eliminated[own[alone]] = True
            for place, (a, b) in enumerate(PAIRS):
                gram = self._grams[i, place]
                gram[np.ix_(places[a], places[b])] = columns[a].T @ columns[b]
                if a != b:
                    gram += gram.T.copy()
            for part, at, sides in zip(columns, places, self._sides[i], strict=True):
                sides[at] = part.T @ torques
            self._squares[i] = torques.T @ torques
        self._grams = self._grams[:, :, ~eliminated][..., ~eliminated]
        self._sides = self._sides[:, :, ~eliminated]
        (self._stated,) = self._scores([np.asarray(fit.model.robot.gravity)])

    def gains(self, fields: Sequence[Array]) -> list[float]:
        """Return by how much the fit is better with each gravity (3,) in m/s^2, in log variance."""
        return [self._stated - score for score in self._scores(fields)]

    def _scores(self, fields: Sequence[Array]) -> list[float]:
        pulls = np.insert(np.array(fields), 0, 1.0, axis=1)
        pairs = np.stack([pulls[:, a] * pulls[:, b] for a, b in PAIRS], axis=1)
        grams = np.tensordot(pairs, self._grams, (1, 1))
        sides = np.tensordot(pulls, self._sides, (1, 1))
        found = self._fit.variances(Products(grams, sides, self._squares, self._whole))
        return np.log(found).sum(axis=1).tolist()

    def reading(self, gravity: Array) -> ReadRows:
        """Return the rows of the log with this gravity (3,) in m/s^2."""
        model, size = self._fit.model, self._fit.base.count
        robot = model.robot.with_gravity(gravity)
        stream = RegressorStream(replace(model, robot=robot), self._fit.base, any_gravity=True)
        rows = self._fit.rows_under(stream)
        blocks = (np.column_stack([rows.blocks[0], self._first]), *rows.blocks[1:])
        columns = (np.append(rows.columns[0], [size, size + 1]), *rows.columns[1:])
        return ReadRows(replace(rows, blocks=blocks, columns=columns), np.eye(robot.dof))

    def best(self) -> tuple[Array, float]:
        """Return the direction of the stated size that explains the torques best, and its gain.

        A pattern search (Hooke and Jeeves 1961) over the two angles to 0.003 rad, from the stated
        direction and from each axis of the base that is another mounting. Of an axis and a direction near it the axis
        is returned where it explains as much.
        """
        gravity = np.asarray(self._fit.model.robot.gravity)
        size = float(np.linalg.norm(gravity))
        axes = [sign * size * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
        start, gain = self.other_mounting()
        found = run(side_by_side([_refined(gravity, 0.0, size), _refined(start, gain, size)]), self.gains)
        best, gain = max(found, key=lambda each: each[1])
        near = [each for each in (gravity, *axes) if each @ best > NEAR * size**2]
        plain = zip(near, self.gains(near), strict=True) if near else ()
        return max((each for each in plain if each[1] > gain - MORE), key=lambda each: each[1], default=(best, gain))

    def best_size(self) -> tuple[float, float]:
        """Return the factor on the stated gravity that explains the torques best, and its gain."""
        gravity = np.asarray(self._fit.model.robot.gravity)
        tried, step = SIZES, float(np.log(SIZES[1] / SIZES[0]))
        while True:
            gains = self.gains([factor * gravity for factor in tried])
            k = int(np.argmax(gains))
            if step < SIZE_STEP:
                return float(tried[k]), gains[k]
            step /= 2.0
            tried = tried[k] * np.exp(step * np.arange(-1, 2))

    def other_mounting(self) -> tuple[Array, float]:
        """Return the axis of the base, apart from the stated direction, along which gravity explains most; its gain."""
        others = other_mountings(np.asarray(self._fit.model.robot.gravity))
        return max(zip(others, self.gains(others), strict=True), key=lambda each: each[1])


def mountings(fit: QuickFit) -> Iterator[Interpretation]:
    """Yield no gravity, or one of another size or direction, where that explains the log far better."""
    gravity = np.asarray(fit.model.robot.gravity)
    size = float(np.linalg.norm(gravity))
    if not size:
        return
    free = GravityDirection(fit)
    (without,) = free.gains([np.zeros(3)])
    best, gain = free.best()
    if without > GAIN:
        evidence = "the torques contain no gravity: without it,"
        remedy = "log the measured torque with gravity, not the controller's part without it"
        yield Interpretation("torque without gravity", (), without, evidence, remedy, free.reading(np.zeros(3)))
    factor, by_size = free.best_size()
    if by_size > GAIN + max(0.0, without, gain) and abs(np.log(factor)) > np.log(OTHER_SIZE):
        text, slow = vector_text(factor * gravity, 3), factor**-0.5
        evidence = f"with gravity of {factor * size:.3g} m/s^2, or a clock that runs {slow:.3g} times as fast as time,"
        remedy = (
            f"check unit and rate of the time (multiplied by {1.0 / slow:.4g} the log agrees with the robot model), or "
            f"state the size of gravity (gravity: [{text}])"
        )
        numbers = {"factor": factor, "clock": slow}
        yield Interpretation(
            "size of gravity", (), by_size, evidence, remedy, free.reading(factor * gravity), numbers, 1
        )
    angle = degrees_off(best, gravity)
    if gain > GAIN and angle > LEAN:
        text = vector_text(best, 3)
        evidence = f"with gravity [{text}], {angle:.1f} degrees off the stated one,"
        remedy = f"state how the arm is mounted (gravity: [{text}] in the frame of the base)"
        yield Interpretation("mounting", (), gain, evidence, remedy, free.reading(best), {"angle_deg": angle}, 2)


def _refined(axis: Array, gain: float, size: float) -> Search[Array, float, tuple[Array, float]]:
    best, found, step = axis, gain, STEP
    while step > ANGLE:
        sides = np.linalg.svd(best[None, :])[2][1:]
        tried = [best + sign * size * np.tan(step) * side for side in sides for sign in (1.0, -1.0)]
        tried = [size * each / np.linalg.norm(each) for each in tried]
        gains = yield tried
        if max(gains) > found:
            best, found = tried[int(np.argmax(gains))], max(gains)
        else:
            step /= 2
    return best, found


def other_mountings(stated: Array) -> list[Array]:
    """Return gravity (3,) along each axis of the base that is apart from the stated one."""
    size = float(np.linalg.norm(stated))
    axes = [sign * size * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
    return [axis for axis in axes if axis @ stated <= APART * size**2]


def degrees_off(gravity: Array, stated: Array) -> float:
    """Return the angle in degrees between two gravities (3,), 0 where one of them is none."""
    size = float(np.linalg.norm(gravity) * np.linalg.norm(stated))
    return float(np.degrees(np.arccos(np.clip(gravity @ stated / size, -1.0, 1.0)))) if size else 0.0


def followed_gravity(fit: QuickFit) -> Array | None:
    """Return the gravity that the torques follow, shape (3,), in m/s^2: the stated one, unless another explains them.

    None where the log does not tell: another mounting explains it about as well.
    """
    stated = np.asarray(fit.model.robot.gravity)
    if not stated.any():
        return None
    free = GravityDirection(fit)
    best, gain = free.best()
    if gain > GAIN and degrees_off(best, stated) > LEAN:
        return best
    return stated if free.other_mounting()[1] < -GAIN else None


def _weight_of_first(fit: QuickFit) -> Array:
    """Return sine and cosine of the first joint, filtered as torques are, shape (N, 2); nothing where it slides."""
    prepared = fit.rows.prepared
    if fit.model.robot.active[0].kind != "revolute":
        return np.zeros((len(fit.rows.torque), 2))
    q = np.asarray(prepared.log.q)[:, 0]
    return prepared.smooth(np.stack([np.sin(q), np.cos(q)]))[:, prepared.keep].T
