"""The recursion of a zero-phase filter, compiled: many signals side by side.

The recursion of one signal waits for its own last result at every sample; the same step of many signals fills vector
registers.
"""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.model.kernels.jit import compiled, inlined

#: Signals that are filtered side by side, and samples of a block of them: it stays in the cache.
_LANES, _HEIGHT = 16, 256


@inlined
def _begin(state: Array, start: Array, value: Array) -> None:
    """Set the state to that of signals which have always had the values (lanes,)."""
    for s in range(len(state)):
        for i in range(2):
            for j in range(_LANES):
                state[s, i, j] = start[s, i] * value[j]


@inlined
def _run(block: Array, first: int, last: int, step: int, sections: Array, state: Array) -> None:
    """Filter rows first, first + step, ... before last of a block (rows, lanes) in place, two sections at a time.

    Each section waits for its own last result, so two of them take the time of one.
    """
    count = len(sections)
    for s in range(0, count - 1, 2):
        b0, b1, b2 = sections[s, 0], sections[s, 1], sections[s, 2]
        a1, a2 = sections[s, 4], sections[s, 5]
        d0, d1, d2 = sections[s + 1, 0], sections[s + 1, 1], sections[s + 1, 2]
        c1, c2 = sections[s + 1, 4], sections[s + 1, 5]
        for t in range(first, last, step):
            for j in range(_LANES):
                x = block[t, j]
                y = b0 * x + state[s, 0, j]
                state[s, 0, j] = b1 * x - a1 * y + state[s, 1, j]
                state[s, 1, j] = b2 * x - a2 * y
                z = d0 * y + state[s + 1, 0, j]
                state[s + 1, 0, j] = d1 * y - c1 * z + state[s + 1, 1, j]
                state[s + 1, 1, j] = d2 * y - c2 * z
                block[t, j] = z
    if count % 2:
        b0, b1, b2 = sections[count - 1, 0], sections[count - 1, 1], sections[count - 1, 2]
        a1, a2 = sections[count - 1, 4], sections[count - 1, 5]
        for t in range(first, last, step):
            for j in range(_LANES):
                x = block[t, j]
                y = b0 * x + state[count - 1, 0, j]
                state[count - 1, 0, j] = b1 * x - a1 * y + state[count - 1, 1, j]
                state[count - 1, 1, j] = b2 * x - a2 * y
                block[t, j] = y


@inlined
def _load(signals: Array, begin: int, size: int, block: Array) -> None:
    for t in range(size):
        for j in range(len(signals)):
            block[t, j] = signals[j, begin + t]


@inlined
def _store(block: Array, begin: int, size: int, signals: Array) -> None:
    for t in range(size):
        for j in range(len(signals)):
            signals[j, begin + t] = block[t, j]


@inlined
def _turned(signals: Array, end: int, step: int, tail: Array) -> None:
    """Write the extension beyond an end: its rows follow each other away from (step -1) or towards the signal."""
    pad = len(tail)
    for j in range(len(signals)):
        for m in range(pad):
            tail[m, j] = 2.0 * signals[j, end] - signals[j, end - 1 - m if step < 0 else pad - m]


@compiled
def there_and_back(signals: Array, sections: Array, start: Array, pad: int, out: Array) -> None:
    """Filter signals (k, N) both ways into ``out``; ``start`` (S, 2) is the state after a constant of one."""
    length = signals.shape[1]
    state = np.empty((len(sections), 2, _LANES))
    block = np.zeros((_HEIGHT, _LANES))
    tail = np.zeros((pad, _LANES))
    value = np.zeros(_LANES)
    for group in range(0, len(signals), _LANES):
        own, to = signals[group : group + _LANES], out[group : group + _LANES]
        _turned(own, 0, 1, tail)
        for j in range(len(own)):
            value[j] = tail[0, j] if pad else own[j, 0]
        _begin(state, start, value)
        _run(tail, 0, pad, 1, sections, state)
        for begin in range(0, length, _HEIGHT):
            size = min(_HEIGHT, length - begin)
            _load(own, begin, size, block)
            _run(block, 0, size, 1, sections, state)
            _store(block, begin, size, to)
        _turned(own, length - 1, -1, tail)
        _run(tail, 0, pad, 1, sections, state)
        for j in range(len(own)):
            value[j] = tail[pad - 1, j] if pad else to[j, length - 1]
        _begin(state, start, value)
        _run(tail, pad - 1, -1, -1, sections, state)
        for end in range(length, 0, -_HEIGHT):
            size = min(_HEIGHT, end)
            _load(to, end - size, size, block)
            _run(block, size - 1, -1, -1, sections, state)
            _store(block, end - size, size, to)
