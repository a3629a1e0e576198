"""The dynamic model against closed forms, Pinocchio, and the laws of drives: coupling, known rotors, followers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.errors import BadOption, UnknownChoice
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.rotor_inertia import RotorInertia
from dynident.model.friction.viscous import Viscous
from dynident.model.joint import Drive
from dynident.model.robot import Link, Robot

ALL = tuple(FRICTION.make(name) for name in ("coulomb", "viscous", "offset", "rotor_inertia"))
EVERY = tuple(FRICTION.make(name) for name in FRICTION.names() if name != "asymmetric")  # in place of Coulomb's
ARMS = ("pendulum", "planar_2r", "planar_3r", "spatial_3r", "sliding_arm", "scara", "mimic_arm", "coupled_arm")


def random_theta(model: DynamicModel, seed: int = 0) -> Array:
    return np.random.default_rng(seed).normal(size=len(model.parameters))


@pytest.mark.parametrize("has_friction", [True, False])
@pytest.mark.parametrize("arm", ARMS)
def test_torque_is_the_regressor_times_theta(arm: str, has_friction: bool, request: pytest.FixtureRequest) -> None:
    """Without friction the rotors are left, for which no columns are made."""
    robot = request.getfixturevalue(arm)
    drives = {name: Drive(gear_ratio=20.0, rotor_inertia=1e-4, bias=0.3) for name in robot.joint_names}
    model = DynamicModel(robot.with_drives(drives), EVERY)
    motion, theta = model.random_motion(20), random_theta(model)
    if not has_friction:
        theta[[one.kind == "friction" for one in model.parameters]] = 0.0
        assert np.any(theta[model.inertial_count :])
    regressor = model.regressor(motion)
    assert regressor.shape == (20, model.robot.dof, len(model.parameters))
    np.testing.assert_allclose(
        regressor @ theta + model.known_torque(motion), model.torque(motion, theta), rtol=1e-10, atol=1e-9
    )


def test_pendulum_in_closed_form(pendulum: Robot) -> None:
    """tau = Izz ddq + g (mx cos q - my sin q) + Fc sign(dq) + Fv dq."""
    model = DynamicModel(pendulum, (Coulomb(0.0), Viscous()))
    motion = model.random_motion(30)
    body = pendulum.links[0].inertia
    assert body is not None
    theta = np.append(body.vector, [0.7, 0.4])
    q, dq, ddq = motion.q[:, 0], motion.dq[:, 0], motion.ddq[:, 0]
    mx, my = body.first_moment[:2]
    weight = 9.81 * (mx * np.cos(q) - my * np.sin(q))
    expected = body.rotational[2, 2] * ddq + weight + 0.7 * np.sign(dq) + 0.4 * dq
    np.testing.assert_allclose(model.torque(motion, theta)[:, 0], expected, atol=1e-12)


def test_planar_two_link_arm_in_closed_form(planar_2r: Robot) -> None:
    """Spong, Hutchinson and Vidyasagar 2006, (7.87), with first moments across the links kept."""
    model = DynamicModel(planar_2r)
    motion = model.random_motion(30)
    first, second = (link.inertia for link in planar_2r.links)
    assert first is not None and second is not None and planar_2r.nominal is not None
    (q1, q2), (w1, w2), (a1, a2) = motion.q.T, motion.dq.T, motion.ddq.T
    length, g = 0.5, 9.81
    x1, y1 = first.first_moment[:2]
    x2, y2 = second.first_moment[:2]
    shared = length * (x2 * np.cos(q2) - y2 * np.sin(q2))
    slope = -length * (x2 * np.sin(q2) + y2 * np.cos(q2))
    i1, i2 = first.rotational[2, 2] + second.mass * length**2, second.rotational[2, 2]
    weight2 = g * (x2 * np.cos(q1 + q2) - y2 * np.sin(q1 + q2))
    weight1 = g * ((x1 + second.mass * length) * np.cos(q1) - y1 * np.sin(q1)) + weight2
    tau1 = (i1 + i2 + 2 * shared) * a1 + (i2 + shared) * a2 + slope * (2 * w1 * w2 + w2**2) + weight1
    tau2 = (i2 + shared) * a1 + i2 * a2 - slope * w1**2 + weight2
    found = model.torque(motion, planar_2r.nominal)
    np.testing.assert_allclose(found, np.stack([tau1, tau2], axis=1), atol=1e-12)


def test_a_vertical_slide_carries_its_weight(scara: Robot) -> None:
    model = DynamicModel(scara)
    motion = model.random_motion(10)
    assert scara.nominal is not None
    carried = sum(link.inertia.mass for link in scara.links[2:] if link.inertia)
    still = Motion(motion.q, 0 * motion.q, 0 * motion.q)
    expected = np.zeros((10, 4))
    expected[:, 2] = 9.81 * carried
    np.testing.assert_allclose(model.torque(still, scara.nominal), expected, atol=1e-12)


def test_coupled_motors_by_hand(coupled_arm: Robot) -> None:
    """tau += C' f(C dq) + C' diag(Ia) C ddq, one sample written out: motor 3 turns with 0.7 dq2 + dq3."""
    model = DynamicModel(coupled_arm, (Coulomb(0.0), Viscous(), RotorInertia()))
    dq, ddq = np.array([0.5, -0.8, 0.1]), np.array([1.0, 2.0, -3.0])
    motion = Motion(np.array([[0.1, 0.2, 0.3]]), dq[None], ddq[None])
    coulomb, viscous, rotor = np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3]), np.array([0.01, 0.02, 0.03])
    theta = np.concatenate([np.zeros(30), np.column_stack([coulomb, viscous, rotor]).ravel()])
    speed3, acceleration3 = 0.7 * -0.8 + 0.1, 0.7 * 2.0 - 3.0
    motor3 = 3.0 * np.sign(speed3) + 0.3 * speed3 + 0.03 * acceleration3
    expected = np.array([1.0 * 1 + 0.1 * 0.5 + 0.01 * 1.0, 2.0 * -1 + 0.2 * -0.8 + 0.02 * 2.0 + 0.7 * motor3, motor3])
    known = model.known_torque(motion)[0]
    np.testing.assert_allclose(model.torque(motion, theta)[0] - known, expected, atol=1e-12)
    np.testing.assert_allclose((model.regressor(motion) @ theta)[0], expected, atol=1e-12)
    ratios = np.array([100.0, -120.0, 80.0])
    motor = ratios**2 * 2e-5 * np.array([1.0, 2.0, acceleration3])
    np.testing.assert_allclose(known, [motor[0], motor[1] + 0.7 * motor[2], motor[2]], atol=1e-12)


def test_coupled_friction_dissipates(coupled_arm: Robot) -> None:
    model = DynamicModel(coupled_arm, ALL[:2])
    motion = model.random_motion(50)
    theta = np.concatenate([np.zeros(30), np.random.default_rng(0).uniform(0, 2, 6)])
    power = np.sum((model.torque(motion, theta) - model.known_torque(motion)) * motion.dq, axis=1)
    assert np.all(power > 0)


def test_known_rotors_are_no_columns(pendulum: Robot) -> None:
    driven = pendulum.with_drives({"joint1": Drive(100.0, 3e-5)})
    plain, model = DynamicModel(pendulum), DynamicModel(driven)
    motion = plain.random_motion(8)
    np.testing.assert_array_equal(model.regressor(motion), plain.regressor(motion))
    theta = random_theta(plain)
    np.testing.assert_allclose(model.torque(motion, theta) - plain.torque(motion, theta), 0.3 * motion.ddq, atol=1e-12)


def test_a_follower_works_through_its_leader(mimic_arm: Robot, planar_3r: Robot) -> None:
    """By virtual work, the leader bears its own torque and the multiplier times that of the follower."""
    model, full = DynamicModel(mimic_arm), DynamicModel(planar_3r)
    motion = model.random_motion(12)
    theta = mimic_arm.nominal
    assert theta is not None

    def spread(signal: Array, shift: float) -> Array:
        return np.column_stack([signal, -0.5 * signal[:, 1] + shift])

    whole = Motion(spread(motion.q, 0.3), spread(motion.dq, 0.0), spread(motion.ddq, 0.0))
    torque = full.torque(whole, theta)
    expected = np.column_stack([torque[:, 0], torque[:, 1] - 0.5 * torque[:, 2]])
    np.testing.assert_allclose(model.torque(motion, theta), expected, atol=1e-11)


def test_parameters_by_name_and_unit(sliding_arm: Robot) -> None:
    model = DynamicModel(sliding_arm, ALL)
    assert (model.inertial_count, model.coefficients_per_joint, len(model.parameters)) == (30, 4, 42)
    tail = model.parameters[30:]
    assert [p.name for p in tail[:5]] == ["Fc[joint1]", "Fv[joint1]", "F0[joint1]", "Ia[joint1]", "Fc[joint2]"]
    assert [p.unit for p in tail[:4]] == ["N m", "N m s/rad", "N m", "kg m^2"]
    assert [p.unit for p in tail[4:8]] == ["N", "N s/m", "N", "kg"]
    assert [p.nonnegative for p in tail[:4]] == [True, True, False, True]
    assert not any(p.nonnegative for p in model.parameters[:30])


def test_no_friction_is_a_model_too(planar_2r: Robot) -> None:
    model = DynamicModel(planar_2r)
    motion = model.random_motion(5)
    assert model.friction_values(motion).shape == (5, 2, 0)
    assert planar_2r.nominal is not None
    np.testing.assert_allclose(model.torque(motion, planar_2r.nominal), model.regressor(motion) @ planar_2r.nominal)


def test_names_and_parts_give_equal_models(planar_2r: Robot) -> None:
    assert DynamicModel(planar_2r, ("coulomb", "viscous")).friction == (Coulomb(), Viscous())  # type: ignore[arg-type]


def test_parts_that_do_not_go_together(planar_2r: Robot) -> None:
    with pytest.raises(BadOption) as caught:
        DynamicModel(planar_2r, ("coulomb", "viscous", "coulomb"))  # type: ignore[arg-type]
    assert str(caught.value) == (
        "friction = ['coulomb', 'viscous', 'coulomb'] is not possible; the coefficient Fc is there twice; "
        "keep one of its parts"
    )
    with pytest.raises(UnknownChoice, match=r"no friction model called 'viscos'.*did you mean 'viscous'"):
        DynamicModel(planar_2r, ("viscos",))  # type: ignore[arg-type]


def test_nominal_takes_stated_friction(planar_2r: Robot) -> None:
    first, second = planar_2r.joints
    stated = replace(planar_2r, joints=(replace(first, damping=0.5, friction=1.5), replace(second, damping=0.25)))
    model = DynamicModel(stated, ALL)
    theta = model.nominal()
    assert theta is not None and stated.nominal is not None
    np.testing.assert_array_equal(theta[:20], stated.nominal)
    np.testing.assert_array_equal(theta[20:], [1.5, 0.5, 0, 0, 0, 0.25, 0, 0])
    unknown = replace(stated, links=(Link("link1"), stated.links[1]))
    assert DynamicModel(unknown).nominal() is None


def test_random_motion_is_repeatable_and_wide(sliding_arm: Robot) -> None:
    model = DynamicModel(sliding_arm)
    one, again, other = (model.random_motion(500, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.q, again.q)
    assert not np.array_equal(one.q, other.q)
    assert np.abs(one.q[:, 1]).max() <= 1.0 < np.abs(one.q[:, 0]).max() <= np.pi
    assert 2.9 < np.abs(one.dq).max() <= 3.0 and 9.9 < np.abs(one.ddq).max() <= 10.0


def test_a_theta_of_another_length_is_refused(planar_2r: Robot) -> None:
    model = DynamicModel(planar_2r, ALL[:1])
    for size in (21, 23):
        with pytest.raises(ValueError):
            model.torque(model.random_motion(2), np.zeros(size))
