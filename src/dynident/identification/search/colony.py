"""The artificial bee colony of Karaboga 2005 on a sum over rows, compiled.

A bee changes one dimension of its source, so its residuals change by a multiple of one column: the residuals of every
source are kept, a trial costs one pass over one column, and joints where that column is zero cost nothing. A trial
ends as soon as its partial sum exceeds the source it competes with. All random numbers are drawn beforehand by NumPy
and sums have a fixed order, so a seed repeats its run.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.identification.search.landscape import Landscape
from dynident.identification.search.swarm import Rules, Stage, Swarm, run
from dynident.model.kernels.jit import compiled, inlined

#: Accepted moves of a source after which its residuals are computed anew, so that rounding cannot add up.
REFRESH = 50

_CYCLES = 256  # cycles whose random numbers are drawn at a time
_BLOCK = 4096  # rows between two looks at the partial sum
_LANES = 128  # partial sums side by side, so that the loop runs in vector registers


@dataclass(frozen=True)
class Draws:
    """Uniform random numbers in [0, 1) of some cycles.

    Attributes:
        moves: Per cycle and bee (S employed, then S onlookers): roulette, dimension, neighbour and step, shape
            (cycles, 2 S, 4).
        scouts: A new source per cycle, shape (cycles, b).
    """

    moves: Array
    scouts: Array


def draw(generator: np.random.Generator, cycles: int, sources: int, dimensions: int) -> Iterator[Draws]:
    """Draw the random numbers of all cycles, some hundred cycles at a time."""
    for start in range(0, cycles, _CYCLES):
        count = min(_CYCLES, cycles - start)
        yield Draws(generator.random((count, 2 * sources, 4)), generator.random((count, dimensions)))


def search(land: Landscape, lower: Array, upper: Array, colony: int, limit: int, cycles: int, seed: int) -> Swarm:
    """Search a box with ``colony`` bees, half of them employed, half onlookers; see :func:`stages`."""
    return run(land, stages(land, lower, upper, colony, limit, cycles, seed), Rules(cycles), cycles)


def stages(
    land: Landscape,
    lower: Array,
    upper: Array,
    colony: int,
    limit: int,
    cycles: int,
    seed: int,
    stride: int | None = None,
) -> Iterator[Stage]:
    """Search a box with ``colony`` bees, half of them employed, half onlookers.

    Args:
        land: What to minimise.
        lower: Lower bounds, shape (b,).
        upper: Upper bounds, shape (b,).
        colony: Number of bees, even, 4 or more; as many random sources are drawn (7) and the better half kept (8).
        limit: Trials without success above which a source may be given up (13).
        cycles: Number of cycles.
        seed: Seed of the random numbers.
        stride: Cycles between two stages; None for as many as are drawn at a time. The path is the same.
    """
    generator = np.random.default_rng(seed)
    size, sources = len(lower), colony // 2
    x = lower + generator.random((colony, size)) * (upper - lower)  # (7)
    residuals = x @ land.columns
    np.subtract(land.target, residuals, out=residuals)
    sums = np.array([land.sums(row) for row in residuals])
    chosen = np.argsort(sums @ land.weights, kind="stable")[:sources]
    x, residuals, sums = x[chosen], residuals[chosen], sums[chosen]
    values = sums @ land.weights + land.constant
    place = (land.columns, land.target, land.edges, land.present, land.weights, land.power, land.constant)
    flock = (x, residuals, sums, values, np.zeros(sources, np.int64), np.zeros(sources, np.int64))
    first = int(np.argmin(values))
    found = np.append(values[first], x[first])
    scouts, done = 0, 0
    for draws in draw(generator, cycles, sources, size):
        step = len(draws.moves) if stride is None else stride
        for start in range(0, len(draws.moves), step):
            moves = draws.moves[start : start + step]
            trace = np.empty(len(moves))
            lost = draws.scouts[start : start + step]
            scouts += _fly(place, (lower, upper), flock, found, moves, lost, limit, trace)
            done += len(trace)
            yield Stage(found[1:].copy(), trace, colony + 2 * sources * done + scouts, scouts)


# Types of the compiled functions: place = (columns, target, edges, present, weights, power, constant) of the landscape;
# flock = (x, residuals, sums, values, trials, moves) of the S sources.
_Place = tuple[Array, Array, IntArray, BoolArray, Array, int, float]
_Flock = tuple[Array, Array, Array, Array, IntArray, IntArray]


@inlined
def _block_sum(residual: Array, column: Array, step: float, start: int, stop: int, power: int, lanes: Array) -> float:
    """Return sum |residual - step column|^power over some rows, many partial sums side by side."""
    for k in range(_LANES):
        lanes[k] = 0.0
    whole = start + (stop - start) // _LANES * _LANES
    for i in range(start, whole, _LANES):
        if power == 1:
            for k in range(_LANES):
                lanes[k] += abs(residual[i + k] - step * column[i + k])
        else:
            for k in range(_LANES):
                lanes[k] += (residual[i + k] - step * column[i + k]) ** 2
    for i in range(whole, stop):
        rest = abs(residual[i] - step * column[i])
        lanes[i - whole] += rest if power == 1 else rest * rest
    total = 0.0
    for k in range(_LANES):
        total += lanes[k]
    return total


@inlined
def _try(place: _Place, flock: _Flock, s: int, j: int, step: float, sums: Array, lanes: Array) -> float:
    """Return the objective of source s moved by ``step`` along j; infinity once it is no better than the source.

    Writes the sums of each block at the moved source.
    """
    columns, _, edges, present, weights, power, constant = place
    total = constant
    for i in range(len(weights)):
        sums[i] = flock[2][s, i]
        if not present[j, i]:
            total += weights[i] * sums[i]
    for i in range(len(weights)):
        if present[j, i]:
            sums[i] = 0.0
            for start in range(edges[i], edges[i + 1], _BLOCK):
                stop = min(start + _BLOCK, edges[i + 1])
                part = _block_sum(flock[1][s], columns[j], step, start, stop, power, lanes)
                sums[i] += part
                total += weights[i] * part
                if total >= flock[3][s]:
                    return np.inf
    return total


@inlined
def _accept(place: _Place, flock: _Flock, s: int, j: int, value: float, sums: Array, total: float) -> None:
    """Move source s to ``value`` along j, its residuals by a multiple of one column."""
    columns, edges, present, residuals = place[0], place[2], place[3], flock[1]
    step = value - flock[0][s, j]
    flock[0][s, j] = value
    flock[3][s] = total
    flock[4][s] = 0
    flock[5][s] += 1
    for i in range(len(sums)):
        flock[2][s, i] = sums[i]
        if present[j, i]:
            for row in range(edges[i], edges[i + 1]):
                residuals[s, row] -= step * columns[j, row]


@inlined
def _settle(place: _Place, flock: _Flock, s: int) -> None:
    """Compute the residuals, sums and objective of source s from its position."""
    columns, target, edges, present, weights, power, constant = place
    x, residuals, kept, values, _, moves = flock
    for row in range(len(target)):
        residuals[s, row] = target[row]
    values[s] = constant
    moves[s] = 0
    for i in range(len(weights)):
        for j in range(len(columns)):
            if present[j, i]:
                for row in range(edges[i], edges[i + 1]):
                    residuals[s, row] -= x[s, j] * columns[j, row]
        total = 0.0
        for row in range(edges[i], edges[i + 1]):
            rest = abs(residuals[s, row])
            total += rest if power == 1 else rest * rest
        kept[s, i] = total
        values[s] += weights[i] * total


@inlined
def _visit(
    place: _Place, lower: Array, upper: Array, flock: _Flock, s: int, dice: Array, sums: Array, lanes: Array
) -> None:
    """Let one bee search near source s, (10), and keep the better of the two places, (11)."""
    x, trials = flock[0], flock[4]
    j = int(dice[1] * len(lower))
    k = int(dice[2] * (len(x) - 1))
    if k >= s:
        k += 1
    value = x[s, j] + (2.0 * dice[3] - 1.0) * (x[s, j] - x[k, j])
    value = min(max(value, lower[j]), upper[j])
    total = _try(place, flock, s, j, value - x[s, j], sums, lanes)
    if total < flock[3][s]:
        _accept(place, flock, s, j, value, sums, total)
    else:
        trials[s] += 1


@inlined
def _follow(flock: _Flock, dice: float) -> int:
    """Return the source that an onlooker chooses with probability (12), fitness (8)."""
    values = flock[3]
    whole = 0.0
    for s in range(len(values)):
        whole += 1.0 / (1.0 + values[s])
    rest = dice * whole
    for s in range(len(values) - 1):
        rest -= 1.0 / (1.0 + values[s])
        if rest < 0.0:
            return s
    return len(values) - 1


@inlined
def _remember(flock: _Flock, found: Array) -> None:
    """Keep (objective, x) of the best source where it is better than the one kept."""
    x, values = flock[0], flock[3]
    for s in range(len(values)):
        if values[s] < found[0]:
            found[0] = values[s]
            for j in range(x.shape[1]):
                found[j + 1] = x[s, j]


@inlined
def _scout(flock: _Flock, lower: Array, upper: Array, dice: Array, limit: int) -> int:
    """Replace the source with the most vain trials where they exceed the limit, (13); return it or -1."""
    x, trials = flock[0], flock[4]
    idle = 0
    for s in range(len(trials)):
        if trials[s] > trials[idle]:
            idle = s
    if trials[idle] <= limit:
        return -1
    for j in range(len(lower)):
        x[idle, j] = lower[j] + dice[j] * (upper[j] - lower[j])
    trials[idle] = 0
    return idle


@compiled
def _fly(
    place: _Place,
    box: tuple[Array, Array],
    flock: _Flock,
    found: Array,
    moves: Array,
    scouts: Array,
    limit: int,
    trace: Array,
) -> int:
    """Run cycles; write (objective, x) of the best source and the trace; return the number of scouts."""
    sources, sent, lower, upper = len(flock[0]), 0, box[0], box[1]
    sums, lanes, chosen = np.empty(len(place[4])), np.empty(_LANES), np.empty(2 * sources, np.int64)
    for cycle in range(len(moves)):
        for bee in range(2 * sources):
            if bee == sources:  # every onlooker sees the fitness at the end of the employed bees' phase
                for onlooker in range(sources, 2 * sources):
                    chosen[onlooker] = _follow(flock, moves[cycle, onlooker, 0])
            s = chosen[bee] if bee >= sources else bee
            _visit(place, lower, upper, flock, s, moves[cycle, bee], sums, lanes)
        _remember(flock, found)
        trace[cycle] = found[0]
        lost = _scout(flock, lower, upper, scouts[cycle], limit)
        sent += lost >= 0
        for s in range(sources):
            if s == lost or flock[5][s] >= REFRESH:
                _settle(place, flock, s)
    return sent
