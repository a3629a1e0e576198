"""Tails and quantiles without SciPy: the answers of ``scipy.special``."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.special

from dynident.identification.residuals.quantiles import (
    chi_square_quantile,
    chi_square_tail,
    normal_quantile,
    normal_share,
    student_quantile,
    student_share,
)

DEGREES = np.array([0.5, 1, 2, 3.3, 7, 30, 99, 199, 201, 1e3, 1e5, 9e6, 1.1e7, 1e9, 1e12, np.inf])[:, None]


def test_student() -> None:
    shares = np.array([1e-12, 1e-6, 0.001, 0.025, 0.3, 0.49, 0.5, 0.6, 0.975, 1 - 1e-6])
    wanted = scipy.special.stdtrit(DEGREES, shares)
    np.testing.assert_allclose(student_quantile(shares, DEGREES), wanted, rtol=1e-9, atol=1e-14)
    values = np.array([-200.0, -8, -4, -1, -1e-5, 0, 0.5, 8])
    np.testing.assert_allclose(student_share(values, DEGREES), scipy.special.stdtr(DEGREES, values), 1e-9, 1e-300)


def test_normal() -> None:
    shares = np.array([0.0, 1e-300, 1e-10, 0.3, 0.5, 0.9, 1.0])
    np.testing.assert_allclose(normal_quantile(shares), scipy.special.ndtri(shares), rtol=1e-14)
    np.testing.assert_allclose(
        normal_share([-30.0, -1.0, 0.0, 4.0]), scipy.special.ndtr([-30.0, -1.0, 0.0, 4.0]), 1e-12
    )


def test_chi_square() -> None:
    degrees = np.array([0.5, 1, 2, 5, 20, 100, 199, 201, 1e3, 1e5, 1e7])[:, None]
    values = degrees * np.array([0.01, 0.3, 0.99, 1, 1.01, 1.2, 5])
    np.testing.assert_allclose(chi_square_tail(values, degrees), scipy.special.chdtrc(degrees, values), 1e-11, 1e-250)
    for share in (0.001, 0.5, 0.95, 0.999):
        for count in (0.5, 1, 17, 150, 1e4):
            found = chi_square_quantile(share, count)
            assert found == pytest.approx(scipy.special.chdtri(count, 1.0 - share), rel=1e-11)


def test_what_is_not_a_number_stays_none_and_ends_are_ends() -> None:
    assert np.isnan(student_quantile(0.975, [0.0, np.nan])).all() and np.isnan(chi_square_tail(3.0, 0))
    assert np.isnan(student_share(np.nan, 3)) and np.isnan(normal_quantile(1.5))
    np.testing.assert_array_equal(chi_square_tail([np.inf, -1.0, 0.0], 3), [0.0, 1.0, 1.0])
    np.testing.assert_array_equal(student_quantile([0.0, 1.0], 3), [-np.inf, np.inf])
    assert student_quantile(0.3, 5).shape == ()
