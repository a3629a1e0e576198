"""Orders, signs and scales of columns: the log with its columns read in another way, where that predicts it far better.

What is found among many readings of the same samples says too much good of itself (Stone 1974). So the search as such
is held out: half of the blocks of a log find a reading and are fitted to, those between are predicted, and the reverse.
A cause that is none of the columns' can still be taken in by the columns of another joint, where it lowers the sum by
one joint alone. So each torque that is read at another joint must be predicted better there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from itertools import combinations

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.causes.quick_fit import FitRows, QuickFit, Solved, Triangles, halves
from dynident.diagnosis.finding import listed

#: Gain of the score from which another reading is the true one, e^(gain / 2) in the ratio of residual deviations. An
#: order needs that both joints are explained then: torques of a light wrist hardly differ.
GAIN = 3.0

#: Relative residual below which a joint is explained.
GOOD = 0.3

#: Friction feeds power into a joint beyond doubt: z-score and share of torque times speed.
FEEDS, FEEDS_SHARE = -6.0, -0.05


@dataclass(frozen=True)
class Columns:
    """The rows of a log with its columns read in another way, and their fit.

    Attributes:
        rows: The rows.
        mixing: Which measured torque each joint has, shape (n, n).
        beta: Fitted base parameters.
    """

    rows: FitRows
    mixing: Array
    beta: Array


@dataclass(frozen=True)
class Interpretation:
    """A way to read the log.

    Attributes:
        name: Of the finding.
        joints: Those it concerns.
        gain: By how much the score falls.
        evidence: In words.
        remedy: In words.
        numbers: Further figures.
        columns: What is read in other columns; None for another cause.
    """

    name: str
    joints: tuple[str, ...]
    gain: float
    evidence: str
    remedy: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    columns: Columns | None = None


def variance_falls(gain: float) -> str:
    """Return a gain of the score in words, as the factor on the product of the joints' residual variances."""
    return f"the residual variance falls by a factor of {Decimal(float(gain)).exp():.3g} (product over the joints)"


def predicts_unseen(fit: QuickFit) -> bool:
    """Return whether other columns that are found on half of a log predict the other half better, both ways."""
    before, after, moved = np.zeros(len(fit.counts)), np.zeros(len(fit.counts)), np.zeros(len(fit.counts), bool)
    for half in halves(len(fit.rows.torque)):
        learned, unseen = fit.part(half), fit.part(~half)
        found = [*torque_orders(learned), *position_readings(learned)]
        columns = max(found, key=lambda reading: reading.gain).columns if found else None
        if columns is None:
            return False
        torque = columns.rows.torque @ columns.mixing.T
        before += unseen.mean_squares(unseen.rows, learned.plain.beta)
        after += unseen.mean_squares(replace(columns.rows, torque=torque), columns.beta) @ columns.mixing
        moved |= np.diag(columns.mixing) == 0
    gains = np.log(np.maximum(before, 1e-300) / np.maximum(after, 1e-300))
    return bool(gains.sum() > 0 and (gains[moved] > 0).all())


def torque_orders(fit: QuickFit) -> Iterator[Interpretation]:
    """Yield the orders of the torques under which a log agrees far better, that of the positions kept."""
    names = fit.model.robot.joint_names
    for order in _orders(len(names)):
        moved = [i for i, k in enumerate(order) if i != k]
        mixing = np.eye(len(names))[list(order)]
        solved = fit.solve(fit.triangles.products, mixing)
        gain = fit.plain.score - solved.score
        if gain > GAIN and _explained(fit, solved, mixing, moved):
            how = _in_words(names, order)
            joints = tuple(names[i] for i in moved)
            evidence = f"with their torques {how}, {variance_falls(gain)}"
            remedy = "name the torque columns in the order of the joints (log: columns: torque)"
            columns = Columns(fit.rows, mixing, solved.beta)
            yield Interpretation("torque order", joints, gain, evidence, remedy, columns=columns)


def _orders(joints: int) -> Iterator[tuple[int, ...]]:
    """Yield orders that are not that of the chain: two or three joints out of place, from the tip, all shifted."""
    plain = tuple(range(joints))
    cycles = [pair for pair in combinations(plain, 2)] + [
        cycle for i, j, k in combinations(plain, 3) for cycle in ((i, j, k), (i, k, j))
    ]
    orders = dict.fromkeys([*(_turned(plain, cycle) for cycle in cycles), *_whole_orders(joints)])
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


def _explained(fit: QuickFit, solved: Solved, mixing: Array, joints: Sequence[int]) -> bool:
    masks = fit.rows.masks
    size = [float(np.std((fit.rows.torque @ mixing[i])[masks[:, i]])) for i in joints]
    return bool((np.sqrt(solved.variances[list(joints)]) < GOOD * np.array(size)).all())


def position_readings(fit: QuickFit) -> Iterator[Interpretation]:
    """Yield the signs, orders and units of the positions under which a log agrees far better."""
    names, q = fit.model.robot.joint_names, np.asarray(fit.log.q)
    turning = np.array([joint.kind == "revolute" for joint in fit.model.robot.active])
    for i, name in enumerate(names):
        turned = q.copy()
        turned[:, i] *= -1
        yield from _read(
            fit, _reduced(fit, turned), "position sign", (name,), "negate the column of its position, or the axis"
        )
    pairs = [_turned(tuple(range(len(names))), pair) for pair in combinations(range(len(names)), 2)]
    for order in dict.fromkeys([*pairs, *_whole_orders(len(names))]):
        moved = tuple(name for i, name in enumerate(names) if order[i] != i)
        if not moved:
            continue
        swapped = _reduced(fit, q[:, list(order)])
        remedy = "name the position columns in the order of the joints (log: columns: q)"
        if len(moved) == 2:
            yield from _read(fit, swapped, "joint order", moved, remedy)
        remedy = "name the columns of positions and torques in the order of the joints (log: columns)"
        how = f"with their positions and torques {_in_words(names, order)}"
        yield from _read(fit, swapped, "joint order", moved, remedy, how, np.eye(len(names))[list(order)])
    if turning.all():
        remedy = "state the unit in the case file (log: units: {position: deg})"
        yield from _read(fit, _reduced(fit, np.deg2rad(q)), "positions in degrees", (), remedy)


def _reduced(fit: QuickFit, q: Array) -> tuple[FitRows, Triangles]:
    """Return the rows with other positions (N, n), and their triangles; torques of any mixing need no others."""
    rows = replace(fit.rows_of(replace(fit.log, q=q)), masks=fit.rows.masks)  # the same rows, or scores do not compare
    return rows, fit.triangles_of(rows)


def _read(
    fit: QuickFit,
    reduced: tuple[FitRows, Triangles],
    name: str,
    joints: tuple[str, ...],
    remedy: str,
    how: str = "with it,",
    mixing: Array | None = None,
) -> Iterator[Interpretation]:
    rows, triangles = reduced
    solved = fit.solve(triangles.products, mixing)
    gain = fit.plain.score - solved.score
    share, z = fit.friction_power(solved)
    if gain > GAIN + 1 and not ((z < FEEDS) & (share < FEEDS_SHARE)).any():
        evidence = f"{how} {variance_falls(gain)}"
        columns = Columns(rows, np.eye(len(share)) if mixing is None else mixing, solved.beta)
        yield Interpretation(name, joints, gain, evidence, remedy, columns=columns)
