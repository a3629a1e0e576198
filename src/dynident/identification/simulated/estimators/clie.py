"""Closed-loop input error: the torque of a simulated closed loop."""

from __future__ import annotations

from dataclasses import dataclass

from dynident.identification.problem.estimator import Solution
from dynident.identification.problem.problem import Problem
from dynident.identification.simulated.iteration import Iterated, started
from dynident.identification.simulated.output_error import output_error
from dynident.plugins import bounded


@dataclass(frozen=True)
class CLIE(Iterated):
    """Output error on the torque: the simulated controller's torque against the measured one (Gautier et al. 2013).

    The simulated robot follows the reference under the same controller; what it needs to do so is compared with what
    was measured, by Gauss-Newton with exact derivatives: the regressor, and how the simulated states move with the
    parameters (forward sensitivity equations). DIDIM is the same with the second part left out. The start is an
    instrumental-variable estimate; steps stay where the mass matrix is positive definite.

    Where the controller is not stated, a virtual one holds the simulated robot on the measured motion, states do not
    move with the parameters, and the method is least squares on the reference. 8 N n b bytes of derivatives are held.
    """

    iterations: int = bounded(20, most=10_000)

    def solve(self, problem: Problem) -> Solution:
        loop, start = started(problem, self)
        fit = output_error(loop, start, "torque", self.iterations, self.tolerance, "the input error")
        return Solution(fit.beta, fit.weights, covariance=fit.covariance, degrees=fit.degrees, run=fit.run)
