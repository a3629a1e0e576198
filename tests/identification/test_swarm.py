"""Searches of a box: the same path as a plain loop, laws of the moves, the rules that end them, what they report."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_landscapes import random_landscape
from scipy.stats import kstest

from dynident.arrays import Array
from dynident.data.preprocessing import Prepared, Preprocessing
from dynident.data.preprocessing.fourier_fit import FourierFit
from dynident.errors import BadOption
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.estimators.abc import ArtificialBeeColony
from dynident.identification.estimators.de import DifferentialEvolution, three_others
from dynident.identification.estimators.ga import GeneticAlgorithm, crossed, mutated, winners
from dynident.identification.estimators.pso import ParticleSwarm
from dynident.identification.problem.problem import Problem, make_problem
from dynident.identification.search import colony
from dynident.identification.search.box_search import BoxSearch
from dynident.identification.search.landscape import (
    Landscape,
    Optimum,
    absolute_landscape,
    box_optimum,
    square_landscape,
)
from dynident.identification.search.population import values
from dynident.identification.search.swarm import Ground, Rules, Stage, run
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.reduction import least_squares

NAMES = ("abc", "de", "ga", "pso")
LOWER, UPPER = np.full(5, -5.0), np.array([5.0, 4.0, 3.0, 5.0, 6.0])


@pytest.fixture(scope="module")
def problem(planar_2r, exact_log) -> Problem:
    model = DynamicModel(planar_2r, (Coulomb(), Viscous()))
    theta = np.concatenate([planar_2r.nominal, [1.0, 0.5, 1.0, 0.5]])
    log = exact_log(model, theta, noise=np.array([0.5, 0.2]), samples=200)
    whole = Prepared(log, np.arange(log.samples), Preprocessing(FourierFit(1.0), standstill=0.0))
    return make_problem(model, base_parameters(model), [whole])


def made(name: str, **options: object) -> BoxSearch:
    part = ESTIMATORS.make(name, options)
    assert isinstance(part, BoxSearch)
    return part


# The objective of many points


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize(("rows", "columns"), [((700, 41, 7), 5), ((1,), 3), ((256, 300), 9)])
def test_many_points_have_the_values_of_each(power, rows, columns):
    land = random_landscape(power, rows, columns)
    x = np.random.default_rng(1).uniform(-3, 3, (11, columns))
    plain = np.array([land.value(one) for one in x])
    np.testing.assert_allclose(values(land, x), plain, rtol=1e-13)
    bar = np.median(plain) * np.ones(11)
    found = values(land, x, bar)
    worse = plain > bar * (1 + 1e-12)
    assert np.all(np.isinf(found[worse])) and worse.sum() == 5
    np.testing.assert_allclose(found[plain < bar * (1 - 1e-12)], plain[plain < bar * (1 - 1e-12)], rtol=1e-13)
    np.testing.assert_array_equal(values(land, x[3:4]), values(land, x)[3:4])  # the company does not matter


def test_a_joint_without_weight_costs_nothing_and_says_nothing():
    land = random_landscape(1, (60, 41))
    deaf = replace(land, weights=np.array([0.0, 1.0]), target=np.where(np.arange(101) < 60, np.nan, land.target))
    assert values(deaf, np.zeros((1, 5)))[0] == pytest.approx(np.abs(land.target[60:]).sum() + 0.25, rel=1e-13)


# The moves, against loops that evaluate whole objectives one by one


def plain_evolution(part: DifferentialEvolution, land: Landscape) -> Iterator[float]:
    random = np.random.default_rng(part.seed).random
    count, size = part.population, len(LOWER)
    x = LOWER + random((count, size)) * (UPPER - LOWER)
    cost = [land.value(one) for one in x]
    while True:
        dice, back = random((count, 3)), random((count, size))
        share, always = random((count, size)), random(count)
        trials = x.copy()
        for i in range(count):
            left, chosen = [k for k in range(count) if k != i], []
            for k in range(3):
                chosen.append(left.pop(int(dice[i, k] * len(left))))
            a, b, c = chosen
            for j in range(size):
                if share[i, j] < part.crossover or j == int(always[i] * size):
                    mutant = x[a, j] + part.factor * (x[b, j] - x[c, j])
                    bound = min(max(mutant, LOWER[j]), UPPER[j])
                    trials[i, j] = mutant if mutant == bound else x[a, j] + back[i, j] * (bound - x[a, j])
        for i in range(count):
            new = land.value(trials[i])
            if new <= cost[i]:
                x[i], cost[i] = trials[i], new
        yield min(cost)


def plain_flock(part: ParticleSwarm, land: Landscape) -> Iterator[float]:
    random = np.random.default_rng(part.seed).random
    count, size = part.population, len(LOWER)
    x = LOWER + random((count, size)) * (UPPER - LOWER)
    speed = (LOWER + random((count, size)) * (UPPER - LOWER) - x) / 2
    best, cost = x.copy(), [land.value(one) for one in x]
    phi = part.own + part.social
    chi = 2 / abs(2 - phi - np.sqrt(phi**2 - 4 * phi))
    while True:
        own, social, seen, known = random((count, size)), random((count, size)), best.copy(), list(cost)
        for i in range(count):
            ring = [i, (i - 1) % count, (i + 1) % count]
            g = min(range(count) if part.informants == "all" else ring, key=lambda k: known[k])
            for j in range(size):
                pull = own[i, j] * part.own * (seen[i, j] - x[i, j]) + social[i, j] * part.social * (
                    seen[g, j] - x[i, j]
                )
                width = part.largest_speed * (UPPER[j] - LOWER[j])
                speed[i, j] = min(max(chi * (speed[i, j] + pull), -width), width)
                x[i, j] += speed[i, j]
                if not LOWER[j] <= x[i, j] <= UPPER[j]:
                    x[i, j], speed[i, j] = min(max(x[i, j], LOWER[j]), UPPER[j]), 0.0
            if land.value(x[i]) < cost[i]:
                best[i], cost[i] = x[i], land.value(x[i])
        yield min(cost)


def sbx(y1: float, y2: float, low: float, high: float, eta: float, u: float) -> tuple[float, float]:
    """The pair of children as in Deb's description of 2000, number by number."""
    children = []
    for side, room in ((-1, y1 - low), (1, high - y2)):
        beta = 1 + 2 * room / (y2 - y1)
        alpha = 2 - beta ** -(eta + 1)
        spread = (u * alpha) ** (1 / (eta + 1)) if u <= 1 / alpha else (1 / (2 - u * alpha)) ** (1 / (eta + 1))
        children.append(min(max(0.5 * (y1 + y2 + side * spread * (y2 - y1)), low), high))
    return children[0], children[1]


def polynomial(y: float, low: float, high: float, eta: float, u: float) -> float:
    if u < 0.5:
        delta = (2 * u + (1 - 2 * u) * (1 - (y - low) / (high - low)) ** (eta + 1)) ** (1 / (eta + 1)) - 1
    else:
        reach = 1 - (high - y) / (high - low)
        delta = 1 - (2 * (1 - u) + 2 * (u - 0.5) * reach ** (eta + 1)) ** (1 / (eta + 1))
    return min(max(y + delta * (high - low), low), high)


def plain_genes(part: GeneticAlgorithm, land: Landscape) -> Iterator[float]:
    random = np.random.default_rng(part.seed).random
    count, size, half = part.population, len(LOWER), part.population // 2
    x = LOWER + random((count, size)) * (UPPER - LOWER)
    cost = [land.value(one) for one in x]
    while True:
        dice = (random((count, part.tournament)) * count).astype(int)
        parents = [x[min(drawn, key=lambda k: cost[k])] for drawn in dice]
        pairs, each = random((half, 1)), random((half, size))
        spread, swap = random((half, size)), random((half, size))
        chance, strength = random((count, size)), random((count, size))
        children = np.array(parents)
        for i in range(half):
            for j in range(size):
                low, high = sorted((parents[i][j], parents[i + half][j]))
                if pairs[i, 0] < part.crossover and each[i, j] < 0.5:
                    if high - low > 1e-14 * (UPPER[j] - LOWER[j]):
                        low, high = sbx(low, high, LOWER[j], UPPER[j], part.crossover_index, spread[i, j])
                    children[i, j], children[i + half, j] = (high, low) if swap[i, j] < 0.5 else (low, high)
        for i, j in zip(*np.nonzero(chance < 1 / size), strict=True):
            children[i, j] = polynomial(children[i, j], LOWER[j], UPPER[j], part.mutation_index, strength[i, j])
        new = [land.value(one) for one in children]
        old = sorted(range(count), key=lambda k: cost[k])[: part.elites]
        born = sorted(range(count), key=lambda k: new[k])[: count - part.elites]
        x = np.array([x[k] for k in old] + [children[k] for k in born])
        cost = [cost[k] for k in old] + [new[k] for k in born]
        yield min(cost)


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize(
    ("part", "plain"),
    [
        (DifferentialEvolution(population=12), plain_evolution),
        (DifferentialEvolution(population=4, factor=1.7, crossover=0.0), plain_evolution),
        (ParticleSwarm(population=12), plain_flock),
        (ParticleSwarm(population=7, informants="ring", own=1.5, social=3.0, largest_speed=0.1), plain_flock),
        (GeneticAlgorithm(population=12), plain_genes),
        (GeneticAlgorithm(population=8, elites=3, tournament=4, crossover_index=2.5, mutation_index=7.5), plain_genes),
    ],
    ids=["de", "de-few", "pso", "pso-ring", "ga", "ga-few"],
)
def test_a_search_takes_the_path_of_a_plain_loop(part, plain, power):
    land = random_landscape(power, (60, 41, 7))
    part = replace(part, iterations=40, seed=3)
    loop = plain(part, land)
    trace = part.search(land, LOWER, UPPER).trace
    np.testing.assert_allclose(trace, [next(loop) for _ in range(40)], rtol=1e-7)
    assert trace[-1] < 0.7 * trace[0]


@given(st.integers(4, 9), st.integers(0, 2**32 - 1))
def test_three_others_are_three_others(count, seed):
    picked = np.column_stack([np.arange(count), *three_others(np.random.default_rng(seed).random((count, 3)))])
    assert all(len(set(row)) == 4 for row in picked.tolist()) and picked.min() >= 0 and picked.max() < count


def test_every_choice_of_three_others_is_equally_likely():
    dice = np.random.default_rng(0).random((4000, 5, 3))
    picked = [tuple(int(p[2]) for p in three_others(part)) for part in dice]
    counts = np.unique(picked, axis=0, return_counts=True)[1]
    assert len(counts) == 4 * 3 * 2 and np.all(np.abs(counts - 4000 / 24) < 5 * np.sqrt(4000 / 24))


def test_tournaments_are_won_by_the_better():
    drawn = np.array([[0.0, 0.3], [0.9, 0.6], [0.3, 0.3]])
    np.testing.assert_array_equal(winners(np.array([4.0, 1.0, 3.0, 2.0]), drawn), [1, 3, 1])


@pytest.mark.parametrize("index", [0.0, 2.0, 15.0])
def test_the_spread_of_children_has_the_published_density(index):
    """Far from the bounds: 0.5 (eta + 1) beta^eta up to 1, 0.5 (eta + 1) / beta^(eta + 2) beyond; the mean stays."""
    dice = np.random.default_rng(0).random(4000)
    one, other = np.full(4000, 1.0), np.full(4000, 3.0)
    low, high = crossed(one, other, np.full(4000, -1e9), np.full(4000, 1e9), index, dice)

    def distribution(beta: Array) -> Array:
        outer = 1 - 0.5 / np.maximum(beta, 1.0) ** (index + 1)
        return np.where(beta <= 1, 0.5 * np.minimum(beta, 1.0) ** (index + 1), outer)

    inner = dice < 0.999  # the last few reach the bounds, far as these are
    np.testing.assert_allclose((low + high)[inner], 4.0, rtol=1e-5)
    assert kstest(0.5 * (high - low), distribution).pvalue > 0.01


@given(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1, exclude_max=True), st.floats(0, 100), st.floats(1e-3, 1e6))
def test_children_and_mutants_keep_to_the_box(first, second, dice, index, size):
    lower, upper = np.array([-2.0 * size]), np.array([size])
    one, other = (np.clip(lower + share * (upper - lower), lower, upper) for share in (first, second))
    for point in (*crossed(one, other, lower, upper, index, np.array([dice])), one):
        changed = mutated(point, lower, upper, index, np.array([dice]))
        assert lower <= point <= upper and lower <= changed <= upper
        assert (changed <= point + 1e-9 * size) if dice < 0.5 else (changed >= point - 1e-9 * size)
    assert mutated(one, lower, upper, index, np.array([0.0])) == pytest.approx(lower, abs=1e-9 * size)


@pytest.mark.parametrize(("own", "social", "chi"), [(2.05, 2.05, 0.7298437881283576), (2.8, 1.3, 0.7298437881283576)])
def test_constriction_is_the_published_one(own, social, chi):
    assert ParticleSwarm(own=own, social=social).constriction == pytest.approx(chi, rel=1e-12)


# What all of them must do


@pytest.mark.parametrize("norm", ["l1", "l2"])
@pytest.mark.parametrize("name", NAMES)
def test_the_report_of_a_search(name, norm, problem):
    part = made(name, norm=norm, iterations=30, seed=5)
    solution, again = part.solve(problem), part.solve(problem)
    other, polished = (replace(part, **{key: value}).solve(problem) for key, value in (("seed", 6), ("polish", True)))
    run = solution.run
    land = (absolute_landscape if norm == "l1" else square_landscape)(problem, np.ones(2))
    lower, upper = (np.array(run.box[key]) for key in ("lower", "upper"))
    assert np.all((lower <= solution.beta) & (solution.beta <= upper))
    assert np.array_equal(solution.beta, again.beta) and run == again.run
    assert run.trace != other.run.trace and run.optimum == other.run.optimum
    assert len(run.trace) == 30 and np.all(np.diff(run.trace) <= 0)
    assert run.objective == pytest.approx(land.value(solution.beta), rel=1e-12)
    assert run.trace[-1] == pytest.approx(run.objective, rel=1e-9)
    assert run.lower_bound <= run.optimum <= run.objective
    assert run.gap == pytest.approx(run.objective / run.optimum - 1) and run.gap > 0
    assert run.evaluations == 30 + 30 * 30 + (run.scouts or 0) and run.stopped == "iterations"
    assert (run.scouts is not None) == (name == "abc")
    assert land.value(polished.beta) == pytest.approx(run.optimum, rel=1e-9)
    assert polished.run.objective == run.objective
    if norm == "l2":
        np.testing.assert_allclose(polished.beta, least_squares(problem.reduced()).beta, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("norm", ["l1", "l2"])
@pytest.mark.parametrize(("name", "gap"), [("abc", 1e-3), ("de", 1e-6), ("ga", 1e-2), ("pso", 1e-5)])
def test_with_time_enough_they_reach_the_proven_optimum(name, gap, norm):
    land = random_landscape(1 if norm == "l1" else 2, (60, 41, 7))
    options = {"limit": 75} if name == "abc" else {}
    found = made(name, norm=norm, iterations=400, **options).search(land, LOWER, UPPER)
    best = box_optimum(land, LOWER, UPPER)
    assert best.lower_bound * (1 - 1e-12) <= found.objective < (1 + gap) * best.objective


@pytest.mark.parametrize("name", NAMES)
def test_no_point_outside_the_box_is_tried(name, monkeypatch):
    """The optimum lies outside, so every method runs against the bounds."""
    tried = []
    original = Ground.values
    monkeypatch.setattr(Ground, "values", lambda *a, **k: (tried.append(a[1].copy()), original(*a, **k))[1])
    land = random_landscape(2, (60, 41))
    lower, upper = np.full(5, 1.9), np.full(5, 2.5)
    found = made(name, iterations=60).search(land, lower, upper)
    assert np.all((lower <= found.x) & (found.x <= upper))
    if name != "abc":  # the colony's bees live in compiled code
        points = np.concatenate(tried)
        assert points.shape == (found.evaluations, 5) and np.all((lower <= points) & (points <= upper))
    best = box_optimum(land, lower, upper)
    np.testing.assert_allclose(best.x, lower, rtol=1e-9)
    assert found.objective < (1 + 1e-5) * best.objective


def test_a_search_below_the_solver_is_the_optimum(problem, monkeypatch):
    """The solver is exact to a millionth: where a search goes lower, the gap is 0 and polish keeps the search."""
    worse = Optimum(np.zeros(problem.base.count), 1e9, 0.0)
    monkeypatch.setattr("dynident.identification.search.box_search.box_optimum", lambda *a: worse)
    solution = ParticleSwarm(iterations=5, polish=True).solve(problem)
    assert solution.run.gap == 0.0 and solution.run.optimum == solution.run.objective < 1e9
    np.testing.assert_array_equal(solution.beta, ParticleSwarm(iterations=5).solve(problem).beta)


# The rules


@pytest.mark.parametrize("name", NAMES)
def test_evaluations_are_never_exceeded(name):
    land = random_landscape(2, (60, 41))
    whole = made(name, iterations=50).search(land, LOWER, UPPER)
    part = made(name, iterations=50, max_evaluations=500).search(land, LOWER, UPPER)
    assert 500 - 31 <= part.evaluations <= 500 and part.stopped == "evaluations"
    np.testing.assert_array_equal(part.trace, whole.trace[: len(part.trace)])
    with pytest.raises(
        BadOption, match=r"max_evaluations = 59 is not possible; give 6[01] or more: the first iteration"
    ):
        made(name, max_evaluations=59)


@pytest.mark.parametrize("name", NAMES)
def test_a_search_that_stalls_ends(name):
    land = random_landscape(2, (60, 41))
    options = {"limit": 10_000} if name == "abc" else {}  # no scouts: the colony settles
    found = made(name, iterations=5000, stall=50, **options).search(land, LOWER, UPPER)
    assert found.stopped == "stall" and 50 < len(found.trace) < 5000
    assert found.trace[-1] > (1 - 1e-6) * found.trace[-51]
    earlier = np.arange(50, len(found.trace) - 1)
    assert np.all(found.trace[earlier] <= (1 - 1e-6) * found.trace[earlier - 50])


def test_time_ends_a_search(monkeypatch):
    clock = iter(np.arange(100.0))
    monkeypatch.setattr("dynident.identification.search.swarm.time.monotonic", lambda: next(clock))
    found = ParticleSwarm(max_seconds=7.0).search(random_landscape(2, (60,)), LOWER, UPPER)
    assert found.stopped == "seconds" and len(found.trace) == 7


@pytest.mark.parametrize("power", [1, 2])
def test_looking_at_every_cycle_does_not_change_the_colony(power):
    land = random_landscape(power, (60, 41, 7))
    one = list(colony.stages(land, LOWER, UPPER, 10, 3, 300, seed=7, stride=1))
    whole = colony.search(land, LOWER, UPPER, 10, 3, 300, seed=7)
    np.testing.assert_array_equal(np.concatenate([stage.trace for stage in one]), whole.trace)
    np.testing.assert_array_equal(one[-1].x, whole.x)
    assert len(one) == 300 and (one[-1].scouts, one[-1].evaluations) == (whole.scouts, whole.evaluations)


def test_a_search_without_end_is_ended():
    def endless() -> Iterator[Stage]:
        while True:
            yield Stage(np.zeros(5), np.array([1.0]), 1)

    found = run(random_landscape(2, (60,)), endless(), Rules(3), 3)
    assert len(found.trace) == 3 and not found.x.flags.writeable


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        (DifferentialEvolution, {"population": 3}, "population = 3 is not possible; give 4 or more"),
        (DifferentialEvolution, {"factor": 0.0}, "factor = 0.0 is not possible; give a number above 0, at most 2"),
        (DifferentialEvolution, {"crossover": 1.1}, "crossover = 1.1 is not possible; give a probability"),
        (GeneticAlgorithm, {"population": 31}, "population = 31 is not possible; give an even number"),
        (GeneticAlgorithm, {"elites": 30}, "elites = 30 is not possible; give 1 or more, fewer than the 30"),
        (GeneticAlgorithm, {"tournament": 1}, "tournament = 1 is not possible; give 2 or more"),
        (GeneticAlgorithm, {"mutation": -0.1}, "mutation = -0.1 is not possible; give a probability"),
        (GeneticAlgorithm, {"mutation_index": -1.0}, "mutation_index = -1.0 is not possible; give 0 or more"),
        (ParticleSwarm, {"population": 2}, "population = 2 is not possible; give 3 or more"),
        (ParticleSwarm, {"own": -1.0}, "own = -1.0 is not possible; give 0 or more"),
        (ParticleSwarm, {"social": 1.0}, "social = 1.0 is not possible; give 0 or more, so that own + social"),
        (ParticleSwarm, {"largest_speed": 0.0}, "largest_speed = 0.0 is not possible; give a share above 0"),
        (ParticleSwarm, {"informants": "few"}, "informants = 'few' is not possible; choose all or ring"),
        (ArtificialBeeColony, {"stall": 0}, "stall = 0 is not possible; give 1 or more"),
        (ArtificialBeeColony, {"max_seconds": 0.0}, "max_seconds = 0.0 is not possible; give a time above 0 in s"),
        (ArtificialBeeColony, {"max_evaluations": 0}, "max_evaluations = 0 is not possible; give 1 or more"),
    ],
)
def test_options_that_cannot_be(kind, options, message):
    with pytest.raises(BadOption) as caught:
        kind(**options)
    assert str(caught.value).startswith(message)
