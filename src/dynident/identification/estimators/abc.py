"""The artificial bee colony of the article, with the certified optimum beside it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.identification.search.box_search import BoxSearch
from dynident.identification.search.landscape import Landscape
from dynident.identification.search.swarm import Stage, Swarm
from dynident.plugins import bounded


@dataclass(frozen=True, kw_only=True)
class ArtificialBeeColony(BoxSearch):
    """Artificial bee colony of the article, (7)-(13), after Karaboga 2005; the certified optimum is reported as well.

    In (10) the neighbour k is another food source, k != i, as in Karaboga 2005. The article draws k from 1..D, the
    number of parameters: with 21 parameters and 15 sources that cannot run. No colony is needed to minimise (9) or the
    squares: the optimum in the same box is computed and certified as well, and its run states how far the colony
    ended from it.

    Attributes:
        iterations: Number of iterations T_max.
        colony: Number of bees N_s, half employed and half onlookers; even, 4 or more.
        limit: Trials without success above which a source may be given up, one per iteration.
    """

    iterations: int = bounded(50, most=1_000_000)
    colony: int = bounded(30, most=10_000)
    limit: int = bounded(15, most=1_000_000)

    def __post_init__(self) -> None:
        if self.colony < 4 or self.colony % 2:
            raise BadOption("colony", self.colony, "give an even number, 4 or more")
        if self.limit < 1:
            raise BadOption("limit", self.limit, "give 1 or more")
        super().__post_init__()

    @property
    def costs(self) -> tuple[int, int]:
        return self.colony, self.colony + 1

    def stages(self, land: Landscape, lower: Array, upper: Array) -> Iterator[Stage]:
        from dynident.identification.search.colony import stages

        cycles, stride = self.rules.affordable(*self.costs), self.rules.stride
        return stages(land, lower, upper, self.colony, self.limit, cycles, self.seed, stride)

    def scouts(self, swarm: Swarm) -> int:
        return swarm.scouts
