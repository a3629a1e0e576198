"""compare: one problem for all, a failure is a line, the order is that of unseen logs, processes change nothing."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.diagnosis.culprit import culprit
from dynident.errors import BadOption, LogMismatch, SolverFailed
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.estimators.wls import WLS
from dynident.identification.identify import identify
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.problem import Problem
from dynident.identification.validate import validate, validate_prepared
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.robot import Robot
from dynident.studies.comparison.compare import compare, contest_of, ranked
from dynident.studies.comparison.contest import Contest, Method, Outcome, like_the_best

GIVEN = Preprocessing(AsGiven(), rest="keep")


@dataclass(frozen=True)
class Failing(Estimator):
    """Fails as it is told."""

    kind: str

    def solve(self, problem: Problem) -> Solution:
        if self.kind == "named":
            raise SolverFailed("this method", "no luck", "take\nanother one")
        if self.kind == "endless":
            time.sleep(600)
        if self.kind == "dead":
            raise SystemExit(7)
        if self.kind == "nan":
            return Solution(np.full(problem.base.count, np.nan), np.ones(len(problem.triangles)))
        raise ZeroDivisionError("1 / 0")


@dataclass(frozen=True)
class Shifted(Estimator):
    """Least squares with one parameter changed."""

    index: int
    by: float

    def solve(self, problem: Problem) -> Solution:
        found = WLS().solve(problem)
        return replace(found, beta=found.beta + self.by * (np.arange(len(found.beta)) == self.index))


@dataclass(frozen=True)
class Signals:
    """What a comparison of two methods looks at."""

    residual: Array


@pytest.fixture(scope="module")
def model(planar_2r: Robot) -> DynamicModel:
    return DynamicModel(planar_2r, (Coulomb(), Viscous()))


@pytest.fixture(scope="module")
def theta(model: DynamicModel) -> Array:
    assert model.robot.nominal is not None
    return np.append(model.robot.nominal, [0.5, 0.3, 0.4, 0.2])


@pytest.fixture(scope="module")
def contest(model: DynamicModel, theta: Array, exact_log: Callable[..., Log]) -> Contest:
    train, test = (exact_log(model, theta, noise=0.3, seed=seed, size=size) for seed, size in ((0, 1.0), (1, 0.7)))
    return contest_of(build_problem(model, [train], GIVEN), [test], theta)


def methods(*names: str) -> list[Method]:
    made = {"consistent": Consistent(bodies="free")}  # a contest keeps no free fit beside that with bounds
    return [Method(name, made.get(name) or ESTIMATORS.make(name)) for name in names]


def test_every_method_has_the_figures_of_identify_and_validate(
    contest: Contest, model: DynamicModel, theta: Array, exact_log: Callable[..., Log]
) -> None:
    steps: list[str] = []
    asked = methods("ols", "wls", "consistent")
    outcomes = list(compare(contest, asked, progress=steps.append))
    assert steps == ["ols (1 of 3)", "wls (2 of 3)", "consistent (3 of 3)"]
    train, test = (exact_log(model, theta, noise=0.3, seed=seed, size=size) for seed, size in ((0, 1.0), (1, 0.7)))
    for method, outcome in zip(asked, outcomes, strict=True):
        estimate = identify(model, [train], method.part, GIVEN)
        assert outcome.estimate is not None and outcome.test is not None and not outcome.failure
        np.testing.assert_array_equal(outcome.estimate.beta, estimate.beta)
        expected = validate(estimate, [test])
        assert outcome.test.figures() | {"bands": []} == expected.figures() | {"bands": []}  # a contest draws none
        assert outcome.figure == expected.total_relative_error
        columns = np.linalg.norm(contest.problem.rows.matrix, axis=0)
        truth = contest.problem.base.from_standard(theta)
        size = np.linalg.norm(columns * truth)
        expected_error = np.linalg.norm(columns * (estimate.beta - truth)) / size
        assert outcome.parameter_error == pytest.approx(expected_error, rel=1e-9)


def test_weighted_least_squares_is_the_reference(contest: Contest) -> None:
    found = {outcome.method: outcome for outcome in compare(contest, methods("ols", "wls", "consistent"))}
    rows, weights = contest.problem.rows, contest.weights
    assert found["wls"].above < 1e-6 and found["ols"].above >= 0
    for outcome in found.values():
        assert outcome.estimate is not None
        residual = weights[rows.joint] * (rows.torque - rows.matrix @ outcome.estimate.beta)
        assert 1 + outcome.above == pytest.approx(np.linalg.norm(residual) / contest.least, abs=1e-9)


def test_a_failure_is_a_line_with_its_reason_and_stops_nobody(contest: Contest) -> None:
    bad = [Method(kind, Failing(kind)) for kind in ("named", "crash", "nan")]
    outcomes = list(compare(contest, [*bad, *methods("wls")]))
    assert [outcome.failure for outcome in outcomes] == [
        "this method found no solution: no luck; take another one",
        "ZeroDivisionError: 1 / 0",
        "LinAlgError: SVD did not converge",
        "",
    ]
    table = ranked(outcomes)
    assert [outcome.method for outcome in table] == ["wls", "named", "crash", "nan"]
    assert table[-1].figure == np.inf and table[-1].figures()["test_error"] is None


def test_the_order_is_that_of_the_logs_not_seen(contest: Contest) -> None:
    worse = [Method(f"by {by}", Shifted(0, by)) for by in (0.5, 0.1, 1.0)]
    outcomes = ranked(list(compare(contest, [*worse, *methods("wls")])))
    assert [outcome.method for outcome in outcomes] == ["wls", "by 0.1", "by 0.5", "by 1.0"]
    errors = [outcome.test.total_relative_error for outcome in outcomes if outcome.test]
    assert errors == sorted(errors)
    without = replace(contest, tests=())
    trained = ranked(list(compare(without, [*worse, *methods("wls")])))
    assert [outcome.method for outcome in trained] == ["wls", "by 0.1", "by 0.5", "by 1.0"]
    assert all(outcome.test is None for outcome in trained)


def test_chance_is_told_from_a_difference(contest: Contest, theta: Array) -> None:
    asked = [*methods("wls", "consistent"), Method("near", Shifted(0, 1e-4)), Method("worse", Shifted(0, 0.5))]
    found = {outcome.method: outcome for outcome in compare(contest, asked)}
    best = found["wls"].test
    assert best is not None
    tests = {name: outcome.test for name, outcome in found.items() if outcome.test is not None}
    assert {name: like_the_best(test, best) for name, test in tests.items()} == {
        "wls": True,
        "consistent": True,
        "near": True,
        "worse": False,
    }
    base = contest.problem.base
    expected = validate_prepared(contest.problem.model, base, contest.tests, base.from_standard(theta))
    assert contest.truth_error == expected.total_relative_error
    assert replace(contest, truth=None).truth_error is None and replace(contest, tests=()).truth_error is None


def test_chance_makes_a_difference_as_rarely_as_stated() -> None:
    """Two methods of the same quality are told apart in one of twenty sets of white errors."""
    generator = np.random.default_rng(0)
    told = 0
    for _ in range(400):
        errors = generator.normal(size=(2, 200, 2))
        one, other = (Signals(error) for error in errors)
        told += not like_the_best(one, other)  # type: ignore[arg-type]
    assert 6 <= told <= 36


def test_an_impossible_estimate_names_its_culprit(contest: Contest, model: DynamicModel, theta: Array) -> None:
    base = contest.problem.base
    names = list(base.names)
    friction = names.index("Fv[joint2]")
    inertia = next(k for k, name in enumerate(names) if name.startswith("Izz[link2]"))
    outcomes = list(compare(contest, [Method("Fv", Shifted(friction, -2.0)), Method("Izz", Shifted(inertia, -3.0))]))
    assert [outcome.worst for outcome in outcomes] == ["Fv[joint2]", "link2"]
    assert culprit(model, base, base.from_standard(theta)) == ""
    assert culprit(model, base, base.from_standard(theta), theta) == ""
    body = theta.copy()
    body[10 + 9] = -0.1  # the mass of link 2
    assert culprit(model, base, base.from_standard(body), body) == "link2"
    body = theta.copy()
    body[-1] = -5.0
    assert culprit(model, base, base.from_standard(body), body) == "Fv[joint2]"


def test_work_and_verdict_are_what_the_method_says(contest: Contest) -> None:
    parts = [Method("de", ESTIMATORS.make("de", {"iterations": 3})), *methods("wls", "log_cholesky")]
    found = {outcome.method: outcome for outcome in compare(contest, parts)}
    assert found["de"].effort["iterations"] == 3 and found["de"].effort["evaluations"] > 3
    assert set(found["wls"].effort) == {"iterations"}
    assert found["wls"].verdict == "" and found["wls"].figures()["simulations"] is None


def test_an_exact_fit_has_no_share_above(model: DynamicModel, theta: Array, exact_log: Callable[..., Log]) -> None:
    exact = contest_of(build_problem(model, [exact_log(model, theta)], GIVEN), (), theta)
    (outcome,) = compare(exact, methods("wls"))
    assert np.isnan(outcome.above) and outcome.figures()["above_weighted_least_squares"] is None
    assert outcome.parameter_error is not None and outcome.parameter_error < 1e-9


def test_samples_at_rest_count_by_what_static_friction_cannot_hold(
    model: DynamicModel, theta: Array, exact_log: Callable[..., Log]
) -> None:
    log = exact_log(model, theta, samples=600)
    still = replace(log, q=np.tile(log.q[-1], (len(log.q), 1)), dq=0 * log.q, ddq=0 * log.q, time=log.time)
    held = model.torque(Motion(still.q, still.dq, still.ddq), theta)  # type: ignore[arg-type]
    how = replace(GIVEN, rest="mask", standstill=0.02)
    contest = contest_of(build_problem(model, [log], how), [log, replace(still, torque=held + 0.1)], truth=theta)
    (outcome,) = compare(contest, [Method("wls", WLS())])
    assert outcome.test is not None and outcome.test.rests and outcome.test.held is not None
    assert outcome.test.total_relative_error < 1e-6 and contest.truth_error == pytest.approx(0.0, abs=1e-6)
    beyond = contest_of(build_problem(model, [log], how), [replace(still, torque=held + 100.0)], truth=theta)
    assert beyond.truth_error is not None and beyond.truth_error > 0.5


def test_a_test_log_without_torques_is_refused(
    contest: Contest, model: DynamicModel, theta: Array, exact_log: Callable[..., Log]
) -> None:
    with pytest.raises(LogMismatch, match="no torques to compare with"):
        contest_of(contest.problem, [replace(exact_log(model, theta), torque=None)])


@pytest.mark.parametrize(("limit", "jobs"), [(0.0, 1), (float("nan"), 1), (None, 0)])
def test_rules_that_cannot_be_are_refused(contest: Contest, limit: float | None, jobs: int) -> None:
    with pytest.raises(BadOption, match="is not possible; give"):
        list(compare(contest, methods("wls"), time_limit=limit, jobs=jobs))


@pytest.mark.battery
def test_processes_end_what_is_over_time_and_change_no_figure(contest: Contest) -> None:
    asked = [Method("endless", Failing("endless")), Method("dead", Failing("dead")), *methods("wls", "consistent")]
    found = {outcome.method: outcome for outcome in compare(contest, asked, time_limit=3.0, jobs=2)}
    assert found["endless"].failure == "ended at the time limit of 3 s" and found["endless"].seconds >= 3.0
    assert found["dead"].failure == "its process ended with code 7: out of memory?"
    here = {outcome.method: outcome for outcome in compare(contest, methods("wls", "consistent"))}
    for name, outcome in here.items():
        there = found[name].figures()
        assert there | {"seconds": 0} == outcome.figures() | {"seconds": 0}


def test_what_is_done_stays_done_when_the_rest_is_broken_off(contest: Contest) -> None:
    asked = [*methods("wls"), Method("endless", Failing("endless"))]
    outcomes = compare(contest, asked, time_limit=60.0)
    first: Outcome = next(outcomes)
    assert first.method == "wls"
    outcomes.close()  # as Ctrl-C does: every process is ended
