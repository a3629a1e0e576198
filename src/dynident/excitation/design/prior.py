"""What is known of the base parameters before a run, as information, and what the run would add to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.arrays import Array, finite, frozen
from dynident.errors import BadOption
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel

#: An eigenvalue of the information with unit diagonal below this is rounding: nothing is known of its direction.
_UNKNOWN = 1e-12

#: A parameter with more than this share of an unknown direction is unknown itself.
_SHARE = 1e-6


@dataclass(frozen=True)
class Prior:
    """Information before a run: the inverse of a covariance, singular where nothing is known.

    Attributes:
        information: Shape (b, b), symmetric, in one over the square of the parameters' units.
        mean: Values of the base parameters, shape (b,); None where none are known.
        source: Where it comes from, in words.

    Raises:
        BadOption: The information is not symmetric, not finite, or negative in some direction.
    """

    information: Array
    mean: Array | None
    source: str

    def __post_init__(self) -> None:
        size = len(self.information)
        object.__setattr__(self, "information", frozen(self.information, (size, size), "information"))
        if self.mean is not None:
            object.__setattr__(self, "mean", frozen(self.mean, (size,), "mean"))
        found = self.information
        if not np.all(np.isfinite(found)):
            raise BadOption("prior", self.source, "its information holds a number that is not finite")
        if not np.allclose(found, found.T, rtol=1e-6, atol=1e-9 * float(np.abs(found).max(initial=0.0))):
            raise BadOption("prior", self.source, "its information is not symmetric")
        if np.linalg.eigvalsh(_scaled(found)[0])[0] < -1e-6:
            raise BadOption("prior", self.source, "its information is negative in some direction")

    def plus(self, other: Prior) -> Prior:
        """Return what two independent sources know together; the values are those of the first that has some."""
        mean = self.mean if self.mean is not None else other.mean
        return Prior(self.information + other.information, mean, f"{self.source}; {other.source}")

    def triangle(self, rows: float) -> Array:
        """Return E, shape (b, b), with E'E the information per row of a run that gives ``rows`` rows a joint."""
        scaled, size = _scaled(self.information)
        values, vectors = np.linalg.eigh(scaled)
        return np.sqrt(np.maximum(values, 0.0) / rows)[:, None] * vectors.T * size


def prior_of_covariance(covariance: Array, mean: Array | None, source: str) -> Prior:
    """Return what an estimate knows.

    Args:
        covariance: Of the base parameters, shape (b, b).
        mean: Their values, shape (b,).
        source: Name of the estimate, for messages.

    Raises:
        BadOption: The covariance is singular or no covariance.
    """
    symmetric = 0.5 * (covariance + covariance.T)
    deviations = np.sqrt(np.maximum(np.diagonal(symmetric), 0.0))
    if not (np.all(np.isfinite(symmetric)) and np.all(deviations > 0)):
        raise BadOption("prior", source, "its covariance has a variance that is not above 0")
    values, vectors = np.linalg.eigh(symmetric / np.outer(deviations, deviations))
    if not values[0] > np.finfo(float).eps * len(values):
        raise BadOption("prior", source, "its covariance is singular; give the logs themselves as earlier logs")
    return Prior((vectors / values) @ vectors.T / np.outer(deviations, deviations), mean, source)


def prior_of_nominal(model: DynamicModel, base: BaseParameters, share: float) -> Prior:
    """Return what the robot model knows when each of its parameters has a relative standard deviation.

    A parameter that is zero or small counts with the size of its kind on its link: the greatest moment of inertia for
    the inertias, mass times the radius of gyration for the first moments. Friction that is not stated is unknown: it
    is marginalised over, so that combinations with it are unknown as well.

    Args:
        model: Robot, drives and friction.
        base: Its base parameters.
        share: Relative standard deviation, such as 0.5.

    Raises:
        BadOption: The robot model states no inertias.
    """
    theta = model.nominal()
    if theta is None:
        step = "the robot model has no inertias; give an estimate or earlier logs, or deviation=none"
        raise BadOption("deviation", share, step)
    known = np.ones(len(theta), bool)
    known[model.inertial_count :] = theta[model.inertial_count :] != 0
    sizes = np.abs(theta)
    for link in range(model.inertial_count // 10):
        own = slice(10 * link, 10 * link + 10)
        sizes[own] = np.maximum(sizes[own], _sizes(theta[own]))
    known &= sizes > 0
    spread = base.matrix[:, known] * (share * sizes[known])
    norms = np.linalg.norm(spread, axis=1)
    scale = np.where(norms > 0, norms, 1.0)
    open_ = _unit_columns(base.matrix[:, ~known] / scale[:, None])
    left, strengths, _ = np.linalg.svd(open_)
    rest = left[:, np.count_nonzero(strengths > _UNKNOWN) :]
    # Of the combinations that no unknown parameter enters, Q' beta, the covariance is Q' S Q; nothing else is known.
    _, values, directions = np.linalg.svd((rest.T @ (spread / scale[:, None])).T, full_matrices=False)
    inverse = np.where(values > _UNKNOWN * values.max(initial=0.0), 1.0 / np.maximum(values, 1e-300), 0.0)
    factor = rest @ directions.T * inverse / scale[:, None]
    return Prior(factor @ factor.T, base.from_standard(theta), f"nominal model within {100 * share:g} %")


def deviations_of(information: Array) -> Array:
    """Return the standard deviation of each base parameter that an information gives, shape (b,); inf where unknown."""
    scaled, size = _scaled(information)
    values, vectors = np.linalg.eigh(scaled)
    lost = values <= _UNKNOWN * max(float(values[-1]), np.finfo(float).tiny)
    unknown = (np.sum(vectors[:, lost] ** 2, axis=1) > _SHARE) | (np.diagonal(information) <= 0)
    kept = vectors[:, ~lost] / np.sqrt(values[~lost])
    return np.where(unknown, np.inf, np.sqrt(np.sum(kept**2, axis=1)) / size)


@dataclass(frozen=True)
class Outlook:
    """What a run would buy: the standard deviation of every base parameter before and after it.

    Attributes:
        names: Names of the base parameters, b of them.
        units: Their units.
        values: Their values before, shape (b,); None where none are known.
        before: Standard deviations before the run, shape (b,); infinite where nothing is known.
        after: Standard deviations expected after it, shape (b,).
        rows: Rows of each joint that the run gives.
        source: What was known before, in words.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array | None
    before: Array
    after: Array
    rows: float
    source: str

    def __post_init__(self) -> None:
        for name in ("before", "after"):
            object.__setattr__(self, name, frozen(getattr(self, name), (len(self.names),), name))

    def relative(self, deviations: Array) -> Array:
        """Return deviations over absolute values, a fraction, (b,); infinite where no value is known or it is 0."""
        size = np.zeros(len(self.names)) if self.values is None else np.abs(self.values)
        return np.divide(deviations, size, out=np.full(len(size), np.inf), where=size > 0)

    def worst(self, count: int) -> list[int]:
        """Return the positions of the least known parameters after the run, the worst first; by size without values."""
        relative = self.relative(self.after)
        key = relative if self.values is not None else self.after
        return [int(k) for k in np.argsort(-key, kind="stable")[:count]]

    def data(self) -> dict[str, Any]:
        """Return it as plain data; null for what is infinite or not known."""
        values = np.full(len(self.names), np.nan) if self.values is None else self.values
        rows = zip(self.names, self.units, values, self.before, self.after, strict=True)
        parameters = [
            {"name": name, "unit": unit, "value": finite(value), "std_before": finite(old), "std_after": finite(new)}
            for name, unit, value, old, new in rows
        ]
        return {"effective_sample_size": self.rows, "before": self.source, "parameters": parameters}


def outlook_of(
    base: BaseParameters, prior: Prior | None, triangle: Array, rows: float, values: Array | None
) -> Outlook:
    """Return what a run would buy.

    Args:
        base: The base parameters.
        prior: What is known before; None for nothing.
        triangle: R, shape (b, b), with R'R the noise-weighted information of the run per row.
        rows: Rows of each joint that it gives, independent ones.
        values: Values for relative figures where the prior has none, shape (b,).
    """
    before = np.zeros((base.count, base.count)) if prior is None else prior.information
    own = rows * (triangle.T @ triangle)
    mean = values if prior is None or prior.mean is None else prior.mean
    source = "nothing" if prior is None else prior.source
    known = np.full(base.count, np.inf) if prior is None else deviations_of(before)
    return Outlook(base.names, base.units, mean, known, deviations_of(before + own), rows, source)


def _scaled(information: Array) -> tuple[Array, Array]:
    """Return the information with unit diagonal, and the root of its diagonal, shape (b,)."""
    diagonal = np.diagonal(information)
    size = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    return 0.5 * (information + information.T) / np.outer(size, size), size


def _sizes(ten: Array) -> Array:
    """Return the size of each of the ten parameters of a link, for those that are zero or small, shape (10,)."""
    mass, largest = abs(float(ten[9])), float(np.abs(ten[[0, 3, 5]]).max())
    moment = float(np.sqrt(mass * largest))
    return np.array([largest] * 6 + [moment] * 3 + [mass])


def _unit_columns(columns: Array) -> Array:
    """Return columns scaled to unit length, without the empty ones."""
    norms = np.linalg.norm(columns, axis=0)
    return columns[:, norms > 0] / norms[norms > 0]
