"""What an estimator is: a pure method from a Problem to a Solution."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.prior import PULL
from dynident.identification.problem.problem import Problem
from dynident.model.reduction import Reduced, least_squares


@dataclass(frozen=True)
class Solution:
    """What an estimator found.

    Attributes:
        beta: Base parameters, shape (b,).
        weights: Weight of each joint's rows, shape (n,), 1 / N m; their squares weigh the covariance.
        theta: Standard parameters behind beta, shape (p,); None where the estimator works on base parameters only.
        covariance: Of beta, shape (b, b), where the method has one of its own; None: from weights and residuals.
        degrees: Degrees of freedom of its variances, for Student's t, shape (b,); None where it is as good as known.
        run: What the method states of its run: iterations, convergence trace, gap to the optimum.
    """

    beta: Array
    weights: Array
    theta: Array | None = None
    covariance: Array | None = None
    degrees: Array | None = None
    run: MethodRun = field(default_factory=MethodRun)

    def pull(self, problem: Problem) -> Array:
        """Return what bounds and prior of the bodies moved the base parameters by from least squares, shape (b,)."""
        if self.theta is None:
            return np.zeros_like(self.beta)
        return self.beta - least_squares(problem.reduced(self.weights)).beta


class Estimator(ABC):
    """A frozen dataclass whose fields are its options; ``solve`` keeps nothing.

    Attributes:
        keeps_constraints: Whether it keeps what the problem states about bodies; a warning is given where it does not.
        from_triangles: Whether triangles are all that it asks for, so that it solves logs reduced as a stream.
        fits_folds: Whether cross-validation fits the rest of the logs with it; weighted least squares does where not.
        may_not_converge: Whether it may end far from the optimum of its objective, so that the load of the drives is
            that of weighted least squares and not of its own answer.
        allows_for_noise: Whether its rows are not the measured ones, or their noise is part of what it solves, so that
            this biases the estimate otherwise than weighted least squares.
        contest_options: Options, as text, that it has among other methods where none are stated: there methods are
            compared by what they make of the data alone.
    """

    keeps_constraints: ClassVar[bool] = False
    from_triangles: ClassVar[bool] = False
    fits_folds: ClassVar[bool] = False
    may_not_converge: ClassVar[bool] = False
    allows_for_noise: ClassVar[bool] = False
    contest_options: ClassVar[Mapping[str, str]] = {}

    def check_steps(self, iterations: int, tolerance: float = 0.5, such_as: float = 0.5) -> None:
        """Refuse options that allow no step, or a step that ends it that is no share; see :class:`BadOption`."""
        if iterations < 1:
            raise BadOption("iterations", iterations, "give 1 or more")
        if not 0 < tolerance < 1:
            raise BadOption("tolerance", tolerance, f"give a number between 0 and 1, such as {such_as:g}")

    @property
    def prior_pull(self) -> float:
        """How tightly a prior holds where it stands beside the data: a deviation of 1 / sqrt(this) natural sizes."""
        return PULL

    def refit(self, problem: Problem, run: MethodRun | None = None) -> Callable[[Reduced], Array] | None:
        """Return the fit of standard parameters (p,) to a triangle of drawn base parameters or of a part of the logs.

        None where no condition narrows the estimate. What its ``run`` on the whole problem settled is not sought again.
        """
        return None

    @abstractmethod
    def solve(self, problem: Problem) -> Solution:
        """Return the estimate for a problem.

        Raises:
            SolverFailed: The method ended without a checked solution.
        """
