"""What every excitation criterion must do, whatever it measures."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynident.arrays import Array
from dynident.excitation.criteria import CRITERIA, Criterion

NAMES = CRITERIA.names()


def information(seed: int, size: int = 6, spread: float = 2.0) -> Array:
    """Return a random symmetric positive definite matrix with columns of unlike units."""
    generator = np.random.default_rng(seed)
    rows = generator.normal(size=(3 * size, size)) * 10.0 ** generator.uniform(-spread / 2, spread / 2, size)
    return rows.T @ rows / len(rows)


def triangle(matrix: Array) -> Array:
    return np.linalg.cholesky(matrix).T


def cost(part: Criterion, matrix: Array) -> float:
    """Return the figure of a criterion, turned so that smaller is better."""
    return (-1.0 if part.larger_is_better else 1.0) * part.value(triangle(matrix))


@pytest.fixture(params=NAMES)
def part(request: pytest.FixtureRequest) -> Criterion:
    return CRITERIA.make(request.param)


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_the_gradient_is_the_derivative(name: str, seed: int) -> None:
    part, matrix = CRITERIA.make(name), information(seed, spread=0.5)
    generator = np.random.default_rng(seed + 1)
    root = np.sqrt(np.diagonal(matrix))
    way = generator.normal(size=matrix.shape) * np.outer(root, root)
    way = way + way.T
    for sharpness in part.stages:
        _, gradient = part.objective(matrix, sharpness)
        step = 1e-5 * np.linalg.eigvalsh(matrix)[0] / np.abs(np.linalg.eigvalsh(way)).max()
        rise = part.objective(matrix + step * way, sharpness)[0] - part.objective(matrix - step * way, sharpness)[0]
        size = np.sum(np.abs(gradient * way))
        assert rise / (2 * step) == pytest.approx(float(np.sum(gradient * way)), rel=1e-4, abs=2e-5 * size)


def test_the_gradient_is_symmetric_and_finite_even_where_nothing_is_excited(part: Criterion) -> None:
    matrix = information(3)
    matrix[2], matrix[:, 2] = 0.0, 0.0
    for sharpness in part.stages:
        for one in (information(1), matrix):
            value, gradient = part.objective(one, sharpness)
            assert np.isfinite(value) and np.all(np.isfinite(gradient))
            np.testing.assert_allclose(gradient, gradient.T, rtol=1e-9, atol=1e-12 * np.abs(gradient).max())


def test_the_objective_ranks_motions_as_the_figure_does(part: Criterion) -> None:
    found = [(cost(part, one), part.objective(one, part.stages[-1])[0]) for one in map(information, range(40))]
    figures = np.array([figure for figure, _ in found])
    gap = 0.1 * np.ptp(figures)
    pairs = [(a, b) for a in found for b in found if a[0] + gap < b[0] and a[0] * 1.2 < b[0] * (1.2 if b[0] < 0 else 1)]
    assert len(pairs) > 20
    assert not [pair for pair in pairs if pair[0][1] >= pair[1][1]]


def test_sharper_objectives_agree_in_the_limit(part: Criterion) -> None:
    matrix = information(5)
    sharp = [part.objective(matrix, sharpness)[0] for sharpness in (1e3, 1e4)]
    assert sharp[0] == pytest.approx(sharp[1], abs=5e-3)


def test_the_order_of_the_parameters_does_not_matter(part: Criterion) -> None:
    matrix, order = information(7), np.random.default_rng(0).permutation(6)
    assert part.value(triangle(matrix[np.ix_(order, order)])) == pytest.approx(part.value(triangle(matrix)), rel=1e-9)


@pytest.mark.parametrize("name", [name for name in NAMES if CRITERIA.get(name).weighted])
def test_more_rows_never_make_an_optimal_design_worse(name: str) -> None:
    part = CRITERIA.make(name)
    matrix = information(9)
    row = np.random.default_rng(1).normal(size=6)
    assert cost(part, matrix + np.outer(row, row)) <= cost(part, matrix)


def test_a_parameter_that_nothing_moves_has_no_good_figure(part: Criterion) -> None:
    damaged = triangle(information(2))
    damaged[:, 3] = 0.0
    figure = part.value(damaged)
    assert figure == 0.0 if np.isfinite(figure) else figure == (-np.inf if part.larger_is_better else np.inf)


def test_nothing_is_kept_and_nothing_is_changed(part: Criterion) -> None:
    matrix = information(4)
    before, factor = matrix.copy(), triangle(matrix)
    first = (part.value(factor), part.objective(matrix, part.stages[0]))
    second = (part.value(factor), part.objective(matrix, part.stages[0]))
    np.testing.assert_array_equal(matrix, before)
    assert first[0] == second[0] and first[1][0] == second[1][0]
    assert repr(part) == repr(CRITERIA.make(CRITERIA.name_of(part)))
