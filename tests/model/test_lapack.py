"""LAPACK of NumPy's own library, and of SciPy where that is not found: the answers of NumPy and SciPy."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import scipy.linalg

from dynident.arrays import Array
from dynident.model import lapack


@pytest.fixture(params=["NumPy", "SciPy"])
def source(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Take the routines of one of the two."""
    lapack.routine.cache_clear()
    if request.param == "SciPy":
        monkeypatch.setattr(lapack, "WHEELS", ())
    yield
    lapack.routine.cache_clear()


def matrix(rows: int, columns: int) -> Array:
    return np.random.default_rng(rows).normal(size=(rows, columns))


@pytest.mark.usefixtures("source")
@pytest.mark.parametrize("shape", [(40, 6), (6, 6), (3, 6), (0, 6), (5, 0)])
def test_upper_triangle(shape: tuple[int, int]) -> None:
    rows = matrix(*shape)
    found = lapack.upper_triangle(rows)
    assert found.shape == (min(shape), shape[1]) and np.array_equal(found, np.triu(found))
    np.testing.assert_allclose(found.T @ found, rows.T @ rows, atol=1e-12)


@pytest.mark.usefixtures("source")
def test_cholesky_and_what_is_solved_by_it() -> None:
    square = matrix(9, 5).T @ matrix(9, 5)
    upper = lapack.cholesky(square)
    assert upper is not None
    np.testing.assert_allclose(upper, scipy.linalg.cholesky(square), atol=1e-13)
    for right in (matrix(5, 2), matrix(5, 2)[:, 0], np.zeros((5, 0))):
        found = lapack.solve_positive(square, right)
        assert found is not None and found.shape == right.shape
        np.testing.assert_allclose(square @ found, right, atol=1e-12)
    assert lapack.cholesky(-square) is None and lapack.solve_positive(-square, np.ones(5)) is None


@pytest.mark.usefixtures("source")
def test_triangles_are_solved_and_multiplied() -> None:
    upper, right = matrix(5, 5), matrix(5, 3)
    upper.flags.writeable = False  # what stands below the diagonal is not read, and nothing is written
    for transposed in (False, True):
        wanted = scipy.linalg.solve_triangular(upper, right, trans=int(transposed))
        np.testing.assert_allclose(lapack.solve_upper(upper, right, transposed), wanted, rtol=1e-10)
        np.testing.assert_allclose(lapack.solve_upper(upper, right[:, 0], transposed), wanted[:, 0], rtol=1e-10)
    product = np.array(right, order="F")
    lapack.times_upper(upper, product)
    np.testing.assert_allclose(product, np.triu(upper) @ right, atol=1e-13)


def test_what_cannot_be_solved_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError, match="zero on its diagonal"):
        lapack.solve_upper(np.diag([1.0, 0.0]), np.ones(2))
    with pytest.raises(ValueError, match="does not fit"):
        lapack.solve_upper(np.eye(3), np.ones(2))
