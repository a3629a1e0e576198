"""Friction parts that are added one by one, on all their drives at once, as long as held-out rows ask for them.

A part with a field of its own stands in the pool once for each value of it; in every fit that value is taken which fits
its rows best. The shortest list within one standard error of the best is kept (Breiman, Friedman, Olshen and Stone
1984, section 3.4.3). A part whose error beyond the range of its fit grows by more than chance is not added.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.identification.selection.friction.column_pool import ColumnPool, PooledLogs, fit, loss
from dynident.identification.selection.friction.held_out_errors import NOTHING, FoldErrors, goes_on, share_of
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction


@dataclass(frozen=True)
class AddedParts:
    """Parts that a model has, and parts that may come to them.

    Attributes:
        model: Whose drives they are.
        pool: Columns of the parts that are there, then of the stand-ins.
        present: Number of the parts that are there.
        stand_ins: Places in the pool of each part that may be added: one for each value of its field.
        tried: The model, for its errors.
    """

    model: DynamicModel
    pool: ColumnPool
    present: int
    stand_ins: Mapping[int, range]
    tried: FoldErrors

    @classmethod
    def over(
        cls,
        model: DynamicModel,
        pooled: PooledLogs,
        present: Sequence[Friction],
        others: Mapping[int, Sequence[Friction]],
    ) -> AddedParts:
        """Return parts that are there, and stand-ins of each part that may be added."""
        pool = pooled.pool([*present, *itertools.chain(*others.values())])
        ends = np.cumsum([len(present), *map(len, others.values())]).tolist()
        stand_ins = {p: range(a, b) for p, (a, b) in zip(others, itertools.pairwise(ends), strict=True)}
        sets = _sets(model, pool.parts, range(len(present)))
        return cls(model, pool, len(present), stand_ins, FoldErrors.of(pool, pool.weights(sets), [sets]))

    def chosen(self) -> tuple[Mapping[int, Friction], Mapping[int, Array]]:
        """Return the parts that are taken, and of each how its absence raises the logarithm of the blocks' errors."""
        path, scores = list[tuple[int, ...]]([()]), self._errors([()])
        blocks = self.tried.blocks
        while left := [p for p in self.stand_ins if p not in map(self._owner, path[-1])]:
            longer = [(*path[-1], self.stand_ins[p][0]) for p in left]
            errors = self._errors(longer)
            going = [k for k, each in enumerate(errors) if goes_on(scores[-1] - each, blocks)]
            if not going:
                break
            k = min(going, key=lambda k: float(np.mean(errors[k][:blocks])))
            path.append(self._fitted(longer[k]))
            scores.append(errors[k])
        best = min(scores, key=lambda each: float(np.mean(each[:blocks])))
        gaps = [(each - best)[:blocks] for each in scores]
        shortest = next(
            own for own, gap in zip(path, gaps, strict=True) if np.mean(gap) <= max(share_of(gap)[1], NOTHING)
        )
        taken = {self._owner(k): k for k in shortest}
        changed = [
            tuple(k for k in shortest if k != taken[p]) if p in taken else (*shortest, own[0])
            for p, own in self.stand_ins.items()
        ]
        first, *others = self._errors([shortest, *changed])
        told = {
            p: (each - first)[:blocks] * (1.0 if p in taken else -1.0)
            for p, each in zip(self.stand_ins, others, strict=True)
        }
        return {p: self.pool.parts[k] for p, k in taken.items()}, told

    def _owner(self, stand_in: int) -> int:
        return next(p for p, own in self.stand_ins.items() if stand_in in own)

    def _family(self, added: Sequence[int]) -> list[IntArray]:
        """Return the columns with some stand-ins, the last of which may have any value of its field."""
        last = self.stand_ins[self._owner(added[-1])] if added else ()
        lists = [(*added[:-1], k) for k in last] or [()]
        always = self.tried.families[0][0]
        kept = [_sets(self.model, self.pool.parts, (*range(self.present), *own)) for own in lists]
        return [self.pool.possible(self.tried.whole, np.sort(self.pool.chosen(own)), always) for own in kept]

    def _fitted(self, added: Sequence[int]) -> tuple[int, ...]:
        """Return the stand-ins, the last one with the value that fits all rows best."""
        whole = self.tried.whole
        losses = [loss(whole, keep, fit(whole, keep)) for keep in self._family(added)]
        return (*added[:-1], self.stand_ins[self._owner(added[-1])][int(np.argmin(losses))])

    def _errors(self, lists: Sequence[Sequence[int]]) -> list[Array]:
        return replace(self.tried, families=tuple(self._family(own) for own in lists)).errors()


def _sets(model: DynamicModel, parts: Sequence[Friction], chosen: Sequence[int]) -> list[list[int]]:
    """Return which of some chosen parts each drive has."""
    acts = {k: set(model.drives_of(parts[k])) for k in chosen}
    return [[k for k in chosen if drive in acts[k]] for drive in range(model.robot.dof)]
