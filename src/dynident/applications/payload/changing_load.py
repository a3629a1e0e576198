"""A payload that is not there all along: the loads of parts of the logs, beside the one that is found of all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynident.arrays import Array

#: Parts of each log that are compared.
_PARTS = 16

#: Standard deviation of the load of a part, as a share of the load, from which the part does not count.
_TOO_VAGUE = 0.25

#: Difference between two parts as a share of the load from which it is one: a load that is put down makes at least the
#: whole of what is found; and in standard deviations.
_LEAST, _CERTAIN = 0.75, 6.0


def load_of_parts(
    mass: float, carried: Sequence[Array], left: Sequence[Array], weights: Array
) -> tuple[float, float] | None:
    """Return the least and the largest load of parts of some logs, where these differ by as much as a load put down.

    Of each part the share of the torque of the payload is found that the residual has beside it, by weighted least
    squares; with all other parameters as found of all logs.

    Args:
        mass: Mass of the payload of all logs, in kg.
        carried: Torque of that payload along each log, shape (N, n), in N m or N; 0 where a row does not count.
        left: What is left of the torques with it, shape (N, n).
        weights: One over the standard deviation of independent rows of each joint, shape (n,).

    Returns:
        Both in kg, below 0 as noise has it; None where the load may be one.
    """
    parts = [
        (torque[part], rest[part])
        for torque, rest in zip(carried, left, strict=True)
        for part in np.array_split(np.arange(len(torque)), _PARTS)
    ]
    shares, _ = _shares(parts, weights)
    before = sum(np.sum(rest**2, axis=0) for _, rest in parts)
    after = sum(np.sum((rest - k * own) ** 2, axis=0) for k, (own, rest) in zip(shares, parts, strict=True))
    # what the change itself has left is no noise
    shares, deviations = _shares(parts, weights * np.sqrt(before / np.maximum(after, 1e-6 * before + 1e-300)))
    counts = np.flatnonzero(deviations < _TOO_VAGUE)
    if len(counts) < 2 or mass <= 0:
        return None
    low, high = counts[np.argmin(shares[counts])], counts[np.argmax(shares[counts])]
    apart, deviation = shares[high] - shares[low], np.hypot(deviations[low], deviations[high])
    loads = (mass * (1.0 + float(shares[low])), mass * (1.0 + float(shares[high])))
    return loads if apart > max(_LEAST, _CERTAIN * deviation) else None


def _shares(parts: Sequence[tuple[Array, Array]], weights: Array) -> tuple[Array, Array]:
    """Return the share of the payload that each part has beside it, and its standard deviation."""
    sizes = np.array([np.sum((weights * own) ** 2) for own, _ in parts])
    sizes = np.maximum(sizes, 1e-300)
    return np.array([np.sum(weights**2 * own * rest) for own, rest in parts]) / sizes, 1.0 / np.sqrt(sizes)
