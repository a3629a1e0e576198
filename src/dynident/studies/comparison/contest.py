"""One contest of estimators: the problem that all are given, and what each comes to."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import stats

from dynident.applications.standstill import counted_at_rest, with_rest
from dynident.arrays import Array, finite, plain
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared
from dynident.diagnosis.culprit import culprit
from dynident.errors import DynidentError
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.identification.estimators import Estimator
from dynident.identification.estimators.wls import WLS
from dynident.identification.fit import fit
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.problem import Problem
from dynident.identification.uncertainty.position_noise import without_noise
from dynident.identification.validate import validate_prepared

#: Share of the torque below which the residual of weighted least squares is rounding.
_EXACT = 1e-9

#: Blocks of consecutive test rows by which two methods are told apart.
BLOCKS = 10

#: Level of that test.
_LEVEL = 0.05

#: Share of an error that nobody can use.
_SMALL = 0.01

#: What a method says of the work it took, in the order in which it is shown.
EFFORTS = ("iterations", "simulations", "evaluations")


@dataclass(frozen=True)
class Method:
    """An estimator with its options, and what it is called in the table.

    Attributes:
        label: Such as ``huber`` or ``huber:bound=2``.
        part: The estimator.
    """

    label: str
    part: Estimator


@dataclass(frozen=True)
class Outcome:
    """What one method came to.

    Attributes:
        method: Its label.
        seconds: Time in s of the solution, its first use's compilation included; of the attempt where it failed.
        estimate: The estimate; None where it failed.
        test: Its figures on logs that the fit has not seen; None where there are none, or where it failed.
        above: By what share the weighted residual norm is above that of weighted least squares, whose weights count;
            0 or more. NaN where the method failed.
        worst: Link or coefficient that is furthest from the possible; empty for a possible robot.
        parameter_error: |D (beta - truth)| / |D truth|, D the norms of the columns of the observation matrix; None
            where the truth is not known, or where the method failed.
        failure: Why there is no estimate, in words; empty where there is one.
    """

    method: str
    seconds: float
    estimate: Estimate | None = None
    test: Validation | None = None
    above: float = float("nan")
    worst: str = ""
    parameter_error: float | None = None
    failure: str = ""

    @property
    def figure(self) -> float:
        """The figure that ranks: held-out relative error, training error without test logs, infinite for a failure."""
        if self.estimate is None:
            return float("inf")
        error = (self.test or self.estimate.train).total_relative_error
        return error if np.isfinite(error) else float("inf")

    @property
    def effort(self) -> dict[str, int]:
        """Iterations, simulations and evaluations that the method tells of; those it does not tell of are missing."""
        run = MethodRun() if self.estimate is None else self.estimate.run
        found = {name: getattr(run, name) for name in EFFORTS if getattr(run, name) is not None}
        searched = run.evaluations is not None and run.trace is not None
        return {"iterations": len(run.trace or ()), **found} if searched else found

    @property
    def verdict(self) -> str:
        """What the method says of its own end, where that is not a plain success; empty where it says nothing."""
        verdict = None if self.estimate is None else self.estimate.run.verdict
        words = [] if verdict in (None, "converged") else [str(verdict)]
        if self.estimate is not None and self.estimate.choices.constraints_not_kept:
            words.append("does not keep the stated constraints")
        return "; ".join(words)

    def figures(self) -> dict[str, Any]:
        """Return everything but the signals as plain data for JSON; a figure that does not exist is None."""
        estimate, test, efforts = self.estimate, self.test, self.effort
        return {
            "method": self.method,
            "failure": self.failure or None,
            "estimator": None if estimate is None else estimate.estimator,
            "options": None if estimate is None else plain(estimate.options),
            "test_error": None if test is None else finite(test.total_relative_error),
            "training_error": None if estimate is None else finite(estimate.train.total_relative_error),
            "above_weighted_least_squares": finite(self.above),
            "parameter_error": self.parameter_error,
            "physically_consistent": None if estimate is None else estimate.consistency.consistent,
            "worst": self.worst or None,
            **{name: efforts.get(name) for name in EFFORTS},
            "seconds": self.seconds,
            "verdict": self.verdict or None,
            "joints": [] if test is None else test.figures()["joints"],
            "values": [] if estimate is None else estimate.beta.tolist(),
            "std": [] if estimate is None else [finite(float(value)) for value in estimate.std],
        }


@dataclass(frozen=True)
class Contest:
    """What every method is given, and what it is measured by.

    Attributes:
        problem: The problem.
        tests: Logs that the fit has not seen, prepared as those of the problem.
        truth: Standard parameters behind the logs, shape (p,); None where they are not known.
        logs: Raw logs of the problem, so that intervals allow for noise of their positions; none where they need not.
    """

    problem: Problem
    tests: tuple[Prepared, ...] = ()
    truth: Array | None = None
    logs: tuple[Log, ...] = ()

    @cached_property
    def weights(self) -> Array:
        """Weights of weighted least squares, shape (n,), 1 / N m."""
        return WLS().solve(self.problem).weights

    @cached_property
    def least(self) -> float:
        """Least weighted residual norm that any base parameters have; 0 where it is rounding."""
        reduced = self.problem.reduced(self.weights)
        rest = float(np.sqrt(reduced.rest))
        return rest if rest > _EXACT * float(np.linalg.norm(reduced.z)) else 0.0

    @cached_property
    def truth_error(self) -> float | None:
        """Error of the known truth on the test logs: their noise, and what the filter leaves of it; None without."""
        if self.truth is None or not self.tests:
            return None
        problem = self.problem
        known = problem.base.from_standard(self.truth)
        found = validate_prepared(problem.model, problem.base, self.tests, known)
        return counted_at_rest(problem.model, self.truth, found, self.tests).total_relative_error

    def attempt(self, method: Method) -> Outcome:
        """Return what a method comes to; a failure is an outcome as well, whatever it is."""
        started = time.perf_counter()
        try:
            return self._measured(method)
        except DynidentError as error:
            failure = " ".join(str(error).split())
        except Exception as error:  # a fault of one part must not take the figures of the others with it
            failure = f"{type(error).__name__}: {' '.join(str(error).split())}"
        return Outcome(method.label, time.perf_counter() - started, failure=failure)

    def _measured(self, method: Method) -> Outcome:
        problem = self.problem
        estimate = fit(problem, method.part)
        norm = float(np.sqrt(self.weights**2 @ problem.residual_squares(estimate.beta)))
        if self.logs:
            estimate, _ = without_noise(estimate, problem, method.part, self.logs, fit)
        estimate = replace(estimate, train=with_rest(estimate, estimate.train, problem.logs))
        beta = estimate.beta
        possible = estimate.consistency.consistent
        return Outcome(
            method=method.label,
            seconds=estimate.run.seconds or 0.0,
            estimate=estimate,
            test=self._tested(estimate) if self.tests else None,
            above=max(norm / self.least - 1.0, 0.0) if self.least > 0 else float("nan"),
            worst="" if possible else culprit(problem.model, problem.base, beta, estimate.theta),
            parameter_error=None if self.truth is None else self._error(beta, self.truth),
        )

    def _tested(self, estimate: Estimate) -> Validation:
        problem = self.problem
        found = validate_prepared(problem.model, problem.base, self.tests, estimate.beta)
        return with_rest(estimate, found, self.tests)

    def _error(self, beta: Array, truth: Array) -> float:
        norms = self.problem.reduced().column_norms
        known = self.problem.base.from_standard(truth)
        return float(np.linalg.norm(norms * (beta - known)) / np.linalg.norm(norms * known))


def like_the_best(test: Validation, best: Validation) -> bool:
    """Return whether the difference of two methods on the same test rows is below 1 % of the error, or may be chance.

    The t-test, at 5 %, of the differences of their squared errors summed over blocks of consecutive rows: blocks, since
    neighbouring rows err alike, differences, since both err with the same noise (Diebold and Mariano 1995).
    """
    squares = [np.sum(found.residual**2, axis=1) for found in (test, best)]
    totals = [float(np.sqrt(square.sum())) for square in squares]
    if abs(totals[0] - totals[1]) <= _SMALL * totals[1] or len(squares[0]) < BLOCKS:
        return True
    blocks = np.array([block.sum() for block in np.array_split(squares[0] - squares[1], BLOCKS)])
    error = float(np.std(blocks, ddof=1)) / np.sqrt(BLOCKS)
    return bool(abs(float(blocks.mean())) <= stats.t.ppf(1.0 - 0.5 * _LEVEL, BLOCKS - 1) * error)
