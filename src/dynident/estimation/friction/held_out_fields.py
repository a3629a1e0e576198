"""Non-linear friction fields whose stated value stands unless held-out rows of the logs ask for another one.

The best value in the fit (see :mod:`variable_projection`) takes up whatever the model lacks, and the next motion need
not have it: a sign of dry friction that turns over a tenth of a radian a second may stand for a joint that gives. Here
values are compared by what they say about stretches of the logs that the fit has not seen, and another value is taken
only where its error is smaller than that of the stated one by more than chance makes it look in one of twenty logs
(Student's t of the differences, block by block). Then it is found to a finer step, in a fit of all rows near it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.estimation.friction.column_pool import fit, held_out, loss, make_pool
from dynident.estimation.friction.load import default_load
from dynident.estimation.friction.variable_projection import fastest_of, minimum, spans_of
from dynident.estimation.uncertainty.quantiles import student_quantile
from dynident.experiment.preprocessing import Prepared
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Friction
from dynident.model.friction.coulomb import Coulomb

#: Blocks of rows at least; fewer than three tell nothing about chance.
BLOCKS, FEWEST = 8, 3

#: Values of a field over its range, and between the neighbours of the best of them where that is taken.
COARSE, FINE = 13, 7

#: Chance of a difference as large where there is none.
CHANCE = 0.05

#: A value that takes less than this share off the held-out error is not worth another one than the stated.
NOTHING = 5e-3


@dataclass(frozen=True)
class Held:
    """A field that the logs could have had otherwise.

    Attributes:
        part: Name of the friction part.
        joints: The joints that it is for; None for all.
        field: Name of the field.
        stated: The value that was stated.
        best: The value with the least held-out error, made finer by all rows where it was taken.
        value: The one that was taken.
        gain: Share of the held-out mean squared residual that the best value takes off.
        error: Standard error of that share, block by block; None where the logs have too few rows to hold some out.
    """

    part: str
    joints: tuple[str, ...] | None
    field: str
    stated: float
    best: float
    value: float
    gain: float
    error: float | None


def has_choices(model: DynamicModel) -> bool:
    """Return whether a friction part leaves fields to the logs where held-out rows ask for it."""
    return any(part.choose for part in model.friction)


def with_chosen_widths(model: DynamicModel) -> DynamicModel:
    """Return the model with the widths of its signs of dry friction left to the logs where held-out rows ask for it."""
    dry = (replace(part, choose=("width",)) if isinstance(part, Coulomb) else part for part in model.friction)
    return replace(model, friction=tuple(dry))


def choose_fields(
    model: DynamicModel, logs: Sequence[Prepared], progress: Callable[[str], None] = lambda step: None
) -> tuple[DynamicModel, tuple[Held, ...]]:
    """Return the model with the stated or the best values of the fields that its parts leave to the logs, and why.

    Args:
        model: With parts whose ``choose`` names non-linear fields.
        logs: Preprocessed logs.
        progress: Told each step in words.

    Raises:
        BadOption: A name in ``choose`` that is no non-linear field of its part, or is in ``vary`` as well.
    """
    fastest = fastest_of(model, logs)
    load = default_load(model, logs) if "torque" in model.needs else None
    pieces = [_by_unit(model, part) if part.choose else (part,) for part in model.friction]
    model = replace(model, friction=tuple(itertools.chain(*pieces)))
    found: list[Held] = []
    for p, part in enumerate(model.friction):
        for name, span in spans_of(part, "choose", fastest).items():
            progress(f"friction: {FRICTION.name_of(part)} {name} on held-out rows")
            held = _chosen(model, p, name, span, logs, load)
            model = _with_value(model, p, name, held.value)
            found.append(held)
    return model, tuple(found)


def _by_unit(model: DynamicModel, part: Friction) -> tuple[Friction, ...]:
    """Return a part once for its revolute and once for its prismatic joints: a speed in rad/s is none in m/s."""
    own = [model.robot.active[drive] for drive in model.drives_of(part)]
    kinds = dict.fromkeys(joint.kind for joint in own)
    if len(kinds) < 2:
        return (part,)
    return tuple(replace(part, joints=tuple(joint.name for joint in own if joint.kind == kind)) for kind in kinds)


def _with_value(model: DynamicModel, p: int, name: str, value: float) -> DynamicModel:
    """Return the model with another value of a field of part p."""
    parts = list(model.friction)
    parts[p] = replace(parts[p], **{name: value})
    return replace(model, friction=tuple(parts))


def _chosen(
    model: DynamicModel, p: int, name: str, span: tuple[float, float], logs: Sequence[Prepared], load: Array | None
) -> Held:
    """Return what the logs say about one field of part p, all else as it is in the model."""
    part = model.friction[p]
    stated = float(getattr(part, name))
    about = (FRICTION.name_of(part), part.joints, name, stated)
    grid = np.geomspace(*span, COARSE)
    tried = _Tried.of(model, p, name, grid, logs, load)
    if len(tried.held) < FEWEST or np.min(tried.rows) < 2 * len(tried.keeps[0]):
        return Held(*about, stated, stated, 0.0, None)
    first, *others = (held_out(tried.held, tried.whole - tried.held, tried.rows, keep) for keep in tried.keeps)
    k = int(np.argmin([np.mean(each) for each in others]))
    best, gaps = float(grid[k]), (first - others[k]) / np.mean(first)
    gain, error = float(np.mean(gaps)), float(np.std(gaps, ddof=1) / np.sqrt(len(gaps)))
    if gain <= max(NOTHING, error * float(student_quantile(1.0 - CHANCE, len(gaps) - 1))):
        return Held(*about, best, stated, gain, error)
    grid = np.geomspace(grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)], FINE)
    tried = _Tried.of(_with_value(model, p, name, best), p, name, grid, logs, load)
    losses = np.array([loss(tried.whole, keep, fit(tried.whole, keep)) for keep in tried.keeps[1:]])
    best, _, _ = minimum(np.log(grid), losses, float(np.sum(tried.rows)))
    return Held(*about, best, best, gain, error)


@dataclass(frozen=True)
class _Tried:
    """A model with several values of a field, as products of the columns.

    Attributes:
        held: Products of each block, the joints weighted by their residuals in the model, shape (B, c + 1, c + 1).
        rows: Rows of each block, shape (B,).
        keeps: Columns of the model, and of each value in place of its own.
    """

    held: Array
    rows: IntArray
    keeps: tuple[IntArray, ...]

    @property
    def whole(self) -> Array:
        return self.held.sum(axis=0)

    @classmethod
    def of(
        cls, model: DynamicModel, p: int, name: str, grid: Array, logs: Sequence[Prepared], load: Array | None
    ) -> _Tried:
        tried = [replace(model.friction[p], **{name: float(value)}) for value in grid]
        pool = make_pool(model, [*model.friction, *tried], logs, max(BLOCKS, len(logs)), load)
        acts = [set(model.drives_of(part)) for part in model.friction]

        def columns(stand_in: int) -> list[list[int]]:
            parts = [(stand_in if k == p else k, own) for k, own in enumerate(acts)]
            return [[k for k, own in parts if drive in own] for drive in range(model.robot.dof)]

        held = pool.weighted(pool.weights(columns(p)))
        keeps = (np.sort(pool.chosen(columns(k))) for k in (p, *range(len(acts), len(pool.parts))))
        return cls(held, pool.rows.sum(axis=1), tuple(keeps))
