"""Cubic smoothing spline through the positions, differentiated analytically."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing._spectra import power_spectrum
from dynident.data.preprocessing._torque_side import PositionSmoother
from dynident.errors import BadOption, LogMismatch
from dynident.plugins import bounded

#: Penalties that are tried, in powers of ten of a sample's length cubed.
PENALTIES = (-6.0, 14.0)


@dataclass(frozen=True)
class SmoothingSpline(PositionSmoother):
    """Cubic spline that minimises sum (y - q)^2 + penalty * integral of (q'')^2 (Reinsch 1967), and its derivatives.

    The penalty of each joint is the one of least generalised cross-validation (Craven and Wahba 1979), or the one that
    leaves a residual of the stated noise (Reinsch). Torque and regressor pass a zero-phase Butterworth, the same on
    both sides, which the spline of the positions is not part of.

    Attributes:
        position_noise: Standard deviation of a position sample in rad or m; None: generalised cross-validation.
        cutoff_hz: Frequency of half amplitude of torque and regressor, in Hz.
        torque: ``same`` filters both sides, ``none`` leaves torque and regressor as they are.
    """

    position_noise: float | None = bounded(None, least=1e-15, most=1e6)
    cutoff_hz: float = 5.0
    torque: str = "same"

    def __post_init__(self) -> None:
        if self.position_noise is not None and not 0 < self.position_noise < np.inf:
            raise BadOption("position_noise", self.position_noise, "give a standard deviation above 0")
        self.check_sides()

    def apply(self, log: Log) -> Log:
        import scipy.interpolate

        if log.samples < 10:
            raise LogMismatch(log.name, f"{log.samples} samples", "a smoothing spline takes at least 10 samples")
        self.check_length(log)
        place = np.arange(log.samples, dtype=float)  # a unit of time of one sample keeps the equations well scaled
        signals: list[list[Array]] = [[], [], []]
        residuals = []
        for column in log.q.T:
            penalty = penalty_of(column, log.rate, self.position_noise)
            spline = scipy.interpolate.make_smoothing_spline(place, column, lam=penalty)
            for order in range(3):
                signals[order].append(spline.derivative(order)(place) * log.rate**order if order else spline(place))
            residuals.append(float(np.sqrt(np.mean((column - signals[0][-1]) ** 2))))
        q, dq, ddq = (np.stack(each, axis=1) for each in signals)
        step = f"smoothing spline, leaves {', '.join(f'{each:.2g}' for each in residuals)}, {self.sides_text()}"
        return replace(log.with_step(step), q=q, dq=dq, ddq=ddq, torque=self.measured(log), raw_torque=log.torque)

    def statement(self) -> dict[str, object]:
        return {
            "kind": "smoothing_spline",
            "cutoff_hz": self.cutoff_hz if self.torque == "same" else None,
            "order": 3,
            "torque": self.torque,
            "position_noise": "by cross-validation" if self.position_noise is None else self.position_noise,
        }


def penalty_of(signal: Array, rate: float, noise: float | None) -> float:
    """Return the penalty of a uniformly sampled signal (N,), its unit of time one sample.

    The spline on a uniform grid takes the frequency w, in radians a sample, to 1 / (1 + penalty (2 sin(w/2))^4) of its
    amplitude, away from the ends, so that residual and freedom follow from the power spectrum of the signal.

    Args:
        signal: Positions.
        rate: Samples a second.
        noise: Standard deviation that the residual is to have; None: generalised cross-validation.
    """
    hertz, power = power_spectrum(signal[:, None], rate)
    width = rate / 2 / len(hertz)
    stiff = (2.0 * np.sin(np.pi * hertz / rate)) ** 4
    penalties = np.logspace(*PENALTIES, 201)
    left = penalties[:, None] * stiff / (1.0 + penalties[:, None] * stiff)
    residuals = left**2 @ power[:, 0] * width
    if noise is not None:
        return float(np.exp(np.interp(np.log(noise**2), np.log(residuals + 1e-300), np.log(penalties))))
    return float(penalties[int(np.argmin(residuals / left.mean(axis=1) ** 2))])
