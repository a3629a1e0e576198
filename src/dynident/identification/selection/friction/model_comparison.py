"""Two models of friction, each with a delay of the torque of its own, compared on held-out stretches of the logs."""

from __future__ import annotations

from collections.abc import Sequence

from dynident.arrays import Array
from dynident.data.preprocessing import Prepared
from dynident.identification.problem.choices import FieldChoice
from dynident.identification.selection.friction.column_pool import PooledLogs, SharedRows
from dynident.identification.selection.friction.held_out_errors import NOTHING, HeldOut, share_of
from dynident.identification.selection.friction.held_out_fields import OF_SHORT_LOGS
from dynident.identification.selection.friction.parts_by_drive import by_drive
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import WHOLE, called


def predicts_better(
    model: DynamicModel,
    logs: Sequence[Prepared],
    other: DynamicModel,
    others: Sequence[Prepared],
    shared: SharedRows,
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
        found += HeldOut.of(pool, parts, [parts], weights).errors(fastest=False)
    gain, error = share_of(found[0] - found[1])
    better = gain > NOTHING
    told = (WHOLE, 0.0, float(gain > 0), float(better), gain, error)
    parts = [part for part in model.friction if part.lags and part.is_optional]
    return better, tuple(FieldChoice(called(part), part.joints, *told) for part in parts)
