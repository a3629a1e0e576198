"""Friction model of a servo by cross-validation: roll-outs of logs that had no part in the fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.linear_start import OFF_S, LinearStart, StartRows, free_parameters, refinable, start_at
from dynident.actuators.output_error import FOLD, ServoProblem, output_error, starts_from
from dynident.actuators.parameters import FRICTION_MODELS, PLACE
from dynident.actuators.rollout import JointRecord, encoder_step, mean_errors
from dynident.arrays import Array, BoolArray, IntArray
from dynident.errors import DynidentError

#: A richer model is taken where it lowers the cross-validation error by this share, and by more than one standard error
#: over the logs (the one-standard-error rule: Hastie, Tibshirani and Friedman 2009, section 7.10). Errors are compared
#: by their ratios log by log, as a fast log has errors many times those of a slow one.
IMPROVES = 0.03

#: A joint whose readings span no more steps of its encoder rests.
_RESTS = 2.0

#: Most folds.
FOLDS = 4

#: Models that are tried; m5 and m6 only where m4 is chosen before them.
_FIRST, _THEN = ("m1", "m2", "m3", "m4"), ("m5", "m6")


def folds_of(records: Sequence[JointRecord]) -> list[np.ndarray]:
    """Return the numbers of the held-out logs of each fold: by position gain where there are several, else by log."""
    gains = np.array([record.kp for record in records])
    distinct = np.unique(gains)
    if 1 < len(distinct):
        groups = [np.flatnonzero(gains == value) for value in distinct]
        while len(groups) > FOLDS:
            groups = [*groups[:-2], np.concatenate(groups[-2:])]
        return groups
    count = len(records)
    return [np.arange(count)[k :: min(FOLDS, count)] for k in range(min(FOLDS, count))] if count > 1 else []


def choose_friction(
    records: Sequence[JointRecord],
    rows: Sequence[StartRows],
    law: DriveLaw,
    scanned: LinearStart,
    off: Array,
    simple: Array,
) -> tuple[str, dict[str, float]]:
    """Return the chosen friction model and the cross-validation error of each that was tried, in rad.

    The errors are geometric means over the logs in which the joint moves: where it rests any friction holds it, and
    no error is that of its friction. Nor do free swings count that are held out from logs with none: these do not tell
    back-EMF from viscous friction. With one such log there is nothing to hold out: m1, and no errors.

    Args:
        records: The joint in the logs.
        rows: What the linear start takes of them.
        law: Its drive law.
        scanned: Where the scan of delay and slew limit ended.
        off: For how long in s the drive is off in motion in each log, shape (logs,).
        simple: Parameters of the fit with m1, shape (COUNT,).
    """
    moving = np.flatnonzero(moves(records))
    folds = []
    for held in folds_of([records[k] for k in moving.tolist()]):
        kept = np.setdiff1d(moving, moving[held])
        counted = moving[held][(off[kept].sum() > OFF_S) | (off[moving[held]] == 0.0)]
        folds += [(kept, counted)] if len(counted) else []
    if not folds:
        return "m1", {}
    errors: dict[str, np.ndarray] = {}
    chosen = "m1"
    for name in (*_FIRST, *_THEN):
        if name in _THEN and chosen not in ("m4", "m5"):
            break
        errors[name] = _held_out_error(name, folds, records, rows, law, scanned, off, simple)
        gain = np.log(errors[chosen]) - np.log(errors[name])
        if np.isfinite(errors[name]).all() and gain.mean() > max(IMPROVES, standard_error(gain)):
            chosen = name
    return chosen, {name: float(np.exp(np.log(each).mean())) for name, each in errors.items()}


def moves(records: Sequence[JointRecord]) -> BoolArray:
    """Return in which logs, (logs,), the joint is told to move, or let go, and does by more than its encoder's step."""
    least, sizes = _RESTS * encoder_step(records), [float(np.ptp(one.q[one.used])) for one in records]
    return np.array([size > least and not one.is_held for one, size in zip(records, sizes, strict=True)])


def standard_error(values: np.ndarray) -> float:
    """Return the standard error of the mean of some values; 0 for a single one."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0


def _held_out_error(
    name: str,
    folds: Sequence[tuple[IntArray, IntArray]],
    records: Sequence[JointRecord],
    rows: Sequence[StartRows],
    law: DriveLaw,
    scanned: LinearStart,
    off: Array,
    simple: Array,
) -> np.ndarray:
    """Return the error in rad of the roll-out of each log that counts, by a fit without its fold, shape (counted,).

    It begins at the linear start or at the fit with m1, but for friction that this lacks: where roll-outs are nearer.
    """
    model, found = FRICTION_MODELS[name], []
    own = np.isin(list(PLACE), [*set(model.free) - set(FRICTION_MODELS["m1"].free), *dict(model.tied)])
    for kept, counted in folds:
        left, has_off = [records[k] for k in kept], bool(off[kept].sum() > OFF_S)
        try:
            linear = start_at([rows[k] for k in kept], law, model, scanned)
            starts = [refinable(one, law, model, has_off) for one in (linear, np.where(own, linear, simple))]
            start = min(starts, key=lambda one: float(np.mean(np.minimum(mean_errors(left, one), np.pi))))
            free = free_parameters(law, model, start, has_off=has_off)
            seeded = starts_from(start, model)[:1]  # at zero the Stribeck terms have no slope to follow
            fit = output_error(ServoProblem(tuple(left), free, model), seeded, effort=FOLD)
        except DynidentError:  # the rest of the logs does not determine this model
            return np.full(sum(len(each) for _, each in folds), np.inf)
        found.append(mean_errors([records[k] for k in counted], fit.parameters))
    return np.concatenate(found)
