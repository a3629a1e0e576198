"""What a fault does to the fit: by how much it moves the held-out error and the identified parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from benchmarks.faults.kinds import Kind
from benchmarks.faults.trials import Trial
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.thin_fit import quick_fit, thin_fit
from dynident.errors import DynidentError

#: The smallest strength moves the held-out error, or an identified parameter, by this share.
MOVES = 0.05

#: A parameter is identified where its relative deviation in the clean fit is at most this.
IDENTIFIED = 0.01

#: Steps of the bisection, on the logarithm of the strength.
STEPS = 6


@dataclass(frozen=True)
class Reference:
    """The fit of a clean log, and a log that is held out."""

    clean: QuickFit
    held: QuickFit

    @cached_property
    def error(self) -> float:
        """The root mean square of the error of the clean fit on the held-out log, over all joints."""
        rows = self.held.rows
        return _size(self.held.residual_of(rows, self.clean.plain.beta), rows.masks)

    @cached_property
    def prediction(self) -> np.ndarray:
        """What the clean fit predicts for the held-out log, shape (N, n)."""
        return self.held.rows.torque - self.held.residual_of(self.held.rows, self.clean.plain.beta)

    def rise(self, fit: QuickFit) -> float:
        """Return the share by which the held-out error grows where what is predicted moves as under a fit.

        The move counts in quadrature with the error of the clean fit: its chance product with the noise of the one
        held-out log, which makes an error larger or smaller by luck, is left out.
        """
        rows = QuickFit(fit.model, fit.base, self.held.log, self.held.how).rows
        predicted = rows.torque - fit.residual_of(rows, fit.plain.beta)
        return float(np.hypot(1.0, _size(predicted - self.prediction, self.held.rows.masks) / self.error)) - 1.0

    def effect(self, fit: QuickFit) -> float:
        """Return the larger of the two moves."""
        values = dict(zip(fit.base.names, fit.plain.beta, strict=True))
        spread = np.sqrt(np.diag(self.clean.plain.covariance) * float(np.median(self.factors)))
        moves = [
            abs(values[name] - value) / abs(value)
            for name, value, deviation in zip(self.clean.base.names, self.clean.plain.beta, spread, strict=True)
            if deviation < IDENTIFIED * abs(value) and name in values
        ]
        return max(self.rise(fit), *moves, 0.0)

    @property
    def factors(self) -> np.ndarray:
        return self.clean.counts / self.clean.independent_rows


def _size(values: np.ndarray, masks: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values[masks] ** 2)))


def fitted(trial: Trial, folder: Path) -> QuickFit | None:
    """Return the quick fit of a trial; None where the log is refused or too short."""
    try:
        log = trial.case.read(trial.written(folder, "fit"))
        return quick_fit(trial.case, log)
    except DynidentError:
        return None


def reference(clean: Trial, held: Trial, folder: Path) -> Reference:
    fits = [thin_fit(trial.case, trial.case.read(trial.written(folder, "fit"))) for trial in (clean, held)]
    assert fits[0] is not None and fits[1] is not None
    return Reference(*fits)  # type: ignore[arg-type]


def smallest(kind: Kind, trial: Trial, against: Reference, folder: Path) -> float | None:
    """Return the least strength that matters, by bisection; None where none of the range does."""
    assert kind.between is not None

    def matters(strength: float) -> bool:
        fit = fitted(kind.inject(trial, strength, np.random.default_rng(1)), folder)
        return fit is None or against.effect(fit) >= MOVES

    low, high = np.log(kind.between)
    if not matters(float(np.exp(high))):
        return None
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if matters(float(np.exp(middle))) else (middle, high)
    return float(np.exp(high))
