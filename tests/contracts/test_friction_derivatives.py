"""The derivatives that every friction part gives are those of its columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.model.friction import FRICTION, Friction, Motion
from dynident.model.friction.coulomb import Coulomb


def motion(seed: int = 0) -> Motion:
    """Return a motion away from standstill, where a smoothed sign is smooth on the scale of a difference."""
    generator = np.random.default_rng(seed)
    q, dq, ddq, torque = generator.uniform(0.01, 1.0, (4, 30, 3)) * generator.choice([-1.0, 1.0], (4, 30, 3))
    return Motion(q, dq, ddq, torque, temperature=25.0 + q, state=0.1 * q[..., None])


def differences(part: Friction, at: Motion) -> list[Array]:
    """Return central differences of the columns by q, dq and ddq."""
    found = []
    for name in ("q", "dq", "ddq"):
        value = getattr(at, name)
        above, below = value + 1e-6, value - 1e-6
        rise = part.columns(replace(at, **{name: above})) - part.columns(replace(at, **{name: below}))
        found.append(rise / (above - below)[..., None])
    return found


@pytest.mark.parametrize("name", FRICTION.names())
def test_derivatives_are_those_of_the_columns(name: str) -> None:
    part = FRICTION.make(name)
    at = motion()
    found = part.derivatives(at)
    by_differences = differences(part, at)
    for exact, difference in zip(found, by_differences, strict=True):
        assert exact.shape == part.columns(at).shape
        np.testing.assert_allclose(exact, difference, rtol=1e-5, atol=1e-7)


def test_a_sharp_sign_has_the_derivative_zero() -> None:
    assert not any(np.any(slope) for slope in Coulomb(width=0.0).derivatives(motion()))


def test_a_smooth_sign_is_steepest_at_rest() -> None:
    still = Motion(*np.zeros((3, 1, 1)))
    assert Coulomb(width=0.02).derivatives(still)[1] == pytest.approx(50.0)
