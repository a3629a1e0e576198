"""Direct and inverse dynamic identification models: the regressor is simulated."""

from __future__ import annotations

from dataclasses import dataclass, replace

from dynident.arrays import Array
from dynident.identification.problem.estimator import Solution
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.coloured import spectral_uncertainty
from dynident.identification.residuals.instruments import with_states
from dynident.identification.simulated.closed_loop import simulated_logs
from dynident.identification.simulated.iteration import Iterated, Round, fixed_point, least_squares_round, started


@dataclass(frozen=True)
class DIDIM(Iterated):
    """Least squares of the measured torques on the regressor along simulated states (Gautier et al. 2013).

    The method needs only torques, commanded positions and the controller: the simulated robot follows the reference
    under the same controller, so its states stay near the real ones whatever the parameters, and the torque's
    derivative is near W. Each round is weighted least squares, a Gauss-Newton step of the output error on the torque.

    Where the controller is not stated, a virtual one follows the measured motion, and noise that the preparation left
    in it stays in W; ``reference_hz`` takes it out. Rounds whose parameters have no positive definite mass matrix
    simulate a mixture with a robot that can, from which the iteration starts; it must not end in one.
    """

    def solve(self, problem: Problem) -> Solution:
        loop, start = started(problem, self)
        settled = replace(problem, masks=loop.settled(start))
        made: list[Problem] = []

        def step(states: tuple[Array, ...], beta: Array) -> Round:
            made[:] = [with_states(settled, simulated_logs(loop, states))]
            return least_squares_round(made[0], beta)

        found, run = fixed_point(loop, start, step, self.iterations, self.tolerance, "the simulated regressor")
        sure = spectral_uncertainty(made[0], found.weights, found.beta)
        return Solution(found.beta, found.weights, covariance=sure.covariance, degrees=sure.degrees, run=run)
