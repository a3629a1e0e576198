"""Differential evolution in a box, with the certified optimum beside it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.errors import BadOption
from dynident.identification.search.box_search import PopulationSearch
from dynident.identification.search.landscape import Landscape
from dynident.identification.search.swarm import Ground, Stage


@dataclass(frozen=True, kw_only=True)
class DifferentialEvolution(PopulationSearch):
    """Differential evolution DE/rand/1/bin (Storn and Price 1997); the certified optimum is reported as well.

    Per generation and point i: the mutant v = x_a + F (x_b - x_c) of three other points, (2) there; a trial that takes
    each parameter from v with the probability CR, one of them always, (4); the trial replaces x_i where it is no
    worse. A parameter of a mutant beyond the box is drawn evenly between that of x_a and the bound ("bounce-back",
    Price, Storn and Lampinen 2005), which reaches an optimum on a bound sooner than a draw from the whole box.

    Attributes:
        population: Number of points NP, 4 or more.
        factor: Weight F of the difference, above 0, at most 2.
        crossover: Probability CR that a parameter comes from the mutant.
    """

    factor: float = 0.5
    crossover: float = 0.9

    def __post_init__(self) -> None:
        if not 0 < self.factor <= 2:
            raise BadOption("factor", self.factor, "give a number above 0, at most 2, such as 0.5")
        if not 0 <= self.crossover <= 1:
            raise BadOption("crossover", self.crossover, "give a probability, such as 0.9")
        super().__post_init__()

    def stages(self, land: Landscape, lower: Array, upper: Array) -> Iterator[Stage]:
        ground, count = Ground(land, lower, upper, self.seed), self.population
        x = ground.scatter(count)
        values = ground.values(x)
        while True:
            trials = self._trials(ground, x)
            found = ground.values(trials, rivals=values)
            better = found <= values
            x = np.where(better[:, None], trials, x)
            values = np.where(better, found, values)
            yield ground.stage()

    def _trials(self, ground: Ground, x: Array) -> Array:
        """Return the trial of every point, shape (S, b)."""
        random = ground.generator.random
        a, b, c = three_others(random((len(x), 3)))
        mutants = x[a] + self.factor * (x[b] - x[c])
        share = random(x.shape)
        mutants = np.where(mutants < ground.lower, x[a] + share * (ground.lower - x[a]), mutants)
        mutants = np.where(mutants > ground.upper, x[a] + share * (ground.upper - x[a]), mutants)
        taken = random(x.shape) < self.crossover
        taken[np.arange(len(x)), (random(len(x)) * ground.size).astype(int)] = True
        return np.where(taken, mutants, x)


def three_others(dice: Array) -> tuple[IntArray, IntArray, IntArray]:
    """Return three points for each of S points, all different, none the point itself, every choice equally likely.

    Args:
        dice: Uniform random numbers in [0, 1), shape (S, 3).
    """
    count = len(dice)
    used = np.arange(count)[:, None]
    for k in range(3):
        pick = (dice[:, k] * (count - 1 - k)).astype(np.int64)
        for taken in np.sort(used, axis=1).T:  # count on past those that are taken
            pick += pick >= taken
        used = np.column_stack([used, pick])
    return used[:, 1], used[:, 2], used[:, 3]
