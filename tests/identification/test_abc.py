"""The bee colony against a plain one that evaluates full objectives, and the figures that it reports about itself."""

import json

import numpy as np
import pytest
from random_landscapes import random_landscape

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, Preprocessing
from dynident.data.preprocessing.fourier_fit import FourierFit
from dynident.errors import BadOption
from dynident.identification.estimators.abc import ArtificialBeeColony
from dynident.identification.problem.problem import Problem, make_problem
from dynident.identification.search.colony import Draws, draw, search
from dynident.identification.search.landscape import Landscape, absolute_landscape, box_optimum, square_landscape
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.reduction import least_squares


def prepared(log: Log, standstill: float = 0.0) -> Prepared:
    """A log whose derivatives are exact already: all rows count but those at rest."""
    return Prepared(log, np.arange(log.samples), Preprocessing(FourierFit(1.0), standstill=standstill))


@pytest.fixture(scope="module")
def problem(spatial_3r, exact_log) -> Problem:
    model = DynamicModel(spatial_3r, (Coulomb(), Viscous()))
    theta = np.concatenate([spatial_3r.nominal, np.tile([3.0, 5.0], 3)])
    log = exact_log(model, theta, noise=np.array([2.0, 1.0, 0.5]), samples=300)
    return make_problem(model, base_parameters(model), [prepared(log)])


def residuals_of(problem: Problem, beta: Array, part: int = 0) -> Array:
    """Measured less predicted torque of one log by the full regressor, shape (N, n)."""
    log = problem.logs[part].log
    assert log.dq is not None and log.ddq is not None and log.torque is not None
    motion = Motion(log.q, log.dq, log.ddq)
    rows = problem.model.regressor(motion)[..., problem.base.independent]
    return log.torque - problem.model.known_torque(motion) - rows @ beta


# The algorithm


class PlainColony:
    """Karaboga's algorithm in words of NumPy: every trial evaluates the whole objective, nothing is kept."""

    def __init__(self, land: Landscape, lower: Array, upper: Array, colony: int, limit: int, seed: int) -> None:
        self.land, self.lower, self.upper, self.limit = land, lower, upper, limit
        self.generator = np.random.default_rng(seed)
        self.sources = colony // 2
        x = lower + self.generator.random((colony, len(lower))) * (upper - lower)
        values = np.array([land.value(one) for one in x])
        chosen = np.argsort(values, kind="stable")[: self.sources]
        self.x, self.values = x[chosen], values[chosen]
        self.trials = np.zeros(self.sources, int)
        self.best, self.scouts = float(self.values.min()), 0

    def visit(self, i: int, dice: Array) -> None:
        j = int(dice[1] * len(self.lower))
        others = [k for k in range(self.sources) if k != i]
        k = others[int(dice[2] * len(others))]
        trial = self.x[i].copy()
        trial[j] += (2 * dice[3] - 1) * (self.x[i, j] - self.x[k, j])
        trial = np.clip(trial, self.lower, self.upper)
        value = self.land.value(trial)
        if value < self.values[i]:
            self.x[i], self.values[i], self.trials[i] = trial, value, 0
        else:
            self.trials[i] += 1

    def cycle(self, moves: Array, scout: Array) -> float:
        for i in range(self.sources):
            self.visit(i, moves[i])
        fitness = 1 / (1 + self.values)
        share = np.cumsum(fitness / fitness.sum())
        for bee in range(self.sources, 2 * self.sources):
            fitness = 1 / (1 + self.values)
            self.visit(min(int(np.searchsorted(share, moves[bee, 0], side="right")), self.sources - 1), moves[bee])
        self.best = min(self.best, float(self.values.min()))
        idle = int(np.argmax(self.trials))
        if self.trials[idle] > self.limit:
            self.x[idle] = self.lower + scout * (self.upper - self.lower)
            self.values[idle], self.trials[idle] = self.land.value(self.x[idle]), 0
            self.scouts += 1
        return self.best

    def run(self, cycles: int) -> list[float]:
        trace = []
        for draws in draw(self.generator, cycles, self.sources, len(self.lower)):
            trace += [self.cycle(moves, scout) for moves, scout in zip(draws.moves, draws.scouts, strict=True)]
        return trace


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize(
    ("rows", "colony", "limit", "cycles"), [((60, 41, 7), 10, 3, 300), ((5000, 8300), 6, 15, 40), ((1,), 4, 1, 30)]
)
def test_the_compiled_colony_is_the_plain_one(power, rows, colony, limit, cycles):
    """Same random numbers, same path: trial by trial, through scouts, refreshed residuals and early ends of sums."""
    land = random_landscape(power, rows)
    lower, upper = np.full(5, -5.0), np.array([5.0, 4.0, 3.0, 5.0, 6.0])
    plain = PlainColony(land, lower, upper, colony, limit, seed=7)
    trace = plain.run(cycles)
    swarm = search(land, lower, upper, colony, limit, cycles, seed=7)
    np.testing.assert_allclose(swarm.trace, trace, rtol=1e-9)
    assert swarm.scouts == plain.scouts
    assert swarm.evaluations == colony + colony * cycles + plain.scouts
    assert swarm.objective == pytest.approx(land.value(swarm.x), rel=1e-12)
    if limit == 3:
        assert plain.scouts > 50


def test_residuals_do_not_drift_in_a_long_run():
    land = random_landscape(1, (40, 20))
    swarm = search(land, np.full(5, -5.0), np.full(5, 5.0), 10, 100, 5000, seed=1)
    assert swarm.trace[-1] == pytest.approx(swarm.objective, rel=1e-12)
    assert np.all(np.diff(swarm.trace) <= 0)
    best = box_optimum(land, np.full(5, -5.0), np.full(5, 5.0))
    assert best.lower_bound <= swarm.objective < 1.01 * best.objective  # with iterations enough it does converge


def test_random_numbers_do_not_depend_on_how_they_are_drawn():
    def stream(cycles: int) -> list[Draws]:
        return list(draw(np.random.default_rng(3), cycles, 2, 3))

    short, long = stream(256), stream(600)
    np.testing.assert_array_equal(short[0].moves, long[0].moves)
    assert [len(part.moves) for part in long] == [256, 256, 88]
    assert long[2].moves.shape == (88, 4, 4) and long[2].scouts.shape == (88, 3)


# The objective


def test_the_absolute_objective_is_equation_9(problem):
    delta = np.array([1.0, 0.5, 0.25])
    beta = np.random.default_rng(0).uniform(-3, 3, problem.base.count)
    land = absolute_landscape(problem, delta)
    residual = residuals_of(problem, beta)
    assert land.value(beta) == pytest.approx(np.mean(np.abs(residual) @ delta), rel=1e-12)
    assert not land.columns[~np.repeat(land.present, np.diff(land.edges), axis=1)].any()


def test_the_square_objective_needs_no_rows(problem):
    delta = np.array([1.0, 0.5, 0.25])
    beta = np.random.default_rng(0).uniform(-3, 3, problem.base.count)
    land = square_landscape(problem, delta)
    assert land.columns.shape == (problem.base.count, problem.base.count)
    assert land.value(beta) == pytest.approx(np.mean(residuals_of(problem, beta) ** 2 @ delta), rel=1e-10)


def test_rows_at_rest_and_several_logs(coupled_arm, exact_log):
    """Rows that do not count are left out of the sum; logs follow each other within a joint's block."""
    model = DynamicModel(coupled_arm, (Coulomb(), Viscous()))
    theta = np.concatenate([coupled_arm.nominal, np.ones(6)])
    logs = [prepared(exact_log(model, theta, 0.5, seed, samples), 0.3) for seed, samples in ((0, 400), (1, 250))]
    problem = make_problem(model, base_parameters(model), logs)
    assert all(0.3 < mask.mean() < 1.0 for mask in problem.masks)
    beta = np.random.default_rng(2).uniform(-1, 1, problem.base.count)
    delta = np.array([1.0, 2.0, 3.0])
    sums = [np.sum((np.abs(residuals_of(problem, beta, k)) * delta)[mask]) for k, mask in enumerate(problem.masks)]
    assert absolute_landscape(problem, delta).value(beta) == pytest.approx(sum(sums) / 650, rel=1e-12)
    squares = [np.sum((residuals_of(problem, beta, k) ** 2 * delta)[mask]) for k, mask in enumerate(problem.masks)]
    assert square_landscape(problem, delta).value(beta) == pytest.approx(sum(squares) / 650, rel=1e-10)


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_least_squares_in_a_box_is_certified(problem, share):
    land = square_landscape(problem, np.ones(3))
    free = least_squares(problem.reduced()).beta
    half = 2 * share * np.abs(free)
    found = box_optimum(land, -half, half)
    assert found.lower_bound <= found.objective * (1 + 1e-12)
    assert found.objective - found.lower_bound <= 1e-6 * found.objective
    if share == 1.0:
        np.testing.assert_allclose(found.x, free, rtol=1e-8)
    else:  # the conditions of Karush, Kuhn and Tucker: no way down inside the box
        for j in range(len(free)):
            for step in (-1e-4, 1e-4):
                moved = found.x.copy()
                moved[j] = np.clip(moved[j] + step * half[j], -half[j], half[j])
                assert land.value(moved) >= found.objective * (1 - 1e-12)
        assert np.sum(np.abs(found.x) >= half * (1 - 1e-9)) > 3


# The estimator


@pytest.mark.parametrize("norm", ["l1", "l2"])
def test_what_the_colony_says_of_itself(problem, norm):
    solution = ArtificialBeeColony(norm=norm, seed=2).solve(problem)
    run = solution.run
    residual = residuals_of(problem, solution.beta)
    objective = np.mean(np.sum(np.abs(residual) if norm == "l1" else residual**2, axis=1))
    assert run.objective == pytest.approx(objective, rel=1e-9)
    assert len(run.trace) == 50 and np.all(np.diff(run.trace) <= 0)
    assert run.trace[-1] == pytest.approx(objective, rel=1e-9)
    assert run.lower_bound <= run.optimum <= run.objective
    assert run.gap == pytest.approx(run.objective / run.optimum - 1, rel=1e-12)
    assert run.evaluations == 30 + 50 * 30 + run.scouts
    assert run.settings["colony"] == 30 and run.settings["norm"] == norm
    assert run.gap > 0.05  # the published settings do not converge, and say so
    np.testing.assert_allclose(solution.weights, 1 / problem.joint_deviations(solution.beta))
    assert json.loads(json.dumps(run.data())) == run.data()


def test_the_default_box_follows_least_squares(problem):
    run = ArtificialBeeColony().solve(problem).run
    fit = least_squares(problem.reduced())
    residual = residuals_of(problem, fit.beta)
    sigma = np.sqrt(np.sum(residual**2) / (residual.size - problem.base.count) * np.diag(fit.unscaled_covariance))
    np.testing.assert_allclose(run.box["upper"], 5 * np.abs(fit.beta) + 5 * sigma, rtol=1e-8)
    np.testing.assert_array_equal(run.box["lower"], -np.array(run.box["upper"]))
    assert run.box["source"].startswith("+-5 times the size of the least-squares estimate")
    assert run.at_bound == []


def test_a_given_box_holds_and_what_it_holds_back_is_named(problem):
    half = 5 * np.abs(least_squares(problem.reduced()).beta) + 1
    upper = half.copy()
    upper[-1] = 0.5  # Fv of joint 3 is 5
    solution = ArtificialBeeColony(lower=tuple(-half), upper=tuple(upper)).solve(problem)
    assert np.all(solution.beta >= -half) and np.all(solution.beta <= upper)
    assert solution.run.at_bound == ["Fv[joint3]"]
    assert solution.run.box["source"] == "as given"


def test_noise_free_data_have_no_relative_gap(spatial_3r, exact_log):
    model = DynamicModel(spatial_3r, (Coulomb(), Viscous()))
    log = exact_log(model, np.concatenate([spatial_3r.nominal, np.zeros(6)]))
    exact = make_problem(model, base_parameters(model), [prepared(log)])
    for norm in ("l1", "l2"):
        run = ArtificialBeeColony(norm=norm, iterations=5).solve(exact).run
        assert run.gap is None
        assert run.optimum < 1e-6 * run.objective


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"colony": 31}, "colony = 31 is not possible; give an even number, 4 or more"),
        ({"colony": 2}, "colony = 2 is not possible; give an even number, 4 or more"),
        ({"limit": 0}, "limit = 0 is not possible; give 1 or more"),
        ({"iterations": 0}, "iterations = 0 is not possible; give 1 or more"),
        ({"seed": -1}, "seed = -1 is not possible; give 0 or more"),
        ({"norm": "l3"}, "norm = 'l3' is not possible; choose l1 or l2"),
    ],
)
def test_options_that_cannot_be(options, message):
    with pytest.raises(BadOption) as caught:
        ArtificialBeeColony(**options)
    assert str(caught.value) == message


def test_boxes_and_weights_that_do_not_fit(problem):
    count = problem.base.count

    def message(**options: object) -> str:
        with pytest.raises(BadOption) as caught:
            ArtificialBeeColony(**options).solve(problem)  # type: ignore[arg-type]
        return str(caught.value)

    assert message(lower=(0.0, 1.0)) == (
        f"lower = (0.0, 1.0) is not possible; give one finite number for each of the {count} base parameters"
    )
    assert message(upper=(np.inf,) * count).endswith(f"give one finite number for each of the {count} base parameters")
    name = problem.base.parameters[problem.base.independent[0]].name
    assert message(lower=(2.0,) * count, upper=(1.0,) * count) == (
        f"lower = 2.0 is not possible; the bound of {name} must be below its upper one, 1"
    )
    assert message(delta=(1.0, -1.0, 0.0)) == (
        "delta = (1.0, -1.0, 0.0) is not possible; give one weight >= 0 for each of the 3 joints, one above 0"
    )
