"""Distances between pairs of shapes along a motion, with what is certain between its samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array

#: How often an interval that is not certain is cut into four.
_CUTS = 6

#: What stands for a lever arm that is not bounded (a slide without ends): nothing is certain while it moves.
_FAR = 1e9

#: Samples whose distances are computed at a time.
_CHUNK = 4096


class Distances(Protocol):
    """Signed distances of c pairs of shapes in any posture; ``Clearance`` is one."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the pairs, c of them, such as ``link3 | floor``."""
        ...

    @property
    def required(self) -> Array:
        """Distance that each pair must keep, shape (c,), in m."""
        ...

    def distances(self, q: Array) -> Array:
        """Return the distances in postures (N, n), shape (N, c), in m; negative where shapes overlap."""
        ...

    def gradient(self, q: Array, pair: npt.ArrayLike) -> Array:
        """Return the derivative of the distance of ``pair[s]`` in posture s by the joints, shape (S, n)."""
        ...

    def speed_bound(self) -> Array:
        """Return the largest |d distance / d q_i| of each pair in any posture that the limits allow, shape (c, n)."""
        ...


def least_distances(
    distances: Distances,
    positions: Callable[[Array], tuple[Array, Array]],
    time: Array,
    accelerations: Array,
    spare: float = 0.0,
) -> tuple[Array, Array]:
    """Return the distance that each pair is certain to keep over a whole motion, and when it is smallest.

    Between two samples h seconds apart a distance d changes no faster than V = sum_i |d d / d q_i| |dq_i|, so that
    it is at least (d_0 + d_1 - V h) / 2. V takes the larger of the two speeds of a joint and what its largest
    acceleration adds in h / 2. Where that is less than is required, although both samples keep it, the interval is cut
    into four, again and again: the guard then falls with the length of the interval.

    Args:
        distances: The pairs.
        positions: q and dq, (N, n) each, at times (N,).
        time: Times of the first samples, ascending, both ends of the motion included, shape (N,).
        accelerations: Largest accelerations of the motion, shape (n,).
        spare: Distance in m beyond the required one that is wanted.

    Returns:
        Distances (c,) in m, and the times (c,) in s of the smallest samples.
    """
    reach, wanted = distances.speed_bound(), distances.required + spare
    reach = np.where(np.isfinite(reach), reach, _FAR)
    q, dq = positions(time)
    found = _by_chunks(distances, q)
    where = time[np.argmin(found, axis=0)]
    certain = found.min(axis=0)
    starts, ends = time[:-1], time[1:]
    left, right, slow, fast = found[:-1], found[1:], np.abs(dq[:-1]), np.abs(dq[1:])
    for cut in range(_CUTS + 1):
        length = (ends - starts)[:, None]
        speed = (np.maximum(slow, fast) + 0.5 * length * accelerations) @ reach.T
        sure = 0.5 * (left + right - length * speed)
        open_ = np.any((sure < wanted) & (np.minimum(left, right) >= wanted), axis=1)
        settled = ~open_ if cut < _CUTS else np.ones_like(open_)
        certain = np.minimum(certain, np.min(sure[settled], axis=0, initial=np.inf))
        if settled.all():
            break
        grid = np.linspace(starts[~settled], ends[~settled], 5, axis=1)
        q, dq = positions(grid.ravel())
        shape = (*grid.shape, -1)
        near, speeds = _by_chunks(distances, q).reshape(shape), np.abs(dq).reshape(shape)
        starts, ends = grid[:, :-1].ravel(), grid[:, 1:].ravel()
        left, right = (part.reshape(len(starts), -1) for part in (near[:, :-1], near[:, 1:]))
        slow, fast = (part.reshape(len(starts), -1) for part in (speeds[:, :-1], speeds[:, 1:]))
    return certain, where


def _by_chunks(distances: Distances, q: Array) -> Array:
    parts = [distances.distances(q[k : k + _CHUNK]) for k in range(0, len(q), _CHUNK)]
    return np.concatenate(parts)
