"""Friction chosen joint by joint: forward selection on held-out blocks of the training logs, as simple as they allow.

Parts are added one by one to a drive, or exchanged, while that lowers the held-out error; then the shortest list is
kept whose error is within one standard error of the best (Breiman, Friedman, Olshen and Stone 1984, section 3.4.3; the
error of the difference, block by block). Of lists as long and as good the most usual one is taken. Where drives take
the Stribeck effect, its velocity is found for each by variable projection, and all choose once more. No test log has a
part in it.

Rows that have chosen among many lists say too much good of the chosen ones (Stone 1974; Varma and Simon 2006). So the
choice as such is held against the list that it starts from: half of the blocks choose, and what they choose is scored
on the other half, and the other way round.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.data.preprocessing import Prepared
from dynident.errors import BrokenPart, LogMismatch
from dynident.identification.problem.choices import FrictionRecord, FrictionScore
from dynident.identification.residuals.quantiles import student_quantile
from dynident.identification.selection.friction.column_pool import ROWS, ColumnPool, PooledLogs
from dynident.identification.selection.friction.load import default_load
from dynident.identification.selection.friction.nested_fits import NestedFits
from dynident.identification.selection.friction.variable_projection import vary_fields
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Friction
from dynident.model.friction.base import SelectionCandidate

#: Width of the sign of dry friction where the model states none.
WIDTH = 0.02

#: A part that takes less than this share off the held-out error is none.
NOTHING = 5e-3

#: Chance with which a choice may be taken that is no better.
CHANCE = 0.05

#: Blocks of rows at least; parts of a drive at most; rounds over the drives.
BLOCKS, LONGEST, ROUNDS = 8, 8, 2

#: How often a list may be improved by exchanging one of its parts, before it grows.
EXCHANGES = 2


@dataclass(frozen=True)
class FrictionChoice:
    """The friction of a robot and how it was found.

    Attributes:
        friction: Parts, for some joints or all.
        steps: By joint, the models on the way.
        blocks: Number of held-out blocks.
        gain: What such a choice takes off the held-out mean squared residual of the model's own friction, as a share of
            it, on blocks that had no part in it; 0 where the model has none.
        error: Standard error of that share.
    """

    friction: tuple[Friction, ...]
    steps: dict[str, tuple[FrictionScore, ...]]
    blocks: int
    gain: float = 0.0
    error: float = 0.0

    @property
    def improves_significantly(self) -> bool:
        """Whether the choice is better than the model's own friction by more than chance."""
        bound = self.error * float(student_quantile(1.0 - CHANCE, self.blocks - 1))
        return self.gain > max(NOTHING, bound)

    def record(self) -> FrictionRecord:
        """Return what the estimate states of the choice."""
        return FrictionRecord(self.blocks, self.steps, self.gain, self.error)


def choose_friction(
    model: DynamicModel,
    logs: Sequence[Prepared],
    progress: Callable[[str], None] = lambda step: None,
    delay_is_free: bool = False,
) -> FrictionChoice:
    """Choose the friction of each drive from training logs.

    Args:
        model: The robot; what it has of friction is held against the choice and is among the candidates, whose signs
            of dry friction turn over the same width.
        logs: Preprocessed training logs.
        progress: Called with each step in words.
        delay_is_free: Whether a delay of the torque is free in what is compared.

    Raises:
        LogMismatch: Too few rows to hold some out.
    """
    logs = [log.sparser(ROWS) for log in logs]
    progress("friction: candidates")
    search = _PartSearch.over(model, _candidates(model, logs), logs, delay_is_free)
    names = model.robot.joint_names
    gain, error = search.judged(_places(search.pool.parts, model), names, progress) if model.friction else (0.0, 0.0)
    search.improve_all(names, progress)
    search = _refined(search, model, logs, progress, delay_is_free)
    return FrictionChoice(
        _gathered(search.pool.parts, search.sets, names),
        dict(zip(names, search.steps, strict=True)),
        search.blocks,
        gain,
        error,
    )


def _candidates(model: DynamicModel, logs: Sequence[Prepared]) -> tuple[Friction, ...]:
    """Return what a drive can have: the usual candidates with the widths of the model, and the parts that it has."""
    own = dict.fromkeys(_bare(part) for part in model.friction)
    dry = [(len(model.drives_of(part)), part.dry_width) for part in model.friction if part.dry_width is not None]
    most = max((count for count, _ in dry), default=0)
    widths = list(dict.fromkeys(width for count, width in dry if count in (most, max(count, 2)))) or [WIDTH]
    found = [
        FRICTION.make(
            name, {**candidate.options} | ({} if candidate.width is None else {"width": width * candidate.width})
        )
        for width in widths
        for name, candidate in _ranked()
    ]
    parts = tuple(dict.fromkeys([*_over_whole_cycles(found, model, logs), *own]))
    if any(log.log.temperature is None for log in logs):
        parts = tuple(part for part in parts if "temperature" not in part.needs)
    return parts


def _over_whole_cycles(parts: Sequence[Friction], model: DynamicModel, logs: Sequence[Prepared]) -> list[Friction]:
    """Return candidates, those of position only for drives whose logs cover a cycle."""
    q = np.concatenate([log.kept.q for log in logs])
    span = np.ptp(q @ np.asarray(model.robot.coupling).T, axis=0)
    found: list[Friction] = []
    for part in parts:
        covers = np.ones(len(span), bool) if part.cycle is None else span >= part.cycle
        names = tuple(name for name, whole in zip(model.robot.joint_names, covers, strict=True) if whole)
        if names:
            found.append(part if covers.all() else replace(part, joints=names))
    return found


def _ranked() -> list[tuple[str, SelectionCandidate]]:
    """Return all candidates with the names of their parts, the most usual first."""
    found: list[tuple[str, SelectionCandidate]] = []
    for name in FRICTION.names():
        with suppress(BrokenPart):  # of a package: whoever asks for it by name is told
            found += [(name, candidate) for candidate in FRICTION.get(name).candidates]
    return sorted(found, key=lambda each: each[1].rank)


def _bare(part: Friction) -> Friction:
    """Return a part for all drives that leaves nothing to the logs."""
    return replace(part, joints=None, vary=None, choose=None)


def _places(parts: Sequence[Friction], model: DynamicModel) -> list[tuple[int, ...]]:
    """Return the candidates that each drive has in the model."""
    acts = [(parts.index(_bare(part)), set(model.drives_of(part))) for part in model.friction]
    return [tuple(p for p, drives in acts if drive in drives) for drive in range(model.robot.dof)]


def _refined(
    search: _PartSearch,
    model: DynamicModel,
    logs: Sequence[Prepared],
    progress: Callable[[str], None],
    delay_is_free: bool,
) -> _PartSearch:
    """Return the search once more with fields of the drives' own, where some drives took a part that has such fields.

    They are found by variable projection with the parts that were chosen; what is held out then decides whether they,
    and which parts beside them, are taken. A drive may take those of another one. A part of speed alone would pass for
    another value of such a field: of the chosen parts only the others stay beside the usual ones meanwhile.
    """
    pool, names = search.pool, model.robot.joint_names
    others = [part for part in pool.parts if not part.refined]
    chosen = _gathered(pool.parts, search.sets, names)
    usual = tuple(pool.parts[p] for p in search.start)
    stays = (part for part in chosen if not part.refined and any(reads - {"dq"} for reads in part.expression.reads))
    fixed = [*usual, *stays]
    taken = [(name, pool.parts[p]) for name, own in zip(names, search.sets, strict=True) for p in own]
    varied = [replace(part, joints=(name,), vary=part.refined) for name, part in taken if part.refined]
    if not varied:
        return search
    found, _ = vary_fields(replace(model, friction=(*fixed, *varied)), logs, progress)
    kinds = dict.fromkeys(replace(part, joints=None, vary=None) for part in found.friction[len(fixed) :])
    place = next(p for p, part in enumerate(pool.parts) if part.refined)
    finer = _PartSearch.over(model, (*others[:place], *kinds, *others[place:]), logs, delay_is_free)
    fields = ", ".join(dict.fromkeys(f"{FRICTION.name_of(part)} {' and '.join(part.refined)}" for part in varied))
    for joint, name in enumerate(names):
        progress(f"friction: {name}, {fields} of its own")
        finer.improve(joint)
    return finer


def _gathered(parts: Sequence[Friction], sets: Sequence[Sequence[int]], names: Sequence[str]) -> tuple[Friction, ...]:
    """Return the parts with the joints that they are for; None where that is all."""
    found = []
    for p, part in enumerate(parts):
        own = tuple(name for name, chosen in zip(names, sets, strict=True) if p in chosen)
        if own:
            found.append(part if len(own) == len(names) else replace(part, joints=own))
    return tuple(found)


def label(part: Friction) -> str:
    """Return a part as the table of the choice names it: ``stribeck (velocity 0.1)``."""
    name, told = FRICTION.name_of(part), part.candidates
    fields = [key for key in part.options if len({each.options.get(key) for each in told}) > 1]
    fields += ["width"] if len({each.width for each in told}) > 1 else []
    return name + (f" ({', '.join(f'{key} {getattr(part, key):.3g}' for key in fields)})" if fields else "")


def _without(own: tuple[int, ...], place: int) -> tuple[int, ...]:
    return own[:place] + own[place + 1 :]


def as_good(scores: Array, others: Array, share: float = np.inf) -> bool:
    """Return whether scores of blocks (B,) are within one standard error, and a share, of others, or below."""
    gap = scores - others
    return bool(np.mean(gap) <= min(np.std(gap, ddof=1) / np.sqrt(len(gap)), share * np.mean(others)))


class _PartSearch:
    """Sets of parts, one a drive, and what is held out."""

    def __init__(self, pool: ColumnPool, start: tuple[int, ...]) -> None:
        self.pool, self.start = pool, start
        self.sets: list[tuple[int, ...]] = [start] * len(pool.products)
        self.steps: list[tuple[FrictionScore, ...]] = [()] * len(self.sets)
        self.blocks = len(pool.rows)
        self._held = pool.weighted(pool.weights(self.sets))
        whole = self._held.sum(axis=0)
        self._all = NestedFits(whole[None], whole[None], pool.shared)
        self._others = NestedFits(whole - self._held, self._held, pool.shared)
        self._rows = pool.rows.sum(axis=1)
        self._known: dict[bytes, Array] = {}

    @classmethod
    def over(
        cls, model: DynamicModel, parts: Sequence[Friction], logs: Sequence[Prepared], delay_is_free: bool
    ) -> _PartSearch:
        """Return the search among some parts, before its first step."""
        kinds = [FRICTION.name_of(part) for part in parts]
        usual = dict.fromkeys(kind for kind, part in zip(kinds, parts, strict=True) if part.is_default)
        places = tuple(kinds.index(name) for name in usual)
        start = replace(model, friction=tuple(parts[p] for p in places))
        load = default_load(start, logs)
        pool = PooledLogs(model, logs, max(BLOCKS, len(logs)), load, delay_is_free).pool(parts)
        rows, needed = int(np.min(pool.rows.sum(axis=1))), 2 * pool.shared
        if len(pool.rows) < 3 or rows < needed:
            evidence = f"the shortest of {len(pool.rows)} held-out parts has {rows} rows in motion, {needed} are needed"
            raise LogMismatch(logs[0].log.name, evidence, "give a longer log, or state the friction in place of auto")
        return cls(pool, places)

    def improve_all(self, names: Sequence[str], progress: Callable[[str], None]) -> None:
        """Choose the parts of all drives in turn, more than once."""
        for turn in range(ROUNDS):
            for joint, name in enumerate(names):
                progress(f"friction: {name}, round {turn + 1} of {ROUNDS}")
                self.improve(joint)

    def judged(
        self, against: Sequence[tuple[int, ...]], names: Sequence[str], progress: Callable[[str], None]
    ) -> tuple[float, float]:
        """Return what the choice takes off the held-out error of given lists, as a share, and the error of that.

        Every other block chooses and is fitted to, those between are predicted, and the reverse.
        """
        gaps, sizes = np.zeros(self.blocks), np.zeros(self.blocks)
        for half in range(2):
            progress(f"friction: the choice held out, {half + 1} of 2")
            seen = np.arange(self.blocks) % 2 == half
            pool = replace(
                self.pool, products=tuple(each[seen] for each in self.pool.products), rows=self.pool.rows[seen]
            )
            search = _PartSearch(pool, self.start)
            search.improve_all(names, lambda step: None)
            unseen = self._held[~seen]
            learned = NestedFits(np.broadcast_to(self._held[seen].sum(axis=0), unseen.shape), unseen, self.pool.shared)
            keeps = (search.possible(against), search.possible(search.sets))
            squares = [learned.losses(keep) / np.maximum(self._rows[~seen], 1) for keep in keeps]
            gaps[~seen], sizes[~seen] = squares[0] - squares[1], squares[0]
        gaps /= np.mean(sizes)
        return float(np.mean(gaps)), float(np.std(gaps, ddof=1) / np.sqrt(self.blocks))

    def possible(self, sets: Sequence[Sequence[int]]) -> IntArray:
        """Return the columns of lists without those whose coefficients would have a wrong sign in a fit of all rows."""
        return self.pool.possible(self._all, np.sort(self.pool.chosen(sets)), np.arange(self.pool.shared))

    def improve(self, joint: int) -> None:
        """Choose the parts of one drive, those of the others held."""
        path: list[tuple[int, ...]] = [()]
        scores = [self._scores(joint, ())]
        while len(path[-1]) < LONGEST:
            best = self._best(joint, [*self._longer(joint, path[-1]), *self._usual(len(path[-1]) + 1)])
            if best is None or np.mean(best[1]) >= (1.0 - NOTHING) * np.mean(scores[-1]):
                break
            for _ in range(EXCHANGES):  # what came first need not be in the best of this length
                other = self._best(
                    joint, [new for k in range(len(best[0])) for new in self._longer(joint, _without(best[0], k))]
                )
                if other is None or not as_good(other[1], best[1], NOTHING) or other[0] == best[0]:
                    break
                if as_good(best[1], other[1], NOTHING) and sorted(best[0]) <= sorted(other[0]):
                    break
                best = other
            path.append(best[0])
            scores.append(best[1])
        lowest = int(np.argmin([np.mean(each) for each in scores]))
        errors = [np.std(each - scores[lowest], ddof=1) / np.sqrt(self.blocks) for each in scores]
        pick = next(k for k, each in enumerate(scores) if as_good(each, scores[lowest]))
        self.sets[joint] = path[pick]
        self.steps[joint] = tuple(
            FrictionScore(tuple(label(self.pool.parts[p]) for p in own), float(np.mean(each)), float(error), k == pick)
            for k, (own, each, error) in enumerate(zip(path, scores, errors, strict=True))
        )

    def _usual(self, length: int) -> list[tuple[int, ...]]:
        """Return the usual lists of a length: two parts may stand in for two of theirs, which exchanges would miss."""
        bent = [p for p, part in enumerate(self.pool.parts) if part.refined] if length == 3 else []
        usual = [self.start[:length]] if length <= len(self.start) else []
        return usual + [(*self.start[:2], p) for p in bent]

    def _longer(self, joint: int, own: tuple[int, ...]) -> list[tuple[int, ...]]:
        places = [p for p, columns in enumerate(self.pool.columns) if len(columns[joint])]
        return [(*own, p) for p in places if self._fits(own, p)]

    def _best(self, joint: int, tried: Sequence[tuple[int, ...]]) -> tuple[tuple[int, ...], Array] | None:
        """Return the best of several lists of parts of a drive, with its scores (B,); None where none is possible."""
        found = [(own, self._scores(joint, own)) for own in tried if self._is_possible(joint, own)]
        if not found:
            return None
        lowest = min((scores for _, scores in found), key=lambda scores: float(np.mean(scores)))
        return min((each for each in found if as_good(each[1], lowest, NOTHING)), key=lambda each: sorted(each[0]))

    def _fits(self, own: Sequence[int], new: int) -> bool:
        """Return whether a part can stand beside others: not twice the same kind, no rivals."""
        part, others = self.pool.parts[new], [self.pool.parts[p] for p in own]
        name = FRICTION.name_of(part)
        return not any(FRICTION.name_of(other) in (name, *part.rivals) or name in other.rivals for other in others)

    def _keep(self, joint: int, own: Sequence[int]) -> IntArray:
        return self.pool.chosen([own if j == joint else other for j, other in enumerate(self.sets)])

    def _is_possible(self, joint: int, own: Sequence[int]) -> bool:
        """Return whether all coefficients of the drive have the sign that physics wants, in a fit of all rows."""
        keep = self._keep(joint, own)
        wanted = np.zeros(len(self.pool.nonnegative), bool)
        mine = np.concatenate([self.pool.columns[p][joint] for p in own])
        wanted[mine] = self.pool.nonnegative[mine]
        return bool(np.all(self._all.coefficients(keep)[0, wanted[keep[self.pool.shared :]]] >= 0))

    def _scores(self, joint: int, own: Sequence[int]) -> Array:
        """Return the mean squared residual of each block, in a fit of the others, shape (B,)."""
        keep = np.sort(self._keep(joint, own))
        if keep.tobytes() not in self._known:
            self._known[keep.tobytes()] = self._others.losses(keep) / np.maximum(self._rows, 1)
        return self._known[keep.tobytes()]
