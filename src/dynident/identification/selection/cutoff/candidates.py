"""What an estimate at one cut-off is worth: its variance, and the biases of noise and filter.

- Variance: that of weighted least squares by blocks of time, whatever the colour of the residuals.
- Noise bias: noise of the power that the positions have is added to them (SIMEX, Cook and Stefanski 1994); in first
  order the estimate moves by its bias once more. Each draw is added once and subtracted once and the mean of the two
  taken, so that what is linear in the draw cancels and the bias is left.
- Filter bias: a log is made up of smooth positions and the torques that the model has for them; what the estimate from
  it differs by from the parameters put in is what the filter of the positions does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import ROWS_PER_PERIOD, Preprocessing, preprocess
from dynident.data.preprocessing._zero_phase import low_passed
from dynident.errors import DynidentError
from dynident.identification.problem.problem import unreduced
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.selection.cutoff.block_triangles import BlockTriangles, block_triangles
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel

#: Samples a second per Hz of the cut-off that are kept before the filter; positions pass five times the cut-off, and
#: central differences want more.
SAMPLES_PER_HZ = 50.0

#: Blocks of time at most whose disagreement is the variance, and periods of the cut-off in one at least.
BLOCKS, PERIODS = 40, 2.0

#: Blocks, and independent rows a parameter, below which a variance says nothing.
FEWEST_BLOCKS, FEWEST_ROWS = 8, 2.0

#: Squared move by added noise, over the variance, below which one draw is enough.
SMALL = 0.02

#: Seed of the noise that is added.
SEED = 20


@dataclass(frozen=True)
class CutoffCandidate:
    """An estimate at one cut-off.

    Attributes:
        hertz: The cut-off in Hz.
        beta: The estimate, shape (b,).
        covariance: Of its random error, shape (b, b).
        bias: What the noise of the positions adds to it, shape (b,).
        gram: Mean product of the weighted columns over the rows, shape (b, b).
    """

    hertz: float
    beta: Array
    covariance: Array
    bias: Array
    gram: Array

    def error(self, gram: Array) -> tuple[float, float]:
        """Return the squared error of the predicted torque that variance and noise bias make, under given products."""
        return float(np.sum(gram * self.covariance)), float(self.bias @ gram @ self.bias)


@dataclass(frozen=True)
class Bench:
    """What candidates are made from.

    Attributes:
        model: A model whose friction does not depend on the load.
        base: Its base parameters.
        logs: Raw logs on uniform grids, joints in the order of the robot.
        delays: By how much the torque of each lags, in s.
        how: How they become rows; its filter is one whose cut-off is open.
        noise: Standard deviation of the white noise of the positions of each log, shape (n,) each.
        share: Share of the recorded time that the logs are; the variance is stated for all of it.
    """

    model: DynamicModel
    base: BaseParameters
    logs: tuple[Log, ...]
    delays: tuple[float, ...]
    how: Preprocessing
    noise: tuple[Array, ...]
    share: float = 1.0

    def candidate(self, hertz: float) -> CutoffCandidate | None:
        """Return the estimate at a cut-off; None where the rows do not determine it, or not how sure it is."""
        independent = self._independent(hertz)
        if independent < FEWEST_ROWS * self.base.count:
            return None
        try:
            own = self.rows(hertz)
            if len(own.blocks) < FEWEST_BLOCKS:
                return None
            beta = own.fit[0]
            gram = own.reduced.r.T @ own.reduced.r / own.reduced.rows
            jackknife = (1.0 - self.base.count / independent) ** -2  # residuals of a fit understate the variance
            covariance = self.share * jackknife * own.covariance
            move = self.rows(hertz, 1.0, blocks=1).fit[0] - beta
            if move @ gram @ move > SMALL * np.sum(gram * covariance):  # else the bias within it is smaller still
                move = 0.5 * (move + self.rows(hertz, -1.0, blocks=1).fit[0] - beta)
        except DynidentError:
            return None
        return CutoffCandidate(hertz, beta, covariance, move, gram)

    def rows(self, hertz: float, added: float = 0.0, blocks: int = BLOCKS) -> BlockTriangles:
        """Return the rows at a cut-off in ``blocks`` of time, ``added`` times the positions' noise put on top."""
        how = self.at(hertz)
        generator = np.random.default_rng(SEED)
        prepared = []
        for log, noise, delay in zip(self.logs, self.noise, self.delays, strict=True):
            noisy = replace(log, q=log.q + added * noise * generator.normal(size=log.q.shape)) if added else log
            prepared.append(preprocess(thinned_out(noisy, SAMPLES_PER_HZ * hertz), replace(how, delay_s=delay)))
        return block_triangles(unreduced(self.model, self.base, prepared), PERIODS / hertz, blocks)

    def at(self, hertz: float) -> Preprocessing:
        """Return the preparation at a cut-off."""
        filter = self.how.filter.with_cutoff(hertz)
        return replace(self.how, filter=filter, rate_hz=None, rows_per_period=ROWS_PER_PERIOD)

    def imitated(self, beta: Array, hertz: float) -> Bench:
        """Return the bench of logs without noise: positions smoothed as at a cut-off, and the torque they ask for.

        Args:
            beta: Base parameters, shape (b,).
            hertz: The cut-off.
        """
        logs, regressor = [], RegressorStream(self.model, self.base)
        for log in self.logs:
            thin = thinned_out(log, SAMPLES_PER_HZ * hertz)
            smooth = self.at(hertz).filter.apply(thin)
            logs.append(replace(thin, q=smooth.q, torque=regressor.predict(smooth, beta)))
        return replace(self, logs=tuple(logs), delays=(0.0,) * len(logs))

    def filter_bias(self, beta: Array, hertz: float) -> Array:
        """Return by how much the estimate differs from the parameters (b,) that the logs were made with."""
        try:
            return self.rows(hertz, blocks=1).fit[0] - beta
        except DynidentError:
            return np.zeros(len(beta))

    def _independent(self, hertz: float) -> float:
        """Return the independent rows that a low-pass leaves: 2 c a second and joint (Nyquist 1928)."""
        seconds = sum(max(log.duration - 2 * self.how.trim_s, 0.0) for log in self.logs)
        return 2 * hertz * seconds * self.model.robot.dof


def thinned_out(log: Log, rate: float) -> Log:
    """Return positions, torques and temperatures of a uniform log at ``rate`` or a little above, low-passed before."""
    every = max(1, int(log.rate / rate))
    names = [name for name in ("q", "torque", "temperature") if getattr(log, name) is not None]
    dropped = {name: None for name in log.signals() if name not in names}
    if every == 1:
        return replace(log, **dropped)  # type: ignore[arg-type]
    smooth = {name: low_passed(getattr(log, name), 8, 0.4 * log.rate / every, log.rate)[::every] for name in names}
    return replace(log, time=log.time[::every], **dropped, **smooth)  # type: ignore[arg-type]


def stretch_of(logs: Sequence[Log], longest: float) -> tuple[tuple[Log, ...], float]:
    """Return the first part of each log, ``longest`` s in all at most, and the share of the time that they are."""
    total = sum(log.duration for log in logs)
    if total <= longest:
        return tuple(logs), 1.0
    share = longest / total
    return tuple(log.rows(slice(0, max(10, int(share * log.samples))), "the first part") for log in logs), share
