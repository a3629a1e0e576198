"""The choice of friction parts and fields by held-out samples, with what it compares them on."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.data.preprocessing import Prepared
from dynident.identification.problem.choices import FieldChoice
from dynident.identification.selection.friction.column_pool import ROWS, PooledLogs, SharedRows
from dynident.identification.selection.friction.held_out_errors import BLOCKS, NOTHING, OF_SHORT_LOGS, HeldOut, evidence
from dynident.identification.selection.friction.held_out_fields import FrictionSearch
from dynident.identification.selection.friction.parts_by_drive import by_drive, by_unit
from dynident.identification.selection.friction.variable_projection import all_spans, without_optional
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import WHOLE_PART, called

#: Shares of a delay that are compared in a period of the cut-off, a straight line between two of them, and at most.
STRAIGHT, MOST = 20, 12


def search_friction(
    model: DynamicModel,
    logs: Sequence[Prepared],
    progress: Callable[[str], None] = lambda step: None,
    delay_is_free: bool = False,
    finest: Array | None = None,
    shared: SharedRows | None = None,
    after: FrictionSearch | None = None,
) -> FrictionSearch:
    """Return the stated or the best values of the fields that the parts of a model leave to the logs, and why.

    Optional parts that remember are left aside at first. What was found without them is the start where they are tried
    (``after``); where one of them was taken, it stays, and the other parts are chosen anew beside it.

    Args:
        model: With parts whose ``choose`` names non-linear fields, or ``part``.
        logs: Preprocessed logs.
        progress: Called with each step in words.
        delay_is_free: Whether a delay of the torque is free in what is compared.
        finest: Resolution of the positions of each drive, shape (n,), in rad or m; None where it is not known.
        shared: Rows that choices share whose logs differ in their delays alone; None for rows of their own.
        after: What was found for the same model before.

    Raises:
        BadOption: A name in ``choose`` that is no non-linear field of its part, or is in ``vary`` as well.
    """
    pieces = [by_unit(model, part) if set(part.choose or ()) - {WHOLE_PART} else (part,) for part in model.friction]
    model = replace(model, friction=tuple(itertools.chain(*pieces)))
    shared = shared or SharedRows(model.robot, [log.sparser(ROWS) for log in logs])
    logs = shared.under(logs)
    load = shared.load(without_optional(model), logs) if "torque" in model.needs else None
    spans = all_spans(model, logs, "choose", finest)
    turns = [abs(log.delay_s) * (log.how.filter.bandwidth() or log.log.rate / STRAIGHT) for log in logs]
    shares = np.linspace(1.0, 0.0, min(int(np.ceil(STRAIGHT * max(turns) * model.lags)), MOST) + 1)
    for blocks in (BLOCKS, OF_SHORT_LOGS):
        pooled = PooledLogs(model, logs, max(blocks, len(logs)), load, delay_is_free, shares.tolist(), shared)
        search = FrictionSearch(model, pooled, spans, progress)
        if search.tells:
            break
    search.run(after)
    return search


def predicts_better(
    model: DynamicModel, logs: Sequence[Prepared], other: DynamicModel, others: Sequence[Prepared], shared: SharedRows
) -> tuple[bool, tuple[FieldChoice, ...]]:
    """Return whether a model predicts held-out stretches better than another one, and what its parts with a state do.

    Each with the logs under its own delay; ``others`` are the same logs under that of the other one. ``shared`` are the
    rows that choices of the same logs have left.
    """
    found: list[Array] = []
    weights = None
    for each, rows in ((other, others), (model, logs)):
        own = shared.under(rows)
        load = shared.load(each, own) if "torque" in each.needs else None
        pool = PooledLogs(each, own, max(OF_SHORT_LOGS, len(own)), load, shared=shared).pool(each.friction)
        parts = by_drive(each, each.friction, range(len(each.friction)))
        weights = pool.weights(parts) if weights is None else weights
        found += replace(HeldOut.of(pool, parts, [parts], weights), always=np.zeros(1, dtype=bool)).errors()
    gain, error, fastest = evidence(np.subtract(*found))
    told = (WHOLE_PART, 0.0, float(gain > 0), float(gain > NOTHING), gain, error, fastest)
    parts = [part for part in model.friction if part.lags and part.is_optional]
    return gain > NOTHING, tuple(FieldChoice(called(part), part.joints, *told) for part in parts)
