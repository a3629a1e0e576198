"""Closed-loop output error: the positions of a simulated closed loop."""

from __future__ import annotations

from dataclasses import dataclass

from dynident.identification.problem.estimator import Solution
from dynident.identification.problem.problem import Problem
from dynident.identification.simulated.iteration import Iterated, started
from dynident.identification.simulated.output_error import output_error
from dynident.plugins import bounded


@dataclass(frozen=True)
class CLOE(Iterated):
    """Output error on the position: simulated against measured positions (Landau 2001; Brunot et al. 2018).

    Gauss-Newton with exact derivatives of the simulated positions by the parameters (forward sensitivity equations).
    Stiff controllers leave little of a wrong parameter to be seen in the positions, so the method is less certain than
    CLIE. The start is an instrumental-variable estimate; steps stay where the mass matrix is positive definite.

    Where the controller is not stated, the measured torque is fed forward and loops of ``bandwidth_hz`` hold the robot
    on the measured motion: an regressor, whose errors of position are those of the torque behind a low-pass of that
    bandwidth. Torques should then be logged fast enough to be interpolated. 8 N n b bytes of derivatives are held.
    """

    iterations: int = bounded(20, most=10_000)

    def solve(self, problem: Problem) -> Solution:
        loop, start = started(problem, self, "measured")
        fit = output_error(loop, start, "q", self.iterations, self.tolerance, "the output error")
        weights = 1.0 / problem.joint_deviations(fit.beta)
        return Solution(fit.beta, weights, covariance=fit.covariance, degrees=fit.degrees, run=fit.run)
