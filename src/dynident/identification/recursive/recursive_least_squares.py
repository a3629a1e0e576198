"""Recursive least squares in square-root form: one triangle that takes rows as they come, and forgets.

Kept is the triangle R of [W, tau] (square-root information form, Bierman 1977, chapter V), not a covariance that loses
its symmetry. Old rows fade or leave. What is known beforehand is a second triangle that never fades, R0: the estimate
is that of both. That is the stabilised forgetting of Kulhavy and Zarrop (1993, section 4), information
lambda L + (1 - lambda) L0 after every sample, said once: started at L0 it is L0 + sum_s lambda^(t-s) w_s w_s'. A
direction that no row shows any more goes back to what was known and its variance to R0's, where it would grow without
bound by forgetting alone.
"""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.identification.recursive.triangle_loops import add_rows, take_rows
from dynident.model.reduction import Reduced, least_squares, triangle_of
from dynident.model.threads import one_blas_thread

#: Share of the square of a diagonal that must be left when rows are taken out; below it the triangle is built anew.
LEAST = 1e-6


class RecursiveLeastSquares:
    """Least squares over rows as they come: all of them, the last ones of a window, or fading ones.

    With ``forgetting`` lambda it minimises sum_s lambda^(t-s) |e_s|^2, with ``window`` the sum over the last samples; a
    prior adds |R0 beta - z0|^2. An update costs about 3 b^2 per row, two to three times that with a window: rows are
    added, those that leave are taken out, and a second triangle takes the new rows only. After a whole window that one
    is the window, made of additions alone, and takes the first one's place: rounding is never older than two windows.
    Where taking out would leave less than the share ``LEAST``, the triangle is built anew from the rows.

    Attributes:
        size: Number of parameters, b.
        forgetting: lambda, the weight of a sample relative to the next one; 1 forgets nothing. The memory is about
            1 / (1 - lambda) samples.
        window: Samples that count; None: no window.
        prior: What is known beforehand and never forgotten, weighted as the rows are; None: nothing.
        samples: Samples taken.
        rebuilt: How often the triangle was built anew because taking rows out would have lost too many digits.
    """

    def __init__(
        self, size: int, forgetting: float = 1.0, window: int | None = None, prior: Reduced | None = None
    ) -> None:
        if size < 1:
            raise BadOption("size", size, "give the number of parameters, 1 or more")
        if not 0 < forgetting <= 1:
            raise BadOption("forgetting", forgetting, "give a number above 0, at most 1, such as 0.999")
        if window is not None and window < 1:
            raise BadOption("window", window, "give the number of samples that count, 1 or more")
        if window is not None and forgetting < 1:
            raise BadOption("window", window, "give a window or a forgetting below 1, not both")
        if prior is not None and len(prior.z) != size:
            raise BadOption("prior", f"of {len(prior.z)} parameters", f"give one of {size}")
        self.size, self.forgetting, self.window, self.prior = size, forgetting, window, prior
        self.samples = self.rebuilt = self._turn = 0
        self._triangle = np.zeros((size + 1, size + 1))
        self._fresh = np.zeros((size + 1, size + 1))
        self._rows: deque[Array] = deque()

    def update(self, matrix: npt.ArrayLike, torque: npt.ArrayLike, age: npt.ArrayLike | None = None) -> None:
        """Take new rows, weighted as they should count.

        Args:
            matrix: Rows W, shape (m, b).
            torque: Shape (m,).
            age: How many samples each row lies before the newest of these, shape (m,); the newest has 0. None: all rows
                belong to one sample.

        Raises:
            ValueError: A shape is wrong, or a value is no number; nothing is taken then.
        """
        rows, right = np.asarray(matrix, dtype=float), np.asarray(torque, dtype=float)
        if rows.shape != (len(right), self.size):
            raise ValueError(f"rows of shape {rows.shape} and {right.shape}, expected (m, {self.size}) and (m,)")
        new = np.empty((len(right), self.size + 1))
        new[:, :-1], new[:, -1] = rows, right
        if not np.isfinite(new).all():
            raise ValueError("the rows contain a value that is not a number")
        if age is None:
            self._take(new)
            return
        ages = np.asarray(age)
        if self.window is None:
            self.forget(int(np.max(ages, initial=0)))
            self._take(new * np.sqrt(self.forgetting ** ages.astype(float))[:, None])
            return
        for each in range(int(np.max(ages, initial=0)), -1, -1):
            self._take(new[ages == each])

    def _take(self, new: Array) -> None:
        """Take the rows (m, b + 1) of one sample."""
        self.forget()
        if self.window is not None:
            self._rows.append(new)
            add_rows(self._fresh, new.copy())
        add_rows(self._triangle, new.copy())
        if self.window is None:
            return
        self._turn += 1
        if len(self._rows) > self.window:
            self._drop()
        if self._turn == self.window:
            self._triangle, self._fresh, self._turn = self._fresh, np.zeros_like(self._fresh), 0

    def forget(self, samples: int = 1) -> None:
        """Let time pass: old rows fade by as many samples; a window drops none."""
        self.samples += samples
        if self.forgetting < 1:
            self._triangle *= np.sqrt(self.forgetting) ** samples

    def clear(self) -> None:
        """Forget all rows; what was known beforehand stays."""
        self._triangle[:], self._fresh[:], self._turn = 0.0, 0.0, 0
        self._rows.clear()

    def _drop(self) -> None:
        if take_rows(self._triangle, self._rows.popleft(), LEAST) < LEAST:
            self.rebuilt += 1
            self._triangle[:] = 0.0
            with one_blas_thread():
                found = triangle_of(np.concatenate(list(self._rows)))
            self._triangle[: len(found)] = found

    @property
    def held(self) -> int:
        """Samples that a window holds now."""
        return len(self._rows)

    @property
    def oldest(self) -> Array:
        """Rows of the sample that leaves a window next, [W, tau], shape (m, b + 1); a view."""
        return self._rows[0]

    @property
    def rows_alone(self) -> Reduced:
        """The least-squares problem of the rows, without what is known beforehand."""
        full = self._triangle
        return Reduced(full[:-1, :-1].copy(), full[:-1, -1].copy(), float(full[-1, -1] ** 2), self.samples)

    @property
    def reduced(self) -> Reduced:
        """The least-squares problem of the rows and of what is known beforehand."""
        if self.prior is None:
            return self.rows_alone
        full, size = self._triangle.copy(), self.size
        add_rows(full, np.column_stack([self.prior.r, self.prior.z]))
        return Reduced(full[:size, :size], full[:size, size], float(full[size, size] ** 2), self.samples)

    def estimate(self) -> Array:
        """Return the estimate, shape (b,); 0 in directions of which nothing is known."""
        return least_squares(self.reduced).beta

    def covariance(self) -> Array:
        """Return (W'W + R0'R0)^-1 of the weighted rows, shape (b, b): times the residual variance the covariance.

        With forgetting it counts a row of age a as one of variance 1 / lambda^a, more than noise alone makes of it.
        """
        return least_squares(self.reduced).unscaled_covariance
