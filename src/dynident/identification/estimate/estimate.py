"""Estimate: values, covariance, verdicts and provenance of one identification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.data.formats import ColumnMap
from dynident.data.preprocessing import Preprocessing
from dynident.identification.estimate.envelope import Envelope
from dynident.identification.estimate.validation import Validation
from dynident.identification.problem.choices import Choices
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.residuals.quantiles import student_quantile
from dynident.methods import EstimateMethods
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel


@dataclass(frozen=True)
class Consistency:
    """Whether a possible robot stands behind the estimate.

    Attributes:
        consistent: All links possible, friction and rotor inertia >= 0, and M(q) > 0 on random states. For base
            parameters only: some such standard parameters have exactly these base parameters.
        reasons: What breaks it, in words; empty where consistent.
        smallest_inertia: Smallest eigenvalue of M(q) over the random states, in kg m^2 (or kg).
    """

    consistent: bool
    reasons: tuple[str, ...]
    smallest_inertia: float


@dataclass(frozen=True, repr=False)
class Estimate(EstimateMethods):
    """The result of an identification; it exists only when it is whole.

    Attributes:
        model: The model whose parameters were identified.
        base: Its base parameters.
        beta: Their values, shape (b,).
        covariance: Their covariance, shape (b, b).
        theta: Standard parameters behind beta, shape (p,); None where the estimator found base parameters only.
        joint_deviations: Residual standard deviation of each joint in the fit, shape (n,).
        correlation_factors: By how much the variance of each joint is larger than for independent rows, shape (n,).
        condition_number: Of the weighted observation matrix with unit columns.
        samples: Time samples used.
        inertial_base_parameters: Number of base parameters without friction, offset and rotor inertia.
        estimator: Name of the method.
        options: Its options.
        consistency: Whether a possible robot stands behind it.
        train: Figures on the data of the fit.
        preprocessing: How logs were and will be prepared.
        columns: How its logs were read.
        run: What the method states of its run: convergence trace, gap to the optimum.
        choices: What was chosen on the way: cut-off, delays, friction; what is known of gains and cut-offs.
        provenance: Versions, files with hashes, case, command.
        degrees: Degrees of freedom of each stated variance, for quantiles of Student's t, shape (b,); None where the
            method has a covariance of its own.
        envelope: What the logs of the fit have seen; None in files of older versions.
        diagnostics: Tests of the residual and cross-validation; None where they were not asked for.
        standard_deviations: Of theta by data and prior together, shape (p,); None where they were not asked for.
        file: The file that it was read from; empty for none.
    """

    model: DynamicModel
    base: BaseParameters
    beta: Array
    covariance: Array
    theta: Array | None
    joint_deviations: Array
    correlation_factors: Array
    condition_number: float
    samples: int
    inertial_base_parameters: int
    estimator: str
    options: Mapping[str, Any]
    consistency: Consistency
    train: Validation
    preprocessing: Preprocessing
    columns: ColumnMap = field(default_factory=ColumnMap)
    run: MethodRun = field(default_factory=MethodRun)
    choices: Choices = field(default_factory=Choices)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    degrees: Array | None = None
    envelope: Envelope | None = None
    diagnostics: Mapping[str, Any] | None = None
    standard_deviations: Array | None = None
    file: str = ""

    @property
    def std(self) -> Array:
        """Standard deviation of each base parameter, shape (b,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def middle(self) -> Array:
        """Mean position of the rows of the fit, shape (n,), in rad or m; zero where no row is known."""
        if self.envelope is not None:
            return np.asarray(self.envelope.mean)[: self.model.robot.dof]
        return np.mean(self.train.q, axis=0) if len(self.train.q) else np.zeros(self.model.robot.dof)

    @property
    def relative_std(self) -> Array:
        """Standard deviation over absolute value, a fraction, shape (b,); infinite for a value of zero."""
        size = np.abs(self.beta)
        return np.divide(self.std, size, out=np.full(len(size), np.inf), where=size > 0)

    def half_widths(self, level: float = 0.95) -> Array:
        """Return half the width of the interval that holds each base parameter at a level of confidence, shape (b,)."""
        degrees = np.full(len(self.beta), np.inf) if self.degrees is None else self.degrees
        return self.std * student_quantile(0.5 + 0.5 * level, degrees)

    def parameters(self) -> list[dict[str, Any]]:
        """Return name, value, unit, std and relative_std of each base parameter as plain data."""
        return [
            {
                "name": name,
                "value": float(value),
                "unit": unit,
                "std": float(std),
                "relative_std": float(relative) if np.isfinite(relative) else None,
            }
            for name, value, unit, std, relative in zip(
                self.base.names, self.beta, self.base.units, self.std, self.relative_std, strict=True
            )
        ]
