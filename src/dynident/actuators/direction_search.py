"""Which joints of an arm run the other way, one or several: all ways of turning its joints over are tried."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np

from dynident.actuators.directions import (
    AXIS,
    NEARLY,
    ORDER,
    Directions,
    LogTorques,
    Turned,
    compared,
    likeliest,
    runs_away,
)
from dynident.actuators.servo_log import ServoLog
from dynident.actuators.torque_rows import COMMAND, ODDS, ZERO
from dynident.arrays import BoolArray
from dynident.model.robot import Robot

#: Zeros of an encoder in rad that are tried, within the reach of each of which a fit makes up for the rest, and those
#: about the best one.
_TURNS = [angle for angle in np.linspace(-np.pi, np.pi, 12, endpoint=False).tolist() if abs(angle) > ZERO]
_NEAR_TURNS = np.linspace(-0.4, 0.4, 9).tolist()

#: Logs of this length in s in all are looked at, and all ways to turn joints over are tried on.
_LONG_S, _SHORT_S = 300.0, 40.0

#: Arms of at most so many joints have all ways tried; of others the best one is changed by one or two joints.
_ALL = 7

#: Sets of joints that explain the logs nearly as well, at most.
_FEW = 4


def turned_over(robot: Robot, logs: Sequence[ServoLog]) -> list[Turned]:
    """Return the joints that run the other way, or whose encoders have another zero, the plainest first.

    Friction, armature and a drive whose torque grows with the position error, of any law, explain the torque that the
    bodies ask for along the measured motion, in each log, with a zero of the encoder that is off by up to 0.3 rad: once
    as the log is, and once with joints turned over. As a joint moves the torques of all others, all sets of joints
    compete on some of the logs; of those that explain them nearly as well the one of the fewest joints. That is told
    where all logs are far more likely with it, and with each of its joints than without that one, by the test of Vuong,
    "Likelihood ratio tests for model selection and non-nested hypotheses", Econometrica 57, 1989, over
    pieces of the logs. An arm that looks the same from both sides is not told, and commands of a joint that follows
    them are right. Zeros of the encoders are told where they explain the logs for sure and directions do not, or
    nearly as much by fewer joints. Two joints that are exchanged in the log are told in the place of all these where
    that explains nearly as much.

    Args:
        robot: With inertias, in SI units.
        logs: Logs of its joints.

    Raises:
        NotConsistent: The robot model has no inertias.
    """
    chosen = [logs[k] for k in _places(logs, _LONG_S)]
    parts = [LogTorques.of(robot, log) for log in chosen]
    short = _places(chosen, _SHORT_S, [part.moves.mean() for part in parts])
    few = [parts[k] for k in short]
    turned = _likeliest_sides(few)
    zeroed = _likeliest_zeros(few, runs_away(parts))
    beside = [part.taken(turned[0]) for part in few]
    is_zeroed = compared(AXIS, 0, beside, zeroed, _ways(zeroed)).is_sure
    ways = [zeroed, *turned] if is_zeroed else [*turned, zeroed]
    best, found = next((own for own in (_sure(parts, way) for way in ways) if own[1]), (zeroed, []))
    if len(found) > 1 and not is_zeroed:  # fewer joints whose zeros explain nearly as much
        other, zeros = _sure(parts, zeroed)
        most, more = (_cost(few, parts[0].directions) - _cost(few, each) for each in (best, other))
        found = zeros if 0 < len(zeros) < len(found) and more > NEARLY * most else found
    exchanged = _exchanged(robot, [chosen[k] for k in short], few, best) if found else None
    return sorted(found, key=lambda one: -one.more) if exchanged is None else [exchanged]


def _exchanged(robot: Robot, logs: Sequence[ServoLog], parts: Sequence[LogTorques], best: Directions) -> Turned | None:
    """Return the two joints whose exchange explains logs nearly as well as directions or zeros do, or better.

    Only what is surely otherwise is looked at again: one exchange of columns is less than two zeros. An exchange that
    explains no more than one joint alone does is none.
    """
    as_is, signals = parts[0].directions, ("q", "q_ref", "dq_ref", "added", "enabled", "failed")
    first = _cost(parts, as_is)
    gain, costs = first - _cost(parts, best), dict[tuple[int, int], float]()
    for one, other in combinations(range(robot.dof), 2):
        order = list(range(robot.dof))
        order[one], order[other] = other, one
        swapped = [replace(log, **{name: getattr(log, name)[:, order] for name in signals}) for log in logs]
        costs[one, other] = _cost([LogTorques.of(robot, log) for log in swapped], as_is)
    if not costs:
        return None
    one, other = min(costs, key=lambda pair: costs[pair])
    more = first - costs[one, other]
    share = NEARLY if best.others(as_is) > 1 else 1.0 / NEARLY
    return Turned(ORDER, one, more, True, 0.0, others=((ORDER, other),)) if more > share * gain else None


def _ways(directions: Directions) -> float:
    """Return how many ways of taking the joints to run were tried beside one."""
    return (len(_TURNS) + 1.0 if directions.zeros.any() else 2.0) ** len(directions.zeros)


def _cost(parts: Sequence[LogTorques], directions: Directions, reach: float = 1.0) -> float:
    """Return minus the logarithm of the likelihood of logs whose joints run in some way; ``reach`` as of ``costs``."""
    return float(np.sum([part.costs(directions, reach) for part in parts]))


def _with_drives(parts: Sequence[LogTorques], directions: Directions, away: BoolArray) -> Directions:
    """Return directions with the drives of joints that go away from their commands, (n,), turned over if likelier."""
    if not away.any():
        return directions
    turned = tuple(COMMAND if is_away else "" for is_away in away)
    ways = [
        np.sum([part.costs(replace(directions, drives=each)) for part in parts], axis=0)
        for each in (directions.drives, turned)
    ]
    drives = tuple(kind if other < own else "" for kind, own, other in zip(turned, *ways, strict=True))
    return replace(directions, drives=drives)


def _likeliest_sides(parts: Sequence[LogTorques]) -> list[Directions]:
    """Return directions of joints and drives that explain logs best or nearly so, the fewest changes first."""
    first, away = parts[0].directions, runs_away(parts)
    costs = dict[tuple[float, ...], tuple[float, Directions]]()

    def cost(sides: tuple[float, ...]) -> float:
        if sides not in costs:
            found = _with_drives(parts, replace(first, sides=np.array(sides)), away)
            costs[sides] = _cost(parts, found), found
        return costs[sides][0]

    as_is = tuple(first.sides.tolist())
    best = min(product((1.0, -1.0), repeat=len(as_is)), key=cost) if len(as_is) <= _ALL else _descended(as_is, cost)
    most = cost(as_is) - cost(best)
    near = [sides for sides in costs if cost(as_is) - cost(sides) >= NEARLY * most]
    found = [costs[sides][1] for sides in sorted(near, key=lambda sides: (sides.count(-1.0), cost(sides)))[:_FEW]]
    likely = costs[best][1]
    found = [one for one in found if not compared(AXIS, 0, [part.taken(one) for part in parts], likely).is_sure]
    return found or [likely]


def _descended(first: tuple[float, ...], cost: Callable[[tuple[float, ...]], float]) -> tuple[float, ...]:
    """Return the directions of joints that cost least of those with one or two other ones, again and again."""
    places, best = range(len(first)), first
    while True:
        moves = [(k,) for k in places] + list(combinations(places, 2))
        tried = [tuple(-side if k in move else side for k, side in enumerate(best)) for move in moves]
        found = min(tried, key=cost)
        if cost(found) >= cost(best):
            return best
        best = found


def _likeliest_zeros(parts: Sequence[LogTorques], away: BoolArray) -> Directions:
    """Return the zeros of the encoders that explain some logs best, with the drives of joints that go away, (n,).

    From the last joint to the first, again and again: the angle of one joint, and of it and against it the next one,
    so that the links beyond keep their directions.
    """
    found = _with_drives(parts, parts[0].directions, away)
    least, is_better, one = _cost(parts, found), True, np.eye(len(away))
    while is_better:
        is_better = False
        for joint in reversed(range(len(one))):
            moves = [one[joint], one[joint] - one[joint + 1]] if joint + 1 < len(one) else [one[joint]]
            tried = [replace(found, zeros=found.zeros + turn * move) for move in moves for turn in _TURNS]
            costs = [_cost(parts, each) for each in tried]
            if min(costs) < least - math.log(ODDS):
                found, least, is_better = tried[int(np.argmin(costs))], min(costs), True
    return replace(found, zeros=np.angle(np.exp(1j * found.zeros)))


def _sure(parts: Sequence[LogTorques], directions: Directions) -> tuple[Directions, list[Turned]]:
    """Return what of directions is sure: all of them beside the logs as they are, and each one beside the others."""
    tried = _ways(directions)
    if not compared(AXIS, 0, parts, directions, tried).is_sure:
        return directions, []
    while True:
        for joint in np.flatnonzero(directions.zeros).tolist():
            near = [directions.zeroed(joint, directions.zeros[joint] + turn) for turn in _NEAR_TURNS]
            directions = min(near, key=lambda each: _cost(parts, each, reach=0.0))
        found, unsure = list[Turned](), list[tuple[float, Directions]]()
        for joint in range(len(directions.zeros)):
            without, kind = directions.without(joint)
            if not kind and not directions.zeros[joint]:
                continue
            beside = [part.taken(without) for part in parts]
            if kind:
                best = likeliest(beside)
                own = None if best is None else _beside_zeros(beside, best)
            else:
                one = compared(AXIS, joint, beside, directions, tried)
                zero = float(np.angle(np.exp(1j * directions.zeros[joint])))
                own = replace(one, zero=zero, is_zero=True) if one.is_sure else None
            if own is None:
                unsure.append((compared(AXIS, joint, beside, directions).more, without))
            else:
                found.append(own)
        if not unsure:
            return directions, found
        directions = min(unsure, key=lambda each: each[0])[1]


def _beside_zeros(parts: Sequence[LogTorques], best: Turned) -> Turned:
    """Return what is turned over with the zero of its encoder that explains the logs as well."""
    zeros = [compared(AXIS, best.joint, parts, parts[0].directions.zeroed(best.joint, turn)).more for turn in _TURNS]
    most = int(np.argmax(zeros))
    if zeros[most] < NEARLY * best.more:
        return best
    return replace(best, zero=_TURNS[most], is_zero=NEARLY * zeros[most] > best.more)


def _places(logs: Sequence[ServoLog], seconds: float, shares: Sequence[float] | None = None) -> list[int]:
    """Return places of logs of some length in s in all, drawn from those that are given.

    Args:
        logs: The logs.
        seconds: Their length in all; where only some joints move, a log counts by its share of them.
        shares: Share of the joints that move in each log; None for all.
    """
    order = np.random.default_rng(0).permutation(len(logs))
    lengths = np.array([log.time[-1] - log.time[0] for log in logs]) * (1.0 if shares is None else np.array(shares))
    return sorted(order[: 1 + int(np.searchsorted(np.cumsum(lengths[order]), seconds))].tolist())
