"""The quick weighted fit of the log checks: exact data of joints of any size, and directions that no row tells."""

from __future__ import annotations

import numpy as np
import pytest

from dynident.diagnosis.causes.weighted_fit import EXACT, weighted_products


@pytest.mark.parametrize("size", [1.0, 1e-18, 1e-6, 1e6, 1e12])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_joint_of_small_torques_leaves_the_columns_of_the_others(size: float, noise: float) -> None:
    """Of torques a millionth of the other joint's, rows weigh 1e12 times as much from the first pass."""
    random, beta = np.random.default_rng(0), np.array([3.0, -2.0, 0.5, 0.0])
    wide, narrow = random.normal(size=(400, 4)), np.zeros((400, 4))
    wide[:, 3] = 0.0  # no row tells it
    narrow[:, 2] = size * random.normal(size=400)
    grams, sides, squares = [], [], []
    for rows in (wide, narrow):
        target = rows @ beta
        target = target + noise * np.std(target) * random.normal(size=len(target))
        grams.append(rows.T @ rows)
        sides.append(rows.T @ target)
        squares.append(target @ target)
    counts, total = np.array([400.0, 400.0]), np.array(squares)
    found = weighted_products(np.array(grams), np.array(sides), total, counts, EXACT**2 * total / counts)
    np.testing.assert_allclose(found.beta, beta, atol=1e-6 + noise)
    assert found.beta[3] == 0.0
    np.testing.assert_allclose(found.variances / (total / counts), max(noise, EXACT) ** 2, rtol=0.2)
