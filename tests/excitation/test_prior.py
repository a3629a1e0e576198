"""What is known before a run: covariances as information, the nominal model, what a run would buy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.excitation.design.prior import (
    Outlook,
    Prior,
    deviations_of,
    outlook_of,
    prior_of_covariance,
    prior_of_nominal,
)
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot


def covariance(seed: int, size: int = 5) -> Array:
    """Return a random covariance of parameters of unlike units."""
    generator = np.random.default_rng(seed)
    rows = generator.normal(size=(3 * size, size)) * 10.0 ** generator.uniform(-3, 3, size)
    return rows.T @ rows


@given(st.integers(0, 10**6))
def test_the_information_of_an_estimate_is_the_inverse_of_its_covariance(seed: int) -> None:
    matrix = covariance(seed)
    prior = prior_of_covariance(matrix, np.ones(5), "estimate.json")
    size = np.sqrt(np.diagonal(matrix))
    np.testing.assert_allclose((prior.information * np.outer(size, size)) @ (matrix / np.outer(size, size)), np.eye(5),
                               atol=1e-7)  # fmt: skip
    np.testing.assert_allclose(deviations_of(prior.information), size, rtol=1e-7)


@given(st.integers(0, 10**6), st.floats(1.0, 1e5))
def test_the_triangle_squared_is_the_information_per_row(seed: int, rows: float) -> None:
    prior = Prior(covariance(seed), None, "runs")
    triangle = prior.triangle(rows)
    size = np.sqrt(np.diagonal(prior.information))
    found = rows * (triangle.T @ triangle)
    np.testing.assert_allclose(found / np.outer(size, size), prior.information / np.outer(size, size), atol=1e-12)


def test_a_direction_that_nothing_moved_is_unknown() -> None:
    rows = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0]])  # the sum of two, the third, never the fourth
    np.testing.assert_allclose(deviations_of(rows.T @ rows), [np.inf, np.inf, 0.5, np.inf])


def test_two_sources_add_up() -> None:
    one, two = Prior(np.diag([1.0, 0.0]), None, "a.csv"), Prior(np.diag([3.0, 4.0]), np.array([1.0, 2.0]), "b.csv")
    both = one.plus(two)
    np.testing.assert_allclose(deviations_of(both.information), [0.5, 0.5])
    assert both.source == "a.csv; b.csv" and both.mean is not None


def test_the_nominal_model_is_that_of_its_standard_parameters(planar_2r: Robot) -> None:
    model = DynamicModel(planar_2r)
    base, theta = base_parameters(model), model.nominal()
    assert theta is not None
    prior = prior_of_nominal(model, base, 0.3)
    generator = np.random.default_rng(0)
    links = theta.reshape(-1, 10)
    # Draws of the standard parameters with a deviation of 30 % of themselves, or of the size of their kind.
    largest, mass = np.abs(links[:, [0, 3, 5]]).max(axis=1), links[:, 9]
    size = np.abs(links)
    size[:, :6] = np.maximum(size[:, :6], largest[:, None])
    size[:, 6:9] = np.maximum(size[:, 6:9], np.sqrt(mass * largest)[:, None])
    draws = (theta + 0.3 * size.ravel() * generator.normal(size=(100_000, len(theta)))) @ base.matrix.T
    np.testing.assert_allclose(deviations_of(prior.information), draws.std(axis=0), rtol=0.02)
    assert prior.mean is not None
    np.testing.assert_allclose(prior.mean, base.from_standard(theta))


def test_friction_that_is_not_stated_is_unknown_and_so_is_what_hangs_together_with_it(planar_2r: Robot) -> None:
    model = DynamicModel(planar_2r, ("viscous", "rotor_inertia"))  # type: ignore[arg-type]
    base, theta = base_parameters(model), model.nominal()
    assert theta is not None
    known = np.isfinite(deviations_of(prior_of_nominal(model, base, 0.5).information))
    unknown = np.ones(len(theta), bool)
    unknown[: model.inertial_count] = False
    unknown[model.inertial_count :] &= theta[model.inertial_count :] == 0
    np.testing.assert_array_equal(known, ~np.any(base.matrix[:, unknown] != 0, axis=1))
    assert known.any() and not known.all()


def test_an_outlook_is_before_and_after(planar_2r: Robot) -> None:
    base = base_parameters(DynamicModel(planar_2r))
    triangle = np.diag(np.arange(1.0, base.count + 1))
    prior = Prior(np.eye(base.count), np.full(base.count, 2.0), "run 1")
    outlook = outlook_of(base, prior, triangle, 100.0, None)
    np.testing.assert_allclose(outlook.before, 1.0)
    np.testing.assert_allclose(outlook.after, 1 / np.sqrt(1 + 100 * np.arange(1.0, base.count + 1) ** 2))
    assert outlook.worst(2) == [0, 1]
    data = outlook.data()
    assert data["before"] == "run 1" and data["effective_sample_size"] == 100.0
    assert data["parameters"][0]["std_after"] == pytest.approx(1 / np.sqrt(101))
    nothing = outlook_of(base, None, triangle, 100.0, None)
    assert nothing.data()["parameters"][0] == {
        "name": base.names[0], "unit": base.units[0], "value": None, "std_before": None, "std_after": 0.1,
    }  # fmt: skip
    assert isinstance(nothing, Outlook) and not np.isfinite(nothing.relative(nothing.after)).any()


@pytest.mark.parametrize(
    ("information", "message"),
    [
        (np.diag([1.0, -1.0]), "negative in some direction"),
        (np.array([[1.0, 0.5], [0.0, 1.0]]), "not symmetric"),
        (np.diag([1.0, np.nan]), "not finite"),
    ],
)
def test_information_that_is_none(information: Array, message: str) -> None:
    with pytest.raises(BadOption, match=message):
        Prior(information, None, "a.json")


@pytest.mark.parametrize(("matrix", "message"), [(np.ones((2, 2)), "is singular"), (np.diag([1.0, 0.0]), "not above")])
def test_covariances_that_are_none(matrix: Array, message: str) -> None:
    with pytest.raises(BadOption, match=message):
        prior_of_covariance(matrix, None, "a.json")
