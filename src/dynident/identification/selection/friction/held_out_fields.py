"""Non-linear friction fields, and whole parts, whose stated value stands unless held-out samples ask for another one.

The best value in the fit (see :mod:`variable_projection`) takes up whatever the model lacks, and the next motion need
not have it. Here values are compared by what they say about stretches of the logs that the fit has not seen, and about
the fastest rows. Another value is taken only where its error is smaller than that of the stated one by more than chance
makes it look in one of twenty logs (Student's t of the differences), then to a finer step in a fit of all rows near it.

Parts that ``choose`` names as a whole are added one by one, on all their drives at once, as long as that lowers the
held-out error, and the shortest list is kept that the best one does not improve on by more than chance. A part with
fields of its own beside the width is held against its absence with their best values. Where a part is taken, all fields
are chosen once more beside it; where one that remembers is, so are the other parts. Signs of dry friction that are left
to the logs turn over one width on the same drive. Errors of blocks are compared by their ratios: a block of large
torques has no more say than others.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from dynident.arrays import Array
from dynident.identification.problem.choices import FieldChoice
from dynident.identification.selection.friction.column_pool import PooledLogs
from dynident.identification.selection.friction.finer_values import finer_values
from dynident.identification.selection.friction.held_out_errors import (
    OF_A_PART,
    HeldOut,
    evidence,
    is_better,
    shortest_list,
)
from dynident.identification.selection.friction.parts_by_drive import (
    by_drive,
    own_widths,
    set_apart,
    together,
    with_values,
)
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import WHOLE_PART, called

#: Values over its range of a width or of a part's first field, and of a further field beside so many on both sides of
#: the best of these.
COARSE, BESIDE, NEAR = 13, 2, 2

#: Why nothing was tried.
TOO_FEW = "too few samples to hold some out"

#: Places of parts in a model, and values of their fields by name.
Places: TypeAlias = Sequence[int]
Points: TypeAlias = Sequence[Mapping[str, float]]
#: Steps to finer values at most: of those that are taken for another one, and of all of them together at the end.
FINER, POLISHED = 3, 10


class FrictionSearch:
    """The model as far as it is chosen.

    Attributes:
        model: All parts, with the values taken so far.
        absent: Places of the parts that are not there so far.
        heads: Of each part, the place of the stated one that it is of; those of drives set apart are last.
        apart: What the logs say about the width of such drives, with the place of the part.
        found: What they say about fields, by the place of the part and name.
        decided: What they say about parts that may be missing, by their place.
    """

    def __init__(
        self,
        model: DynamicModel,
        pooled: PooledLogs,
        spans: Mapping[tuple[int, str], tuple[float, float]],
        progress: Callable[[str], None],
    ) -> None:
        self.model, self.stated = model, model
        self.absent = tuple(p for p, part in enumerate(model.friction) if part.is_optional)
        self.heads, self.apart = tuple(range(len(model.friction))), list[tuple[int, FieldChoice]]()
        self.found, self.decided = dict[tuple[int, str], FieldChoice](), dict[int, FieldChoice]()
        self._lagging = tuple(p for p in self.absent if model.friction[p].lags)
        self._pooled, self._spans, self._progress = pooled, spans, progress
        parts = model.friction
        self._inside = [{q for q, own in enumerate(parts) if called(own) in part.in_place_of} for part in parts]
        self._contained = [{q for q in self.absent if called(parts[q]) in part.contains} for part in parts]
        self.tells = self.tried((), ()).tells  # whether the blocks have rows enough to hold some out

    @property
    def chosen(self) -> DynamicModel:
        """The model with what was chosen."""
        there = sorted((p for p in range(len(self.heads)) if p not in self.absent), key=lambda p: self.heads[p])
        return replace(self.stated, friction=tuple(self.model.friction[p] for p in there))

    @property
    def told(self) -> tuple[FieldChoice, ...]:
        """What the logs say, in the order of the parts."""
        fields = [(p, held) for (p, _), held in self.found.items()]
        each = [*fields, *self.decided.items(), *self.apart, *self._not_tried()]
        return tuple(held for _, held in sorted(each, key=lambda one: one[0]))

    def _not_tried(self) -> Iterator[tuple[int, FieldChoice]]:
        """Yield the parts that were not tried since others are not there, each with its place."""
        for p, part in enumerate(self.stated.friction):
            if part.is_optional and p not in self.decided and (others := part.after or part.in_place_of):
                yield p, self._told(p, False, None, f"only where {' or '.join(others)} is chosen")

    @property
    def remembers(self) -> bool:
        """Whether an optional part that remembers is there."""
        return any(p not in self.absent for p in self._lagging)

    def run(self, after: FrictionSearch | None) -> None:
        """Choose, from nothing, what remembers beside what was found before, or the others beside that."""
        there = self.absent if after is None else after.absent
        if after is not None and not after.remembers:
            fresh = self.model, self.absent, self.heads, self.apart, self.found
            self.model, self.absent, self.heads, self.apart = after.model, there, after.heads, after.apart
            self.found, self.decided = after.found, after.decided | {p: self.with_part(p) for p in self._lagging}
            if not self.remembers:
                return
            there, (self.model, self.absent, self.heads, self.apart, self.found) = self.absent, fresh
        self.absent = tuple(p for p in self.absent if p not in self._lagging or p in there)
        if after is not None and not after.remembers:  # the others may have stood in its place: its delay comes first
            self.fields()
            self.add_parts(and_fields=False)
            self.polish()
            return
        self.parts()
        taken = [p for p, held in self.decided.items() if held.value]
        needed = {name for p in taken for own in (self.stated.friction[p],) for name in (*own.after, *own.in_place_of)}
        linear = [p for p in taken if not self._own_fields(p) and called(self.stated.friction[p]) not in needed]
        if taken or self.remembers:
            self.polish()
        if linear and (any(map(self._own_fields, taken)) or self.remembers):
            self.absent += tuple(self._of(linear))  # they may have stood in the place of the others
            self.decided |= self.with_linear_parts()
            if not all(self.decided[p].value for p in linear):
                self.polish()

    def fields(self) -> None:
        """Choose the fields of all parts that are there, one after another."""
        for p, name in self._spans:
            names = [name] if name == "width" else self._own_fields(p)
            group = self._group(p, name)
            if p not in self.absent and p == group[0] and name in names[:1]:
                self.found |= {(p, each.field): each for each in self._chosen(group, names)}

    def parts(self) -> None:
        """Choose the fields of what is there, and which of the absent parts are put there."""
        self.fields()
        self.decided = self.with_linear_parts()
        if any(held.value for held in self.decided.values()):
            self.fields()
        self.add_parts()

    def add_parts(self, and_fields: bool = True) -> None:
        """Put absent parts with fields there that held-out rows ask for; with each, choose the fields of all again."""
        for p, part in enumerate(self.stated.friction):
            there, is_absent = {called(own) for own in self.chosen.friction}, p in self.absent
            wanted = {*part.after, *(called(self.stated.friction[q]) for q in self._inside[p])}
            is_next = not wanted or there & wanted if is_absent else self._stands_for(p)
            tried = self.with_part(p) if is_next and self._left_open(p) and not part.lags else None
            if tried and (is_absent or tried.value):
                self.decided[p] = tried
            if tried and tried.value and and_fields:
                self.fields()

    def polish(self) -> None:
        """Make values finer together: what is best of one hangs on the others.

        They are those that were taken, and those of parts that might be missing, of which the stated one is a start.
        """
        optional = [(p, name) for p, name in self.found if name != "width" and self.stated.friction[p].is_optional]
        if moved := [key for key, held in self.found.items() if held.value != held.stated or key in optional]:
            finer = self._finer([(self._group(*key), key[1]) for key in moved], POLISHED)
            self.found |= {key: replace(self.found[key], best=x, value=x) for key, x in zip(moved, finer, strict=True)}
        self._leave_out_again()

    def _leave_out_again(self) -> None:
        """Leave a part with fields out again that held-out rows do not ask for beside the values of all others."""
        present = [p for p in range(len(self.heads)) if p not in self.absent]
        parts = [self.model.friction[p] for p in present]
        for p in [p for p in self.decided if p in present and self._own_fields(p) and p not in self._lagging]:
            rest = [k for k, q in enumerate(present) if self.heads[q] != p]
            sets = [by_drive(self.model, parts, own) for own in (range(len(parts)), rest)]
            tried = HeldOut.of(self._pooled.pool(parts), sets[0], sets)
            own, others = replace(tried, always=np.zeros(1, dtype=bool)).errors()
            if not is_better(others - own, least=OF_A_PART):
                self.absent += tuple(self._of([p]))
                self.decided[p] = self._told(p, False, others - own)
                self.found = {key: held for key, held in self.found.items() if key[0] != p or key[1] == "width"}
                return

    def with_linear_parts(self) -> dict[int, FieldChoice]:
        """Put the absent parts there that have no field of their own beside a width and that held-out rows ask for."""
        inside = self._inside
        linear = [p for p in self.absent if self.heads[p] == p and (inside[p] or not self._left_open(p))]
        linear = [p for p in linear if p not in self._lagging and inside[p] <= {*linear}]
        for p in linear:
            self._share_width(p)
        present = [p for p in range(len(self.model.friction)) if p not in self.absent]
        if not linear:
            return {}
        named = ", ".join(dict.fromkeys(called(self.model.friction[p]) for p in linear))
        self._progress(f"friction: {named} on held-out samples")
        parts, own = self.model.friction, by_drive(self.model, self.model.friction, present)
        tried = HeldOut.of(self._pooled.pool(parts), own, [own])
        if not self.tells:
            return {p: self._told(p, False, None) for p in linear}

        def errors_of(added: Sequence[tuple[int, ...]]) -> list[Array]:
            lists = [by_drive(self.model, parts, (*present, *self._of(extra))) for extra in added]
            return tried.with_parts(lists).errors()

        chosen = shortest_list([p for p in linear if not inside[p]], errors_of)
        linear = [p for p in linear if inside[p] <= {*chosen}]
        for p in linear:  # in the place of those that are inside it
            if inside[p] and is_better(np.subtract(*errors_of([chosen, other := (*({*chosen} - inside[p]), p)])), None):
                chosen = other
        around = {p: {p, *inside[p], *(q for q in linear if p in inside[q])} for p in linear}
        others = [(*({*chosen} - around[p]), *(inside[p] if p in chosen else [p])) for p in linear]
        first, *errors = errors_of([chosen, *others])
        self.absent = tuple(p for p in self.absent if self.heads[p] not in chosen)
        gaps = [(each - first) * (1.0 if p in chosen else -1.0) for p, each in zip(linear, errors, strict=True)]
        return {p: self._told(p, p in chosen, own) for p, own in zip(linear, gaps, strict=True)}

    def _told(self, p: int, is_taken: bool, gaps: Array | None, not_tried: str = TOO_FEW) -> FieldChoice:
        """Return what is said of a part, from the logarithms of the blocks' errors without less those with it (B,)."""
        part, taken = self.stated.friction[p], float(is_taken)
        if gaps is None:
            return FieldChoice(called(part), part.joints, WHOLE_PART, 0.0, 0.0, 0.0, 0.0, None, None, not_tried)
        best = taken or float(np.mean(gaps) > 0)
        return FieldChoice(called(part), part.joints, WHOLE_PART, 0.0, best, taken, *evidence(gaps))

    def _own_fields(self, p: int) -> list[str]:
        """Return the fields that are left to the logs; none of a part in the place of others, which is as stated."""
        return [] if self._stands_for(p) else self._left_open(p)

    def _left_open(self, p: int) -> list[str]:
        """Return the fields of a part that are left to the logs, without the width that it shares."""
        return [name for own, name in self._spans if own == p and name != "width"]

    def _stands_for(self, p: int) -> set[int]:
        """Return the places of the parts that one which is there stands in the place of."""
        there = self.stated.friction[p].is_optional and p not in self.absent
        return self._inside[p] if there and self._inside[p] <= {*self.absent} else set()

    def _share_width(self, p: int) -> None:
        """Give a part the width that those have that it shares it with."""
        for shared in self._group(p, "width") if (p, "width") in self._spans else ():
            if shared not in self.absent:
                self.model = with_values(self.model, [p], {"width": self.model.friction[shared].options["width"]})

    def _of(self, heads: Iterable[int]) -> list[int]:
        """Return the places of stated parts and of those for drives of a width of their own."""
        return [p for p, head in enumerate(self.heads) if head in heads]

    def with_part(self, p: int) -> FieldChoice:
        """Hold a part against its absence, or those it stands for, and put it there if it is better."""
        self._progress(f"friction: {called(self.model.friction[p])} on held-out samples")
        comes, goes = self._stands_for(p), self._contained[p] - {*self.absent}
        for q in (p, *comes):
            self._share_width(q)
        points = self._points(p, self._left_open(p)[:1])  # further ones are as stated until it is there
        beside = [q for q in range(len(self.heads)) if q not in self.absent and self.heads[q] not in {p, *goes}]
        tried = self.tried(self._of([p]), points, beside=[*beside, *self._of(comes)])
        if not self.tells:
            return self._told(p, False, None)
        first, *others = tried.errors()
        k = int(np.argmin([np.mean(each) for each in others]))
        before, is_swap, gaps = (self.model, self.absent), bool(comes or goes), first - others[k]
        if (is_swap and not is_better(-gaps)) or is_better(gaps, least=OF_A_PART):
            best, stays = self._with_best_fields(tried), {p, *comes}
            self.absent = tuple(q for q in (*self.absent, *self._of(goes)) if self.heads[q] not in stays)
            self.model = with_values(self.model, self._of([p]), points[k])
            gaps = best - (self._with_best_fields(tried) if is_swap else others[k])
        if not (better := is_better(gaps, least=OF_A_PART)):
            self.model, self.absent = before
        elif is_swap:
            self.decided |= {q: self._told(q, True, gaps) for q in comes}
            self.decided |= {q: replace(self.decided[q], value=0.0) for q in goes}
            self.found = {key: held for key, held in self.found.items() if key[0] not in goes or key[1] == "width"}
        return self._told(p, better, gaps)

    def _with_best_fields(self, tried: HeldOut) -> Array:
        """Return the errors (B + 1,) with the best fields, the rows weighted alike: other values are no evidence."""
        kept, groups = self.model, sorted({(self._group(*key), key[1]) for key in self._spans})
        if there := [each for each in groups if not set(each[0]) <= set(self.absent)]:
            self._finer(there)
        errors, self.model = self.tried((), (), tried.weighed.weights).errors()[0], kept
        return errors

    def _group(self, p: int, name: str) -> tuple[int, ...]:
        """Return the parts whose fields have one value: signs of dry friction on the same joints, stated alike."""
        part = self.stated.friction[p]
        if name != "width":
            return tuple(self._of([p]))
        alike = (part.joints, getattr(part, name, None))
        return tuple(
            other
            for other, own in enumerate(self.stated.friction)
            if (other, name) in self._spans and (own.joints, getattr(own, name, None)) == alike
        )

    def _chosen(self, group: tuple[int, ...], names: Sequence[str]) -> list[FieldChoice]:
        """Return what the logs say about fields of some parts together, all else as in the model, and take it."""
        if names[0] == "width":
            joints = self.stated.friction[group[0]].joints
            self.model, self.absent, self.heads = together(self.model, self.absent, self.heads, group, joints)
            self.apart = [each for each in self.apart if each[0] != group[0]]
        there = [p for p in group if p not in self.absent]
        labels = ", ".join(dict.fromkeys(called(self.model.friction[p]) for p in there))
        stated = {name: float(getattr(self.stated.friction[there[0]], name)) for name in names}
        self._progress(f"friction: {labels} {' and '.join(names)} on held-out samples")
        about = (labels, self.stated.friction[there[0]].joints)
        self.model = with_values(self.model, there, stated)
        tried = self.tried(there, points := [stated | point for point in self._points(group[0], names[:1])])
        if not self.tells:
            return [FieldChoice(*about, name, x, x, x, 0.0, None, None, TOO_FEW) for name, x in stated.items()]
        first, *others = tried.errors()
        if names[1:]:  # each of further fields near the best value of the first one
            k = int(np.argmin([np.mean(each) for each in others]))
            near, beside = points[max(k - NEAR, 0) : k + NEAR + 1], self._points(group[0], names[1:])
            points += (more := [own | other for own in near for other in beside if own != own | other])
            others += self.tried(there, more).errors()[1:]
        k = int(np.argmin([np.mean(each) for each in others]))
        gaps, best, before = first - others[k], dict(points[k]), self.model
        if (is_taken := is_better(gaps)) or names[0] == "width":
            self.model = with_values(self.model, there, best)
            best = dict(zip(names, self._finer([(group, name) for name in names]), strict=True))
            if not is_taken:  # a stated width may lie nearer to the best one than those of the grid
                finer = np.subtract(*self.tried(there, [stated, best]).errors()[1:])
                if is_taken := is_better(finer):
                    gaps = finer
                else:
                    self.model, best = before, points[k]
        value, told = best if is_taken else stated, evidence(gaps)
        if names[0] == "width":
            errors, grid = tried.by_joint(), np.array([point["width"] for point in points])
            self._set_apart(group, labels, stated["width"], grid, [errors[k + 1 if is_taken else 0], *errors[1:]])
        return [FieldChoice(*about, name, stated[name], best[name], value[name], *told) for name in names]

    def _points(self, p: int, names: Sequence[str]) -> list[dict[str, float]]:
        """Return the values of fields of a part that are compared."""
        grids = [self._grid(p, name) for name in names]
        return [dict(zip(names, map(float, values), strict=True)) for values in itertools.product(*grids)]

    def _grid(self, p: int, name: str) -> Array:
        """Return the values of a field over its range."""
        return np.geomspace(*self._spans[p, name], BESIDE if name in self._own_fields(p)[1:] else COARSE)

    def _finer(self, fields: Sequence[tuple[Sequence[int], str]], turns: int = FINER) -> list[float]:
        """Return the values near those of the model that fit all rows best, of fields of groups of parts; take them."""
        groups = [[p for p in group if p not in self.absent] for group, _ in fields]
        keys = [(self.heads[own[0]], name) for own, (_, name) in zip(groups, fields, strict=True)]
        steps = [grid[1] / grid[0] for grid in itertools.starmap(self._grid, keys)]
        place = {p: k for k, p in enumerate(p for p in range(len(self.model.friction)) if p not in self.absent)}
        own = replace(self.model, friction=tuple(self.model.friction[p] for p in place))
        moved = [([place[p] for p in each], name) for each, (_, name) in zip(groups, keys, strict=True)]
        found = finer_values(own, moved, [self._spans[key] for key in keys], steps, self._pooled, turns)[0].tolist()
        for each, (_, name), value in zip(groups, keys, found, strict=True):
            self.model = with_values(self.model, each, {name: value})
        return found

    def _set_apart(self, group: Sequence[int], label: str, stated: float, grid: Array, errors: Sequence[Array]) -> None:
        """Give drives widths of their own where held-out samples ask for them and the model is better with all."""
        model = self.model
        if not (own := own_widths(model, model.drives_of(model.friction[group[0]]), label, stated, grid, errors)):
            return
        split, absent, heads = set_apart(model, self.absent, self.heads, group, {k: own[k].value for k in own})
        before = [part for p, part in enumerate(model.friction) if p not in self.absent]
        parts = [*before, *(part for p, part in enumerate(split.friction) if p not in absent)]
        sets = [by_drive(model, parts, own) for own in (range(len(before)), range(len(before), len(parts)))]
        if is_better(np.subtract(*HeldOut.of(self._pooled.pool(parts), sets[0], sets).errors())):
            self.model, self.absent, self.heads = split, absent, heads
            there = [[p for p in self._of(group) if split.friction[p].joints == held.joints] for held in own.values()]
            finer = self._finer([(each, "width") for each in there])
            told = zip(own.values(), finer, strict=True)
            self.apart += [(group[0], replace(held, best=best, value=best)) for held, best in told]

    def tried(self, group: Places, points: Points, weights: Array | None = None, beside: Places = ()) -> HeldOut:
        """Return the model with values of fields of some parts, or it and each of them beside other parts."""
        model, present = self.model, [p for p in range(len(self.model.friction)) if p not in self.absent]
        others = [*present, *(p for p in beside if p not in present)]
        parts = [model.friction[p] for p in others]
        stand_ins = [replace(model.friction[p], **each) for each in points for p in group]
        pool = self._pooled.pool(every := [*parts, *stand_ins])

        def columns(value: int | None) -> list[list[int]]:
            places = {p: k for k, p in enumerate(others) if p in (present if value is None else beside or present)}
            if value is not None:
                places |= {p: len(parts) + value * len(group) + k for k, p in enumerate(group)}
            return by_drive(model, every, places.values())

        sets = [columns(value) for value in (None, *range(len(points)))]
        tried = HeldOut.of(pool, sets[0], sets, weights)
        return tried.with_parts(sets) if any(p in self.absent for p in (*group, *beside)) else tried
