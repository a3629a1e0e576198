"""Non-linear friction fields, and whole parts, whose stated value stands unless held-out samples ask for another one.

The best value in the fit (see :mod:`variable_projection`) takes up whatever the model lacks, and the next motion need
not have it: a sign of dry friction that turns over a tenth of a radian a second may stand for a joint that gives. Here
values are compared by what they say about stretches of the logs that the fit has not seen, and another value is taken
only where its error is smaller than that of the stated one by more than chance makes it look in one of twenty logs
(Student's t of the differences, block by block). Then it is found to a finer step, in a fit of all rows near it.

Parts that ``choose`` names as a whole are added one by one, on all their drives at once, as long as that lowers the
held-out error, and the shortest list within one standard error of the best is kept (Breiman, Friedman, Olshen and Stone
1984, section 3.4.3). A field that a part has beside the width is that which fits the rows of the fit best, block by
block anew, so that the held-out rows have no part in it (variable projection, Golub and Pereyra 1973). The fastest
rows, those of the largest torques and those of the farthest positions are left out in turn as well: a part whose error
beyond the range of its fit grows by more than that of a block does by chance is not added. Where a part is taken, all
other fields are chosen once more beside it. Signs of dry friction that are left to the logs turn over one width on the
same joints. Errors are compared by their ratios, joint by joint: a block or a drive of large torques has no more say
than others.

Where the delay of the torque is to be found as well, it is free in every fit: friction shows at reversals, a delay in
all that the torque does, so that neither is compared by what the other one does.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.data.preprocessing import Prepared
from dynident.identification.problem.choices import FieldChoice
from dynident.identification.residuals.quantiles import student_quantile
from dynident.identification.selection.friction.column_pool import ColumnPool, PooledLogs, fit, fit_inside, loss, losses
from dynident.identification.selection.friction.load import default_load
from dynident.identification.selection.friction.variable_projection import fastest_of, minimum, spans_of
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, WHOLE, Friction

#: Blocks of rows at least; fewer than three tell nothing about chance.
BLOCKS, FEWEST = 8, 3

#: Rows in a period of the filter's cut-off that are compared.
ROWS = 8.0

#: Values of a field over its range, and between the neighbours of the best of them where that is taken.
COARSE, FINE = 13, 7

#: How often the values taken are made finer in turn where a part came to those that are there.
POLISHED = 2

#: Chance of a difference as large where there is none.
CHANCE = 0.05

#: A value that takes less than this share off the held-out error is not worth another one than the stated.
NOTHING = 5e-3

#: Least mean squared residual that is told from none, in units of its joint's own.
TINY = 1e-12

#: Values of a part that is left out, and of one that is there.
_ABSENT, _THERE = 0.0, 1.0


def has_choices(model: DynamicModel) -> bool:
    """Return whether a friction part leaves fields, or itself, to the logs where held-out samples ask for it."""
    return any(part.choose for part in model.friction)


def without_optional(model: DynamicModel) -> DynamicModel:
    """Return the model without the parts that are only there if held-out samples ask for them."""
    return replace(model, friction=tuple(part for part in model.friction if not part.is_optional))


def choose_fields(
    model: DynamicModel,
    logs: Sequence[Prepared],
    progress: Callable[[str], None] = lambda step: None,
    delay_is_free: bool = False,
) -> tuple[DynamicModel, tuple[FieldChoice, ...]]:
    """Return the model with the stated or the best values of the fields that its parts leave to the logs, and why.

    Args:
        model: With parts whose ``choose`` names non-linear fields, or ``part``.
        logs: Preprocessed logs.
        progress: Called with each step in words.
        delay_is_free: Whether a delay of the torque is free in what is compared.

    Raises:
        BadOption: A name in ``choose`` that is no non-linear field of its part, or is in ``vary`` as well.
    """
    pieces = [_by_unit(model, part) if set(part.choose or ()) - {WHOLE} else (part,) for part in model.friction]
    model = replace(model, friction=tuple(itertools.chain(*pieces)))
    logs = [log.sparser(ROWS) for log in logs]
    load = default_load(without_optional(model), logs) if "torque" in model.needs else None
    pooled = PooledLogs(model, logs, max(BLOCKS, len(logs)), load, delay_is_free)
    search = _FieldSearch(model, pooled, fastest_of(model, logs), progress)
    found = search.fields()
    decided = search.with_parts()
    if any(held.value == _THERE for held in decided.values()):
        found |= search.polished(search.fields())
    found |= {(p, WHOLE): held for p, held in decided.items()}
    kept = tuple(part for p, part in enumerate(search.model.friction) if p not in search.absent)
    return replace(model, friction=kept), tuple(found[key] for key in sorted(found, key=lambda key: key[0]))


def _by_unit(model: DynamicModel, part: Friction) -> tuple[Friction, ...]:
    """Return a part once for its revolute and once for its prismatic joints: a speed in rad/s is none in m/s."""
    own = [model.robot.active[drive] for drive in model.drives_of(part)]
    kinds = dict.fromkeys(joint.kind for joint in own)
    if len(kinds) < 2:
        return (part,)
    return tuple(replace(part, joints=tuple(joint.name for joint in own if joint.kind == kind)) for kind in kinds)


def _with_value(model: DynamicModel, group: Sequence[int], name: str, value: float) -> DynamicModel:
    """Return the model with another value of a field of some parts."""
    parts = list(model.friction)
    for p in group:
        parts[p] = replace(parts[p], **{name: value})
    return replace(model, friction=tuple(parts))


class _FieldSearch:
    """The model as far as it is chosen.

    Attributes:
        model: All parts, with the values taken so far.
        absent: Places of the parts that are not there so far.
    """

    def __init__(
        self, model: DynamicModel, pooled: PooledLogs, fastest: float, progress: Callable[[str], None]
    ) -> None:
        self.model, self.stated = model, model
        self.absent = tuple(p for p, part in enumerate(model.friction) if part.is_optional)
        self._pooled, self._progress = pooled, progress
        self._spans = {
            (p, name): span
            for p, part in enumerate(model.friction)
            for name, span in spans_of(part, "choose", fastest).items()
        }

    def fields(self) -> dict[tuple[int, str], FieldChoice]:
        """Choose the fields of all parts that are there, one after another."""
        found: dict[tuple[int, str], FieldChoice] = {}
        for (p, name), span in self._spans.items():
            group = self._group(p, name)
            if p not in self.absent and p == group[0]:
                found[p, name] = self._chosen(group, name, span)
        return found

    def polished(self, found: dict[tuple[int, str], FieldChoice]) -> dict[tuple[int, str], FieldChoice]:
        """Return what was found with the values taken made finer in turn: what is best of one hangs on the others."""
        for key in [key for key, held in found.items() if held.value != held.stated] * POLISHED:
            p, name = key
            low, high = self._spans[key]
            step = (high / low) ** (1.0 / (COARSE - 1))
            grid = np.geomspace(max(found[key].value / step, low), min(found[key].value * step, high), FINE)
            there = [own for own in self._group(p, name) if own not in self.absent]
            best = self._tried(there, name, grid).finest(grid)
            self.model = _with_value(self.model, there, name, best)
            found[key] = replace(found[key], best=best, value=best)
        return found

    def with_parts(self) -> dict[int, FieldChoice]:
        """Put the absent parts there that held-out rows ask for, each with the best value of its first own field."""
        absent = self.absent
        if not absent:
            return {}
        named = ", ".join(dict.fromkeys(FRICTION.name_of(self.model.friction[p]) for p in absent))
        self._progress(f"friction: {named} on held-out samples")
        present = [p for p in range(len(self.model.friction)) if p not in absent]
        stand_ins = {p: self._alternatives(p) for p in absent}
        kinds = [part for p in absent for part in stand_ins[p]]
        pool = self._pooled.pool([*(self.model.friction[p] for p in present), *kinds])
        acts = [set(self.model.drives_of(part)) for part in pool.parts]
        ends = np.cumsum([len(present), *(len(stand_ins[p]) for p in absent)])
        places = {p: range(a, b) for p, (a, b) in zip(absent, itertools.pairwise(ends.tolist()), strict=True)}

        def drives(added: Sequence[int]) -> list[list[int]]:
            own = [*range(len(present)), *added]
            return [[k for k in own if drive in acts[k]] for drive in range(self.model.robot.dof)]

        tried = _Tried.of(pool, pool.weights(drives(())), [drives(())])
        if not tried.tells:
            return {p: self._told(p, False, None) for p in absent}
        whole, always = tried.whole, tried.families[0][0]

        def family(added: Sequence[int]) -> list[IntArray]:
            """Return the columns with some stand-ins, the last one free to be another value of its part."""
            other = next((own for own in places.values() if added and added[-1] in own), [])
            sets = (drives((*added[:-1], k)) for k in other) if added else [drives(())]
            return [pool.possible(whole, np.sort(pool.chosen(own)), always) for own in sets]

        def best(added: Sequence[int]) -> tuple[int, ...]:
            """Return stand-ins, the last one with the value that fits all rows best."""
            losses = [loss(whole, keep, fit(whole, keep)) for keep in family(added)]
            own = next(own for own in places.values() if added[-1] in own)
            return (*added[:-1], own[int(np.argmin(losses))])

        def errors_of(added: Sequence[Sequence[int]]) -> list[Array]:
            return replace(tried, families=tuple(family(own) for own in added)).errors()

        def owner(k: int) -> int:
            return next(p for p, own in places.items() if k in own)

        path, scores = list[tuple[int, ...]]([()]), errors_of([()])
        while left := [p for p in absent if p not in map(owner, path[-1])]:
            longer = [(*path[-1], places[p][0]) for p in left]
            errors = errors_of(longer)
            going = [k for k, each in enumerate(errors) if _goes_on(scores[-1] - each, tried.blocks)]
            if not going:
                break
            k = min(going, key=lambda k: float(np.mean(errors[k][: tried.blocks])))
            path.append(best(longer[k]))
            scores.append(errors[k])
        scores = [each[: tried.blocks] for each in scores]
        lowest = scores[int(np.argmin([np.mean(each) for each in scores]))]
        gaps = [each - lowest for each in scores]
        chosen = next(own for own, gap in zip(path, gaps, strict=True) if np.mean(gap) <= max(_share(gap)[1], NOTHING))
        taken = {owner(k): k for k in chosen}
        others = [tuple(k for k in chosen if k != taken[p]) if p in taken else (*chosen, places[p][0]) for p in absent]
        first, *errors = errors_of([chosen, *others])
        for p, k in taken.items():
            self.model = replace(self.model, friction=_put(self.model.friction, p, pool.parts[k]))
        self.absent = tuple(p for p in absent if p not in taken)
        gaps = [(each - first) * (1.0 if p in taken else -1.0) for p, each in zip(absent, errors, strict=True)]
        gaps = [own[: tried.blocks] for own in gaps]
        return {p: self._told(p, p in taken, own) for p, own in zip(absent, gaps, strict=True)}

    def _alternatives(self, p: int) -> list[Friction]:
        """Return a part that is absent with the width that it shares, once for each value of its first own field."""
        self._share_width(p)
        part = self.model.friction[p]
        fields = self._own_fields(p)
        if not fields:
            return [part]
        return [replace(part, **{fields[0]: float(x)}) for x in np.geomspace(*self._spans[p, fields[0]], COARSE)]

    def _told(self, p: int, is_taken: bool, gaps: Array | None) -> FieldChoice:
        """Return what is said of a part, from the logarithms of the blocks' errors without less those with it (B,)."""
        part = self.stated.friction[p]
        about = (FRICTION.name_of(part), part.joints, WHOLE, _ABSENT)
        if gaps is None:
            return FieldChoice(*about, _ABSENT, _ABSENT, 0.0, None)
        gain, error = _share(gaps)
        return FieldChoice(*about, _THERE if is_taken or gain > 0 else _ABSENT, float(is_taken), gain, error)

    def _own_fields(self, p: int) -> list[str]:
        """Return the fields of a part that are left to the logs, without the width that it shares."""
        return [name for own, name in self._spans if own == p and name != "width"]

    def _share_width(self, p: int) -> None:
        """Give a part the width that those have that it shares it with."""
        for shared in self._group(p, "width") if (p, "width") in self._spans else ():
            if shared not in self.absent:
                width = self.model.friction[shared].options["width"]
                self.model = _with_value(self.model, [p], "width", width)

    def _group(self, p: int, name: str) -> tuple[int, ...]:
        """Return the parts whose fields have one value: signs of dry friction on the same joints, stated alike."""
        part = self.stated.friction[p]
        if name != "width":
            return (p,)
        alike = (part.joints, getattr(part, name, None))
        return tuple(
            other
            for other, own in enumerate(self.stated.friction)
            if (other, name) in self._spans and (own.joints, getattr(own, name, None)) == alike
        )

    def _chosen(self, group: tuple[int, ...], name: str, span: tuple[float, float]) -> FieldChoice:
        """Return what the logs say about one field of some parts, all else as it is in the model, and take it."""
        there = [p for p in group if p not in self.absent]
        part = self.stated.friction[there[0]]
        labels = ", ".join(FRICTION.name_of(self.model.friction[p]) for p in there)
        stated = float(getattr(part, name))
        self._progress(f"friction: {labels} {name} on held-out samples")
        about = (labels, part.joints, name, stated)
        self.model = _with_value(self.model, there, name, stated)
        grid = np.geomspace(*span, COARSE)
        tried = self._tried(there, name, grid)
        if not tried.tells:
            return FieldChoice(*about, stated, stated, 0.0, None)
        first, *others = tried.errors(outer=False)
        k = int(np.argmin([np.mean(each) for each in others]))
        is_projected = part.is_optional and name == (self._own_fields(there[0]) or [""])[0]
        if is_projected:
            k = int(np.argmin(tried.losses()))
        gain, error = _share(first - others[k])
        if not is_projected and not _is_better(first - others[k]):
            return FieldChoice(*about, float(grid[k]), stated, gain, error)
        self.model = _with_value(self.model, there, name, float(grid[k]))
        grid = np.geomspace(grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)], FINE)
        best = self._tried(there, name, grid).finest(grid)
        self.model = _with_value(self.model, there, name, best)
        return FieldChoice(*about, best, best, gain, error)

    def _tried(self, group: Sequence[int], name: str, grid: Array) -> _Tried:
        """Return the model with values of a field of some parts; of one that is absent, it with each beside itself."""
        model = self.model
        present = [p for p in range(len(model.friction)) if p not in self.absent]
        parts = [model.friction[p] for p in present]
        options = [{name: float(value)} if name else {} for value in grid]
        stand_ins = [replace(model.friction[p], **each) for each in options for p in group]
        pool = self._pooled.pool([*parts, *stand_ins])
        acts = [set(model.drives_of(part)) for part in (*parts, *stand_ins)]

        def columns(value: int | None) -> list[list[int]]:
            places = {p: place for place, p in enumerate(present)}
            if value is not None:
                places |= {p: len(parts) + value * len(group) + k for k, p in enumerate(group)}
            return [[place for place in places.values() if drive in acts[place]] for drive in range(model.robot.dof)]

        tried = _Tried.of(pool, pool.weights(columns(None)), [columns(value) for value in (None, *range(len(grid)))])
        stated = [k for k, p in enumerate(present) if not model.friction[p].is_optional]
        always = pool.chosen([[k for k in stated if drive in acts[k]] for drive in range(model.robot.dof)])
        whole = tried.whole
        return replace(tried, families=tuple([pool.possible(whole, keep, always)] for (keep,) in tried.families))


def _put(parts: Sequence[Friction], place: int, part: Friction) -> tuple[Friction, ...]:
    """Return parts with another one at a place."""
    return tuple(part if p == place else other for p, other in enumerate(parts))


def _share(gaps: Array) -> tuple[float, float]:
    """Return the share that is taken off an error and its standard error, from logarithms of its ratios (B,)."""
    return float(-np.expm1(-np.mean(gaps))), float(np.std(gaps, ddof=1) / np.sqrt(len(gaps)))


def _goes_on(gaps: Array, blocks: int) -> bool:
    """Return whether errors of outer rows, those after the blocks, grow by no more than that of a block does by chance.

    ``gaps`` are logarithms of ratios of errors of the blocks and of the outer rows (B + 3,), above 0 where they fall.
    """
    chance = float(np.std(gaps[:blocks], ddof=1) * student_quantile(1.0 - CHANCE, blocks - 1))
    return bool(np.min(gaps[blocks:]) >= -(NOTHING + chance))


def _is_better(gaps: Array) -> bool:
    """Return whether logarithms of ratios of errors (B,) are above nothing by more than chance."""
    gain, error = _share(gaps)
    return gain > max(NOTHING, error * float(student_quantile(1.0 - CHANCE, len(gaps) - 1)))


@dataclass(frozen=True)
class _Tried:
    """A model with several values of a field, or several lists of parts, as products of the columns.

    Attributes:
        held: Products of each block and joint, weighted by its residuals in the model, shape (B, n, c + 1, c + 1).
        rows: Rows of them, shape (B, n).
        outer: Products of the outer rows of each kind and joint, shape (3, n, c + 1, c + 1), and their rows.
        shared: Number of columns that every fit has.
        families: Columns of the model, and of each value or list in place of its own; of several sets that is meant
            which fits the rows of a fit best.
    """

    held: Array
    rows: IntArray
    outer: tuple[Array, IntArray]
    shared: int
    families: tuple[Sequence[IntArray], ...]

    @classmethod
    def of(cls, pool: ColumnPool, weights: Array, sets: Sequence[Sequence[Sequence[int]]]) -> _Tried:
        """Return the models whose drives have the parts ``sets[k][drive]``."""
        own = (weights**2)[:, None, None]
        families = tuple([np.sort(pool.chosen(each))] for each in sets)
        return cls(pool.products * own, pool.rows, (pool.outer * own, pool.outer_rows), pool.shared, families)

    @cached_property
    def whole(self) -> Array:
        """Products of all rows, shape (c + 1, c + 1)."""
        return self.held.sum(axis=(0, 1))

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return len(self.held)

    @property
    def tells(self) -> bool:
        """Whether there are rows enough to hold some out."""
        return len(self.held) >= FEWEST and bool(np.min(self.rows.sum(axis=1)) >= 2 * len(self.families[0][0]))

    def errors(self, outer: bool = True) -> list[Array]:
        """Return the logarithms of the held-out errors of each, the mean of the joints: of blocks and outer rows."""
        found = [
            [self._fold(family, *fold) for fold in zip(self.held, self.rows, strict=True)] for family in self.families
        ]
        for family, errors in zip(self.families, found, strict=True) if outer else ():
            errors += [self._fold(family, *fold, is_outer=True) for fold in zip(*self.outer, strict=True)]
        return [np.array(errors) for errors in found]

    def _fold(self, family: Sequence[IntArray], own: Array, rows: IntArray, is_outer: bool = False) -> float:
        """Return the logarithm of the error of some rows, by a fit of the others with the columns that suit it best."""
        left = own.sum(axis=0)
        seen = self.whole - left
        fits = [
            fit_inside(self.whole, left, keep, self.shared)
            if is_outer
            else (beta := fit(seen, keep), loss(seen, keep, beta))
            for keep in family
        ]
        best = int(np.argmin([value for _, value in fits]))
        return _mean_log(losses(own, family[best], fits[best][0]), rows)

    def losses(self) -> Array:
        """Return the sum of squared residuals of all rows for each but the model itself."""
        return np.array([loss(self.whole, keep, fit(self.whole, keep)) for (keep,) in self.families[1:]])

    def finest(self, grid: Array) -> float:
        """Return the value between those of a grid that fits all rows best."""
        return minimum(np.log(grid), self.losses(), float(np.sum(self.rows)))[0]


def _mean_log(squares: Array, rows: IntArray) -> float:
    """Return the mean of the logarithms of the joints' mean squares, from sums (n,): each joint has the same say."""
    some = rows > 0
    return float(np.mean(np.log(np.maximum(squares[some] / rows[some], TINY)))) if some.any() else 0.0
