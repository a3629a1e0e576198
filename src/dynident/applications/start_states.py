"""How warm drives are at the start of a log: what no log states, and what lasts for minutes.

A log that begins in the middle of a recording goes on from the samples before it. Any other one is taken to begin cold,
as those of the fit: of a log with torques the states that explain these best are found (the initial states of a
comparison of a dynamic model with data: Ljung 1999, section 16.6), and of any log it is known what they matter.
States that a motion forgets at its reversals are no part of it: samples before are not counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dynident.applications.compensation import parameters_of
from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, preprocess
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.problem.problem import counting_rows
from dynident.identification.problem.regressor_stream import RegressorStream, remembered_motion
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction, called
from dynident.model.friction.base import State

#: Share of the squared residual that states at the start have to take off: fewer may be noise, or another fault.
LEAST = 0.05


def lasting_states(model: DynamicModel) -> dict[int, tuple[Friction, State]]:
    """Return the states that last for minutes, by their place among all, each with its part."""
    each = [(part, state) for part in model.friction for state in part.states]
    return {k: own for k, own in enumerate(each) if not own[0].lags}


def with_starts(
    estimate: Estimate, logs: Sequence[Prepared]
) -> tuple[tuple[Prepared, ...], tuple[dict[str, Any], ...]]:
    """Return logs with the states at their start that explain their torques best, and these states as plain data.

    Logs that go on from samples before them stay as they are.

    Args:
        estimate: The estimate.
        logs: Logs as they were prepared for it.
    """
    if not lasting_states(estimate.model):
        return tuple(logs), ()
    found, told = list[Prepared](), list[dict[str, Any]]()
    for log in logs:
        if log.log.before is not None or log.log.torque is None:
            found.append(log)
            continue
        first, share = _first_states(estimate, log)
        found.append(replace(log, log=replace(log.log, before=first)) if share >= LEAST else log)
        told += _told(estimate.model, log, first if share >= LEAST else np.zeros_like(first), share)
    return tuple(found), tuple(told)


def with_warm_starts(estimate: Estimate, logs: Sequence[Log]) -> Estimate:
    """Return the estimate with the states of training logs (raw) that say that their drives did not begin cold."""
    if not lasting_states(estimate.model):
        return estimate
    names = estimate.model.robot.joint_names
    _, told = with_starts(estimate, [preprocess(log.ordered(names), estimate.preprocessing) for log in logs])
    warm = tuple(each for each in told if each["share"] >= LEAST)
    return replace(estimate, train=replace(estimate.train, start_states=warm)) if warm else estimate


def first_states(estimate: Estimate, log: Log) -> Array | None:
    """Return the states of friction at the first sample of a raw log, shape (n, s); None for their start."""
    if not lasting_states(estimate.model):
        return None
    ((found,), _) = with_starts(estimate, [preprocess(log, estimate.preprocessing)])
    first = found.log.before
    return np.asarray(remembered_motion(estimate.model, first).state)[-1] if isinstance(first, Log) else first


def changes_by(estimate: Estimate, prepared: Prepared) -> dict[int, Array]:
    """Return what each lasting state changes at the drives if it is 1 higher at the start, (N, n) over the kept rows.

    It is filtered as the measured torque is.
    """
    model, theta = estimate.model, parameters_of(estimate)
    motion = model.loaded(remembered_motion(model, prepared.log), theta)
    table, found = model.coefficient_table(theta), dict[int, Array]()
    own = model.friction_values(motion)
    for k in lasting_states(model):
        first = np.array(np.asarray(motion.state)[0])
        first[:, k] += 1.0
        changed = remembered_motion(model, replace(prepared.log, before=first))
        values = model.friction_values(replace(motion, state=changed.state)) - own
        found[k] = prepared.smooth(np.einsum("sjk,jk->js", values, table)).T[prepared.keep]
    return found


def warmed_torque(estimate: Estimate, prepared: Prepared) -> Array:
    """Return by how much torques change at most where drives begin as warm as a motion leaves them, shape (n,)."""
    model, change = estimate.model, np.zeros((len(prepared.keep), estimate.model.robot.dof))
    if lasting_states(model):
        states = np.asarray(remembered_motion(model, prepared.log).state)
        for k, own in changes_by(estimate, prepared).items():
            change += own * (states[-1, :, k] - states[0, :, k])
    return np.abs(change @ np.asarray(model.robot.coupling)).max(axis=0)


def _first_states(estimate: Estimate, prepared: Prepared) -> tuple[Array, float]:
    """Return the states at the start that explain the torques best, (n, s), and which share of the square they take."""
    model, log, smooth = estimate.model, prepared.log, prepared.smooth
    torque = smooth(RegressorStream(model, estimate.base).predict(log, estimate.beta).T).T
    weight = counting_rows(model, prepared) / np.asarray(estimate.joint_deviations)
    error = ((np.asarray(log.torque) - torque)[prepared.keep] * weight).ravel()
    coupling, first = np.asarray(model.robot.coupling), np.array(np.asarray(remembered_motion(model, log).state)[0])
    places, columns = list[tuple[int, int]](), list[Array]()
    for k, change in changes_by(estimate, prepared).items():
        places += [(j, k) for j in range(model.robot.dof)]
        columns += [(change[:, j, None] * coupling[j] * weight).ravel() for j in range(model.robot.dof)]
    least = np.array([lasting_states(model)[k][1].low - first[j, k] for j, k in places])
    matrix = np.stack(columns, axis=1)
    free = np.any(matrix != 0, axis=0)
    while True:  # no drive is colder than cold
        step = least.copy()
        step[free] = np.linalg.lstsq(matrix[:, free], error - matrix[:, ~free] @ step[~free])[0]
        if not (below := free & (step < least)).any():
            break
        free &= ~below
    for (j, k), by in zip(places, step.tolist(), strict=True):
        first[j, k] += by
    left = error - matrix @ step
    return first, 1.0 - float(left @ left) / max(float(error @ error), 1e-300)


def _told(model: DynamicModel, prepared: Prepared, first: Array, share: float) -> list[dict[str, Any]]:
    """Return the states at the start of a log as plain data, with what they take off its squared residual."""
    joints = zip(model.robot.joint_names, model.robot.active, strict=True)
    kinds = [(name, joint.kind) for name, joint in joints]
    return [
        {
            "log": prepared.log.name,
            "part": called(part),
            "joint": name,
            "state": state.symbol,
            "value": float(first[j, k]),
            "unit": state.unit if kind == "revolute" else state.linear_unit,
            "share": share,
        }
        for k, (part, state) in lasting_states(model).items()
        for j, (name, kind) in enumerate(kinds)
    ]
