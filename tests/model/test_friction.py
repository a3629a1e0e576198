"""Friction columns in closed form, and what a motion looks like from the motors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.model.friction import FRICTION, Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.offset import Offset
from dynident.model.friction.rotor_inertia import RotorInertia
from dynident.model.friction.viscous import Viscous

SIGNAL = arrays(float, (4, 2), elements=st.floats(-5, 5))


def motion(dq: Array, ddq: Array | None = None) -> Motion:
    return Motion(np.zeros_like(dq), dq, np.zeros_like(dq) if ddq is None else ddq)


@given(SIGNAL, st.floats(1e-3, 1.0))
def test_coulomb_is_a_smooth_sign(dq: Array, width: float) -> None:
    found = Coulomb(width).columns(motion(dq))
    np.testing.assert_allclose(found, np.tanh(dq / width)[:, :, None])
    np.testing.assert_array_equal(Coulomb(width).columns(motion(-dq)), -found)


@given(SIGNAL)
def test_width_zero_is_the_sharp_sign_of_the_article(dq: Array) -> None:
    np.testing.assert_array_equal(Coulomb(0.0).columns(motion(dq))[..., 0], np.sign(dq))
    far = np.where(np.abs(dq) < 0.5, 0.5, dq)
    np.testing.assert_allclose(Coulomb(1e-3).columns(motion(far)), Coulomb(0.0).columns(motion(far)), atol=1e-12)


def test_coulomb_reaches_three_quarters_at_its_width() -> None:
    assert Coulomb(0.02).columns(motion(np.array([[0.02]])))[0, 0, 0] == pytest.approx(np.tanh(1.0))


@pytest.mark.parametrize("width", [-0.1, np.inf, np.nan])
def test_widths_that_are_none(width: float) -> None:
    with pytest.raises(BadOption) as caught:
        Coulomb(width)
    assert str(caught.value) == f"width = {width!r} is not possible; give a speed >= 0 in rad/s"


@given(SIGNAL, SIGNAL)
def test_viscous_offset_and_rotor(dq: Array, ddq: Array) -> None:
    moved = motion(dq, ddq)
    np.testing.assert_array_equal(Viscous().columns(moved)[..., 0], dq)
    np.testing.assert_array_equal(Offset().columns(moved)[..., 0], np.ones_like(dq))
    np.testing.assert_array_equal(RotorInertia().columns(moved)[..., 0], ddq)


def test_coefficients_and_their_units() -> None:
    found = {name: FRICTION.get(name).coefficients for name in ("coulomb", "viscous", "offset", "rotor_inertia")}
    table = {name: [(c.symbol, c.unit, c.linear_unit, c.nonnegative) for c in row] for name, row in found.items()}
    assert table == {
        "coulomb": [("Fc", "N m", "N", True)],
        "viscous": [("Fv", "N m s/rad", "N s/m", True)],
        "offset": [("F0", "N m", "N", False)],
        "rotor_inertia": [("Ia", "kg m^2", "kg", True)],
    }


@given(SIGNAL, SIGNAL, arrays(float, (2, 2), elements=st.floats(-0.4, 0.4)))
def test_motors_see_the_coupled_speed_and_do_the_same_work(dq: Array, torque: Array, mixed: Array) -> None:
    coupling = np.eye(2) + mixed
    at_joints = Motion(dq + 1.0, dq, 2.0 * dq, torque, temperature=torque)
    at_motors = at_joints.at_motors(coupling)
    assert at_motors.torque is not None
    for row in range(len(dq)):
        np.testing.assert_allclose(at_motors.dq[row], coupling @ dq[row], atol=1e-12)
        np.testing.assert_allclose(at_motors.q[row], coupling @ (dq[row] + 1.0), atol=1e-12)
        np.testing.assert_allclose(at_motors.ddq[row], coupling @ (2.0 * dq[row]), atol=1e-12)
        assert at_motors.torque[row] @ at_motors.dq[row] == pytest.approx(torque[row] @ dq[row], abs=1e-9)
    np.testing.assert_array_equal(at_motors.temperature, torque)
    assert motion(dq).at_motors(coupling).torque is None
