"""The certified L1 optimum against HiGHS, closed forms and laws; the certificate is recomputed by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from dynident.errors import SolverFailed
from dynident.identification.search import least_absolute as module
from dynident.identification.search.least_absolute import GAP, dual_bound, least_absolute


def random_fit(seed, rows=200, columns=6, noise=1.0):
    generator = np.random.default_rng(seed)
    matrix = generator.standard_normal((rows, columns)) * np.logspace(-2, 2, columns)
    truth = generator.uniform(-1, 1, columns) * np.logspace(2, -2, columns)
    target = matrix @ truth + noise * generator.laplace(size=rows)
    weights = generator.uniform(0.1, 2.0, rows)
    return matrix, target, weights, np.abs(truth) * 2 + 1e-3 * np.logspace(2, -2, columns)


def highs(matrix, target, weights, lower, upper):
    """The same minimum as a linear program: residual = p - n, p and n >= 0."""
    rows, columns = matrix.shape
    cost = np.concatenate([np.zeros(columns), weights, weights])
    equality = np.hstack([matrix, np.eye(rows), -np.eye(rows)])
    bounds = [*zip(lower, upper, strict=True), *[(0, None)] * (2 * rows)]
    found = linprog(cost, A_eq=equality, b_eq=target, bounds=bounds, method="highs")
    assert found.status == 0
    return found.fun


def check_certificate(found, matrix, target, weights, lower, upper):
    """Recompute objective, bound and gap from beta and the dual alone."""
    assert np.all(found.beta >= lower) and np.all(found.beta <= upper)
    assert np.all(np.abs(found.dual) <= weights * (1 + 1e-15))
    objective = sum(w * abs(t - row @ found.beta) for row, t, w in zip(matrix, target, weights, strict=True))
    pull = [found.dual @ matrix[:, j] for j in range(matrix.shape[1])]
    bound = found.dual @ target - sum(max(g * a, g * b) for g, a, b in zip(pull, lower, upper, strict=True))
    rounding = 1e-12 * float(1 + weights @ np.abs(target))
    assert found.objective == pytest.approx(objective, rel=1e-9, abs=rounding)
    assert found.lower_bound == pytest.approx(max(bound, 0.0), rel=1e-9, abs=rounding)
    assert objective - bound <= GAP * max(objective, 1e-6 * weights @ np.abs(target)) + rounding


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("share", [1.0, 0.3])
def test_optimum_equals_highs(seed, share):
    matrix, target, weights, box = random_fit(seed)
    lower, upper = -share * box, share * box  # 0.3: the truth lies outside, bounds are active
    found = least_absolute(matrix, target, weights, lower, upper)
    check_certificate(found, matrix, target, weights, lower, upper)
    assert found.objective == pytest.approx(highs(matrix, target, weights, lower, upper), rel=1e-8)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(1, 12))
def test_every_shape_is_certified(seed, rows, columns):
    """Few rows, more columns than rows, rows without weight and columns without room included."""
    generator = np.random.default_rng(seed)
    matrix, target = generator.standard_normal((rows, columns)), 3 * generator.standard_normal(rows)
    weights = generator.random(rows) * (generator.random(rows) > 0.2)
    lower = -generator.random(columns)
    upper = np.where(generator.random(columns) > 0.8, lower, generator.random(columns))
    found = least_absolute(matrix, target, weights, lower, upper)
    check_certificate(found, matrix, target, weights, lower, upper)
    assert found.objective == pytest.approx(highs(matrix, target, weights, lower, upper), rel=1e-6, abs=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(-1000, 1000), min_size=1, max_size=30), st.integers(0, 1000))
def test_one_constant_column_gives_the_weighted_median(values, seed):
    target = 0.1 * np.array(values)
    weights = np.random.default_rng(seed).uniform(0.5, 1.5, len(target))
    found = least_absolute(np.ones((len(target), 1)), target, weights, [-200.0], [200.0])
    best = min(float(weights @ np.abs(target - value)) for value in target)
    assert found.objective == pytest.approx(best, rel=2e-6, abs=1e-9 * (1 + float(weights @ np.abs(target))))


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_any_dual_bounds_any_point_of_the_box(seed):
    matrix, target, weights, box = random_fit(seed, rows=30, columns=4)
    generator = np.random.default_rng(seed)
    dual = generator.normal(size=30) * weights
    beta = box * generator.uniform(-1, 1, 4)
    bound = dual_bound(matrix, target, weights, -box, box, dual)
    assert bound <= weights @ np.abs(target - matrix @ beta) * (1 + 1e-12) + 1e-9


def test_scaling_columns_and_weights_changes_nothing():
    matrix, target, weights, box = random_fit(1)
    plain = least_absolute(matrix, target, weights, -box, box)
    scale = np.logspace(-6, 6, matrix.shape[1])
    other = least_absolute(matrix * scale, 1e3 * target, 7 * weights, -1e3 * box / scale, 1e3 * box / scale)
    assert other.objective == pytest.approx(7e3 * plain.objective, rel=1e-8)


def test_a_perfect_fit_is_found_and_certified():
    matrix, target, weights, box = random_fit(2, noise=0.0)
    found = least_absolute(matrix, target, weights, -box, box)
    assert found.objective <= 1e-9 * weights @ np.abs(target)
    assert found.gap <= GAP


@pytest.mark.parametrize("kind", ["laplace", "cauchy", "lopsided", "quantised"])
def test_cutting_rows_leaves_the_optimum(kind, monkeypatch):
    """More than 12 000 rows are first cut; the interior point on all rows must agree."""
    generator = np.random.default_rng(5)
    rows = 15_000
    matrix = generator.standard_normal((rows, 5)) * np.linspace(0.1, 3.0, rows)[:, None]
    noise = {
        "laplace": generator.laplace(size=rows),
        "cauchy": generator.standard_cauchy(rows),
        "lopsided": generator.exponential(size=rows) * generator.choice([0.0, 1.0, 10.0], rows),
        "quantised": generator.laplace(size=rows),
    }[kind]
    target = matrix @ np.array([1.0, -2.0, 3.0, 0.5, 0.0]) + noise
    target = np.round(target) if kind == "quantised" else target
    weights, box = np.full(rows, 1.0 / rows), np.full(5, 10.0)
    cut = least_absolute(np.asfortranarray(matrix), target, weights, -box, box)
    assert cut.gap <= GAP
    monkeypatch.setattr(module, "solve_doubtful", lambda fit: None)
    whole = least_absolute(matrix, target, weights, -box, box)
    assert cut.objective == pytest.approx(whole.objective, rel=1e-8)


def test_the_result_is_read_only_and_the_input_is_left_alone():
    matrix, target, weights, box = random_fit(3)
    copies = [array.copy() for array in (matrix, target, weights, box)]
    found = least_absolute(matrix, target, weights, -box, box)
    assert not found.beta.flags.writeable and not found.dual.flags.writeable
    for array, copy in zip((matrix, target, weights, box), copies, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_a_failed_certificate_is_an_error(monkeypatch):
    matrix, target, weights, box = random_fit(4)
    monkeypatch.setattr(module, "primal_and_dual", lambda fit: (np.zeros(6), np.zeros(200)))
    assert least_absolute(matrix, target, weights, -box, box).gap < 1e-6  # the linear program steps in
    monkeypatch.setattr(module, "linear_program", lambda fit: (np.zeros(6), np.zeros(200)))
    objective = weights @ np.abs(target)
    with pytest.raises(SolverFailed) as caught:
        least_absolute(matrix, target, weights, -box, box)
    assert str(caught.value) == (
        f"the least absolute residual fit found no solution: objective {objective:.6g}, proven lower bound 0, "
        "relative gap 1; check the units of the log and the width of the box, or use the norm l2"
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"matrix": np.zeros(3)}, "matrix has shape (3,), expected (r, b) with at least one row and column"),
        ({"target": np.zeros(4)}, "target has shape (4,), expected (3,)"),
        ({"weights": [1.0, -2.0, 1.0]}, "weight 1 is -2, expected 0 or more"),
        ({"target": [0.0, np.nan, 0.0]}, "target has a value that is not finite"),
        ({"upper": [np.inf, 1.0]}, "upper has a value that is not finite"),
        ({"lower": [0.0, 2.0]}, "bound 1: the lower one, 2, is above the upper one, 1"),
    ],
)
def test_bad_input_is_named(change, message):
    given_arrays = {
        "matrix": np.ones((3, 2)),
        "target": np.zeros(3),
        "weights": np.ones(3),
        "lower": -np.ones(2),
        "upper": np.ones(2),
    }
    with pytest.raises(ValueError) as caught:
        least_absolute(**{**given_arrays, **change})
    assert str(caught.value) == message
