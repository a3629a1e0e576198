"""A Fourier series that starts and ends every period at rest, by construction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.excitation.trajectories._series import HarmonicSeries

#: How far the two sums may miss zero, as a share of the sum of their absolute terms.
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class RestFourier(HarmonicSeries):
    """Finite Fourier series (14) with dq = ddq = 0 at the start and end of each period; it needs no run-in.

    The coefficients fulfil sum k a_ik = 0 (speed) and sum k^2 b_ik = 0 (acceleration). Every such series with H
    harmonics comes from 2 H - 1 free numbers a joint by :func:`rest_map`.

    Attributes:
        offset: q_io, shape (n,), in rad or m.
        sine: a_ik, shape (n, H), in rad or m.
        cosine: b_ik, shape (n, H), in rad or m.
        period: Period in s.

    Raises:
        BadOption: Coefficients that do not start at rest, numbers that are not finite, a period that is not positive.
        ValueError: Shapes that do not fit each other.
    """

    def check(self) -> None:
        """Refuse a start that is not at rest.

        Raises:
            BadOption: Its velocity or acceleration is not zero.
        """
        order = np.arange(1, self.harmonics + 1, dtype=float)
        for name, values, power in (("sine", self.sine, order), ("cosine", self.cosine, order**2)):
            missed = np.abs(values @ power) > _TOLERANCE * (np.abs(values) @ power)
            if np.any(missed):
                joint = int(np.argmax(missed))
                what = "velocity" if name == "sine" else "acceleration"
                step = f"the {what} at the start is not zero; take the coefficients from RestFourier.from_free"
                raise BadOption(f"{name} of joint {joint + 1}", values[joint].tolist(), step)

    @classmethod
    def from_free(cls, free: npt.ArrayLike, period: float) -> RestFourier:
        """Build from free numbers, shape (n, 2 H - 1): the offset, then H - 1 for the sines and the cosines each.

        Raises:
            BadOption: Fewer than two harmonics, or an even count of numbers.
        """
        rows = np.atleast_2d(np.asarray(free, dtype=np.float64))
        harmonics, odd = divmod(rows.shape[1] + 1, 2)
        if odd or harmonics < 2:
            raise BadOption("free", f"of shape {rows.shape}", "give 2 H - 1 numbers per joint, H >= 2 harmonics")
        return cls.from_table(list(rows @ rest_map(harmonics).T), period)

    @staticmethod
    def free_map(harmonics: int) -> Array:
        """Return :func:`rest_map`."""
        return rest_map(harmonics)

    @property
    def at_rest(self) -> bool:
        """It starts at rest."""
        return True


def rest_map(harmonics: int) -> Array:
    """Return the map of free numbers onto offset, a_1..a_H, b_1..b_H at rest, shape (2 H + 1, 2 H - 1).

    Its columns are orthonormal and span all series with sum k a_k = 0 and sum k^2 b_k = 0.

    Raises:
        BadOption: Fewer than two harmonics: only the constant is at rest.
    """
    if harmonics < 2:
        raise BadOption("harmonics", harmonics, "give 2 or more to start and end at rest")
    order = np.arange(1, harmonics + 1, dtype=float)
    found = np.zeros((2 * harmonics + 1, 2 * harmonics - 1))
    found[0, 0] = 1.0
    found[1 : harmonics + 1, 1:harmonics] = _orthogonal_to(order)
    found[harmonics + 1 :, harmonics:] = _orthogonal_to(order**2)
    return found


def _orthogonal_to(row: Array) -> Array:
    """Return an orthonormal basis of the vectors orthogonal to ``row`` (H,), shape (H, H - 1)."""
    return np.linalg.svd(row[None, :])[2][1:].T
