"""Triangles against the rows that they stand for: every quadratic question has the same answer on both."""

from __future__ import annotations

import itertools
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynident.arrays import Array, IntArray
from dynident.model import reduction
from dynident.model.reduction import (
    MANY,
    Reduced,
    Triangle,
    absorb,
    absorber,
    least_squares,
    merged_pairs,
    reduce,
    triangle_of,
    without_own,
)

COLUMNS = np.arange(4)


def rows_of(seed: int, count: int, columns: int = 5, scale: float = 1.0) -> Array:
    return scale * np.random.default_rng(seed).normal(size=(count, columns))


def triangle(rows: Array, columns: IntArray = COLUMNS) -> Triangle:
    return Triangle(columns, triangle_of(rows), len(rows))


@given(seed=st.integers(0, 10_000), count=st.integers(0, 30), columns=st.integers(1, 6))
def test_a_triangle_has_the_gram_matrix_of_its_rows(seed: int, count: int, columns: int) -> None:
    rows = rows_of(seed, count, columns)
    factor = triangle_of(rows)
    assert factor.shape == (min(count, columns), columns)
    np.testing.assert_array_equal(factor, np.triu(factor))
    np.testing.assert_allclose(factor.T @ factor, rows.T @ rows, atol=1e-12 * (1 + count))


@pytest.mark.parametrize("many", [0, MANY])
@pytest.mark.parametrize("condition", [1e2, 1e5, 1e8])
def test_absorbed_rows_solve_as_well_as_all_rows_by_qr(condition: float, many: int) -> None:
    """Least squares from panels of a thousand rows beside NumPy's QR of all rows at once."""
    random = np.random.default_rng(3)
    left = np.linalg.qr(random.normal(size=(5000, 20)))[0]
    rows = left * np.geomspace(1.0, 1.0 / condition, 20) @ np.linalg.qr(random.normal(size=(20, 20)))[0]
    truth = random.normal(size=20)
    both = np.column_stack([rows, rows @ truth])
    factor: Array = np.zeros((21, 21), order="F")
    for start in range(0, 5000, 1000):
        factor = absorber(many)(factor, np.array(both[start : start + 1000], order="F"))
    upper = np.triu(factor)
    found = np.linalg.solve(upper[:-1, :-1], upper[:-1, -1])
    q, r = np.linalg.qr(rows)
    wanted = np.linalg.solve(r, q.T @ both[:, -1])
    assert np.abs(found - truth).max() < 30 * max(np.abs(wanted - truth).max(), 1e-16 * condition)
    values = np.linalg.svd(upper[:-1, :-1], compute_uv=False)
    np.testing.assert_allclose(values, np.linalg.svd(rows, compute_uv=False), rtol=1e-14 * condition)


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 10_000),
    columns=st.integers(4, 12),
    units=st.floats(0, 8),
    condition=st.floats(0, 14),
    growth=st.floats(-2, 2),
    rank=st.integers(1, 12),
    faint=st.floats(2, 16),
)
def test_every_column_of_many_absorbed_rows_is_exact_to_its_own_size(
    seed: int, columns: int, units: float, condition: float, growth: float, rank: int, faint: float
) -> None:
    """Columns of any units, dependent ones, directions that are faint in the first panels, panels that grow or fade.

    The triangle of rows by QR has the Gram matrix of rows that differ by a few roundings of each column's norm; so has
    this one, however the condition.
    """
    random = np.random.default_rng(seed)
    mixing = random.normal(size=(columns, columns)) * np.geomspace(1.0, 10.0**-condition, columns)[:, None]
    mixing = (mixing @ np.linalg.qr(random.normal(size=(columns, columns)))[0]) * 10.0 ** random.uniform(
        -units, units, columns
    )
    panels = []
    for k in range(12):
        inner = random.normal(size=(100 + k, columns)) * 10.0 ** (growth * k / 2)
        inner[:, min(rank + k // 3, columns) :] *= 10.0**-faint
        panels.append(inner @ mixing)
    take, plain = absorber(MANY), np.zeros((columns, columns), order="F")
    factor: Array = np.zeros((columns, columns), order="F")
    for panel in panels:
        factor = take(factor, np.array(panel, order="F"))
        plain = absorb(plain, np.array(panel, order="F"))
    np.testing.assert_array_equal(np.tril(factor, -1), 0.0)
    rows = np.concatenate(panels)
    norms = np.linalg.norm(rows, axis=0)
    scaled, wanted = factor / norms, rows / norms
    assert np.abs(scaled.T @ scaled - wanted.T @ wanted).max() < 1e-14
    found, other = (np.linalg.svd(each / norms, compute_uv=False) for each in (factor, np.triu(plain)))
    np.testing.assert_allclose(found, other, atol=3e-14)  # to the size of the largest, as QR has them


def test_many_rows_are_absorbed_by_qr_where_they_are_large_beside_those_before(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[int] = []

    def noted(factor: Array, rows: Array) -> Array:
        taken.append(len(rows))
        return absorb(factor, rows)

    monkeypatch.setattr(reduction, "absorb", noted)
    take, factor = absorber(MANY), np.zeros((5, 5), order="F")
    for scale, count in ((1.0, 100), (1.0, 101), (1e3, 102), (1.0, 103), (np.nan, 104)):
        factor = take(factor, np.asfortranarray(rows_of(count, count, 5, scale)))
    assert taken == [100, 102, 104]
    assert np.isnan(factor).any()


def test_other_threads_go_on_while_rows_are_absorbed() -> None:
    counted, stop = [0], threading.Event()

    def count() -> None:
        while not stop.is_set():
            counted[0] += 1

    rows, factor = np.asfortranarray(rows_of(0, 200_000, 40)), np.zeros((40, 40), order="F")
    thread = threading.Thread(target=count)
    thread.start()
    before = counted[0]
    absorb(factor, rows)
    during = counted[0] - before
    stop.set()
    thread.join()
    assert during > 100


def test_arrays_that_lapack_cannot_take_are_refused() -> None:
    with pytest.raises(ValueError, match="Fortran order"):
        absorb(np.zeros((5, 5), order="F"), rows_of(0, 7))
    with pytest.raises(ValueError, match="do not fit rows"):
        absorb(np.zeros((4, 4), order="F"), np.asfortranarray(rows_of(0, 7)))


def test_singular_values_are_those_of_the_rows_and_not_of_the_gram_matrix() -> None:
    rows = rows_of(0, 200) @ np.diag([1.0, 1e-3, 1e-6, 1e-9, 1e-11])
    found = np.linalg.svd(triangle_of(rows), compute_uv=False)
    np.testing.assert_allclose(found, np.linalg.svd(rows, compute_uv=False), rtol=1e-3)


@settings(deadline=None)
@given(seed=st.integers(0, 10_000), cuts=st.lists(st.integers(0, 60), max_size=5))
def test_merged_parts_are_the_triangle_of_all_rows(seed: int, cuts: list[int]) -> None:
    rows = rows_of(seed, 60)
    edges = [0, *sorted(cuts), 60]
    parts = [triangle(rows[a:b]) for a, b in itertools.pairwise(edges)]
    merged, whole = parts[0].merged(parts[1:]), triangle(rows)
    assert merged.rows == whole.rows == 60
    np.testing.assert_allclose(merged.factor.T @ merged.factor, whole.factor.T @ whole.factor, atol=1e-11)


@given(seed=st.integers(0, 10_000), panels=st.lists(st.integers(0, 12), max_size=5))
def test_absorbed_panels_are_the_triangle_of_all_rows(seed: int, panels: list[int]) -> None:
    factor: Array = np.zeros((5, 5), order="F")
    everything = [rows_of(seed, 0)]
    for k, count in enumerate(panels):
        rows = rows_of(seed + k, count)
        everything.append(rows)
        factor = absorb(factor, np.array(rows, order="F"))  # overwritten
    upper, whole = np.triu(factor), np.concatenate(everything)
    np.testing.assert_allclose(upper.T @ upper, whole.T @ whole, atol=1e-11)


def test_an_empty_triangle_adds_nothing() -> None:
    rows = rows_of(1, 10)
    merged = Triangle.empty(COLUMNS).merged([triangle(rows), Triangle.empty(COLUMNS)])
    assert (Triangle.empty(COLUMNS).rows, merged.rows) == (0, 10)
    np.testing.assert_allclose(merged.factor.T @ merged.factor, rows.T @ rows, atol=1e-12)


@given(seed=st.integers(0, 10_000))
def test_residuals_without_the_rows(seed: int) -> None:
    rows, beta = rows_of(seed, 25), rows_of(seed + 1, 1, 6)[0]
    columns = np.array([0, 2, 3, 5])  # columns 1 and 4 of beta are zero on this joint
    reduced = triangle(rows, columns)
    error = rows[:, :4] @ beta[columns] - rows[:, 4]
    assert reduced.residual_square(beta) == pytest.approx(error @ error)
    assert reduced.torque_square == pytest.approx(rows[:, 4] @ rows[:, 4])


def test_a_factor_of_another_width_is_refused() -> None:
    with pytest.raises(ValueError, match=r"triangle has shape \(3, 3\), expected \(None, 5\)"):
        Triangle(COLUMNS, np.eye(3), 3)


def dense(blocks: list[tuple[Array, IntArray]], weights: Array, size: int) -> tuple[Array, Array]:
    """Return the weighted rows of all joints, stacked."""
    full = []
    for (rows, columns), weight in zip(blocks, weights, strict=True):
        wide = np.zeros((len(rows), size + 1))
        wide[:, [*columns, size]] = rows
        full.append(weight * wide)
    stacked = np.concatenate(full)
    return stacked[:, :size], stacked[:, size]


@given(seed=st.integers(0, 10_000))
def test_reduced_joints_are_the_stacked_weighted_rows(seed: int) -> None:
    generator = np.random.default_rng(seed)
    blocks = [(rows_of(seed + 1, 20), np.array([0, 1, 2, 4])), (rows_of(seed + 2, 9, 4), np.array([2, 3, 5]))]
    weights = generator.uniform(0.1, 10, 2)
    problem = reduce([triangle(rows, columns) for rows, columns in blocks], 6, weights)
    matrix, torque = dense(blocks, weights, 6)
    beta = generator.normal(size=6)
    error = matrix @ beta - torque
    assert problem.residual_square(beta) == pytest.approx(error @ error)
    assert problem.rows == 29
    np.testing.assert_allclose(problem.column_norms, np.linalg.norm(matrix, axis=0), atol=1e-12)
    np.testing.assert_allclose(problem.r.T @ problem.r, matrix.T @ matrix, atol=1e-9)
    best, rest, *_ = np.linalg.lstsq(matrix, torque)
    assert problem.rest == pytest.approx(rest[0])
    np.testing.assert_allclose(least_squares(problem).beta, best, rtol=1e-8, atol=1e-10)


@given(seed=st.integers(0, 10_000), powers=st.lists(st.floats(-6, 6), min_size=4, max_size=4))
def test_units_of_the_columns_do_not_matter(seed: int, powers: list[float]) -> None:
    rows, units = rows_of(seed, 40), 10.0 ** np.array([*powers, 0.0])
    plain = least_squares(reduce([triangle(rows)], 4, [1.0]))
    scaled = least_squares(reduce([triangle(rows * units)], 4, [1.0]))
    np.testing.assert_allclose(scaled.beta * units[:4], plain.beta, rtol=1e-7, atol=1e-9)
    assert scaled.condition_number == pytest.approx(plain.condition_number, rel=1e-6)
    spread = np.outer(units[:4], units[:4])
    np.testing.assert_allclose(scaled.unscaled_covariance * spread, plain.unscaled_covariance, rtol=1e-6, atol=1e-12)


def test_least_squares_in_full() -> None:
    rows = rows_of(3, 50)
    matrix, torque = rows[:, :4], rows[:, 4]
    solution = least_squares(reduce([triangle(rows)], 4, [1.0]))
    np.testing.assert_allclose(solution.beta, np.linalg.lstsq(matrix, torque)[0])
    np.testing.assert_allclose(solution.unscaled_covariance, np.linalg.inv(matrix.T @ matrix))
    singular = np.linalg.svd(matrix / np.linalg.norm(matrix, axis=0), compute_uv=False)
    np.testing.assert_allclose(solution.singular_values, singular)
    assert solution.condition_number == pytest.approx(singular[0] / singular[-1])


def test_directions_that_the_rows_leave_open_stay_at_zero() -> None:
    rows = rows_of(4, 30)
    rows[:, 3] = rows[:, 0]  # two equal columns share what either could explain
    solution = least_squares(reduce([triangle(rows)], 4, [1.0]))
    assert solution.beta[0] == pytest.approx(solution.beta[3])
    assert solution.condition_number > 1e10
    best = np.linalg.lstsq(rows[:, :4], rows[:, 4])[0]
    np.testing.assert_allclose(rows[:, :4] @ solution.beta, rows[:, :4] @ best, atol=1e-9)


def test_a_column_of_zeros_gets_zero() -> None:
    rows = rows_of(5, 30)
    rows[:, 1] = 0.0
    solution = least_squares(reduce([triangle(rows)], 4, [1.0]))
    assert abs(solution.beta[1]) < 1e-12 and solution.condition_number > 1e12
    assert np.all(np.isfinite(solution.unscaled_covariance))


def test_no_rows_at_all() -> None:
    solution = least_squares(Reduced(np.zeros((2, 2)), np.zeros(2), 0.0, 0))
    np.testing.assert_array_equal(solution.beta, np.zeros(2))
    assert solution.condition_number == np.inf


@pytest.mark.parametrize("count", [1, 2, 3, 6, 7])
def test_each_two_triangles_that_follow_each_other_are_merged(count: int) -> None:
    rows = np.stack([rows_of(seed, 8, 4) for seed in range(count)])
    found = merged_pairs(np.stack([triangle_of(each) for each in rows]))
    assert found.shape == ((count + 1) // 2, 4, 4)
    for k, factor in enumerate(found):
        pair = np.concatenate(list(rows[2 * k : 2 * k + 2]))
        np.testing.assert_allclose(factor.T @ factor, pair.T @ pair, atol=1e-12)
        np.testing.assert_array_equal(np.tril(factor, -1), 0.0)


def test_triangles_are_solved_alike_whatever_their_condition() -> None:
    """A well-conditioned one by itself, a nearly dependent one and one with a zero column by singular values."""
    rows = np.random.default_rng(3).normal(size=(200, 6))
    for column, found in ((rows[:, 4], 5), (rows[:, 0] + 1e-13 * rows[:, 4], 4), (0.0 * rows[:, 4], 4)):
        matrix = np.column_stack([rows[:, :4], column]) * np.geomspace(1e-4, 1e4, 5)
        upper = triangle_of(np.column_stack([matrix, rows[:, 5]]))
        problem = Reduced(upper[:5, :5], upper[:5, 5], float(upper[5, 5] ** 2), 200)
        solution, norms = least_squares(problem), np.linalg.norm(matrix, axis=0)
        unit = matrix / np.where(norms > 0, norms, 1.0)
        expected = np.linalg.lstsq(unit, rows[:, 5], rcond=1e-10)[0]
        np.testing.assert_allclose(solution.beta * np.where(norms > 0, norms, 1.0), expected, atol=1e-9)
        kept = np.sum(solution.singular_values > 1e-10 * solution.singular_values[0])
        assert kept == found
        np.testing.assert_allclose(solution.singular_values, np.linalg.svd(unit, compute_uv=False), atol=1e-12)
        assert (solution.condition_number < 1e10) == (kept == 5)


@pytest.mark.parametrize("depends", [False, True])
def test_a_fit_without_the_columns_of_one_joint_is_the_same(depends: bool) -> None:
    """Columns 0 to 2 are those of both joints, 3 and 4 of the first, 5 of the second; the first has two parts."""
    random, columns = np.random.default_rng(5), [np.array([0, 3, 1, 2, 4]), np.array([0, 1, 2, 5])]
    rows = [random.normal(size=(40, len(own) + 1)) for own in columns]
    if depends:
        rows[0][:, 4] = 2.0 * rows[0][:, 1]
    first, second = (triangle(each, own) for each, own in zip(rows, columns, strict=True))
    parts = [[triangle(rows[0][:15], columns[0]), triangle(rows[0][15:], columns[0])], [second]]
    shared, count, completed = without_own(parts, 6)
    assert count == (5 if depends else 3)
    weights = [1.0, 3.0]
    beta = completed(least_squares(reduce(shared, count, weights)).beta)
    np.testing.assert_allclose(beta, least_squares(reduce([first, second], 6, weights)).beta, atol=1e-12)
    for whole, each, own in zip((first, second), shared, (0, 1), strict=True):
        found = each.residual_square(least_squares(reduce(shared, count, weights)).beta)
        assert each.rows == whole.rows and found == pytest.approx(whole.residual_square(beta), rel=1e-10), own
