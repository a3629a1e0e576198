"""Tables t, q, dq, ddq as CSV with twelve digits: the text and the samples read back from it."""

from __future__ import annotations

import io

import numpy as np

from dynident.arrays import Array
from dynident.experiment.design.plan import samples_text
from dynident.results.exporters.base import Printed

#: Largest relative error of a number with twelve digits.
DIGITS_12 = 5e-12


def table(time: Array, signals: Array, scale: Array) -> tuple[bytes, Printed]:
    """Return the bytes of a table and what is printed in it.

    Args:
        time: Times (N,) in s.
        signals: q, dq, ddq (3, N, n) in SI units.
        scale: Printed unit for each SI unit, shape (n,).
    """
    text = samples_text(time, list(signals * scale + 0.0))
    found = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1, ndmin=2)
    joints = signals.shape[2]
    read = found[:, 1:].reshape(len(found), 3, joints).transpose(1, 0, 2) / scale
    return text.encode("ascii"), Printed(found[:, 0], read, DIGITS_12 * np.abs(signals).max(axis=1))
