"""Searches for the lowest value of a function near a start, many of them side by side.

A search is a generator: it yields the places at which it wants the function and is sent the values there, so that
searches that go on together have their places evaluated at once.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from typing import TypeAlias, TypeVar

Place = TypeVar("Place")
Value = TypeVar("Value")
Found = TypeVar("Found")

#: Yields places, is sent the values there, and returns what it found.
Search: TypeAlias = Generator[Sequence[Place], Sequence[Value], Found]


def lowest_near(start: float, step: float, precision: float) -> Search[float, float, float]:
    """Return where a score is lowest near a start: steps to the better side, then vertices of parabolas.

    Args:
        start: Where to begin.
        step: The first step, above 0; a peak narrower than it may be missed.
        precision: The step below which the search ends.
    """
    best, (found,) = start, (yield [start])
    while step > precision:
        low, high = yield [best - step, best + step]
        if min(low, high) < found:
            best, found = (best - step, low) if low < high else (best + step, high)
            continue
        vertex = best + 0.5 * step * (low - high) / max(low - 2.0 * found + high, 1e-300)
        (value,) = yield [vertex]
        best, found = (vertex, value) if value < found else (best, found)
        step /= 8
    return best


def side_by_side(searches: Sequence[Search[Place, Value, Found]]) -> Search[Place, Value, list[Found]]:
    """Return what each of several searches finds; what they want next is asked for at once."""
    found: dict[int, Found] = {}
    wanted: dict[int, Sequence[Place]] = {}

    def go_on(k: int, values: Sequence[Value] | None) -> None:
        try:
            wanted[k] = next(searches[k]) if values is None else searches[k].send(values)
        except StopIteration as end:
            found[k] = end.value

    for k in range(len(searches)):
        go_on(k, None)
    while wanted:
        asked, values = dict(wanted), iter((yield [place for places in wanted.values() for place in places]))
        wanted.clear()
        for k, places in asked.items():
            go_on(k, [next(values) for _ in places])
    return [found[k] for k in range(len(searches))]


def run(search: Search[Place, Value, Found], measure: Callable[[Sequence[Place]], Sequence[Value]]) -> Found:
    """Return what a search finds, with values as ``measure`` has them for some places at once."""
    try:
        wanted = next(search)
        while True:
            wanted = search.send(measure(wanted))
    except StopIteration as end:
        return end.value
