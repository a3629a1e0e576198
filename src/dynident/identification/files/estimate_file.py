"""The estimate file: versioned JSON with everything that validation, reports and exports need; no pickle."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array, finite, frozen, plain
from dynident.errors import DynidentError, EstimateFormatError
from dynident.files import DAMAGE, read_json, write_atomically
from dynident.identification.consistency.labels import labels_of
from dynident.identification.estimate.envelope import Envelope
from dynident.identification.estimate.estimate import Consistency, Estimate
from dynident.identification.estimate.plausibility import Plausibility
from dynident.identification.estimate.validation import Fit, NominalErrors, Validation
from dynident.identification.files.estimate_versions import VERSIONS
from dynident.identification.files.saved_values import (
    columns_from_dict,
    model_from_dict,
    model_to_dict,
    preprocessing_from_dict,
    preprocessing_to_dict,
)
from dynident.identification.problem.choices import CHOICES, choices_of
from dynident.identification.problem.method_run import recorded_run
from dynident.identification.uncertainty.propagation import mass_matrix
from dynident.model.base_parameters import base_parameters

KIND = "dynident estimate"

_SIGNALS = ("time", "q", "dq", "measured", "unfiltered", "predicted")

#: Rows of the training signals that the file keeps for the report; figures are over all rows.
KEPT_ROWS = 2000


def summary(estimate: Estimate, test: Validation | None = None, warnings: Sequence[str] = ()) -> dict[str, Any]:
    """Return what ``--json`` prints: documented plain data, relative figures as fractions.

    Args:
        estimate: The estimate.
        test: Its figures on data that had no part in the fit.
        warnings: What does not look right about it, for people to check.
    """
    return {
        "robot": estimate.model.robot.name,
        "estimator": estimate.estimator,
        "options": plain(estimate.options),
        "samples": estimate.samples,
        "condition_number": finite(estimate.condition_number),
        "inertial_base_parameters": estimate.inertial_base_parameters,
        "base_parameters": estimate.base.count,
        "parameters": estimate.parameters(),
        "degrees_of_freedom": None if estimate.degrees is None else plain(estimate.degrees),
        "standard_parameters": None if estimate.theta is None else _standard(estimate, estimate.theta),
        "mass_matrix": _mass_matrix(estimate),
        "physically_consistent": estimate.consistency.consistent,
        "inconsistencies": list(estimate.consistency.reasons),
        "warnings": list(warnings),
        "smallest_inertia_eigenvalue": finite(estimate.consistency.smallest_inertia),
        "residual_std": estimate.joint_deviations.tolist(),
        "correlation_factors": estimate.correlation_factors.tolist(),
        "train": estimate.train.figures(),
        "test": None if test is None else test.figures(),
        "extrapolation": None if test is None or test.departure is None else test.departure.figures(),
        "diagnostics": None if estimate.diagnostics is None else plain(estimate.diagnostics),
        "filter": plain(estimate.train.filter),
        "extras": plain({**estimate.run.data(), **estimate.choices.data()}),
    }


def _standard(estimate: Estimate, theta: Array) -> list[dict[str, Any]]:
    count = len(estimate.model.parameters)
    known = [None] * count if estimate.standard_deviations is None else plain(estimate.standard_deviations)
    ranges = plain(getattr(Plausibility.of(estimate.run), "ranges", ())) or [None] * count
    return [
        {
            "name": parameter.name,
            "value": float(value),
            "std": std,
            "unit": parameter.unit,
            "verdict": verdict,
            "label": label.word,
            "data_share": label.data_share,
            "range": span,
        }
        for parameter, value, std, verdict, label, span in zip(
            estimate.model.parameters, theta, known, estimate.base.verdicts, labels_of(estimate), ranges, strict=True
        )
    ]


def _mass_matrix(estimate: Estimate) -> dict[str, Any]:
    """Return the mass matrix in the middle of the motion of the fit as plain data."""
    value, deviations = mass_matrix(estimate, estimate.middle)
    return {"q": estimate.middle.tolist(), "value": value.tolist(), "std": deviations.tolist()}


def write_estimate(
    estimate: Estimate, path: str | Path, warnings: Sequence[str] = (), test: Validation | None = None
) -> None:
    """Write an estimate as JSON; the old file or the new one is there, never half of one.

    Args:
        estimate: The estimate.
        path: The file.
        warnings: What does not look right about it, for people who read the file.
        test: Its figures on data that had no part in the fit, for those who read the summary.

    Raises:
        FileError: The file cannot be written.
    """
    train = estimate.train
    rows = np.linspace(0, len(train.time) - 1, min(KEPT_ROWS, len(train.time))).round().astype(int)
    data = {
        "kind": KIND,
        "format": VERSIONS.current,
        "summary": summary(estimate, test, warnings),
        **plain(model_to_dict(estimate.model)),
        "preprocessing": plain(preprocessing_to_dict(estimate.preprocessing)),
        "columns": plain(asdict(estimate.columns)),
        "beta": estimate.beta.tolist(),
        "covariance": estimate.covariance.tolist(),
        "theta": None if estimate.theta is None else estimate.theta.tolist(),
        "envelope": None if estimate.envelope is None else plain(estimate.envelope.figures()),
        "train": {
            "filter": plain(train.filter),
            "standstill": train.standstill,
            "logs": list(train.logs),
            "samples": train.samples,
            "joints": [plain(asdict(fit)) for fit in train.joints],
            "moving": [plain(asdict(fit)) for fit in train.moving],
            "total_relative_error": finite(train.total_relative_error),
            "starts": np.searchsorted(rows, train.starts).tolist(),
            "signals": {
                name: _rounded(np.asarray(getattr(train, name))[rows], 15 if name == "time" else 7) for name in _SIGNALS
            },
            "torque_std": None if train.deviations is None else _rounded(np.asarray(train.deviations)[rows]),
            "nominal": None if train.nominal is None else train.nominal.figures(),
            "at_rest": plain(train.at_rest),
            "held": None if train.held is None else [_rounded(np.asarray(side)[rows]) for side in train.held],
        },
        "provenance": plain(estimate.provenance),
    }
    write_atomically(path, json.dumps(data, allow_nan=False) + "\n")


def read_estimate(path: str | Path) -> Estimate:
    """Read an estimate file.

    Raises:
        FileError: The file cannot be read.
        EstimateFormatError: It is no estimate, damaged, or of another format.
    """
    step = "give a file that 'dynident identify -o' has written"
    if str(path).lower().endswith((".yaml", ".yml")):
        step = f"a case file is identified first: dynident identify {path} -o ESTIMATE.json"
    data = read_json(path, step, EstimateFormatError)
    if not isinstance(data, dict) or data.get("kind") != KIND:
        raise EstimateFormatError(path, "no estimate", step)
    try:
        data = VERSIONS.migrated(data, lambda evidence, step: EstimateFormatError(path, evidence, step))
        return _estimate(data, path)
    except EstimateFormatError:
        raise
    except DAMAGE as error:
        raise EstimateFormatError(path, f"damaged ({type(error).__name__}: {error})", "identify again") from error
    except DynidentError as error:
        raise EstimateFormatError(path, str(error), "identify again") from error


def _estimate(data: Mapping[str, Any], path: str | Path) -> Estimate:
    model = model_from_dict(data, path)
    facts, train = data["summary"], data["train"]
    joints, theta, rows = model.robot.dof, data["theta"], len(train["signals"]["time"])
    signals: dict[str, Any] = {
        name: _array(train["signals"][name], (rows,) if name == "time" else (rows, joints), name) for name in _SIGNALS
    }
    held = [_array(side, (rows, joints), "held") for side in train.get("held") or ()]
    validation = Validation(
        joints=tuple(Fit(**_with_nan(fit)) for fit in train["joints"]),
        moving=tuple(Fit(**_with_nan(fit)) for fit in train["moving"]),
        total_relative_error=_with_nan(train)["total_relative_error"],
        samples=train["samples"],
        standstill=train["standstill"],
        filter=train["filter"],
        logs=tuple(train["logs"]),
        starts=tuple(train["starts"]),
        **signals,
        deviations=_optional(train.get("torque_std"), (rows, joints), "torque_std"),
        noise=_array(facts["residual_std"], (joints,), "residual_std"),
        nominal=_nominal(train.get("nominal"), joints),
        at_rest=tuple(train.get("at_rest", ())),
        held=(held[0], held[1]) if held else None,
    )
    how, columns = preprocessing_from_dict(data["preprocessing"]), columns_from_dict(data["columns"])
    envelope = _envelope(data, joints)
    base = base_parameters(model)  # takes longer than all the rest
    return Estimate(
        model=model,
        base=base,
        beta=_array(data["beta"], (base.count,), "beta"),
        covariance=_array(data["covariance"], (base.count, base.count), "covariance"),
        theta=None if theta is None else _array(theta, (len(model.parameters),), "theta"),
        joint_deviations=_array(facts["residual_std"], (joints,), "residual_std"),
        correlation_factors=_array(facts["correlation_factors"], (joints,), "correlation_factors"),
        condition_number=float("inf") if facts["condition_number"] is None else facts["condition_number"],
        samples=facts["samples"],
        inertial_base_parameters=facts["inertial_base_parameters"],
        estimator=facts["estimator"],
        options=facts["options"],
        consistency=Consistency(
            facts["physically_consistent"], tuple(facts["inconsistencies"]), facts["smallest_inertia_eigenvalue"]
        ),
        train=validation,
        preprocessing=how,
        columns=columns,
        run=recorded_run({name: value for name, value in facts["extras"].items() if name not in CHOICES}),
        choices=choices_of(facts["extras"]),
        provenance=data["provenance"],
        file=str(path),
        degrees=_degrees(facts, base.count),
        envelope=envelope,
        diagnostics=facts.get("diagnostics"),
        standard_deviations=_optional(_stds(facts), (len(model.parameters),), "standard deviations"),
    )


def _nominal(found: Mapping[str, Any] | None, joints: int) -> NominalErrors | None:
    """Return the errors of the nominal inertias; None where the file states none."""
    if found is None:
        return None
    fitted, bare = (_with_none(found[f"joints_{key}"], joints) for key in ("friction_fitted", "nothing_fitted"))
    friction = {item["name"]: float(item["value"]) for item in found["friction"]}
    totals = _with_nan({key: found[key] for key in ("friction_fitted", "nothing_fitted")})
    return NominalErrors(totals["friction_fitted"], totals["nothing_fitted"], fitted, bare, friction)


def _with_none(values: Sequence[float | None], count: int) -> tuple[float, ...]:
    """Return numbers with NaN where the file has null."""
    return tuple(frozen([np.nan if value is None else value for value in values], (count,), "nominal").tolist())


def _degrees(facts: Mapping[str, Any], size: int) -> Array | None:
    """Return the degrees of freedom; null stands for a variance that is known."""
    found = facts.get("degrees_of_freedom")
    if found is None:
        return None
    return frozen([np.inf if value is None else value for value in found], (size,), "degrees_of_freedom")


def _envelope(data: Mapping[str, Any], joints: int) -> Envelope | None:
    found = data.get("envelope")
    if found is None:
        return None
    seen = (len(found["low"]), joints)
    shapes = {"low": seen, "high": seen, "mean": (3 * joints,), "whitener": (3 * joints, 3 * joints)}
    arrays = {name: _array(found[name], shape, name) for name, shape in shapes.items()}
    return Envelope(**arrays, furthest=float(found["furthest"]), bands=_array(found["bands"], (joints,), "bands"))


def _rounded(values: Array, digits: int = 7) -> Any:
    """Return signals as lists of few significant digits, enough to draw; stamps of the system clock need more."""
    with np.errstate(divide="ignore"):
        power = digits - 1 - np.floor(np.log10(np.abs(values)))
    power = np.clip(np.where(np.isfinite(power), power, 0.0), -300.0, 300.0)
    scale = 10.0 ** np.abs(power)
    return np.where(power < 0, np.rint(values / scale) * scale, np.rint(values * scale) / scale).tolist()


def _array(values: Any, shape: tuple[int, ...], name: str) -> Array:
    array = frozen(values, shape, name)
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name} holds a value that is not finite")
    return array


def _optional(values: Any, shape: tuple[int, ...], name: str) -> Array | None:
    return None if values is None else _array(values, shape, name)


def _stds(facts: Mapping[str, Any]) -> list[float] | None:
    """Return the deviations of the standard parameters; None where the file states none."""
    found = [item.get("std") for item in facts.get("standard_parameters") or ()]
    return None if not found or None in found else found


def _with_nan(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Return figures with NaN where the file has null."""
    return {name: float("nan") if value is None else value for name, value in figures.items()}
