"""Uncertainty of a predicted torque: from shares, from a covariance, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynident.errors import BadOption
from dynident.excitation.design.observation import TorqueUncertainty
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot


def test_shares_of_standard_parameters_become_a_covariance_of_base_parameters(planar_2r: Robot) -> None:
    model = DynamicModel(planar_2r, ("viscous",))  # type: ignore[arg-type]
    base, theta = base_parameters(model), model.nominal()
    assert theta is not None
    found = TorqueUncertainty.of_shares(base, theta, 0.1, 3.0)
    drawn = theta * (1.0 + 0.1 * np.random.default_rng(0).normal(size=(200_000, len(theta))))
    expected = np.cov(drawn @ base.matrix.T, rowvar=False)
    scale = np.sqrt(np.outer(np.diagonal(expected), np.diagonal(expected))) + 1e-300
    np.testing.assert_allclose(found.covariance / scale, expected / scale, atol=0.02)
    assert found.sigmas == 3.0
    single = np.where(np.arange(len(theta)) == 0, 0.5, 0.0)
    assert np.linalg.matrix_rank(TorqueUncertainty.of_shares(base, theta, single).covariance) <= 1


def test_factors_are_roots_of_the_covariance_on_the_columns_of_each_joint() -> None:
    root = np.random.default_rng(0).normal(size=(6, 4)) * 10.0 ** np.arange(-6, 6, 2)[:, None]  # rank 4, unlike units
    matrix = root @ root.T
    columns = [np.array([0, 2, 5]), np.array([1, 3])]
    for factor, own in zip(TorqueUncertainty(matrix, 1.5).factors(columns), columns, strict=True):
        assert factor.shape == (len(own), 4)
        expected = 2.25 * matrix[np.ix_(own, own)]
        scale = np.sqrt(np.outer(np.diagonal(expected), np.diagonal(expected)))
        np.testing.assert_allclose(factor @ factor.T / scale, expected / scale, atol=1e-9)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((np.eye(2), 0.0), "sigmas = 0.0 is not possible; give a number above 0"),
        ((np.ones((2, 3)),), "give a square matrix of finite numbers"),
        ((np.full((2, 2), np.nan),), "give a square matrix of finite numbers"),
        ((np.array([[1.0, 2.0], [2.0, 1.0]]),), "without negative eigenvalues"),
        ((np.array([[1.0, 0.5], [0.4, 1.0]]),), "give a symmetric matrix"),
        ((np.array([[0.0, 0.5], [0.5, 1.0]]),), "give a symmetric matrix without negative"),
    ],
)
def test_what_is_no_covariance(given: Any, message: str) -> None:
    with pytest.raises(BadOption, match=message):
        TorqueUncertainty(*given)


def test_shares_that_are_none(planar_2r: Robot) -> None:
    model = DynamicModel(planar_2r)
    base, theta = base_parameters(model), model.nominal()
    assert theta is not None
    with pytest.raises(BadOption, match=r"share = -0.1 is not possible; give shares of 0 or more"):
        TorqueUncertainty.of_shares(base, theta, -0.1)
    with pytest.raises(ValueError, match=r"theta has shape \(3,\), expected \(20,\)"):
        TorqueUncertainty.of_shares(base, np.zeros(3), 0.1)
