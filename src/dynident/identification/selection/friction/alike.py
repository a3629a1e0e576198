"""One friction for all drives, where the logs do not tell them apart.

Drives of one robot are mostly built alike, and a list of parts that was chosen for each drive by itself follows the
motion of the log: beyond its speeds and loads it errs more. So lists that are the same on all drives are fitted and
held out block by block beside the lists of the drives' own, this time with possible robots; the best of them is taken
if it is within one standard error (Breiman, Friedman, Olshen and Stone 1984, section 3.4.3), the shortest of those that
are as good as the best. The list that a draft has is always among them. Lists of the drives' own stand aside where the
choice as such is no better than that list (:mod:`friction_choice`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from itertools import combinations

import numpy as np

from dynident.arrays import Array
from dynident.data.preprocessing import Prepared
from dynident.errors import PoorExcitation, SolverFailed
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.problem.choices import FrictionScore
from dynident.identification.problem.problem import Problem
from dynident.identification.selection.cross_validation import cross_validate
from dynident.identification.selection.friction.friction_choice import as_good
from dynident.identification.selection.friction.load import problem_of
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Friction, shared_parts

#: A list that errs more by less than this share of the held-out error errs no more.
NOTHING = 5e-3

#: Blocks of rows, each left out once.
BLOCKS = 10

#: Stands for the lists of the drives' own.
OWN = ("each its own",)


def starting_friction() -> tuple[Friction, ...]:
    """Return the list for all drives that a choice begins with, as a draft does, from the uses that parts state."""
    return tuple(FRICTION.make(name, use.options) for name, use in shared_parts())


def shared_lists() -> tuple[tuple[str, ...], ...]:
    """Return the lists for all drives by the names of their parts, the shortest first: with and without each group."""
    parts = shared_parts()
    groups = list(dict.fromkeys(use.group for _, use in parts if use.group not in ("default", "optional")))
    added = (chosen for size in range(len(groups) + 1) for chosen in combinations(groups, size))
    lists = (tuple(name for name, use in parts if use.group in ("default", *chosen)) for chosen in added)
    return tuple(sorted(lists, key=len))


def same_for_all(
    model: DynamicModel,
    logs: Sequence[Prepared],
    progress: Callable[[str], None] = lambda step: None,
    usual: tuple[Friction, ...] = (),
    improves_significantly: bool = True,
) -> tuple[DynamicModel, tuple[FrictionScore, ...]]:
    """Return the model with one friction for all drives if that is as good, and what was compared.

    Args:
        model: With the friction chosen for each drive.
        logs: Preprocessed training logs.
        progress: Called with each step in words.
        usual: A further list for all drives: that which the choice began with.
        improves_significantly: Whether the lists of the drives' own may be taken.

    Raises:
        PoorExcitation: The logs do not determine the parameters.
        SolverFailed: No checked solution was found.
    """
    if not usual and all(part.joints is None for part in model.friction):
        return model, ()
    progress("friction: all drives alike")
    own = problem_of(model, logs)
    shared = shared_lists()
    try:
        scale = own.joint_deviations(Consistent(bodies="free").solve(own).beta)
        held = fold_errors(own, scale)
    except SolverFailed:  # parts of their own that hardly differ: what is alike and has a solution is taken
        own = problem_of(replace(model, friction=_alike(shared[0], usual, model.friction)), logs)
        scale, held = own.joint_deviations(Consistent(bodies="free").solve(own).beta), np.array([np.inf])
    if held is None:
        return model, ()
    kept, scores = [model.friction], [held]
    names: list[tuple[str, ...]] = [OWN]
    lists = [_alike(parts, usual, model.friction) for parts in shared]
    for friction in (*lists, *([usual] if usual and usual not in lists else [])):
        parts = tuple(dict.fromkeys(FRICTION.name_of(part) for part in friction))
        try:
            score = fold_errors(problem_of(replace(model, friction=friction), logs), scale)
        except (PoorExcitation, SolverFailed):  # the logs do not determine it
            continue
        if score is not None:
            scores.append(score)
            kept.append(friction)
            names.append(parts)
    means = [float(np.mean(score)) for score in scores]
    solved = bool(np.isfinite(held).all())
    gaps = [float(np.std(score - held, ddof=1) / np.sqrt(len(held))) if solved else 0.0 for score in scores]
    best = min(range(1, len(kept)), key=lambda k: means[k], default=0)
    shortest = next((k for k in range(1, len(kept)) if as_good(scores[k], scores[best], NOTHING)), best)
    pick = shortest if not improves_significantly or means[best] - means[0] <= gaps[best] else 0
    table = (
        FrictionScore(parts, mean, gap, k == pick)
        for k, (parts, mean, gap) in enumerate(zip(names, means, gaps, strict=True))
        if np.isfinite(mean)
    )
    return replace(model, friction=kept[pick]), tuple(table)


def _alike(parts: Sequence[str], usual: Sequence[Friction], chosen: Sequence[Friction]) -> tuple[Friction, ...]:
    """Return a list for all drives, its parts as in the usual list, else with the options that most drives have."""
    found: list[Friction] = []
    for name in parts:
        own = [part for part in usual if FRICTION.name_of(part) == name]
        found += own or [_like(name, usual or chosen)]
    return tuple(found)


def _like(name: str, chosen: Sequence[Friction]) -> Friction:
    """Return a part for all drives, with the options that most drives were given; else with the width of the others."""
    own = [part for part in chosen if FRICTION.name_of(part) == name]
    if not own:
        width = next((other.dry_width for other in chosen if other.dry_width is not None), None)
        turns = width is not None and any(each.width is not None for each in FRICTION.get(name).candidates)
        return FRICTION.make(name, {"width": width} if turns else {})
    most = max(own, key=lambda part: np.inf if part.joints is None else len(part.joints))
    options = {f.name: getattr(most, f.name) for f in fields(most) if f.name != "joints"}
    return FRICTION.make(name, options)


def fold_errors(problem: Problem, scale: Array) -> Array | None:
    """Return the mean squared residual of each block by a fit of the others, in units of ``scale`` (n,), (B,).

    None where the others do not determine the parameters.
    """
    estimator = Consistent(bodies="free")
    found = cross_validate(problem, estimator, estimator.solve(problem).beta, BLOCKS)
    if any(fold.missing for fold in found.folds):
        return None
    return np.array([np.nanmean(np.square(fold.rmse / scale)) for fold in found.folds])
