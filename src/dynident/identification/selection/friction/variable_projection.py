"""Values of friction fields that enter non-linearly: searched outside the linear solve (Golub and Pereyra 1973).

For every value of the fields the coefficients follow from a linear problem, so that only the fields are searched. They
are few and what they do is smooth, so each is looked for on a logarithmic grid over its range, the grid is narrowed
around the best value, and a parabola through the last three gives the minimum and how sharp it is. All values of a grid
are columns of one pass over the rows; the fields take turns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.data.preprocessing import Prepared
from dynident.errors import BadOption
from dynident.identification.problem.choices import FieldEstimate
from dynident.identification.selection.friction.column_pool import ColumnPool, PooledLogs
from dynident.identification.selection.friction.load import default_load
from dynident.identification.selection.friction.nested_fits import NestedFits
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, WHOLE, Friction

#: Values of a field that are compared at a time, how often the grid is narrowed, turns over the fields.
VALUES, ROUNDS, TURNS = 7, 3, 3


def has_varying(model: DynamicModel) -> bool:
    """Return whether a friction part asks for values of its fields from the log."""
    return any(part.vary for part in model.friction)


def has_choices(model: DynamicModel) -> bool:
    """Return whether a friction part leaves fields, or itself, to the logs where held-out samples ask for it."""
    return any(part.choose for part in model.friction)


def without_optional(model: DynamicModel) -> DynamicModel:
    """Return the model without the parts that are only there if held-out samples ask for them."""
    return replace(model, friction=tuple(part for part in model.friction if not part.is_optional))


def vary_fields(
    model: DynamicModel,
    logs: Sequence[Prepared],
    progress: Callable[[str], None] = lambda step: None,
    finest: Array | None = None,
) -> tuple[DynamicModel, tuple[FieldEstimate, ...]]:
    """Return the model with the best values of the fields that its parts vary, and these values.

    Args:
        model: With parts whose ``vary`` names non-linear fields.
        logs: Preprocessed logs.
        progress: Called with each step in words.
        finest: Resolution of the positions of each drive, shape (n,), in rad or m; None where it is not known.

    Raises:
        BadOption: A name in ``vary`` that is no non-linear field of its part.
    """
    spans = all_spans(model, logs, "vary", finest)
    pooled = PooledLogs(model, logs, load=default_load(model, logs) if "torque" in model.needs else None)
    parts = list(model.friction)
    found: dict[tuple[int, str], FieldEstimate] = {}
    for turn in range(ROUNDS):
        progress(f"non-linear friction, round {turn + 1} of {ROUNDS}")
        grids = {key: np.geomspace(*span, VALUES) for key, span in spans.items()}
        tried = [replace(parts[p], **{name: float(x)}) for (p, name), grid in grids.items() for x in grid]
        pool = pooled.pool([*parts, *tried])
        best = _best(model, pool, list(grids.values()), [p for p, _ in grids])
        for key, grid, (value, low, high) in zip(grids, grids.values(), best, strict=True):
            p, name = key
            parts[p] = replace(parts[p], **{name: value})
            found[key] = FieldEstimate(FRICTION.name_of(parts[p]), parts[p].joints, name, value, low, high)
            step = grid[1] / grid[0]
            spans[key] = (max(value / step, spans[key][0]), min(value * step, spans[key][1]))
    return replace(model, friction=tuple(parts)), tuple(found.values())


def fastest_of(model: DynamicModel, logs: Sequence[Prepared]) -> float:
    """Return the largest speed of a drive in the logs, in rad/s or m/s."""
    coupling = np.asarray(model.robot.coupling)
    return max(float(np.max(np.abs(np.asarray(log.log.dq) @ coupling.T))) for log in logs)


def finest_of(model: DynamicModel, part: Friction, finest: Array | None) -> float:
    """Return the coarsest resolution of the positions (n,) of the drives of a part, in rad or m."""
    return 0.0 if finest is None else float(np.max(finest[list(model.drives_of(part))], initial=0.0))


def all_spans(
    model: DynamicModel, logs: Sequence[Prepared], asked: str, finest: Array | None
) -> dict[tuple[int, str], tuple[float, float]]:
    """Return where the fields are looked for that the parts name in ``asked`` (vary or choose), by place and name.

    Raises:
        BadOption: See :func:`spans_of`.
    """
    fastest, longest = fastest_of(model, logs), max(log.log.samples / log.log.rate for log in logs)
    return {
        (p, name): span
        for p, part in enumerate(model.friction)
        for name, span in spans_of(part, asked, fastest, finest_of(model, part, finest), longest).items()
    }


def spans_of(
    part: Friction, asked: str, fastest: float, finest: float = 0.0, longest: float = np.inf
) -> dict[str, tuple[float, float]]:
    """Return where each field of a part that its option ``asked`` (vary or choose) names is looked for.

    ``part`` in choose is no field.

    Raises:
        BadOption: The part has no such field to look for, or both options name it.
    """
    spans = {}
    for name in getattr(part, asked) or ():
        if asked == "choose" and name == WHOLE:
            continue
        if name not in part.ranges:
            step = f"the part '{FRICTION.name_of(part)}' can {asked}: {', '.join(part.ranges) or 'nothing'}"
            raise BadOption(asked, name, step)
        if name in (part.vary or ()) and name in (part.choose or ()):
            raise BadOption(asked, name, "name a field in vary or in choose, not in both")
        span = part.ranges[name]
        high = min(span.high, max(fastest, 2 * span.low)) if span.is_speed else span.high
        if span.is_duration and longest < 0.9 * span.least_log:  # some of a log is cut off at its ends
            step = f"in logs of at least twice that; this is {longest:.3g} s; log longer, or state a value"
            raise BadOption(asked, name, f"it is looked for from {span.low:g} s on, {step}")
        high = min(high, longest) if span.is_duration else high
        spans[name] = (min(max(span.low, finest), high) if span.is_distance else span.low, high)
    return spans


def _best(
    model: DynamicModel, pool: ColumnPool, grids: Sequence[Array], owners: Sequence[int]
) -> list[tuple[float, float, float]]:
    """Return the best value of each field and the interval that is as good, the fields taking turns."""
    stated = len(model.friction)
    acts = [set(model.drives_of(part)) for part in model.friction]
    places: list[int | None] = [None] * len(grids)
    first = stated + np.concatenate([[0], np.cumsum([len(grid) for grid in grids])[:-1]]).astype(int)

    def sets(changed: int, value: int) -> list[list[int]]:
        """Return the parts of each drive with one field at a value of its grid, the others at their best so far."""
        stand_in = list(range(stated))
        for k, owner in enumerate(owners):
            place = value if k == changed else places[k]
            if place is not None and (k == changed or owner != owners[changed]):
                stand_in[owner] = int(first[k]) + place
        return [[stand_in[p] for p in range(stated) if drive in acts[p]] for drive in range(model.robot.dof)]

    weights = pool.weights(sets(0, len(grids[0]) // 2))
    total, rows = pool.weighted(weights).sum(axis=0)[None], float(pool.rows.sum())
    fits = NestedFits(total, total, pool.shared)
    results: list[tuple[float, float, float]] = [(0.0, 0.0, 0.0)] * len(grids)
    for _ in range(TURNS if len(grids) > 1 else 1):
        for k, grid in enumerate(grids):
            keeps = [pool.chosen(sets(k, value)) for value in range(len(grid))]
            losses = np.array([fits.losses(keep)[0] for keep in keeps])
            places[k] = int(np.argmin(losses))
            results[k] = minimum(np.log(grid), losses, rows)
    return results


def minimum(at: Array, losses: Array, rows: float) -> tuple[float, float, float]:
    """Return the value at the minimum of a parabola in the logarithm, and the interval of one standard deviation.

    At an end of the grid it is that end; where the loss hardly changes the interval is the grid.
    """
    k = int(np.clip(np.argmin(losses), 1, len(at) - 2))
    step = at[1] - at[0]
    slope, bend = (
        (losses[k + 1] - losses[k - 1]) / (2 * step),
        (losses[k + 1] - 2 * losses[k] + losses[k - 1]) / step**2,
    )
    lowest = float(np.min(losses))
    if bend <= 0:
        place, spread = float(at[int(np.argmin(losses))]), np.inf
    else:
        place = float(np.clip(at[k] - slope / bend, at[0], at[-1]))
        spread = float(np.sqrt(2.0 * lowest / max(rows, 1.0) / bend))
    low, high = max(place - spread, at[0]), min(place + spread, at[-1])
    return float(np.exp(place)), float(np.exp(low)), float(np.exp(high))
