"""Kalman smoother: a motion of white jerk or white snap seen through white noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing._spectra import noise_floor
from dynident.data.preprocessing._state_smoother import likelihood, smoothed
from dynident.data.preprocessing._torque_side import PositionSmoother
from dynident.errors import BadOption, LogMismatch
from dynident.plugins import bounded

#: Samples in a row that the likelihood looks at, at most, from the middle of the log.
LONGEST = 8192

#: Decades of the intensity that are searched below that of the raw differences, and points of the first grid.
DECADES, POINTS = 16.0, 17

#: Share of the range of a signal that its noise has at least: positions made by a formula have none.
LEAST = 1e-8

#: Derivative that is white, by model.
ORDERS = {"jerk": 3, "snap": 4}


@dataclass(frozen=True)
class KalmanSmoother(PositionSmoother):
    """Positions as integrated white jerk (or snap) under white noise, smoothed with their derivatives over the log.

    The smoother of Rauch, Tung and Striebel (1965). Intensity of the jerk and noise of the positions are found joint by
    joint by maximum likelihood of the innovations (Schweppe 1965). Torque and regressor pass a zero-phase Butterworth,
    the same on both sides, which the smoother of the positions is not part of.

    Attributes:
        model: ``jerk`` (white jerk) or ``snap`` (white derivative of the jerk).
        position_noise: Standard deviation of a position sample in rad or m; None: by likelihood.
        cutoff_hz: Frequency of half amplitude of torque and regressor, in Hz.
        torque: ``same`` filters both sides, ``none`` leaves torque and regressor as they are.
    """

    model: str = "jerk"
    position_noise: float | None = bounded(None, least=1e-15, most=1e6)
    cutoff_hz: float = 5.0
    torque: str = "same"

    def __post_init__(self) -> None:
        if self.model not in ORDERS:
            raise BadOption("model", self.model, "choose 'jerk' or 'snap'")
        if self.position_noise is not None and not 0 < self.position_noise < np.inf:
            raise BadOption("position_noise", self.position_noise, "give a standard deviation above 0")
        self.check_sides()

    def apply(self, log: Log) -> Log:
        q, deviations, noises = self._states(log)
        step = (
            f"Kalman smoother of white {self.model}, noise of positions "
            f"{', '.join(f'{noise:.2g}' for noise in noises)}, of accelerations "
            f"{', '.join(f'{float(np.median(each)):.2g}' for each in deviations[2].T)} (stated), {self.sides_text()}"
        )
        return replace(log.with_step(step), q=q[0], dq=q[1], ddq=q[2], torque=self.measured(log), raw_torque=log.torque)

    def deviations(self, log: Log) -> tuple[Array, Array, Array]:
        """Return the standard deviations of q, dq and ddq that the model states, each (N, n)."""
        found = self._states(log)[1]
        return found[0], found[1], found[2]

    def statement(self) -> dict[str, object]:
        return {
            "kind": "kalman_smoother",
            "cutoff_hz": self.cutoff_hz if self.torque == "same" else None,
            "order": ORDERS[self.model],
            "torque": self.torque,
            "model": self.model,
            "position_noise": "by likelihood" if self.position_noise is None else self.position_noise,
        }

    def _states(self, log: Log) -> tuple[tuple[Array, ...], tuple[Array, ...], list[float]]:
        """Return q, dq, ddq, their deviations, (N, n) each, and the noise of each joint's positions."""
        if log.samples < 10:
            raise LogMismatch(log.name, f"{log.samples} samples", "a Kalman smoother takes at least 10 samples")
        self.check_length(log)
        order = ORDERS[self.model]
        unit = 1.0 / log.rate
        steps = np.diff(log.time) / unit
        means, deviations, noises = [], [], []
        for column in log.q.T:
            size = float(np.ptp(column))
            scale = unit ** -np.arange(order)
            if size == 0.0:
                means.append(np.outer(np.ones(len(column)), [column[0], *[0.0] * (order - 1)]))
                deviations.append(np.zeros((len(column), order)))
                noises.append(0.0)
                continue
            ratio, noise = self._noises(column, steps, order, log.rate)
            mean, deviation = smoothed((column - column[0]) / noise, steps, ratio, order)
            means.append(mean * noise * scale + np.array([column[0], *[0.0] * (order - 1)]))
            deviations.append(deviation * noise * scale)
            noises.append(noise)
        signals, spreads = (tuple(np.stack(each, axis=2).transpose(1, 0, 2)) for each in (means, deviations))
        return signals, spreads, noises

    def _noises(self, column: Array, steps: Array, order: int, rate: float) -> tuple[float, float]:
        """Return the intensity of the white derivative over the noise's variance, and the noise, of highest likelihood.

        The likelihood depends on their ratio alone once the noise is taken at its own maximum.
        """
        first = max(0, (len(column) - LONGEST) // 2)
        part, between = column[first : first + LONGEST], steps[first : first + LONGEST - 1]
        size = max(float(np.ptp(part)), 1e-300)
        floor = float(np.sqrt(noise_floor(part[:, None], rate)[0] * rate / 2))
        scale = self.position_noise or max(floor, LEAST * size)
        signal = (part - part[0]) / scale
        stated = self.position_noise is not None

        def cost(logarithm: float) -> float:
            found = likelihood(signal, between, float(np.exp(logarithm)), order)
            size = found.squares if stated else found.count * np.log(max(found.squares, 1e-300))
            return 0.5 * (size + found.log_variance)

        highest = float(np.log(max(float(np.mean(np.diff(signal, order) ** 2)), 1e-12))) + 4.0
        best = float(np.exp(_least(cost, highest - DECADES * np.log(10.0), highest)))
        if stated:
            return best, scale
        found = likelihood(signal, between, best, order)
        noise = scale * float(np.sqrt(found.squares / found.count))
        return best, max(noise, LEAST * size)


def _least(cost: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function of one number is least: a coarse grid, then a search about its best point."""
    import scipy.optimize

    grid = np.linspace(low, high, POINTS)
    best = int(np.argmin([cost(float(point)) for point in grid]))
    bounds = (float(grid[max(best - 1, 0)]), float(grid[min(best + 1, POINTS - 1)]))
    found: Any = scipy.optimize.minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 0.02})
    return float(found.x)
