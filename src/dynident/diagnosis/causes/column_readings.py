"""Orders, signs and units of columns: the log with its columns read in another way, where that explains it far better.

These are proposals; :mod:`.held_out` ranks them by samples that they were not fitted to.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from itertools import chain, combinations, pairwise, permutations

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray, vector_text
from dynident.case.case import Case
from dynident.case.evidence.positions import LITTLE_SLIDE, LITTLE_TURN
from dynident.data.motor_side import gears_of
from dynident.diagnosis.causes.held_out import ReadRows
from dynident.diagnosis.causes.quick_fit import FitRows, QuickFit, in_order
from dynident.diagnosis.causes.weighted_fit import EXACT, Products
from dynident.diagnosis.finding import ABSOLUTE, listed
from dynident.diagnosis.new_log import IN_MEMORY

#: Gain of the score from which another reading is the true one, e^(gain / 2) in the ratio of residual deviations. An
#: order needs that both joints are explained then: torques of a light wrist hardly differ.
GAIN = 3.0

#: Relative residual below which a joint is explained.
GOOD = 0.3

#: Friction feeds power into a joint beyond doubt: z-score and share of torque times speed.
FEEDS, FEEDS_SHARE = -6.0, -0.05

#: Gain of the score from which a sign is turned at a joint that friction drives.
FED = -0.5

#: Joints up to which all orders of their torques are tried.
FEW = 7

#: Other units of a position by the kind of the joint: the factor, its name, and the travel as read, in rad or m, that
#: is no usual one: of a unit that makes it smaller from there on, of one that makes it larger up to there.
UNITS: Mapping[str, tuple[tuple[float, str, float], ...]] = {
    "revolute": ((np.pi / 180, "degrees", 2 * np.pi), (180 / np.pi, "radians", LITTLE_TURN)),
    "prismatic": ((1e-3, "millimetres", 5.0), (1e3, "metres", LITTLE_SLIDE)),
}

#: Joints that travel oddly up to whose number all sets of them are read in other units; of more, pairs and all.
SUBSETS = 4


@dataclass(frozen=True)
class Interpretation:
    """A way to read the log.

    Attributes:
        name: Of the finding.
        joints: Those it concerns.
        gain: By how much the score falls.
        evidence: In words, before what is said of the gain.
        remedy: In words.
        reading: The rows of the log read in this way.
        numbers: Further figures.
        freedom: Continuous unknowns that were found beside the parameters.
    """

    name: str
    joints: tuple[str, ...]
    gain: float
    evidence: str
    remedy: str
    reading: ReadRows
    numbers: Mapping[str, float] = field(default_factory=dict)
    freedom: int = 0


def variance_falls(gain: float) -> str:
    """Return a gain of the score in words, as the factor on the product of the joints' residual variances."""
    return f"the residual variance falls by a factor of {Decimal(float(gain)).exp():.3g} (product over the joints)"


def feeding(share: Array, z: Array) -> BoolArray:
    """Return which joints friction drives beyond doubt, from the share of their power (n,) and its z-score (n,)."""
    return (z < FEEDS) & (share < FEEDS_SHARE)


def torques_of_columns(case: Case) -> Array:
    """Return what makes torques of the numbers in their columns, shape (n, n): units, gears and couplings."""
    robot, columns = case.robot, case.columns
    own = columns.joints or robot.joint_names
    units = dict(zip(own, columns.to_si("torque", np.ones((1, len(own))))[0], strict=True))
    scales = np.diag([units.get(name, 1.0) for name in robot.joint_names])
    return gears_of(robot).T @ scales if "torque" in columns.motor else scales


def torque_orders(fit: QuickFit, made: Array | None = None) -> Iterator[Interpretation]:
    """Yield the orders of the torques under which a log agrees far better, that of the positions kept.

    Args:
        fit: Of the log.
        made: What made torques of the columns, shape (n, n), which are exchanged before it; None for nothing.
    """
    names, stated = fit.model.robot.joint_names, fit.solve(fit.shared).score
    plain = f"{fit.effort}s"
    exchanged_columns = fit.exchanged
    if made is not None and fit.conversion is None:
        turn, back = made, np.linalg.inv(made)

        def exchanged_columns(order: Sequence[int]) -> Array:
            return turn @ in_order(order) @ back

    columns = {plain: exchanged_columns} | ({} if fit.conversion is None else {"currents and gains": in_order})
    for what, exchanged in columns.items():
        least, tried = GAIN, dict.fromkeys([*_orders(len(names)), _assigned_order(fit)])
        while tried:
            best, last = least, tuple(range(len(names)))
            mixings = np.array([exchanged(order) for order in tried])
            for order, mixing, variances in zip(tried, mixings, fit.variances(fit.shared, mixings), strict=True):
                moved = [i for i, k in enumerate(order) if i != k]
                gain = stated - float(np.log(variances).sum())
                if gain > least and moved and _explained(fit, variances, mixing, moved):
                    joints = tuple(names[i] for i in moved)
                    evidence = f"with their {what} {_in_words(names, order)},"
                    remedy = f"name the {fit.effort} columns in the order of the joints (log: columns: {fit.effort})"
                    remedy += ", and give each joint its own gain (drives)" * (what != plain)
                    yield Interpretation("torque order", joints, gain, evidence, remedy, ReadRows(fit.rows, mixing))
                    best, last = max((best, last), (gain, order))
            tried = dict.fromkeys(_turned(last, cycle) for cycle in _cycles(len(names))) if best > least else {}
            least = best + GAIN  # other columns are exchanged beside the best ones


def _assigned_order(fit: QuickFit) -> tuple[int, ...]:
    """Return the order of the torques whose residuals have the least product, parameters of each joint its own.

    That is an assignment of columns to joints (Kuhn 1955), each column fitted to the rows of each joint. It is that of
    the chain where all joints are explained, or each has the best column.
    """
    joints = len(fit.counts)
    plain = tuple(range(joints))
    if not (fit.relative > GOOD).any():
        return plain
    left = [np.sum(factor[len(own) :, len(own) : len(own) + joints] ** 2, axis=0) for own, factor in fit.triangles]
    whole = np.maximum(np.diag(fit.rows.torque.T @ fit.rows.torque), 1e-300)
    costs = np.log(np.maximum(np.array(left) / whole, EXACT**2))
    if np.array_equal(np.argmin(costs, axis=1), plain):
        return plain
    if joints <= FEW:  # all orders are tried in less time than SciPy's assignment takes to load
        orders = np.array(list(permutations(plain)))
        return tuple(orders[np.argmin(costs[plain, orders].sum(axis=1))].tolist())
    from scipy.optimize import linear_sum_assignment

    return tuple(linear_sum_assignment(costs)[1].tolist())


def _cycles(joints: int) -> Iterator[tuple[int, ...]]:
    """Yield two or three joints out of place."""
    yield from combinations(range(joints), 2)
    for i, j, k in combinations(range(joints), 3):
        yield from ((i, j, k), (i, k, j))


def _orders(joints: int) -> Iterator[tuple[int, ...]]:
    """Yield orders that are not that of the chain: two or three joints out of place, from the tip, all shifted."""
    plain = tuple(range(joints))
    orders = dict.fromkeys([*(_turned(plain, cycle) for cycle in _cycles(joints)), *_whole_orders(joints)])
    yield from (order for order in orders if order != plain)


def _in_words(names: Sequence[str], order: Sequence[int]) -> str:
    """Return what is done to the columns of the joints that are out of place."""
    moved = [i for i, k in enumerate(order) if i != k]
    return "exchanged" if len(moved) == 2 else f"read as those of {listed([names[order.index(i)] for i in moved])}"


def _whole_orders(joints: int) -> list[tuple[int, ...]]:
    """Return the orders from the tip, and with all joints shifted by one to either side."""
    plain = tuple(range(joints))
    return [plain[::-1], plain[1:] + plain[:1], plain[-1:] + plain[:-1]]


def _turned(order: tuple[int, ...], cycle: tuple[int, ...]) -> tuple[int, ...]:
    """Return an order with each entry of a cycle at the place of the one before."""
    turned = list(order)
    for place, entry in zip(cycle, (*cycle[1:], cycle[0]), strict=True):
        turned[place] = order[entry]
    return tuple(turned)


def _explained(fit: QuickFit, variances: Array, mixing: Array, joints: Sequence[int]) -> bool:
    masks = fit.rows.masks
    size = [float(np.std((fit.rows.torque @ mixing[i])[masks[:, i]])) for i in joints]
    return bool((np.sqrt(variances[list(joints)]) < GOOD * np.array(size)).all())


class PositionReadings:
    """Signs, orders and units of the positions under which a log agrees far better; products of each are made once."""

    def __init__(self, fit: QuickFit, made: Array | None = None) -> None:
        self.fit, self.made = fit, made
        self._names = fit.model.robot.joint_names
        self._products: dict[tuple[tuple[int, ...], tuple[float, ...]], Products] = {}
        self._of_coupled: dict[tuple[float, ...], Products] = {}

    def found(self, wrong: BoolArray, feeds: BoolArray) -> Iterator[Interpretation]:
        """Yield the readings under which the log agrees far better.

        Pairs of positions are exchanged at ``wrong`` joints, shape (n,), and beside them, or those of neighbours where
        none is wrong, and all positions are read in another order or unit where half of the joints are wrong; a
        position of another sign may upset other joints alone, and mends friction that drives a joint, ``feeds`` (n,),
        as a torque of another sign does. An axis that the robot model counts the other way turns both. Columns may be
        those of coupled motors at ``wrong`` joints.
        """
        fit, names, joints = self.fit, self._names, len(self._names)
        near = wrong | np.append(wrong[1:], False) | np.append(False, wrong[:-1])
        most, plain, ones = wrong.sum() >= len(wrong) / 2, tuple(range(joints)), np.ones(joints)
        turning = np.array([joint.kind == "revolute" for joint in fit.model.robot.active])
        sets = [np.arange(joints) == i for i in range(joints)]
        sets += {own.tobytes(): own for own in (turning, ~turning, turning | True) if own.sum() > 1}.values()
        for own in sets:
            turned, told = np.where(own, -1.0, 1.0), tuple(names[i] for i in np.flatnonzero(own))
            its = "its position" if len(told) == 1 else "their positions"
            remedy, least = f"negate the column of {its}, or the axis", FED if feeds[own].all() else GAIN + 1.0
            yield from self._read(plain, turned, "position sign", told, remedy, least)
            both = f"{its} and {fit.effort}{'s' * (len(told) > 1)}"
            how, remedy = f"with {both} turned,", f"turn the signs of {both}, or the axis in the robot model"
            yield from self._read(plain, turned, "axis sign", told, remedy, how=how, mixing=np.diag(turned))
        pairs = list(combinations(np.flatnonzero(near).tolist(), 2)) or list(pairwise(plain))
        orders = [_turned(plain, pair) for pair in pairs]
        for order in dict.fromkeys(chain(orders, _whole_orders(joints) if most else ())):
            moved = tuple(name for i, name in enumerate(names) if order[i] != i)
            if not moved:
                continue
            remedy = "name the position columns in the order of the joints (log: columns: q)"
            if len(moved) == 2:
                yield from self._read(order, ones, "joint order", moved, remedy)
            line = f"joints: [{listed([names[order.index(i)] for i in plain])}]"
            if fit.log.source.path in IN_MEMORY:
                line = f"q = q[:, {[*order]}], and so the {fit.effort}s"
            remedy = f"write {line}, or name the columns of both in the order of the joints (log: columns)"
            how = f"with their positions and {fit.effort}s {_in_words(names, order)},"
            yield from self._read(order, ones, "joint order", moved, remedy, how=how, mixing=fit.exchanged(order))
        if np.array_equal(np.asarray(fit.model.robot.coupling), np.eye(joints)):
            for joint, motor in pairwise(plain):
                if (wrong[joint] or wrong[motor]) and turning[joint] and turning[motor]:
                    yield from self._of_motors(joint, motor)
                    yield from self._absolute(joint, motor)
        if turning.all() and most:
            remedy = "state the unit in the case file (log: units: {position: deg})"
            yield from self._read(plain, np.deg2rad(ones), "positions in degrees", (), remedy)

    def units(self) -> Iterator[Interpretation]:
        """Yield the positions of joints that travel oddly, of one or some of them at once, in another unit."""
        ways, joints = np.ptp(np.asarray(self.fit.log.q), axis=0), self.fit.model.robot.active
        odd = {
            i: (factor, unit)
            for i in np.flatnonzero(ways).tolist()
            for factor, unit, limit in UNITS[joints[i].kind]
            if (ways[i] > limit if factor < 1.0 else ways[i] < limit)
        }
        for size in range(1, len(odd) + 1):
            for some in combinations(odd, size) if len(odd) <= SUBSETS or size in (1, 2, len(odd)) else ():
                factors, plain = np.ones(len(joints)), tuple(range(len(joints)))
                factors[list(some)] = [odd[i][0] for i in some]
                read = "; ".join(f"{joints[i].name} in {odd[i][1]}" for i in some) if size > 1 else odd[some[0]][1]
                how = f"its position read in {read}," if size == 1 else f"positions read anew ({read}),"
                remedy, names = "state the unit (log: units: {position: [...]})", tuple(joints[i].name for i in some)
                for found in self._read(plain, factors, "position unit", names, remedy, GAIN - 1.0, how):
                    yield replace(found, numbers={f"factor {joints[i].name}": odd[i][0] for i in some})

    def mirrored(self) -> ReadRows:
        """Return the rows with all positions of the other sign."""
        joints = len(self._names)
        return ReadRows(self._rows(tuple(range(joints)), (-1.0,) * joints), np.eye(joints))

    def _read(
        self,
        order: tuple[int, ...],
        factors: Array,
        name: str,
        joints: tuple[str, ...],
        remedy: str,
        least: float = GAIN + 1.0,
        how: str = "with it,",
        mixing: Array | None = None,
    ) -> Iterator[Interpretation]:
        """Yield what columns of positions in an order, times ``factors`` (n,), explain, where that is enough."""
        fit, key = self.fit, (order, tuple(factors.tolist()))
        if key not in self._products:
            self._products[key] = fit.products_of(self._rows(*key))
        solved = fit.solve(self._products[key], mixing)
        gain = fit.plain.score - solved.score
        if gain > least and not feeding(*fit.friction_power(solved)).any():
            reading = ReadRows(self._rows(*key), np.eye(len(factors)) if mixing is None else mixing)
            yield Interpretation(name, joints, gain, how, remedy, reading)

    def _of_motors(self, joint: int, motor: int) -> Iterator[Interpretation]:
        """Yield a log whose columns are those of motors, one of which turns with a joint before it as with its own.

        So do the motors of a parallelogram. Friction acts at the speeds that were logged; positions and torques of the
        joints follow from motor positions = C q and torques = C' tau of the motors.
        """
        fit, names = self.fit, self._names
        for way in (1.0, -1.0):
            coupling = np.eye(len(names))
            coupling[motor, joint] = way
            if (joint, motor, way) not in self._of_coupled:
                self._of_coupled[joint, motor, way] = fit.products_of(self._coupled_rows(coupling))
            solved = fit.solve(self._of_coupled[joint, motor, way], coupling.T)
            gain, touched = fit.plain.score - solved.score, (joint, motor)
            if gain <= GAIN + 1.0 or not _explained(fit, solved.variances, coupling.T, touched):
                continue
            if feeding(*fit.friction_power(solved)).any():
                continue
            how = (
                f"with columns of motors, that of {names[motor]} turning {'with' if way > 0 else 'against'} "
                f"{names[joint]} as well (position = C q, C' torque),"
            )
            stated = ", ".join(f"[{vector_text(row, 6)}]" for row in coupling)
            remedy = f"state the coupling of the motors, as of a parallelogram (coupling: [{stated}]; log: side: motor"
            geared = any(one.drive.gear_ratio != 1.0 for one in fit.model.robot.active)
            remedy += f"{', with gear_ratio: 1 where the columns are behind the gears' * geared})"
            numbers = {f"entry {motor + 1}, {joint + 1}": way}
            reading = ReadRows(self._coupled_rows(coupling), coupling.T)
            yield Interpretation("coupling", tuple(names[i] for i in touched), gain, how, remedy, reading, numbers)

    def _absolute(self, before: int, joint: int) -> Iterator[Interpretation]:
        """Yield a log whose position of a joint is counted from the base, as if the joint before it stood still.

        So does a controller that states the angle of a forearm against the horizontal. Torques are those of joints.
        """
        fit, names, size = self.fit, self._names, len(self._names)
        for way in (1.0, -1.0):
            key, summed = (before, joint, way, 0.0), np.eye(size)
            summed[joint, before] = way
            if key not in self._of_coupled:
                self._of_coupled[key] = fit.products_of(fit.rows_mixed(summed))
            solved = fit.solve(self._of_coupled[key])
            gain = fit.plain.score - solved.score
            if gain <= GAIN + 1.0 or not _explained(fit, solved.variances, np.eye(size), (before, joint)):
                continue
            if feeding(*fit.friction_power(solved)).any():
                continue
            word = "plus" if way > 0 else "less"
            how = (
                f"with its position {word} that of {names[before]}, as a controller counts an angle from the base and "
                "not from the link before,"
            )
            remedy = "name the sum of both columns as its position (log: columns: {q: [..., a + b, ...]})"
            reading = ReadRows(fit.rows_mixed(summed), np.eye(size))
            numbers = {f"of {names[before]}": way}
            yield Interpretation(ABSOLUTE, (names[joint],), gain, how, remedy, reading, numbers)

    def _coupled_rows(self, coupling: Array) -> FitRows:
        """Return the rows of a log of motors with a coupling (n, n): bodies at the joints, friction as logged."""
        fit, blocks, columns = self.fit, list[Array](), list[IntArray]()
        moved = fit.rows_mixed(np.linalg.inv(coupling))
        is_body = fit.base.independent < fit.model.inertial_count
        for i, (block, own) in enumerate(zip(moved.blocks, moved.columns, strict=True)):
            parts, places = [block[:, is_body[own]]], [own[is_body[own]]]
            for k in np.flatnonzero(coupling[:, i]).tolist():
                other = fit.rows.columns[k]
                parts.append(coupling[k, i] * fit.rows.blocks[k][:, ~is_body[other]])
                places.append(other[~is_body[other]])
            blocks.append(np.hstack(parts))
            columns.append(np.concatenate(places))
        return replace(moved, blocks=tuple(blocks), columns=tuple(columns))

    def _rows(self, order: tuple[int, ...], factors: tuple[float, ...]) -> FitRows:
        """Return the rows with such positions."""
        return self.fit.rows_mixed(np.diag(factors) @ np.eye(len(factors))[list(order)])
