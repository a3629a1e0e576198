"""What callers ask an estimator: they ask the estimator itself, not its name, type or options."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from dynident.data.log import Log
from dynident.data.preprocessing import FILTERS, Preprocessing
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators import Estimator, Solution
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.estimators.wls import WLS
from dynident.identification.fit import fit
from dynident.identification.problem.problem import Problem
from dynident.identification.selection.cross_validation import cross_validate
from dynident.identification.uncertainty.trust import with_diagnostics
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot


@dataclass(frozen=True)
class Guest(Estimator):
    """A consistent fit under another name."""

    inner: Consistent

    fits_folds = True

    @property
    def prior_pull(self) -> float:
        return self.inner.pull

    def refit(self, problem: Problem, run=None):  # type: ignore[no-untyped-def]
        return self.inner.refit(problem, run)

    def solve(self, problem: Problem) -> Solution:
        return self.inner.solve(problem)


@pytest.fixture
def problem(planar_2r: Robot, exact_log: Callable[..., Log]) -> Problem:
    model = DynamicModel(planar_2r, ("viscous",))  # type: ignore[arg-type]
    assert planar_2r.nominal is not None
    log = exact_log(model, np.append(planar_2r.nominal, [0.3, 0.2]), noise=0.3, samples=600, rate=200.0)
    return build_problem(model, [log], Preprocessing(FILTERS.make("as_given"), rest="keep"))


def test_an_estimator_of_another_type_is_treated_as_what_it_says_of_itself(problem: Problem) -> None:
    own, guest = Consistent(pull=0.1), Guest(Consistent(pull=0.1))
    estimate = fit(problem, own)
    ours, theirs = (with_diagnostics(estimate, problem, part, 3, 40) for part in (own, guest))
    assert ours.diagnostics is not None and theirs.diagnostics is not None
    assert theirs.diagnostics["bootstrap"] == ours.diagnostics["bootstrap"]
    assert theirs.diagnostics["bootstrap"]["kind"] == "refit"
    np.testing.assert_array_equal(theirs.standard_deviations, ours.standard_deviations)
    wider = with_diagnostics(estimate, problem, Consistent(pull=0.001), 0)
    assert np.all(np.asarray(wider.standard_deviations) >= np.asarray(ours.standard_deviations) - 1e-12)


def test_an_estimator_that_fits_no_folds_leaves_them_to_weighted_least_squares(problem: Problem) -> None:
    beta = WLS().solve(problem).beta
    assert cross_validate(problem, Guest(Consistent()), beta, 3).relative_error == pytest.approx(
        cross_validate(problem, Consistent(), beta, 3).relative_error, rel=1e-12
    )


def test_a_free_estimator_has_no_refit(problem: Problem) -> None:
    found = with_diagnostics(fit(problem, WLS()), problem, WLS(), 0, 40).diagnostics
    assert WLS().refit(problem) is None and found is not None and found["bootstrap"]["kind"] == "blocks"
