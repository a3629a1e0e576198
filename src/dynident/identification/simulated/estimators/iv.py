"""Instrumental variables from a simulated robot."""

from __future__ import annotations

from dataclasses import dataclass

from dynident.arrays import Array
from dynident.identification.problem.estimator import Solution
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.instruments import Instruments, instruments
from dynident.identification.simulated.closed_loop import simulated_logs
from dynident.identification.simulated.iteration import Iterated, Round, fixed_point, instrument_round, started
from dynident.plugins import bounded


@dataclass(frozen=True)
class IV(Iterated):
    """Instrumental variables beta = (Z' W)^-1 Z' tau, Z the regressor along simulated states (Janot et al. 2014).

    Noise of the measured positions is in W and in the residual, which biases least squares; it is not in Z when the
    simulated robot follows the commanded positions (``q_ref``), whatever its controller. With the measured positions as
    reference, Z is free only of the noise above ``reference_hz``. Rows of Z are filtered and chosen as those of W, each
    joint has its own weight, and the covariance is (Z' W)^-1 Z' S Z (W' Z)^-1.

    A robot whose mass matrix is not positive definite cannot be simulated: the instruments of that round are those of a
    mixture with a robot that can be simulated, from which the iteration starts. Instruments need not be exact.

    Attributes:
        reference: Motion to follow: ``commanded`` or ``measured``; ``auto`` takes the commanded one where it is logged.
        reference_hz: Cut-off in Hz of a zero-phase filter of the measured reference; None leaves it as it was prepared.
    """

    reference_hz: float | None = bounded(5.0, least=1e-3, most=1e5)

    def solve(self, problem: Problem) -> Solution:
        loop, start = started(problem, self, as_instruments=True)
        made: list[Instruments] = []

        def step(states: tuple[Array, ...], beta: Array) -> Round:
            made[:] = [instruments(problem, simulated_logs(loop, states))]
            return instrument_round(made[0], beta)

        found, run = fixed_point(loop, start, step, self.iterations, self.tolerance, "the instrumental variables")
        sure = made[0].uncertainty(found.weights, found.beta)
        return Solution(found.beta, found.weights, covariance=sure.covariance, degrees=sure.degrees, run=run)
