"""Friction columns in closed form, and what a motion looks like from the motors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.model.friction import FRICTION, Friction, Motion, auto_friction
from dynident.model.friction.asymmetric import Asymmetric
from dynident.model.friction.balancer import Balancer
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.degressive import Degressive
from dynident.model.friction.load import Load
from dynident.model.friction.load_directional import LoadDirectional
from dynident.model.friction.load_stribeck import LoadStribeck
from dynident.model.friction.offset import Offset
from dynident.model.friction.periodic import Periodic
from dynident.model.friction.polynomial import Polynomial
from dynident.model.friction.rotor_inertia import RotorInertia
from dynident.model.friction.spring import Spring
from dynident.model.friction.stribeck import Stribeck
from dynident.model.friction.temperature import Temperature
from dynident.model.friction.viscous import Viscous
from dynident.model.joint import Drive
from dynident.model.robot import Robot

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


@given(SIGNAL, st.floats(0.05, 1.0), st.floats(0.5, 2.0))
def test_stribeck_fades_with_speed(dq: Array, velocity: float, exponent: float) -> None:
    part = Stribeck(velocity, exponent, width=0.01)
    expected = np.tanh(dq / 0.01) * np.exp(-((np.abs(dq) / velocity) ** exponent))
    np.testing.assert_allclose(part.columns(motion(dq))[..., 0], expected, atol=1e-15)
    at = part.columns(motion(np.array([[0.2, velocity]])))[0, :, 0] if velocity > 0.2 else None
    assert at is None or (at[0] > at[1] and at[1] == pytest.approx(np.exp(-1.0)))


@given(SIGNAL)
def test_powers_of_the_speed(dq: Array) -> None:
    moved = motion(dq)
    np.testing.assert_allclose(Polynomial().columns(moved), np.stack([np.abs(dq) * dq, dq**3], axis=-1))
    far = np.where(np.abs(dq) < 1.0, 1.0, dq)
    root = Degressive(width=1e-4).columns(motion(far))[..., 0]
    np.testing.assert_allclose(root, np.sign(far) * np.sqrt(np.abs(far)), rtol=1e-7)


def test_degressive_friction_is_a_straight_line_near_standstill() -> None:
    part = Degressive(exponent=0.5, width=0.1)
    slow = np.array([[1e-4, -2e-4]])
    np.testing.assert_allclose(part.columns(motion(slow))[..., 0], slow / np.sqrt(0.1), rtol=1e-5)


@given(SIGNAL)
def test_two_directions_with_one_level_are_coulomb_friction(dq: Array) -> None:
    found = Asymmetric(0.05).columns(motion(dq))
    np.testing.assert_allclose(found.sum(axis=-1), Coulomb(0.05).columns(motion(dq))[..., 0])
    assert np.all(found[..., 0] >= 0) and np.all(found[..., 1] <= 0)


@given(SIGNAL, SIGNAL)
def test_load_is_coulomb_friction_times_the_torque(dq: Array, torque: Array) -> None:
    found = Load(0.05).columns(Motion(dq, dq, dq, torque=torque))
    np.testing.assert_allclose(found, np.abs(torque)[..., None] * Coulomb(0.05).columns(motion(dq)))


@given(SIGNAL, SIGNAL, st.floats(0.05, 1.0))
def test_loss_of_load_fades_with_speed_and_depends_on_the_direction_of_the_power(
    dq: Array, torque: Array, velocity: float
) -> None:
    at = Motion(dq, dq, dq, torque=torque)
    found = LoadStribeck(velocity, 0.05).columns(at)[..., 0]
    expected = np.abs(torque) * np.tanh(dq / 0.05) * np.exp(-((dq / velocity) ** 2))
    np.testing.assert_allclose(found, expected, atol=1e-12)
    forth, back = np.moveaxis(LoadDirectional(velocity, 0.05).columns(at), -1, 0)
    np.testing.assert_allclose(forth + back, found, atol=1e-12)
    driving = np.sign(torque) * np.sign(dq) > 0
    np.testing.assert_array_equal(forth[~driving], 0.0)
    np.testing.assert_array_equal(back[driving], 0.0)
    assert np.all(forth * dq >= 0) and np.all(back * dq >= 0)


@given(SIGNAL, st.floats(0.5, 100.0))
def test_ripple_repeats_after_a_cycle(q: Array, cycles: float) -> None:
    rest = np.zeros_like(q)
    one, next_one = (Periodic(cycles).columns(Motion(at, rest, rest)) for at in (q, q + 2 * np.pi / cycles))
    np.testing.assert_allclose(one, next_one, atol=1e-11 * (1 + 10 * cycles))
    np.testing.assert_allclose(one[..., 0] ** 2 + one[..., 1] ** 2, 1.0)


@given(SIGNAL, SIGNAL)
def test_temperature_scales_dry_and_viscous_friction(dq: Array, temperature: Array) -> None:
    part = Temperature(reference=20.0, width=0.03)
    found = part.columns(Motion(dq, dq, dq, temperature=20.0 + temperature))
    np.testing.assert_allclose(found[..., 0], temperature * np.tanh(dq / 0.03), atol=1e-12)
    np.testing.assert_allclose(found[..., 1], temperature * dq, atol=1e-12)


@pytest.mark.parametrize(("part", "missing"), [(Load(), "rigid bodies"), (Temperature(), "temperatures")])
def test_a_signal_that_is_not_there_is_named(part: Friction, missing: str) -> None:
    with pytest.raises(BadOption, match=missing):
        part.columns(motion(np.ones((2, 1))))


def test_a_motion_of_some_rows_and_drives() -> None:
    signals = np.random.default_rng(0).normal(size=(5, 6, 3))
    whole = Motion(*signals)
    np.testing.assert_array_equal(whole.of_drives([2, 0]).ddq, signals[2][:, [2, 0]])
    np.testing.assert_array_equal(whole.rows(slice(1, 4)).temperature, signals[4][1:4])
    assert motion(signals[0]).of_drives([1]).torque is None


@pytest.mark.parametrize(
    ("drive", "is_there"),
    [(Drive(gain=9.0), True), (Drive(gain=-9.0), True), (Drive(gain=9.0, rotor_inertia=1e-5), False), (Drive(), False)],
)
def test_the_automatic_list_holds_rotors_where_torques_are_those_of_currents(
    planar_2r: Robot, drive: Drive, is_there: bool
) -> None:
    robot = planar_2r.with_drives(dict.fromkeys(planar_2r.joint_names, drive), planar_2r.coupling)
    (rotor,) = (part for part in auto_friction(robot) if isinstance(part, RotorInertia))
    assert rotor.is_optional is not is_there
    others = [[part for part in own if part != rotor] for own in (auto_friction(robot), auto_friction())]
    assert others[0] == [part for part in others[1] if not isinstance(part, RotorInertia)]


def test_one_drive_without_a_current_leaves_rotors_to_held_out_samples(planar_2r: Robot) -> None:
    first = planar_2r.joint_names[0]
    robot = planar_2r.with_drives({first: Drive(gain=9.0)}, planar_2r.coupling)
    assert auto_friction(robot) == auto_friction()


@given(st.floats(0.05, 0.4), st.floats(1.02, 8.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_a_balancer_is_the_slope_of_the_energy_of_a_spring_between_two_points(
    near: float, ratio: float, slack: float, dead: float
) -> None:
    """A spring of 900 N/m from a point on the base to one on the link, its length from their places in the plane."""
    stiffness, far = 900.0, ratio * near

    def energy(q: Array) -> Array:
        on_link = far * np.array([np.cos(q - dead), np.sin(q - dead)])
        length = np.hypot(on_link[0] - near, on_link[1])
        return 0.5 * stiffness * (length - slack * near) ** 2

    q, step = np.linspace(dead - 2.0, dead + 2.0, 21), 1e-5
    at = Motion(q[:, None], np.zeros((21, 1)), np.zeros((21, 1)))
    found = stiffness * near * far * Balancer(dead, ratio).columns(at)[:, 0] @ [1.0, -slack]
    slope = (energy(q + step) - energy(q - step)) / (2.0 * step)
    np.testing.assert_allclose(found, slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max())


def test_a_spring_asks_for_torque_in_proportion_to_the_way_from_rest() -> None:
    q = np.array([[0.4, -1.0], [0.1, 0.0]])
    found = Spring(rest=0.1).columns(Motion(q, 0 * q, 0 * q))
    np.testing.assert_allclose(found[..., 0], q - 0.1, atol=1e-15)
