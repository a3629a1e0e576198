"""Excitation criteria in closed form and beside NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.arrays import Array
from dynident.errors import BadOption, UnknownChoice
from dynident.excitation.criteria import CRITERIA
from dynident.excitation.criteria.base import log_ends
from dynident.excitation.criteria.d_optimal import DOptimal

DIAGONAL = np.diag([4.0, 1.0, 0.25])


def rows(seed: int) -> Array:
    return np.random.default_rng(seed).normal(size=(50, 5)) * np.array([1.0, 10.0, 0.1, 3.0, 0.5])


def test_figures_of_a_diagonal_matrix() -> None:
    root = np.sqrt(DIAGONAL)
    figures = {name: CRITERIA.make(name).value(root) for name in CRITERIA.names()}
    assert figures["condition"] == pytest.approx(4.0)
    assert figures["unit_condition"] == pytest.approx(1.0)
    assert figures["e_optimal"] == pytest.approx(0.25)
    assert figures["a_optimal"] == pytest.approx(0.25 + 1.0 + 4.0)
    assert DOptimal(regularisation=0.0).value(root) == pytest.approx(0.0, abs=1e-12)
    assert DOptimal(regularisation=0.5).value(root) == pytest.approx(3 * np.log(1.5))


@given(st.integers(0, 1000))
def test_condition_numbers_are_those_of_numpy(seed: int) -> None:
    matrix = rows(seed)
    triangle = np.linalg.qr(matrix, mode="r")
    assert CRITERIA.make("condition").value(triangle) == pytest.approx(np.linalg.cond(matrix))
    unit = matrix / np.linalg.norm(matrix, axis=0)
    assert CRITERIA.make("unit_condition").value(triangle) == pytest.approx(np.linalg.cond(unit))


@given(st.integers(0, 1000), st.sampled_from([4.0, 16.0, 64.0]))
def test_smoothed_extremes_lie_outside_the_true_ones_by_less_than_log_b_over_p(seed: int, sharpness: float) -> None:
    matrix = rows(seed).T @ rows(seed)
    values = np.log(np.linalg.eigvalsh(matrix))
    largest, smallest = log_ends(matrix, sharpness, 1.0, 0.0)[0], log_ends(matrix, sharpness, 0.0, 1.0)[0]
    room = np.log(len(matrix)) / sharpness
    assert values[-1] - 1e-9 <= largest <= values[-1] + room + 1e-9
    assert values[0] - room - 1e-9 <= smallest <= values[0] + 1e-9


@given(st.integers(0, 1000))
def test_unit_columns_and_d_optimal_do_not_see_units(seed: int) -> None:
    matrix = rows(seed)
    size = 10.0 ** np.random.default_rng(seed).uniform(-2, 2, 5)
    one, other = (np.linalg.qr(m, mode="r") for m in (matrix, matrix * size))
    part = CRITERIA.make("unit_condition")
    assert part.value(one) == pytest.approx(part.value(other))
    volume = CRITERIA.make("d_optimal")
    assert volume.value(other) - volume.value(one) == pytest.approx(2 * np.sum(np.log(size)))
    gram, other_gram = matrix.T @ matrix, (matrix * size).T @ (matrix * size)
    assert part.objective(gram, 16.0)[0] == pytest.approx(part.objective(other_gram, 16.0)[0])


def test_d_optimal_is_minus_the_log_volume() -> None:
    gram = rows(1).T @ rows(1)
    value, gradient = DOptimal(regularisation=0.0).objective(gram, 1.0)
    assert value == pytest.approx(-np.linalg.slogdet(gram)[1] / 5)
    np.testing.assert_allclose(gradient, -np.linalg.inv(gram) / 5, rtol=1e-9)


def test_a_optimal_is_the_log_of_the_trace() -> None:
    gram = rows(2).T @ rows(2)
    inverse = np.linalg.inv(gram)
    value, gradient = CRITERIA.make("a_optimal").objective(gram, 1.0)
    assert value == pytest.approx(np.log(np.trace(inverse)))
    np.testing.assert_allclose(gradient, -inverse @ inverse / np.trace(inverse), rtol=1e-7)


@pytest.mark.parametrize("value", [-1e-9, 1.0, np.nan])
def test_a_regularisation_that_is_none(value: float) -> None:
    with pytest.raises(BadOption, match=r"regularisation = .*give a number from 0 to less than 1"):
        DOptimal(regularisation=value)


def test_an_unknown_criterion_names_the_nearest() -> None:
    with pytest.raises(UnknownChoice, match=r"no criterion called 'd_optimum'.*did you mean 'd_optimal'"):
        CRITERIA.make("d_optimum")
