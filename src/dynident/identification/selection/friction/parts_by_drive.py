"""Friction parts by kind of joint and by drive: drives whose sign of dry friction turns over a width of their own.

The width is chosen for all drives at once; drives differ in how far they turn under load before they slip, and light
ones in simulators with soft friction by a hundredfold. What each value does to the held-out rows of a drive's own joint
is known from the same fits: drives that ask for another one get it, if the model then predicts better as a whole.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.identification.problem.choices import FieldChoice
from dynident.identification.selection.friction.held_out_errors import CHANCE, is_better, share_of
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction


def by_unit(model: DynamicModel, part: Friction) -> tuple[Friction, ...]:
    """Return a part once for its revolute and once for its prismatic joints: a speed in rad/s is none in m/s."""
    own = [model.robot.active[drive] for drive in model.drives_of(part)]
    kinds = dict.fromkeys(joint.kind for joint in own)
    if len(kinds) < 2:
        return (part,)
    return tuple(replace(part, joints=tuple(joint.name for joint in own if joint.kind == kind)) for kind in kinds)


def with_values(model: DynamicModel, group: Sequence[int], values: Mapping[str, float]) -> DynamicModel:
    """Return the model with other values of fields of some parts."""
    parts = list(model.friction)
    for p in group:
        parts[p] = replace(parts[p], **values)
    return replace(model, friction=tuple(parts))


def by_drive(model: DynamicModel, parts: Sequence[Friction], places: Iterable[int]) -> list[list[int]]:
    """Return which of the parts at some places each drive of a model has."""
    acts = {place: model.drives_of(parts[place]) for place in places}
    return [[place for place, drives in acts.items() if drive in drives] for drive in range(model.robot.dof)]


def own_widths(
    model: DynamicModel, drives: Sequence[int], label: str, stated: float, grid: Array, errors: Sequence[Array]
) -> dict[int, FieldChoice]:
    """Return the drives whose held-out rows ask for another width than the one of all, but one, and what they say.

    Args:
        model: The model.
        drives: Those that have one width.
        label: Names of their parts.
        stated: The width that was stated.
        grid: Widths, shape (k,).
        errors: Held-out squared residuals of blocks and joints, (B, n): with the width of all, then with each of grid.
    """
    names, found = model.robot.joint_names, dict[int, FieldChoice]()
    for drive in drives if len(drives) > 1 else ():
        moved = np.asarray(model.robot.coupling)[drive] != 0
        first, *others = (np.log(np.maximum(each[:, moved].sum(axis=1), 1e-300)) for each in errors)
        k = int(np.argmin([np.mean(each) for each in others]))
        gaps = first - others[k]
        if is_better(gaps, CHANCE / len(drives)):
            best = float(grid[k])
            found[drive] = FieldChoice(label, (names[drive],), "width", stated, best, best, *share_of(gaps))
    if len(found) == len(drives):
        del found[min(found, key=lambda drive: found[drive].gain)]
    return found


def set_apart(
    model: DynamicModel, absent: Sequence[int], heads: Sequence[int], group: Sequence[int], widths: Mapping[int, float]
) -> tuple[DynamicModel, tuple[int, ...], tuple[int, ...]]:
    """Return a model whose parts of some drives have widths of their own, its absent parts and the heads of all.

    Args:
        model: With parts that have one width for their drives.
        absent: Places of the parts that are not there so far.
        heads: Of each part, the place of the stated one that it is of.
        group: Places of the parts that are split; what comes to them is last.
        widths: By drive, of some of those that have one.
    """
    names, parts, missing, of = model.robot.joint_names, list(model.friction), list(absent), list(heads)
    for p in group:
        rest = tuple(names[drive] for drive in model.drives_of(parts[p]) if drive not in widths)
        own = [replace(parts[p], joints=(names[drive],), width=width) for drive, width in widths.items()]
        parts[p] = replace(parts[p], joints=rest)
        missing += range(len(parts), len(parts) + len(own)) if p in absent else ()
        of += [p] * len(own)
        parts += own
    return replace(model, friction=tuple(parts)), tuple(missing), tuple(of)


def together(
    model: DynamicModel, absent: Sequence[int], heads: Sequence[int], group: Sequence[int], joints: Sequence[str] | None
) -> tuple[DynamicModel, tuple[int, ...], tuple[int, ...]]:
    """Return the model before the parts of ``group``, which are for these joints, were set apart; as there."""
    parts = list(model.friction)
    for p in group:
        parts[p] = replace(parts[p], joints=joints)
    kept = [p for p, head in enumerate(heads) if p == head or head not in group]
    missing = tuple(place for place, p in enumerate(kept) if p in absent)
    return replace(model, friction=tuple(parts[p] for p in kept)), missing, tuple(heads[p] for p in kept)
