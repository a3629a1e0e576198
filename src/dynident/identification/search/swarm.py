"""What every search of a box by many points shares: the box, counting, stopping rules, the convergence trace.

A method is a generator of stages; what ends it stands outside, so that all methods end by the same rules.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, frozen
from dynident.errors import BadOption
from dynident.identification.search.landscape import Landscape

#: Share of the best objective that it must fall by within ``stall`` iterations; the certificate is as fine.
STALL = 1e-6


@dataclass(frozen=True)
class Rules:
    """When a search ends: with the first rule that holds.

    Attributes:
        iterations: Iterations at most.
        evaluations: Evaluations of the objective at most; None for any number. The search ends before the iteration
            that could exceed it.
        stall: Iterations within which the best objective must fall by a millionth of itself; None for any number.
        seconds: Time in s after which no iteration is begun; None for any time. It depends on the machine, so a seed
            does not repeat a run that ends by it.
    """

    iterations: int
    evaluations: int | None = None
    stall: int | None = None
    seconds: float | None = None

    def __post_init__(self) -> None:
        if self.iterations < 1:
            raise BadOption("iterations", self.iterations, "give 1 or more")
        if self.evaluations is not None and self.evaluations < 1:
            raise BadOption("max_evaluations", self.evaluations, "give 1 or more, or null for any number")
        if self.stall is not None and self.stall < 1:
            raise BadOption("stall", self.stall, "give 1 or more, or null for any number")
        if self.seconds is not None and not 0 < self.seconds < np.inf:
            raise BadOption("max_seconds", self.seconds, "give a time above 0 in s, or null for any time")

    def affordable(self, first: int, each: int) -> int:
        """Return how many iterations the evaluations allow, at most ``iterations``.

        Args:
            first: Evaluations before the first iteration.
            each: Evaluations of an iteration at most.

        Raises:
            BadOption: Not one.
        """
        if self.evaluations is None:
            return self.iterations
        if self.evaluations < first + each:
            raise BadOption("max_evaluations", self.evaluations, f"give {first + each} or more: the first iteration")
        return min(self.iterations, (self.evaluations - first) // each)

    @property
    def stride(self) -> int | None:
        """Iterations between two looks at the rules: 1, or None where the number of iterations alone decides."""
        return None if self.stall is None and self.seconds is None else 1


@dataclass(frozen=True)
class Stage:
    """A search after some more iterations.

    Attributes:
        x: Best point so far, shape (b,).
        trace: Best objective after each iteration since the stage before.
        evaluations: Evaluations so far.
        scouts: Points given up so far, where the method gives up points.
    """

    x: Array
    trace: Array
    evaluations: int
    scouts: int = 0


@dataclass(frozen=True)
class Swarm:
    """What a search of a box found.

    Attributes:
        x: Best point ever, shape (b,).
        objective: F(x), computed anew.
        trace: Best objective after each iteration, shape (iterations,).
        evaluations: Number of points that were tried.
        scouts: Number of points that were given up.
        stopped: The rule that ended it: iterations, evaluations, stall or seconds.
    """

    x: Array
    objective: float
    trace: Array
    evaluations: int
    scouts: int = 0
    stopped: str = "iterations"

    def __post_init__(self) -> None:
        object.__setattr__(self, "x", frozen(self.x))
        object.__setattr__(self, "trace", frozen(self.trace))


def run(land: Landscape, stages: Iterator[Stage], rules: Rules, iterations: int) -> Swarm:
    """Run a search until a rule ends it.

    Args:
        land: The objective.
        stages: The search; it may end by itself after ``iterations``.
        rules: The rules.
        iterations: Iterations that are affordable by the rules.
    """
    start = time.monotonic()
    stage, parts, done = None, [], 0
    stopped = "iterations" if iterations == rules.iterations else "evaluations"
    for stage in stages:
        parts.append(stage.trace)
        done += len(stage.trace)
        if done >= iterations:
            break
        stall = len(parts) if rules.stall is None else rules.stall
        if stall < len(parts) and parts[-1][-1] > (1.0 - STALL) * parts[-1 - stall][-1]:  # next to nothing was gained
            stopped = "stall"
            break
        if rules.seconds is not None and time.monotonic() - start >= rules.seconds:
            stopped = "seconds"
            break
    assert stage is not None  # a search has one iteration at least
    trace = np.concatenate(parts)
    return Swarm(stage.x, land.value(stage.x), trace, stage.evaluations, stage.scouts, stopped)


class Ground:
    """A box of a landscape: counts the points that are tried in it and keeps the best of them.

    Attributes:
        lower: Lower bounds, shape (b,).
        upper: Upper bounds, shape (b,).
        generator: Source of all random numbers of the search.
    """

    def __init__(self, land: Landscape, lower: Array, upper: Array, seed: int) -> None:
        self.lower, self.upper, self.generator = lower, upper, np.random.default_rng(seed)
        self._land = land
        self._best, self._x, self._evaluations = np.inf, lower, 0

    @property
    def size(self) -> int:
        """Number of dimensions b."""
        return len(self.lower)

    @property
    def width(self) -> Array:
        """Upper less lower bound, shape (b,)."""
        return self.upper - self.lower

    @property
    def best(self) -> Array:
        """Best point so far, shape (b,)."""
        return self._x

    def scatter(self, count: int) -> Array:
        """Return points drawn evenly from the box, shape (count, b)."""
        return self.lower + self.generator.random((count, self.size)) * self.width

    def values(self, x: Array, rivals: Array | None = None) -> Array:
        """Return F of points of the box, shape (S,); infinity for those that are worse than their rivals.

        Args:
            x: The points, shape (S, b).
            rivals: Values to beat, shape (S,); None where every value is wanted.
        """
        from dynident.identification.search.population import values

        found = values(self._land, x, rivals)
        self._evaluations += len(x)
        first = int(np.argmin(found))
        if found[first] < self._best:
            self._best, self._x = float(found[first]), x[first].copy()
        return found

    def stage(self) -> Stage:
        """Return where the search stands after one more iteration."""
        return Stage(self._x, np.array([self._best]), self._evaluations)
