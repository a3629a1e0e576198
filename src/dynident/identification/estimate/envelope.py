"""What the logs of a fit have seen, and whether another log leaves it: a model is only tried where it was fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.model.reduction import Triangle

QUANTITIES = ("position", "velocity", "acceleration", "temperature")

#: How far beyond the range of the fit a joint may go, as a share of that range.
BEYOND = 0.15

#: Range of temperatures, in K, that one of a fit counts as at least: friction changes by a percent or two in each.
LEAST_WARMTH = 10.0

#: Share of rows outside that is more than a few peaks.
SEVERAL = 0.01

#: Share of the spread of a state that a direction must have to count; less is rounding.
_FLAT = 1e-6

#: Excess over a range, as a share of it, that is rounding: the same log filtered on another processor.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Envelope:
    """Where the rows of a fit lie.

    Attributes:
        low: Smallest position, velocity and acceleration of each joint, and temperature, if logged, shape (3 or 4, n).
        high: Largest, of the same shape.
        mean: Of all states [q, dq, ddq], shape (3 n,).
        whitener: Turns a state less the mean into one of unit covariance, shape (3 n, 3 n).
        furthest: Largest Mahalanobis distance of a row of the fit.
        bands: Torque that the parameters' covariance leaves open, root mean square of each joint, shape (n,).
    """

    low: Array
    high: Array
    mean: Array
    whitener: Array
    furthest: float
    bands: Array

    def figures(self) -> dict[str, Any]:
        """Return the same as plain data."""
        return {name: np.asarray(getattr(self, name)).tolist() for name in self.__dataclass_fields__}


@dataclass(frozen=True)
class Departure:
    """How a log lies to an envelope.

    Attributes:
        joints: Names.
        low: Smallest position, velocity and acceleration of each joint in the log, and temperature, shape (3 or 4, n).
        high: Largest, of the same shape.
        beyond: How far each goes beyond the fit, as a share of its range there, of the same shape; 0 inside.
        outside: Share of the rows in which it does, of the same shape.
        far: Share of the rows further from the mean of the fit than any row of the fit, in the Mahalanobis sense.
        bands: Torque that the parameters' covariance leaves open along the log, root mean square, shape (n,).
        growth: The same squared over that of the fit: the ratio of predicted variances, shape (n,).
    """

    joints: tuple[str, ...]
    low: Array
    high: Array
    beyond: Array
    outside: Array
    far: float
    bands: Array
    growth: Array

    def leaves(self) -> bool:
        """Return whether the log leaves the envelope by more than a few peaks."""
        return bool(np.any((self.beyond > BEYOND) & (self.outside > SEVERAL)))

    def sentence(self, envelope: Envelope) -> str:
        """Return the departure in words with its numbers; empty where the log stays inside."""
        if not self.leaves():
            return ""
        parts = []
        for k, name in enumerate(QUANTITIES[: len(self.low)]):
            left = np.flatnonzero((self.beyond[k] > BEYOND) & (self.outside[k] > SEVERAL))
            if len(left):
                worst = left[np.argmax(self.beyond[k, left])]
                ours = f"{self.low[k, worst]:.3g} to {self.high[k, worst]:.3g}"
                seen = f"{envelope.low[k, worst]:.3g} to {envelope.high[k, worst]:.3g}"
                count = f"{len(left)} joint{'s' if len(left) > 1 else ''}"
                parts.append(f"{name} of {count} ({self.joints[worst]} {ours}, in training {seen})")
        top = int(np.argmax(self.growth))
        growth = f"the predicted torque of {self.joints[top]} has {self.growth[top]:.2g} times the training variance"
        warm = " and temperatures" if "temperature" in "".join(parts) else ""
        advice = f"the test error does not hold for the training motions; include such motions{warm} in identification"
        return f"extrapolation beyond the training range: {'; '.join(parts)}; {growth}: {advice}"

    def figures(self) -> dict[str, Any]:
        """Return the departure as plain data, fractions for shares."""
        rows = [
            {
                "name": name,
                **{
                    quantity: {
                        "low": float(self.low[k, i]),
                        "high": float(self.high[k, i]),
                        "beyond": float(self.beyond[k, i]),
                        "outside": float(self.outside[k, i]),
                    }
                    for k, quantity in enumerate(QUANTITIES[: len(self.low)])
                },
                "torque_band": float(self.bands[i]),
                "variance_growth": float(self.growth[i]) if np.isfinite(self.growth[i]) else None,
            }
            for i, name in enumerate(self.joints)
        ]
        return {"beyond_training_range": self.leaves(), "outside": self.far, "joints": rows}


def envelope_of(logs: Sequence[Log], triangles: Sequence[Triangle], covariance: Array) -> Envelope:
    """Return the envelope of a fit.

    Args:
        logs: Its rows, with q, dq and ddq, and temperatures where there are some.
        triangles: Its rows, joint by joint, unweighted.
        covariance: Of its base parameters, shape (b, b).
    """
    states = _states(logs)
    flat = states[:3].transpose(1, 0, 2).reshape(states.shape[1], -1)
    mean = flat.mean(axis=0)
    size = np.maximum(flat.std(axis=0), 1e-300)
    scaled = (flat - mean) / size
    values, vectors = np.linalg.eigh(scaled.T @ scaled / len(flat))
    kept = values > _FLAT * values[-1]
    inverse = np.where(kept, 1.0 / np.sqrt(np.where(kept, values, 1.0)), 0.0)
    whitener = (vectors * inverse) / size[:, None]
    furthest = float(np.max(np.linalg.norm((flat - mean) @ whitener, axis=1)))
    bands = torque_bands(triangles, covariance)
    return Envelope(states.min(axis=1), states.max(axis=1), mean, whitener, furthest, bands)


def departure_of(
    envelope: Envelope, logs: Sequence[Log], triangles: Sequence[Triangle], covariance: Array
) -> Departure:
    """Return how logs lie to an envelope; arguments as of :func:`envelope_of`."""
    states = _states(logs)[: len(envelope.low)]
    low, high = envelope.low[: len(states), None], envelope.high[: len(states), None]
    span = np.maximum((high - low)[:, 0], np.array([1e-12, 1e-12, 1e-12, LEAST_WARMTH])[: len(states), None])
    over = np.maximum(states - high, low - states)
    over = np.where(over > _ROUNDING * span[:, None], over, 0.0)
    flat = states[:3].transpose(1, 0, 2).reshape(states.shape[1], -1)
    distance = np.linalg.norm((flat - envelope.mean) @ envelope.whitener, axis=1)
    bands = torque_bands(triangles, covariance)
    growth = np.divide(bands, envelope.bands, out=np.full(len(bands), np.nan), where=envelope.bands > 0) ** 2
    return Departure(
        joints=logs[0].joints,
        low=states.min(axis=1),
        high=states.max(axis=1),
        beyond=over.max(axis=1) / span,
        outside=np.mean(over > 0, axis=1),
        far=float(np.mean(distance > (1.0 + _ROUNDING) * envelope.furthest)),
        bands=bands,
        growth=growth,
    )


def torque_bands(triangles: Sequence[Triangle], covariance: Array) -> Array:
    """Return sqrt(mean w' C w) over the rows w of each joint, shape (n,): what C leaves open of its torque."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    squares = [np.sum((t.factor[:, :-1] @ root[t.columns]) ** 2) / max(t.rows, 1) for t in triangles]
    return np.sqrt(np.array(squares))


def _states(logs: Sequence[Log]) -> Array:
    """Return positions, velocities, accelerations, and temperatures where all logs have them, shape (3 or 4, N, n)."""
    names = ("q", "dq", "ddq", *["temperature"] * all(log.temperature is not None for log in logs))
    return np.concatenate([np.stack([np.asarray(getattr(log, name)) for name in names]) for log in logs], axis=1)
