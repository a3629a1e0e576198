"""Particle swarm optimisation in a box, with the certified optimum beside it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.errors import BadOption
from dynident.identification.search.box_search import PopulationSearch
from dynident.identification.search.landscape import Landscape
from dynident.identification.search.swarm import Ground, Stage


@dataclass(frozen=True, kw_only=True)
class ParticleSwarm(PopulationSearch):
    """Particle swarm (Kennedy and Eberhart 1995) with constriction; the certified optimum is reported as well.

    Per iteration v <- chi (v + r_1 c_1 (p - x) + r_2 c_2 (g - x)), x <- x + v, with p the best place of the particle, g
    that of its informants, r_1 and r_2 drawn evenly from [0, 1) for every particle and parameter, and chi =
    2 / (phi - 2 + sqrt(phi^2 - 4 phi)), phi = c_1 + c_2 > 4 (Clerc and Kennedy 2002, type 1"). The speed is
    limited as well (Eberhart and Shi 2000); a particle stops at a bound. The default accelerations are those of
    Carlisle and Dozier 2001.

    Attributes:
        population: Number of particles, 3 or more.
        own: Acceleration c_1 towards the particle's own best place.
        social: Acceleration c_2 towards the best place of its informants; c_1 + c_2 above 4.
        largest_speed: Largest change of a parameter per iteration, as a share of the width of the box.
        informants: all particles, or ring: itself and the two neighbours (Kennedy and Mendes 2002), slower and surer.
    """

    least: ClassVar = 3

    own: float = 2.8
    social: float = 1.3
    largest_speed: float = 0.5
    informants: Literal["all", "ring"] = "all"

    def __post_init__(self) -> None:
        if not 0 <= self.own < np.inf:
            raise BadOption("own", self.own, "give 0 or more, such as 2.8")
        if not (0 <= self.social < np.inf and self.own + self.social > 4):
            raise BadOption("social", self.social, "give 0 or more, so that own + social is above 4, such as 1.3")
        if not 0 < self.largest_speed < np.inf:
            raise BadOption("largest_speed", self.largest_speed, "give a share above 0, such as 0.5")
        if self.informants not in ("all", "ring"):
            raise BadOption("informants", self.informants, "choose all or ring")
        super().__post_init__()

    @property
    def constriction(self) -> float:
        """Clerc and Kennedy's chi."""
        phi = self.own + self.social
        return 2.0 / (phi - 2.0 + np.sqrt(phi * (phi - 4.0)))

    def stages(self, land: Landscape, lower: Array, upper: Array) -> Iterator[Stage]:
        ground, count = Ground(land, lower, upper, self.seed), self.population
        x = ground.scatter(count)
        speed, most = 0.5 * (ground.scatter(count) - x), self.largest_speed * ground.width
        values, places = ground.values(x), x
        random = ground.generator.random
        while True:
            pull = random(x.shape) * self.own * (places - x)
            pull += random(x.shape) * self.social * (places[self._leaders(values)] - x)
            speed = np.clip(self.constriction * (speed + pull), -most, most)
            free = x + speed
            x = np.clip(free, lower, upper)
            speed = np.where(free == x, speed, 0.0)
            found = ground.values(x, rivals=values)
            better = found < values
            places = np.where(better[:, None], x, places)
            values = np.where(better, found, values)
            yield ground.stage()

    def _leaders(self, values: Array) -> IntArray:
        """Return the best informant of every particle, shape (S,)."""
        count = len(values)
        if self.informants == "all":
            return np.full(count, int(np.argmin(values)))
        ring = (np.arange(count)[:, None] + np.array([0, -1, 1])) % count
        return ring[np.arange(count), np.argmin(values[ring], axis=1)]
