"""A real-coded genetic algorithm in a box, with the certified optimum beside it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.errors import BadOption
from dynident.identification.search.box_search import PopulationSearch
from dynident.identification.search.landscape import Landscape
from dynident.identification.search.swarm import Ground, Stage
from dynident.plugins import bounded

#: Difference of two parents, as a share of the box, below which they are the same.
SAME = 1e-14


@dataclass(frozen=True, kw_only=True)
class GeneticAlgorithm(PopulationSearch):
    """A genetic algorithm (Holland 1975, Goldberg 1989) on real numbers; the certified optimum is reported as well.

    Per generation: parents by tournament (Goldberg and Deb 1991), simulated binary crossover (Deb and Agrawal 1995),
    polynomial mutation (Deb and Goyal 1996), both in the form that keeps to the box (Deb 2000), and the best of the old
    generation in place of the worst children (De Jong 1975).

    Attributes:
        population: Number of points, even, 4 or more.
        elites: Points of a generation that live on.
        tournament: Points of which the best becomes a parent.
        crossover: Probability that two parents are crossed; each of their parameters then is with one half.
        crossover_index: Index eta_c of the crossover: the larger, the nearer the children to their parents.
        mutation: Probability that a parameter of a child is changed; None is one over the number of parameters.
        mutation_index: Index eta_m of the mutation: the larger, the smaller the change.
    """

    elites: int = bounded(4, most=10_000)
    tournament: int = bounded(2, most=1_000)
    crossover: float = 0.9
    crossover_index: float = 3.0
    mutation: float | None = None
    mutation_index: float = 20.0

    def __post_init__(self) -> None:
        if self.population % 2:
            raise BadOption("population", self.population, "give an even number: children come in pairs")
        if not 1 <= self.elites < self.population:
            raise BadOption(
                "elites", self.elites, f"give 1 or more, fewer than the {self.population} of the population"
            )
        if not 2 <= self.tournament:
            raise BadOption("tournament", self.tournament, "give 2 or more")
        for name in ("crossover", "mutation"):
            value = getattr(self, name)
            if value is not None and not 0 <= value <= 1:
                raise BadOption(name, value, "give a probability")
        for name in ("crossover_index", "mutation_index"):
            if not 0 <= getattr(self, name) < np.inf:
                raise BadOption(name, getattr(self, name), "give 0 or more, such as 3")
        super().__post_init__()

    def stages(self, land: Landscape, lower: Array, upper: Array) -> Iterator[Stage]:
        ground, count = Ground(land, lower, upper, self.seed), self.population
        mutation = 1.0 / ground.size if self.mutation is None else self.mutation
        random = ground.generator.random
        x = ground.scatter(count)
        values = ground.values(x)
        while True:
            parents = x[winners(values, random((count, self.tournament)))]
            children = self._crossed(ground, parents[: count // 2], parents[count // 2 :])
            changed = random(children.shape) < mutation
            mutants = mutated(children, lower, upper, self.mutation_index, random(children.shape))
            children = np.where(changed, mutants, children)
            found = ground.values(children)
            old, new = np.argsort(values, kind="stable"), np.argsort(found, kind="stable")
            keep, drop = old[: self.elites], new[: count - self.elites]
            x = np.concatenate([x[keep], children[drop]])
            values = np.concatenate([values[keep], found[drop]])
            yield ground.stage()

    def _crossed(self, ground: Ground, one: Array, other: Array) -> Array:
        """Return two children of each pair of parents, shape (S, b)."""
        random = ground.generator.random
        pairs = random((len(one), 1)) < self.crossover
        chosen = pairs & (random(one.shape) < 0.5)
        dice, swap = random(one.shape), random(one.shape) < 0.5
        low, high = crossed(one, other, ground.lower, ground.upper, self.crossover_index, dice)
        first = np.where(chosen, np.where(swap, high, low), one)
        second = np.where(chosen, np.where(swap, low, high), other)
        return np.concatenate([first, second])


def winners(values: Array, dice: Array) -> IntArray:
    """Return the best of some points drawn with replacement, for each of S tournaments, shape (S,).

    Args:
        values: Objective of each point, shape (S,).
        dice: Uniform random numbers in [0, 1), shape (S, tournament).
    """
    drawn = (dice * len(values)).astype(np.int64)
    return drawn[np.arange(len(drawn)), np.argmin(values[drawn], axis=1)]


def crossed(one: Array, other: Array, lower: Array, upper: Array, index: float, dice: Array) -> tuple[Array, Array]:
    """Return the lower and the upper child of two parents by simulated binary crossover in a box (Deb 2000).

    Children are (y_1 + y_2 -+ beta_q |y_2 - y_1|) / 2, where the spread beta_q has the density 0.5 (eta + 1) beta^eta
    up to 1 and 0.5 (eta + 1) / beta^(eta + 2) beyond (Deb and Agrawal 1995), cut off at the bound.

    Args:
        one: Parents, shape (..., b).
        other: Their partners, the same shape.
        lower: Lower bounds, shape (b,).
        upper: Upper bounds, shape (b,).
        index: eta, 0 or more.
        dice: Uniform random numbers in [0, 1), the shape of the parents; both children take the same.
    """
    low, high = np.minimum(one, other), np.maximum(one, other)
    apart = np.where(high - low > SAME * (upper - lower), high - low, 0.0)
    gap = np.where(apart > 0, apart, 1.0)

    def spread(room: Array) -> Array:
        alpha = 2.0 - (1.0 + 2.0 * room / gap) ** -(index + 1.0)
        inside = dice * alpha <= 1.0
        share = np.where(inside, dice * alpha, 1.0 / np.where(inside, 1.0, 2.0 - dice * alpha))
        return share ** (1.0 / (index + 1.0))

    middle = 0.5 * (low + high)
    first = middle - 0.5 * spread(low - lower) * apart
    second = middle + 0.5 * spread(upper - high) * apart
    return np.clip(first, lower, upper), np.clip(second, lower, upper)


def mutated(x: Array, lower: Array, upper: Array, index: float, dice: Array) -> Array:
    """Return points whose every parameter is changed by polynomial mutation in a box (Deb and Goyal 1996, Deb 2000).

    The change has half its chance to either side and reaches just to the bound.

    Args:
        x: Points, shape (..., b).
        lower: Lower bounds, shape (b,).
        upper: Upper bounds, shape (b,).
        index: eta, 0 or more.
        dice: Uniform random numbers in [0, 1), the shape of the points.
    """
    power = index + 1.0
    width = upper - lower
    below, above = np.clip((x - lower) / width, 0.0, 1.0), np.clip((upper - x) / width, 0.0, 1.0)
    down = (2.0 * dice + (1.0 - 2.0 * dice) * (1.0 - below) ** power) ** (1.0 / power) - 1.0
    rest = 2.0 * (1.0 - dice)
    up = 1.0 - (rest + (1.0 - rest) * (1.0 - above) ** power) ** (1.0 / power)
    return np.clip(x + np.where(dice < 0.5, down, up) * width, lower, upper)
