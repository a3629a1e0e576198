"""The objective of many points at once, compiled: what genetic algorithm, differential evolution and swarm spend.

Their moves change every dimension, so a residual is computed anew, panel by panel of rows that stay in the cache while
all points use them. Columns that are zero throughout a joint cost nothing there, and a point leaves the sum as soon as
it exceeds the value that it has to beat. Sums have a fixed order, so a seed repeats its run.
"""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.identification.search.landscape import Landscape
from dynident.model.kernels.jit import compiled, inlined

_PANEL = 256  # rows whose columns stay in the cache while all points use them
_LANES = 64  # partial sums side by side, so that the loop runs in vector registers


def values(land: Landscape, x: Array, rivals: Array | None = None) -> Array:
    """Return F of many points, shape (S,).

    Args:
        land: The objective.
        x: The points, shape (S, b).
        rivals: Values to beat, shape (S,): a point that is worse than its rival gets infinity, at less work. Points at
            which F equals the rival may get it too, where only rounding tells them apart. None: every value is wanted.
    """
    found = np.full(len(x), land.constant)
    bar = np.full(len(x), np.inf) if rivals is None else rivals
    order = np.argsort(-land.weights * land.sums(land.target), kind="stable")  # joints that decide most come first
    used = [np.flatnonzero(land.present[:, i] & (land.weights[i] > 0)) for i in order]
    ends = np.cumsum([0, *map(len, used)])
    place = (land.columns, land.target, land.edges, land.weights, land.power)
    _sum_up(place, order, np.concatenate(used), ends, np.ascontiguousarray(x), bar, found)
    return found


# Type of the compiled functions: (columns, target, edges, weights, power) of the landscape.
_Place = tuple[Array, Array, IntArray, Array, int]


@inlined
def _residual(place: _Place, used: IntArray, x: Array, start: int, stop: int, rest: Array) -> None:
    """Write target - columns' x of some rows; ``used`` are the columns that are not zero there."""
    columns, target = place[0], place[1]
    size, whole = stop - start, len(used) // 4 * 4
    for k in range(size):
        rest[k] = target[start + k]
    for j in range(0, whole, 4):  # four columns a pass: the residual is loaded and stored once for four
        a, b, c, d = used[j], used[j + 1], used[j + 2], used[j + 3]
        xa, xb, xc, xd = x[a], x[b], x[c], x[d]
        first, second = columns[a, start:stop], columns[b, start:stop]
        third, fourth = columns[c, start:stop], columns[d, start:stop]
        for k in range(size):
            rest[k] -= (xa * first[k] + xb * second[k]) + (xc * third[k] + xd * fourth[k])
    for j in range(whole, len(used)):
        column, value = columns[used[j], start:stop], x[used[j]]
        for k in range(size):
            rest[k] -= value * column[k]


@inlined
def _total(rest: Array, size: int, power: int, lanes: Array) -> float:
    """Return sum |rest|^power of the first ``size`` values, many partial sums side by side."""
    for k in range(_LANES):
        lanes[k] = 0.0
    even = size // _LANES * _LANES
    for k in range(0, even, _LANES):
        if power == 1:
            for lane in range(_LANES):
                lanes[lane] += abs(rest[k + lane])
        else:
            for lane in range(_LANES):
                lanes[lane] += rest[k + lane] ** 2
    for k in range(even, size):
        lanes[k - even] += abs(rest[k]) if power == 1 else rest[k] ** 2
    total = 0.0
    for k in range(_LANES):
        total += lanes[k]
    return total


@compiled
def _sum_up(
    place: _Place, order: IntArray, used: IntArray, ends: IntArray, x: Array, rivals: Array, found: Array
) -> None:
    """Add the sums over all rows to ``found``; infinity for points that exceed their rival."""
    _, _, edges, weights, power = place
    rest, lanes = np.empty(_PANEL), np.empty(_LANES)
    for block in range(len(order)):
        i = order[block]
        if weights[i] == 0.0:
            continue
        mine = used[ends[block] : ends[block + 1]]
        for start in range(edges[i], edges[i + 1], _PANEL):
            stop = min(start + _PANEL, int(edges[i + 1]))
            for s in range(len(x)):
                if found[s] <= rivals[s]:
                    _residual(place, mine, x[s], start, stop, rest)
                    found[s] += weights[i] * _total(rest, stop - start, power, lanes)
    for s in range(len(x)):
        if not found[s] <= rivals[s]:
            found[s] = np.inf
