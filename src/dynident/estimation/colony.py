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
from dynident.model.kernels.jit import compiled

#: Accepted moves of a source after which its residuals are computed anew, so that rounding cannot add up.
REFRESH = 50

_CYCLES = 256  # cycles whose random numbers are drawn at a time
_BLOCK = 4096  # rows between two looks at the partial sum
_LANES = 128  # partial sums side by side, so that the loop runs in vector registers


@dataclass(frozen=True)
class Landscape:
    """The objective F(x) = constant + sum_i weight_i sum_{rows of block i} |target - columns' x|^power.

    Attributes:
        columns: Observation matrix, each column contiguous, shape (b, r).
        target: Shape (r,).
        edges: First row of each block (joint), then r, shape (n + 1,).
        present: Whether a column is not zero throughout a block, shape (b, n).
        weights: Shape (n,).
        power: 1 or 2.
        constant: See above.
    """

    columns: Array
    target: Array
    edges: IntArray
    present: BoolArray
    weights: Array
    power: int
    constant: float = 0.0

    def sums(self, residual: Array) -> Array:
        """Return sum |residual|^power of each block, shape (n,)."""
        size = np.abs(residual) if self.power == 1 else residual**2
        return np.array([size[a:b].sum() for a, b in zip(self.edges[:-1], self.edges[1:], strict=True)])

    def value(self, x: Array) -> float:
        """Return F(x)."""
        return float(self.weights @ self.sums(self.target - x @ self.columns)) + self.constant


@dataclass(frozen=True)
class Swarm:
    """What a colony found.

    Attributes:
        x: Best source ever, shape (b,).
        objective: F(x), computed anew.
        trace: Best objective after each cycle, shape (cycles,).
        evaluations: Number of sources that were tried.
        scouts: Number of sources that were given up.
    """

    x: Array
    objective: float
    trace: Array
    evaluations: int
    scouts: int


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
    """Search a box with ``colony`` bees, half of them employed, half onlookers.

    Args:
        land: What to minimise.
        lower: Lower bounds, shape (b,).
        upper: Upper bounds, shape (b,).
        colony: Number of bees, even, 4 or more; as many random sources are drawn (7) and the better half kept (8).
        limit: Trials without success above which a source may be given up (13).
        cycles: Number of cycles.
        seed: Seed of the random numbers.
    """
    generator = np.random.default_rng(seed)
    size, sources = len(lower), colony // 2
    x = lower + generator.random((colony, size)) * (upper - lower)  # (7)
    residuals = land.target - x @ land.columns
    sums = np.array([land.sums(row) for row in residuals])
    chosen = np.argsort(sums @ land.weights, kind="stable")[:sources]
    x, residuals, sums = x[chosen], residuals[chosen], sums[chosen]
    values = sums @ land.weights + land.constant
    place = (land.columns, land.target, land.edges, land.present, land.weights, land.power, land.constant)
    flock = (x, residuals, sums, values, np.zeros(sources, np.int64), np.zeros(sources, np.int64))
    first = int(np.argmin(values))
    best, best_value = x[first].copy(), values[first : first + 1].copy()
    trace, scouts, done = np.empty(cycles), 0, 0
    for draws in draw(generator, cycles, sources, size):
        part = trace[done : done + len(draws.moves)]
        scouts += _fly(place, lower, upper, flock, best, best_value, draws.moves, draws.scouts, limit, part)
        done += len(part)
    return Swarm(best, land.value(best), trace, colony + 2 * sources * cycles + scouts, scouts)


# Types of the compiled functions: place = (columns, target, edges, present, weights, power, constant) of the landscape;
# flock = (x, residuals, sums, values, trials, moves) of the S sources.
_Place = tuple[Array, Array, IntArray, BoolArray, Array, int, float]
_Flock = tuple[Array, Array, Array, Array, IntArray, IntArray]


@compiled
def _block_sum(residual: Array, column: Array, step: float, start: int, stop: int, power: int, lanes: Array) -> float:
    """Return sum |residual - step column|^power over some rows, many partial sums side by side."""
    lanes[:] = 0.0
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


@compiled
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


@compiled
def _accept(place: _Place, flock: _Flock, s: int, j: int, value: float, step: float, sums: Array, total: float) -> None:
    """Move source s to ``value`` along j, its residuals by ``step`` columns."""
    columns, target, edges, present, weights, power, constant = place
    x, residuals, kept, values, trials, moves = flock
    x[s, j] = value
    trials[s] = 0
    moves[s] += 1
    kept[s] = sums
    values[s] = total
    for i in range(len(weights)):
        if present[j, i]:
            for row in range(edges[i], edges[i + 1]):
                residuals[s, row] -= step * columns[j, row]


@compiled
def _settle(place: _Place, flock: _Flock, s: int) -> None:
    """Compute the residuals, sums and objective of source s from its position."""
    columns, target, edges, present, weights, power, constant = place
    x, residuals, kept, values, trials, moves = flock
    residuals[s] = target
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


@compiled
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
    step = value - x[s, j]
    total = _try(place, flock, s, j, step, sums, lanes)
    if total < flock[3][s]:
        _accept(place, flock, s, j, value, step, sums, total)
    else:
        trials[s] += 1


@compiled
def _fly(
    place: _Place,
    lower: Array,
    upper: Array,
    flock: _Flock,
    best: Array,
    best_value: Array,
    moves: Array,
    scouts: Array,
    limit: int,
    trace: Array,
) -> int:
    """Run cycles; write the best source, its objective and the trace; return the number of scouts."""
    x, values, trials, accepted = flock[0], flock[3], flock[4], flock[5]
    sources, sent = len(x), 0
    sums, lanes, roulette = np.empty(len(place[4])), np.empty(_LANES), np.empty(sources)
    for cycle in range(len(moves)):
        fitness = 0.0
        for bee in range(2 * sources):
            s = bee
            if bee == sources:
                for source in range(sources):
                    fitness += 1.0 / (1.0 + values[source])  # (8)
                    roulette[source] = fitness
            if bee >= sources:  # (12)
                s = min(np.searchsorted(roulette, moves[cycle, bee, 0] * fitness, side="right"), sources - 1)
            _visit(place, lower, upper, flock, s, moves[cycle, bee], sums, lanes)
        s = np.argmin(values)
        if values[s] < best_value[0]:
            best_value[0] = values[s]
            best[:] = x[s]
        trace[cycle] = best_value[0]
        idle = np.argmax(trials)
        for s in range(sources):
            lost = s == idle and trials[s] > limit  # (13), one scout per cycle
            if lost:
                x[s] = lower + scouts[cycle] * (upper - lower)
                trials[s] = 0
                sent += 1
            if lost or accepted[s] >= REFRESH:
                _settle(place, flock, s)
    return sent
