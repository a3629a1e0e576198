"""Rows divided by a triangle, and their Gram matrix: machine code beside a solver in NumPy."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.model.kernels import preconditioned
from dynident.model.kernels.compiled import lanes
from dynident.model.kernels.preconditioned import Preconditioned


def triangle_and_rows(columns: int, count: int) -> tuple[Array, Array]:
    """Return a triangle whose part below the diagonal must not be read, and rows."""
    random = np.random.default_rng(columns + count)
    factor = np.triu(random.normal(size=(columns, columns)) / columns, 1) + np.diag(random.uniform(0.5, 2.0, columns))
    below = np.tril(np.full((columns, columns), np.nan), -1)
    return np.asfortranarray(factor + below), np.asfortranarray(random.normal(size=(count, columns)))


@pytest.mark.parametrize("width", [4, 8])
def test_the_gram_matrix_is_that_of_the_quotient(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Columns and samples that fill tiles and vectors, and those that do not; both sets of registers."""
    if width > lanes():
        pytest.skip("this processor has narrower vectors")
    monkeypatch.setattr(preconditioned, "lanes", lambda: width)
    maker = Preconditioned()
    for columns in (4, 5, 7, 8, 38):
        for count in (1000, 33, 999, 32):  # the working memory of one is larger than the next one needs
            factor, rows = triangle_and_rows(columns, count)
            kept = rows.copy()
            found = maker.gram(factor, rows)
            quotient = np.linalg.solve(np.triu(np.nan_to_num(factor)).T, rows.T).T
            wanted = np.eye(columns) + quotient.T @ quotient
            sizes = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
            assert np.abs(np.triu(found - wanted) / sizes).max() < 1e-14
            np.testing.assert_array_equal(rows, kept)


def test_below_the_diagonal_stands_no_memory_of_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Infinities there would be NaN and a warning where the triangle is taken, as a product with zeros."""
    factor, rows = triangle_and_rows(38, 1000)
    maker = Preconditioned()
    monkeypatch.setattr(np, "empty", lambda shape, order="C": np.full(shape, np.inf, order=order))
    assert np.isfinite(maker.gram(factor, rows)).all()


def test_few_rows_and_narrow_ones_are_not_taken() -> None:
    maker = Preconditioned()
    assert maker.takes(np.zeros((32, 4))) and maker.takes(np.zeros((1000, 60)))
    assert not maker.takes(np.zeros((7, 4))) and not maker.takes(np.zeros((1000, 3)))
    with pytest.raises(ValueError, match="does not fit rows"):
        maker.gram(np.asfortranarray(np.eye(3)), np.asfortranarray(np.zeros((100, 3))))
    with pytest.raises(ValueError, match="does not fit rows"):
        maker.gram(np.asfortranarray(np.eye(5)), np.asfortranarray(np.zeros((100, 4))))
    with pytest.raises(ValueError, match="Fortran order"):
        maker.gram(np.asfortranarray(np.eye(4)), np.zeros((100, 4)))


def test_a_triangle_that_cannot_be_divided_by_gives_no_finite_diagonal() -> None:
    factor, rows = triangle_and_rows(5, 64)
    factor[2, 2] = 0.0
    found = Preconditioned().gram(factor, rows).diagonal()
    assert np.isfinite(found[:2]).all() and not np.isfinite(found[2:]).any()


#: Four threads ask for the code at once, in a process where nobody did before; then all use it.
AT_ONCE = """
import gc, threading
import numpy as np
from dynident.model.kernels.preconditioned import Preconditioned

start = threading.Barrier(4)
makers, found = [], []

def begin():
    start.wait()
    makers.append(Preconditioned())

def use(maker):
    for _ in range(50):
        found.append(maker.gram(np.asfortranarray(np.eye(8)), np.ones((1000, 8), order="F"))[0, 0])

threads = [threading.Thread(target=begin) for _ in range(4)]
[one.start() for one in threads], [one.join() for one in threads]
gc.collect()
threads = [threading.Thread(target=use, args=(maker,)) for maker in makers]
[one.start() for one in threads], [one.join() for one in threads]
print(len(found), set(found))
"""


def test_threads_that_ask_at_once_share_code_that_stays() -> None:
    done = subprocess.run([sys.executable, "-c", AT_ONCE], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "200 {np.float64(1001.0)}"), done.stderr
