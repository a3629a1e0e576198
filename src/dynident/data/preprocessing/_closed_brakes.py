"""Spells of a log with closed brakes: all joints stand still, and no drive holds the arm."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log

#: Length in s of the windows whose means are taken, and of the shortest spell.
WINDOW_S, SHORTEST_S = 0.25, 0.5

#: Speed in rad/s or m/s below which a joint stands still.
STILL = 0.02

#: Share of a torque's root mean square up to which its mean is none, or else one standard deviation of it there; and
#: share up to which its samples are at one joint at least: noise may hide a torque.
NONE, SILENT = 0.02, 0.05

#: Deviations of the noise of a spell beyond which a sample is not of it.
FAR = 4.0

#: Share of a log from which on it is no pause of it.
MOST = 0.8


def closed_brakes(log: Log) -> Array:
    """Return the start and end in s of each spell in which all joints stand still and all torques are none, (k, 2).

    An arm that its drives hold asks for torque at the joints that carry weight. Where no joint does, as in a SCARA's
    arm, a spell at rest is left out as well, in which nothing is measured but static friction.

    Args:
        log: On a uniform grid.
    """
    none = np.zeros((0, 2))
    if log.torque is None or log.samples < 2:
        return none
    width = max(round(WINDOW_S * log.rate), 4)
    if log.samples <= width:
        return none
    torque, sizes = np.asarray(log.torque), np.sqrt(np.mean(np.asarray(log.torque) ** 2, axis=0))
    still = np.all(_windows(log.q, width)[1] <= STILL * WINDOW_S / np.sqrt(12.0), axis=1)  # of a uniform motion
    if not still.any():
        return none
    means, deviations = _windows(torque, width)
    calm = still & np.all(np.abs(means) <= NONE * sizes + deviations, axis=1)
    edges = np.flatnonzero(np.diff(calm, prepend=False, append=False))
    short = np.flatnonzero(np.diff(edges)[1::2] < width) * 2 + 1  # noise between two spells
    edges = np.delete(edges, np.concatenate([short, short + 1])).reshape(-1, 2)
    found = list[tuple[float, float]]()
    for start, end in edges[np.diff(edges, axis=1)[:, 0] >= SHORTEST_S * log.rate]:
        noise = np.sqrt(np.mean(torque[start:end] ** 2, axis=0))
        if np.any((sizes > 0.0) & (noise <= SILENT * sizes)):  # windows at the ends have seen what moves beyond
            loud = np.any(np.abs(torque) > NONE * sizes + FAR * noise, axis=1)
            sides = loud[:start][::-1][:width], loud[end:][:width]
            before, after = (int(np.argmax(np.append(each, True))) for each in sides)
            found.append((float(log.time[start - before]), float(log.time[end + after - 1])))
    spells = np.array(found).reshape(-1, 2)
    return spells if np.diff(spells, axis=1).sum() <= MOST * log.duration else none


def _windows(values: Array, width: int) -> tuple[Array, Array]:
    """Return means and standard deviations over a window about each sample, shape (N, n) each."""
    middle = values.mean(axis=0)
    values = values - middle
    sums = [np.cumsum(np.concatenate([np.zeros_like(values[:1]), each]), axis=0) for each in (values, values**2)]
    place = np.arange(len(values))
    first, last = np.maximum(place - width // 2, 0), np.minimum(place + width - width // 2, len(values))
    mean, square = ((one[last] - one[first]) / (last - first)[:, None] for one in sums)
    return mean + middle, np.sqrt(np.maximum(square - mean**2, 0.0))
