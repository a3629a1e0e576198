"""Motors that turn with a neighbouring joint as well: a log read with such a coupling.

With motor speed = C joint speed, tau = C' tau_motor at the joints, and friction acts at the speed of the motors (Khalil
and Dombre 2002, section 9.3.2). The friction columns are made anew for each entry of C that is tried; those of the
bodies stay. The torques of the log may be those of the joints already, or still those of the motors: both are tried,
and scores are compared in the torques of the log, hence the determinant.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.diagnosis.causes.held_out import ReadRows
from dynident.diagnosis.causes.line_search import lowest_near, run
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.weighted_fit import EXACT, weighted_variances
from dynident.identification.problem.regressor_stream import motion_of
from dynident.model.friction import Motion

#: Relative residual above which a joint is not explained, so that a coupling of its motor is looked for; and the
#: one above which it is not where it is so many times the median of all joints.
UNEXPLAINED, OUTLYING, TIMES = 0.1, 0.03, 4.0

#: Sizes of the entries of C that are tried, of either sign, for the first one and beside others; 1 is that of bevels.
#: Of a motor that slides and a joint that turns, or the other way round, times the ratio of their usual speeds.
SIZES, FINE_SIZES = (np.sort([*0.05 * step ** np.arange(count), 1.0]) for step, count in ((2.0, 7.0), (1.5, 12.0)))

#: Motors of a differential: both turn with both joints.
DIFFERENTIALS = tuple(np.array([[1.0, a], [-a * b, b]]) for a in (1.0, -1.0) for b in (1.0, -1.0))

#: Places at which the best value of an entry is looked for.
REFINED = 2

#: Share of an entry to which its best value is found.
PRECISION = 1e-4

#: Gain of the score and standard deviations from zero for which an entry is kept, and entries found at most.
KEPT, SURE, MOST = 1.5, 2.0, 3


#: Gain, rank among equal ones, C, and the motors and joints of the entries that are new.
Trial: TypeAlias = tuple[float, int, Array, tuple[tuple[int, int], ...]]


@dataclass(frozen=True)
class Coupled:
    """A coupling under which a log agrees far better.

    Attributes:
        matrix: C with motor speed = C joint speed, shape (n, n).
        entries: Motor, joint, value and deviation of each entry that was found; a deviation of 0 for a differential.
        gain: By how much the score falls.
        at_motors: Whether the torques of the log are those of the motors; else those of the joints.
        before: Relative residual of each joint as the case reads the log, shape (n,).
        after: The same under the coupling, shape (n,).
        reading: The rows of the log under the coupling.
    """

    matrix: Array
    entries: tuple[tuple[int, int, float, float], ...]
    gain: float
    at_motors: bool
    before: Array
    after: Array
    reading: ReadRows


def best_coupling(fit: QuickFit) -> Coupled | None:
    """Return the coupling of neighbouring joints that a log asks for; None where it asks for none."""
    if not np.any(unexplained(fit)):
        return None
    rows = CoupledRows(fit)
    found = [each for at_motors in (False, True) if (each := _found(_Scan(rows, at_motors))) is not None]
    return max(found, key=lambda each: each.gain, default=None)


def unexplained(fit: QuickFit) -> BoolArray:
    """Return which joints the fit does not explain, shape (n,)."""
    return fit.relative > min(UNEXPLAINED, max(OUTLYING, TIMES * float(np.median(fit.relative))))


def _found(scan: _Scan) -> Coupled | None:
    """Return the coupling that is found entry by entry."""
    matrix, entries, best = scan.stated, list[tuple[int, int, float, float]](), 0.0
    while len(entries) < MOST:
        trials = [*scan.single(matrix), *scan.differentials(matrix), *scan.transposed(matrix)]
        gain, _, tried, places = max(trials, key=lambda trial: trial[:2], default=(0.0, 0, matrix, ()))
        if gain - best < KEPT:
            break
        single = len(places) == 1
        new = [(*place, float(tried[place]), scan.deviation(tried, place) if single else 0.0) for place in places]
        if any(abs(value) < SURE * spread for *_, value, spread in new):
            break
        entries += new
        matrix, best = tried, gain
    if not entries:
        return None
    before, after = scan.rows.fit.relative, scan.relative(matrix)
    reading = scan.rows.reading(matrix, scan.at_motors)
    return Coupled(matrix, tuple(entries), best, scan.at_motors, before, after, reading)


class _Scan:
    """Couplings, and how well the log agrees under each, its torques taken for those of motors or of joints."""

    def __init__(self, rows: CoupledRows, at_motors: bool) -> None:
        self.rows, self.at_motors, self.stated = rows, at_motors, rows.stated
        self._score = self._scores([self.stated])[0]

    def single(self, matrix: Array) -> Iterator[Trial]:
        """Yield the best entry of C at the places where one promises most."""
        sizes = SIZES if np.array_equal(matrix, self.stated) else FINE_SIZES
        open_places = [place for place in self.rows.pairs if not matrix[place]]
        tried = {
            place: np.unique(
                [
                    *(self.rows.unit(place) * np.array([*-sizes, *sizes])),
                    *self.rows.start(matrix, place, self.at_motors),
                ]
            )
            for place in open_places
        }
        for place in open_places:
            self.rows.make_friction(place[0], [_with(matrix, place, value)[place[0]] for value in tried[place]])
        gains = {place: self.gains([_with(matrix, place, value) for value in tried[place]]) for place in open_places}
        for place in sorted(open_places, key=lambda place: -max(gains[place]))[:REFINED]:
            k = int(np.clip(np.argmax(gains[place]), 1, len(tried[place]) - 2))
            gain, value = self._refined(matrix, place, tried[place][k - 1 : k + 2])
            yield gain, 1, _with(matrix, place, value), (place,)

    def differentials(self, matrix: Array) -> Iterator[Trial]:
        """Yield couplings in which two motors share two joints."""
        for motor, joint in self.rows.pairs:
            both = np.ix_((joint, motor), (joint, motor))
            if motor - joint == 1 and np.array_equal(matrix[both], np.eye(2)):
                tried = np.repeat(matrix[None], len(DIFFERENTIALS), axis=0)
                for own, block in zip(tried, DIFFERENTIALS, strict=True):
                    own[both] = block
                for own, gain in zip(tried, self.gains(list(tried)), strict=True):
                    yield gain, 0, own, ((joint, motor), (motor, joint), (motor, motor))

    def transposed(self, matrix: Array) -> Iterator[Trial]:
        """Yield the stated coupling transposed, as it comes out where motors and joints are taken for each other."""
        if np.array_equal(matrix, self.stated) and not np.array_equal(matrix, matrix.T):
            new = (matrix.T != 0) & (matrix == 0)
            yield self.gains([matrix.T])[0], 2, matrix.T.copy(), tuple((int(i), int(j)) for i, j in np.argwhere(new))

    def gains(self, matrices: Sequence[Array]) -> list[float]:
        """Return by how much couplings better the score, residuals counted in the torques of the log."""
        scales = np.abs(np.linalg.det(np.array(matrices)) / np.linalg.det(self.stated))
        sound = scales >= 1e-3  # two motors that turn with both joints alike are one
        gains = np.full(len(matrices), -np.inf)
        scores = self._scores([matrix for matrix, one in zip(matrices, sound, strict=True) if one])
        gains[sound] = self._score - np.array(scores) + self.at_motors * 2 * np.log(scales[sound])
        return gains.tolist()

    def relative(self, matrix: Array) -> Array:
        """Return the root mean square of the residual over that of the torque less its mean, shape (n,)."""
        torque, masks = self.rows.torques(matrix)[int(self.at_motors)], self.rows.fit.rows.masks
        size = [float(np.std(column[mask])) for column, mask in zip(torque.T, masks.T, strict=True)]
        return np.sqrt(self._variances([matrix])[0]) / np.maximum(size, 1e-300)

    def deviation(self, matrix: Array, place: tuple[int, int]) -> float:
        """Return the standard deviation of an entry of C.

        That of the curvature of the likelihood of independent rows, and beside it the share of the torque that the
        model still leaves: as far as that may be what such an entry does.
        """
        value = float(matrix[place])
        step = 1e-2 * abs(value)
        low, middle, high = self.gains([_with(matrix, place, value + shift) for shift in (-step, 0.0, step)])
        curvature = (2 * middle - low - high) / step**2
        rows, left = float(np.median(self.rows.fit.independent_rows)), float(np.max(self.relative(matrix)[list(place)]))
        return float(np.hypot(np.sqrt(2.0 / (rows * curvature)), left * value)) if curvature > 0 else float("inf")

    def _refined(self, matrix: Array, place: tuple[int, int], values: Array) -> tuple[float, float]:
        """Return gain and value of the best entry between the first and the last of three values."""
        low, value, high = values.tolist()
        step = 0.5 * min(value - low, high - value)
        search = lowest_near(value, step, PRECISION * abs(value))
        best = run(search, lambda values: [-gain for gain in self.gains([_with(matrix, place, x) for x in values])])
        return self.gains([_with(matrix, place, best)])[0], best

    def _scores(self, matrices: Sequence[Array]) -> list[float]:
        return np.log(self._variances(matrices)).sum(axis=1).tolist() if matrices else []

    def _variances(self, matrices: Sequence[Array]) -> Array:
        """Return the residual variances under couplings, shape (m, n)."""
        if len({(matrix != 0).tobytes() for matrix in matrices}) > 1:  # an entry may be tried at 0
            return np.concatenate([self._variances([matrix]) for matrix in matrices])
        which, counts = int(self.at_motors), self.rows.fit.counts
        made = [[self.rows.products(matrix, i) for i in range(len(matrix))] for matrix in matrices]
        squares = np.array([[whole[which] for *_, whole in joints] for joints in made])
        left = np.array([[rest[which] for _, _, rest, _ in joints] for joints in made])
        grams = np.array([[gram for gram, *_ in joints] for joints in made])
        sides = np.array([[side[:, which] for _, side, *_ in joints] for joints in made])
        return weighted_variances(grams, sides, left, counts, np.maximum(EXACT**2 * squares / counts, 1e-300))


class _Left:
    """Rows of a joint less what columns of its own explain, and their products; ``whole`` are those of all torques."""

    def __init__(self, basis: Array, bodies: Array, targets: Array) -> None:
        self._basis, self.whole = basis, targets.T @ targets
        self.bodies, self.targets = self.out_of(bodies), self.out_of(targets)
        self.gram, self.sides = self.bodies.T @ self.bodies, self.bodies.T @ self.targets
        self.squares = self.targets.T @ self.targets

    def out_of(self, columns: Array) -> Array:
        """Return columns (N, k) less what the basis (N, m) explains."""
        return columns - self._basis @ (self._basis.T @ columns)


class CoupledRows:
    """The rows of a quick fit with friction columns that can be made for any coupling."""

    def __init__(self, fit: QuickFit) -> None:
        self.fit, self.stated = fit, np.array(fit.model.robot.coupling, dtype=float)
        bodies = fit.base.independent < fit.model.inertial_count
        place = np.cumsum(bodies) - 1
        self._inertial = []
        for block, own in zip(fit.rows.blocks, fit.rows.columns, strict=True):
            full = np.zeros((len(block), int(bodies.sum())))
            full[:, place[own[bodies[own]]]] = block[:, bodies[own]]
            self._inertial.append(full)
        self._motion = motion_of(fit.rows.prepared.log)
        targets = [np.column_stack([fit.rows.torque, known]) for known in fit.rows.known.T]
        self._targets = [target[mask] for target, mask in zip(targets, fit.rows.masks.T, strict=True)]
        self._bodies = [block[mask] for block, mask in zip(self._inertial, fit.rows.masks.T, strict=True)]
        self._of_two = np.sum([block.any(axis=0) for block in self._bodies], axis=0) > 1
        self._friction: dict[tuple[int, bytes], Array] = {}
        self._left: dict[tuple[int, bytes, bytes], _Left] = {}
        self._made: dict[tuple[int, bytes, bytes], tuple[Array, Array, Array, Array]] = {}
        self.pairs = tuple(self._neighbours())

    def torques(self, matrix: Array) -> tuple[Array, Array]:
        """Return the filtered torques at the joints, (N, n), if the log's are those, and if they are the motors'."""
        torque = self.fit.rows.torque
        return torque, torque @ np.linalg.solve(self.stated, matrix)

    def unit(self, place: tuple[int, int]) -> float:
        """Return what sizes of an entry count in: the ratio of the speeds of motor and joint, where one slides."""
        kinds = [self.fit.model.robot.active[k].kind for k in place]
        speeds = [float(np.sqrt(np.mean(np.asarray(self._motion.dq)[:, k] ** 2))) for k in place]
        return 1.0 if kinds[0] == kinds[1] or not speeds[1] else max(speeds[0] / speeds[1], 1e-9)

    def start(self, matrix: Array, place: tuple[int, int], at_motors: bool) -> tuple[float, ...]:
        """Return an entry near the best one, as the peak of a good log is narrow; none where the rows tell none.

        Torques of motors: that of the motor is a column beside those of the joint. Torques of joints: the slope of the
        motor's torque by the speed of the joint over that by the speed of the motor's own.
        """
        motor, joint = place
        row = joint if at_motors else motor
        mask, speed = self.fit.rows.masks[:, row], np.asarray(self.fit.rows.prepared.kept.dq)
        if at_motors:
            drives = np.linalg.solve(self.stated.T, self.fit.rows.torque.T).T
            block = np.column_stack([self._block(matrix, row), drives[:, motor]])
        else:
            ones = np.ones(len(speed))
            block = np.column_stack([self._inertial[row], ones, speed[:, motor], speed[:, joint]])
        target = self.torques(matrix)[int(at_motors)][:, row] - self.fit.rows.known[:, row]
        *_, before, last = np.linalg.lstsq(block[mask], target[mask])[0]
        value = -last if at_motors else last / before if before else 0.0
        return (float(value),) if 0 < abs(value) < 2 * SIZES[-1] * self.unit(place) else ()

    def products(self, matrix: Array, i: int) -> tuple[Array, Array, Array, Array]:
        """Return products of the columns of a joint, those with both torques, the squares of these, and their own.

        Columns that one joint alone has are taken out of all but the last: the residual of a fit is the same.
        """
        drives, turned = np.flatnonzero(matrix[:, i]), np.count_nonzero(matrix, axis=1) > 1
        key = (i, turned.tobytes(), matrix[drives].tobytes())
        if key not in self._made:
            left = self._left_at(matrix, drives[~turned[drives]], i)
            taken = np.vstack([np.eye(len(matrix))[i], np.linalg.solve(self.stated, matrix)[:, i]]).T
            taken = np.vstack([taken, -np.ones(2)])  # the known torque is taken off
            mask, count, own = self.fit.rows.masks[:, i], self.fit.model.coefficients_per_joint, len(left.gram)
            friction = np.zeros((int(mask.sum()), int(turned.sum()), count))
            for k, drive in enumerate(np.flatnonzero(turned).tolist()):
                if matrix[drive, i]:
                    friction[:, k] = matrix[drive, i] * self.friction(drive, matrix[drive])[mask]
            columns = left.out_of(friction.reshape(len(friction), friction.shape[1] * count))
            gram, side = np.zeros((own + columns.shape[1],) * 2), np.zeros((own + columns.shape[1], 2))
            gram[:own, :own], gram[:own, own:] = left.gram, left.bodies.T @ columns
            gram[own:, :own], gram[own:, own:] = gram[:own, own:].T, columns.T @ columns
            side[:own], side[own:] = left.sides @ taken, columns.T @ left.targets @ taken
            squares = (np.einsum("kj,kl,lj->j", taken, each, taken) for each in (left.squares, left.whole))
            self._made[key] = gram, side, *squares
        return self._made[key]

    def _left_at(self, matrix: Array, alone: IntArray, i: int) -> _Left:
        """Return what is left at a joint without the friction of motors ``alone`` (k,), which no other joint has."""
        key = (i, alone.tobytes(), matrix[alone].tobytes())
        if key not in self._left:
            mask, bodies, targets = self.fit.rows.masks[:, i], self._bodies[i], self._targets[i]
            friction = (self.friction(drive, matrix[drive])[mask] for drive in alone.tolist())
            columns = np.hstack([bodies[:, ~self._of_two], *friction])
            basis = np.linalg.qr(columns[:, columns.any(axis=0)])[0]
            self._left[key] = _Left(basis, bodies[:, self._of_two], targets)
        return self._left[key]

    def reading(self, matrix: Array, at_motors: bool) -> ReadRows:
        """Return the rows under a coupling."""
        blocks = tuple(self._block(matrix, i) for i in range(len(matrix)))
        every = tuple(np.arange(block.shape[1]) for block in blocks)
        mixing = np.linalg.solve(self.stated, matrix).T if at_motors else np.eye(len(matrix))
        return ReadRows(replace(self.fit.rows, blocks=blocks, columns=every), mixing)

    def _block(self, matrix: Array, i: int) -> Array:
        """Return the observation matrix of a joint under a coupling, shape (N, k)."""
        columns = np.zeros((len(self._inertial[i]), len(matrix), self.fit.model.coefficients_per_joint))
        for drive in np.flatnonzero(matrix[:, i]).tolist():
            columns[:, drive] = self.friction(drive, matrix[drive]) * matrix[drive, i]
        return np.column_stack([self._inertial[i], columns.reshape(len(columns), -1)])

    def friction(self, drive: int, row: Array) -> Array:
        """Return the friction columns of a motor with its row (n,) of C, at its own speed, filtered, shape (N, k)."""
        if (drive, row.tobytes()) not in self._friction:
            self.make_friction(drive, [row])
        return self._friction[drive, row.tobytes()]

    def make_friction(self, drive: int, wanted: Sequence[Array]) -> None:
        """Make the friction columns of a motor for rows (n,) of C side by side, but for those that are there."""
        new = [row for row in wanted if (drive, row.tobytes()) not in self._friction]
        if not new:
            return
        motion, prepared, rows = self._motion, self.fit.rows.prepared, np.array(new)
        motors = Motion(*(signal @ rows.T for signal in (motion.q, motion.dq, motion.ddq)))
        acts = self.fit.model.drives_of
        parts = [part.columns(motors) * (drive in acts(part)) for part in self.fit.model.friction]
        values = np.concatenate(parts, axis=2)
        flat = np.ascontiguousarray(values.reshape(len(values), -1).T)
        smooth = prepared.smooth(flat)[:, prepared.keep].reshape(len(rows), -1, len(prepared.keep))
        for row, own in zip(rows, smooth, strict=True):
            self._friction[drive, row.tobytes()] = np.ascontiguousarray(own.T)

    def _neighbours(self) -> Iterator[tuple[int, int]]:
        """Yield motors and joints: one or two joints before that of the motor, or the next one behind it."""
        above, is_open = _ancestors(self.fit), unexplained(self.fit)
        for motor in range(len(above)):
            for joint in range(len(above)):
                before = joint in above[motor] and motor - joint <= 2
                behind = motor in above[joint] and joint - motor == 1
                if (before or behind) and (is_open[motor] or is_open[joint]):
                    yield motor, joint


def _with(matrix: Array, place: tuple[int, int], value: float) -> Array:
    changed = matrix.copy()
    changed[place] = value
    return changed


def _ancestors(fit: QuickFit) -> list[frozenset[int]]:
    """Return the places of the moving joints between the base and each of them."""
    robot = fit.model.robot
    places = {joint.name: k for k, joint in enumerate(robot.active)}
    above: list[frozenset[int]] = []
    for joint in robot.joints:
        found = frozenset[int]() if joint.parent < 0 else above[joint.parent]
        parent = None if joint.parent < 0 else places.get(robot.joints[joint.parent].name)
        above.append(found if parent is None else found | {parent})
    return [above[k] for k, joint in enumerate(robot.joints) if joint.name in places]
