"""Values of friction fields that enter non-linearly: searched outside the linear solve (Golub and Pereyra 1973).

For every value of the fields the coefficients follow from a linear problem, so that only the fields are searched. They
are few and what they do is smooth: each is looked for on a logarithmic grid over its range, and steps of all together
lead from there to the minimum and tell how sharp it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared
from dynident.errors import BadOption
from dynident.identification.problem.choices import FieldEstimate
from dynident.identification.selection.friction.load import default_load
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import WHOLE_PART, Friction, called

#: Values of a field that are compared, and steps from the best of them at most.
VALUES, TURNS = 7, 10


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
    from dynident.identification.selection.friction.column_pool import PooledLogs  # few cases need these
    from dynident.identification.selection.friction.finer_values import finer_values
    from dynident.identification.selection.friction.held_out_errors import HeldOut
    from dynident.identification.selection.friction.parts_by_drive import by_drive

    pooled = PooledLogs(model, logs, load=default_load(model, logs) if "torque" in model.needs else None)
    parts, steps, found = list(model.friction), list[float](), list[FieldEstimate]()
    for (p, name), span in spans.items():
        progress(f"non-linear friction: {called(parts[p])} {name}")
        grid = np.geomspace(*span, VALUES)
        pool = pooled.pool([*parts, *(replace(parts[p], **{name: float(x)}) for x in grid)])
        lists = [[*range(p), own, *range(p + 1, len(parts))] for own in range(len(parts), len(pool.parts))]
        sets = [by_drive(model, pool.parts, each) for each in lists]
        losses = HeldOut.of(pool, sets[VALUES // 2], sets).best[0]
        parts[p] = pool.parts[len(parts) + int(np.argmin(losses))]
        steps.append(grid[1] / grid[0])
    start, fields = replace(model, friction=tuple(parts)), [([p], name) for p, name in spans]
    values, spreads = finer_values(start, fields, list(spans.values()), steps, pooled, TURNS)
    bands = [2.0 * (log.how.filter.bandwidth() or np.inf) * log.every / log.log.rate for log in logs]
    spreads = np.exp(spreads / np.sqrt(min(1.0, np.mean(bands))))  # two independent rows a period of the bandwidth
    for ((p, name), (low, high)), value, by in zip(spans.items(), values.tolist(), spreads.tolist(), strict=True):
        parts[p] = replace(parts[p], **{name: value})
        ends = max(value / by, low), min(value * by, high)
        found.append(FieldEstimate(called(parts[p]), parts[p].joints, name, value, *ends))
    return replace(model, friction=tuple(parts)), tuple(found)


def finest_of(model: DynamicModel, part: Friction, finest: Array | None) -> float:
    """Return the coarsest resolution of the positions (n,) of the drives of a part, in rad or m."""
    return 0.0 if finest is None else float(np.max(finest[list(model.drives_of(part))], initial=0.0))


def all_spans(
    model: DynamicModel, logs: Sequence[Prepared], asked: str, finest: Array | None
) -> dict[tuple[int, str], tuple[float, float]]:
    """Return where the fields are looked for that the parts name in ``asked`` (vary or choose), by place and name."""
    fastest = max(float(np.abs(np.asarray(log.log.dq) @ np.asarray(model.robot.coupling).T).max()) for log in logs)
    longest, furthest = max(log.log.samples / log.log.rate for log in logs), reach_of(model, [log.log for log in logs])
    return {
        (p, name): span
        for p, part in enumerate(model.friction)
        for name, span in spans_of(part, asked, fastest, finest_of(model, part, finest), longest, furthest).items()
    }


def reach_of(model: DynamicModel, logs: Sequence[Log]) -> float:
    """Return half the largest range of the motion of a drive, in rad or m: further no drive slips at every reversal."""
    turns = np.asarray(model.robot.coupling).T  # what is not finite is refused elsewhere, by its name
    return max(float(np.ptp(np.where(np.isfinite(log.q), log.q, 0.0) @ turns, axis=0).max()) for log in logs) / 2


def spans_of(
    part: Friction, asked: str, fastest: float, finest: float = 0.0, longest: float = np.inf, furthest: float = np.inf
) -> dict[str, tuple[float, float]]:
    """Return where each field of a part that its option ``asked`` (vary or choose) names is looked for.

    ``part`` in choose is no field.

    Raises:
        BadOption: The part has no such field to look for, or both options name it.
    """
    spans = {}
    for name in getattr(part, asked) or ():
        if asked == "choose" and name == WHOLE_PART:
            continue
        if name not in part.ranges:
            known = ", ".join((*part.ranges, *[WHOLE_PART] * (asked == "choose")))
            raise BadOption(asked, name, f"the part '{called(part)}' can {asked}: {known or 'nothing; leave it out'}")
        if name in (part.vary or ()) and name in (part.choose or ()):
            raise BadOption(asked, name, "name a field in vary or in choose, not in both")
        span = part.ranges[name]
        high = min(span.high, max(fastest, 2 * span.low)) if span.is_speed else span.high
        if span.is_duration and longest < 0.9 * span.least_log:  # some of a log is cut off at its ends
            step = f"in logs of at least twice that; this is {longest:.3g} s; log longer, or state a value"
            raise BadOption(asked, name, f"it is looked for from {span.low:g} s on, {step}")
        high = min(high, longest) if span.is_duration else high
        high = min(high, max(furthest, finest)) if span.is_distance else high
        spans[name] = (min(max(span.low, finest), high) if span.is_distance else span.low, high)
    return spans
