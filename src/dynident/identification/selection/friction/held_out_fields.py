"""Non-linear friction fields, and whole parts, whose stated value stands unless held-out samples ask for another one.

The best value in the fit (see :mod:`variable_projection`) takes up whatever the model lacks, and the next motion need
not have it: a sign of dry friction that turns over a tenth of a radian a second may stand for a joint that gives. Here
values are compared by what they say about stretches of the logs that the fit has not seen, and another value is taken
only where its error is smaller than that of the stated one by more than chance makes it look in one of twenty logs
(Student's t of the differences, block by block). Then it is found to a finer step, in a fit of all rows near it.

Parts that ``choose`` names as a whole are added as :mod:`added_parts` says, their first field beside the width by
variable projection (Golub and Pereyra 1973). Where a part is taken, all other fields are chosen once more beside it.
Signs of dry friction that are left to the logs turn over one width on the same joints. A wide sign and a part that
builds up slowly pass for each other, so fields and parts are chosen in both orders, and the better outcome is taken.

Where the delay of the torque is to be found as well, it is free in every fit: friction shows at reversals, a delay in
all that the torque does, so that neither is compared by what the other one does.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.data.preprocessing import Prepared
from dynident.identification.problem.choices import FieldChoice
from dynident.identification.selection.friction.added_parts import AddedParts
from dynident.identification.selection.friction.column_pool import PooledLogs
from dynident.identification.selection.friction.held_out_errors import FoldErrors, is_better, share_of
from dynident.identification.selection.friction.load import default_load
from dynident.identification.selection.friction.variable_projection import fastest_of, spans_of
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, WHOLE, Friction

#: Blocks of rows at least.
BLOCKS = 8

#: Rows in a period of the filter's cut-off that are compared.
ROWS = 8.0

#: Values of a field over its range, and between the neighbours of the best of them where that is taken.
COARSE, FINE = 13, 7

#: How often the values taken are made finer in turn where a part came to those that are there.
POLISHED = 2

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
    found = search.chosen()
    if search.optional and any(held.value != held.stated for held in found.values() if held.field != WHOLE):
        other = _FieldSearch(model, pooled, fastest_of(model, logs), progress)
        others = other.chosen(parts_first=True)
        if np.mean(other.errors()) < np.mean(search.errors()):
            search, found = other, others
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
        optional: Places of the parts that are only there if held-out rows ask for them.
        absent: Those of them that are not there so far.
    """

    def __init__(
        self, model: DynamicModel, pooled: PooledLogs, fastest: float, progress: Callable[[str], None]
    ) -> None:
        self.model, self.stated = model, model
        self.optional = tuple(p for p, part in enumerate(model.friction) if part.is_optional)
        self.absent = self.optional
        self._pooled, self._progress = pooled, progress
        self._spans = {
            (p, name): span
            for p, part in enumerate(model.friction)
            for name, span in spans_of(part, "choose", fastest).items()
        }

    def chosen(self, parts_first: bool = False) -> dict[tuple[int, str], FieldChoice]:
        """Choose fields and parts, the fields of the parts that are always there first, or all parts before them."""
        found = {} if parts_first else self.fields()
        decided = self.with_parts()
        if parts_first or any(held.value == _THERE for held in decided.values()):
            found |= self.polished(self.fields())
        return found | {(p, WHOLE): held for p, held in decided.items()}

    def errors(self) -> Array:
        """Return the logarithms of the errors of the blocks, by the model as far as it is chosen."""
        return self._tried((), "", np.empty(0)).errors(outer=False)[0]

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
        others = {p: self._alternatives(p) for p in absent}
        present = [part for p, part in enumerate(self.model.friction) if p not in absent]
        added = AddedParts.over(self.model, self._pooled, present, others)
        if not added.tried.tells:
            return {p: self._told(p, False, None) for p in absent}
        taken, gaps = added.chosen()
        self.model = replace(
            self.model, friction=tuple(taken.get(p, part) for p, part in enumerate(self.model.friction))
        )
        self.absent = tuple(p for p in absent if p not in taken)
        return {p: self._told(p, p in taken, gaps[p]) for p in absent}

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
        gain, error = share_of(gaps)
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
        gain, error = share_of(first - others[k])
        if not is_projected and not is_better(first - others[k]):
            return FieldChoice(*about, float(grid[k]), stated, gain, error)
        self.model = _with_value(self.model, there, name, float(grid[k]))
        grid = np.geomspace(grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)], FINE)
        best = self._tried(there, name, grid).finest(grid)
        self.model = _with_value(self.model, there, name, best)
        return FieldChoice(*about, best, best, gain, error)

    def _tried(self, group: Sequence[int], name: str, grid: Array) -> FoldErrors:
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

        tried = FoldErrors.of(
            pool, pool.weights(columns(None)), [columns(value) for value in (None, *range(len(grid)))]
        )
        stated = [k for k, p in enumerate(present) if not model.friction[p].is_optional]
        always = pool.chosen([[k for k in stated if drive in acts[k]] for drive in range(model.robot.dof)])
        whole = tried.whole
        return replace(tried, families=tuple([pool.possible(whole, keep, always)] for (keep,) in tried.families))
