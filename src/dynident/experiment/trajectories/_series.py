"""What the Fourier trajectories share: the basis of equation (14), its range between samples, its plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, frozen
from dynident.errors import BadOption
from dynident.experiment.preprocessing.fourier_fit import fourier_basis


def series_basis(time: Array, period: float, count: int) -> Array:
    """Return 1, sin(k w t).., cos(k w t).. and their three derivatives, shape (4, N, C), C = 2 H + 1."""
    harmonics = count // 2
    q, dq, ddq = fourier_basis(time, period, harmonics)
    pulsation = 2 * np.pi / period * np.r_[0.0, np.tile(np.arange(1, harmonics + 1), 2)]
    return np.stack([q, dq, ddq, -(pulsation**2) * dq])


def series_extremes(table: Array, period: float, samples: int) -> Array:
    """Return bounds on q, dq, ddq and jerk at every time, shape (2, 4, n): lowest, highest.

    A trigonometric polynomial of degree H is at most 1 / cos(pi H / N) times the largest of N even samples of a period
    (Ehlich and Zeller 1964); this is used about the middle between its highest and its lowest sample.

    Raises:
        BadOption: So few samples that they bound nothing.
    """
    harmonics = table.shape[1] // 2
    if samples <= 2 * harmonics:
        raise BadOption("samples", samples, f"give more than {2 * harmonics}")
    signals = series_basis(np.arange(samples) * period / samples, period, table.shape[1]) @ table.T
    low, high = signals.min(axis=1), signals.max(axis=1)
    middle, half = 0.5 * (high + low), 0.5 * (high - low) / np.cos(np.pi * harmonics / samples)
    return np.stack([middle - half, middle + half])


def series_fields(offset: npt.ArrayLike, sine: npt.ArrayLike, cosine: npt.ArrayLike, period: float) -> dict[str, Any]:
    """Return the four fields of a series, frozen and checked.

    Raises:
        BadOption: A number that is not finite, or a period that is not positive.
        ValueError: Shapes that do not fit each other.
    """
    fields: dict[str, Any] = {"offset": frozen(offset, (None,), "offset")}
    fields["sine"] = frozen(sine, (len(fields["offset"]), None), "sine")
    fields["cosine"] = frozen(cosine, fields["sine"].shape, "cosine")
    for name, values in fields.items():
        if not np.all(np.isfinite(values)):
            raise BadOption(name, float(values[~np.isfinite(values)][0]), "give finite numbers")
    return {**fields, "period": checked_period(period)}


def checked_period(period: float) -> float:
    """Return a period as a number.

    Raises:
        BadOption: It is not positive and finite.
    """
    if not 0 < float(period) < np.inf:
        raise BadOption("period", float(period), "give the period in s, above 0")
    return float(period)


def split_table(rows: Sequence[npt.ArrayLike]) -> tuple[Array, Array, Array]:
    """Return offset (n,), sine (n, H) and cosine (n, H) from one row per joint: offset, a_1..a_H, b_1..b_H.

    Raises:
        BadOption: No rows, rows of different lengths, or an even number of numbers in a row.
    """
    table = [np.asarray(row, dtype=np.float64) for row in rows]
    lengths = [row.size for row in table]
    if not table or lengths[0] % 2 == 0:
        raise BadOption("row 1", lengths[:1], "give an odd number of values: offset, a_1..a_H, b_1..b_H")
    for joint, length in enumerate(lengths, 1):
        if length != lengths[0]:
            raise BadOption(f"row {joint}", f"{length} values", f"give {lengths[0]} as in row 1")
    values = np.array(table)
    harmonics = lengths[0] // 2
    return values[:, 0], values[:, 1 : 1 + harmonics], values[:, 1 + harmonics :]


def series_data(offset: Array, sine: Array, cosine: Array, period: float) -> dict[str, Any]:
    """Return the numbers of a series as plain data."""
    return {"period": period, "offset": offset.tolist(), "sine": sine.tolist(), "cosine": cosine.tolist()}


def series_arguments(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a series from its plain data.

    Raises:
        KeyError: One is missing.
    """
    return {name: np.array(data[name], float) for name in ("offset", "sine", "cosine")} | {"period": data["period"]}
