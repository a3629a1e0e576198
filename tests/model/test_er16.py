"""The ER-16: what the article's numbers say of themselves, and the consistent robot that ships."""

import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.inertia import Inertia
from dynident.model.kernels import batched
from dynident.model.robot import Robot
from dynident.robot_files import read_robot, robots
from dynident.robot_files.formats.dh import read_dh
from dynident.studies import er16_article as article
from loaded_file import loaded_file


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return loaded_file("scripts/derive_er16.py")


@pytest.fixture(scope="module")
def target(script):
    return script.article_target()


@pytest.fixture(scope="module")
def shipped() -> Robot:
    return read_robot("er16")


def theta_of(robot_or_model: Robot | DynamicModel) -> Array:
    theta = robot_or_model.nominal if isinstance(robot_or_model, Robot) else robot_or_model.nominal()
    assert theta is not None
    return theta


def rows_of(target, motion, width=0.0):
    model = DynamicModel(target.model.robot, (Coulomb(width=width), *target.model.friction[1:]))
    return model.regressor(motion)[..., base_parameters(model).independent]


# What the article says of itself


def test_the_base_parameters_are_those_of_table_2(target):
    base = base_parameters(target.model)
    assert [target.model.parameters[k].name for k in base.independent] == list(article.TABLE_2)
    assert [base.names[0], base.names[5], base.names[14]] == [
        "Izz[link1] + Iyy[link2] + 0.0256 m[link2] + Iyy[link3] + 0.488 m[link3]",
        "Izz[link2] + 0.4624 m[link3]",
        "my[link3]",
    ]
    assert base_parameters(target.model, inertial_only=True).count == 15
    assert base_parameters(DynamicModel(target.robot)).count == 36


def test_the_columns_of_table_2_span_the_regressor(target):
    motion = target.model.random_motion(300, seed=3)
    full = target.model.regressor(motion)[..., :30].reshape(-1, 30)
    q, _ = np.linalg.qr(full[:, base_parameters(target.model).independent[:15]])
    norms = np.linalg.norm(full, axis=0)
    live = norms > 1e-12 * norms.max()
    assert np.linalg.norm(full - q @ (q.T @ full), axis=0)[live].max() < 4e-14 * norms.max()


def test_condition_numbers_over_the_excitation(target):
    rows = rows_of(target, target.motion).reshape(-1, 21)
    assert rows.shape == (75_000, 21)
    assert np.linalg.cond(rows) == pytest.approx(75.9, abs=0.05)
    assert np.linalg.cond(rows / np.linalg.norm(rows, axis=0)) == pytest.approx(5.96, abs=0.005)
    smooth = rows_of(target, target.motion, width=0.02).reshape(-1, 21)
    assert np.linalg.cond(smooth) == pytest.approx(79.4, abs=0.05)


def test_torques_of_table_2_over_the_excitation(target):
    np.testing.assert_allclose(target.torque.min(axis=0), [-249.86, -513.84, -77.32], atol=0.01)
    np.testing.assert_allclose(target.torque.max(axis=0), [375.22, -163.36, 100.17], atol=0.01)


def test_table_2_is_no_possible_robot(target):
    theta = base_parameters(target.model).to_standard(target.beta)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (2000, 3))
    smallest = np.linalg.eigvalsh(batched.mass_matrix(target.model.robot.chain, theta[:30], q))[:, 0]
    assert np.all(smallest < 0)
    assert article.TABLE_2["Izz[link3]"] < 0 and article.TABLE_2["Fc[joint1]"] < 0


def test_table_3_leaves_one_parameter_of_table_2_outside():
    assert list(article.TABLE_3) == list(article.TABLE_2)
    outside = [name for name, value in article.TABLE_2.items() if abs(value) > article.TABLE_3[name]]
    assert outside == ["Fc[joint2]"]


def test_the_excitation_stays_within_its_range_and_does_not_start_at_rest(target):
    degrees = np.rad2deg(target.motion.q)
    assert degrees.min() == pytest.approx(-95.5, abs=0.1) and degrees.max() == pytest.approx(121.0, abs=0.1)
    np.testing.assert_allclose(target.motion.dq[0], [-1.33, 0.66, 0.33], atol=0.005)


def test_the_closest_consistent_robot_differs_by_35_to_41_percent(script, target):
    nothing = (Inertia.from_vector(np.zeros(10)),) * 3
    x, misfit = script.closest(target, wrist=nothing, margin=0.0, spread=0.0, floor=0.0)
    beta = np.concatenate([target.grouping[:, :30] @ x[:30], x[30:]])
    np.testing.assert_allclose(target.shares(beta), [0.360, 0.352, 0.406], atol=0.002)
    np.testing.assert_allclose(target.correlations(beta), [0.936, 0.938, 0.926], atol=0.0015)
    assert misfit == pytest.approx(np.linalg.norm(target.shares(beta)), rel=1e-6)
    assert x[19] == pytest.approx(200.0, abs=0.01)  # a mass at its bound: why the shipped robot takes one more step


# The robot that ships


def test_the_shipped_robot_is_what_the_script_derives(script, target, shipped):
    derived = script.derive(target)
    again = read_dh("derived", script.as_yaml(derived).encode())
    np.testing.assert_allclose(theta_of(shipped), theta_of(again), rtol=1e-3, atol=5e-3)
    for one, other in zip(shipped.joints, again.joints, strict=True):
        assert (one.limits, one.drive) == (other.limits, other.drive)
        assert one.friction == pytest.approx(other.friction, rel=1e-3)
        assert one.damping == pytest.approx(other.damping, rel=1e-3)
    assert shipped.note == again.note and "our assumption" in shipped.note


def test_the_shipped_robot_stands_off_every_boundary(shipped):
    assert all(link.inertia.is_consistent(margin=1e-3) for link in shipped.links)
    assert all(joint.friction >= 0.5 and joint.damping >= 0.5 for joint in shipped.joints)
    masses = [link.inertia.mass for link in shipped.links]
    assert min(masses[:3]) > 2.0 and max(masses[:3]) < 190.0  # bounds 1 and 200 kg
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (500, 6))
    assert np.linalg.eigvalsh(batched.mass_matrix(shipped.chain, theta_of(shipped), q)).min() > 1e-3


def test_the_shipped_robot_comes_as_close_to_table_2_as_it_says(script, target, shipped):
    model = DynamicModel(shipped.locked(article.LOCKED), target.model.friction)
    beta = base_parameters(model).from_standard(theta_of(model))
    shares = target.shares(beta)
    np.testing.assert_allclose(shares, [0.372, 0.364, 0.465], atol=0.002)
    np.testing.assert_allclose(target.correlations(beta), [0.928, 0.934, 0.903], atol=0.002)
    _, smallest = script.closest(target)
    assert np.linalg.norm(shares) == pytest.approx((1 + script.SLACK) * smallest, rel=1e-4)
    np.testing.assert_allclose(model.torque(target.motion, theta_of(model)), target.predict(beta), atol=1e-9)


def test_locking_the_wrist_is_holding_it_still(target, shipped):
    """Inverse dynamics of all six axes with the wrist at rest, against the three-axis robot with merged links."""
    motion = target.model.random_motion(200, seed=5)
    q, dq, ddq = (np.pad(values, ((0, 0), (0, 3))) for values in (motion.q, motion.dq, motion.ddq))
    six = batched.inverse_dynamics(shipped.chain, theta_of(shipped), q, dq, ddq)
    locked = shipped.locked(article.LOCKED)
    three = batched.inverse_dynamics(locked.chain, theta_of(locked), motion.q, motion.dq, motion.ddq)
    np.testing.assert_allclose(six[:, :3], three, atol=1e-9 * np.abs(three).max())


def test_the_shipped_kinematics_are_table_1(target, shipped):
    q = np.random.default_rng(1).uniform(-2, 2, (20, 6))
    rotations, translations = batched.link_poses(shipped.chain, q)
    for sample, angles in enumerate(q):
        pose = np.eye(4)
        for i, (alpha, a, d, theta) in enumerate(article.TABLE_1):
            ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta + angles[i]), np.sin(theta + angles[i])
            rows = [ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa], [st * sa, ct * sa, ca, d * ca], [0, 0, 0, 1]
            pose = pose @ np.array(rows)
            np.testing.assert_allclose(rotations[sample, i], pose[:3, :3], atol=1e-12)
            np.testing.assert_allclose(translations[sample, i], pose[:3, 3], atol=1e-12)
    assert shipped.tool == "" and shipped.frames == {}


@pytest.mark.parametrize("table", [article.BETA_1, article.BETA_2])
def test_the_limits_hold_both_trajectories(shipped, table):
    time = np.arange(0, article.PERIOD, 0.01)
    motion = Motion(*FourierSeries.from_table(list(table), article.PERIOD).evaluate(time))
    model = DynamicModel(shipped.locked(article.LOCKED), (Coulomb(), Viscous()))
    torque = model.torque(motion, theta_of(model))
    for i, joint in enumerate(shipped.joints[:3]):
        limits = joint.limits
        assert limits.lower < motion.q[:, i].min() and motion.q[:, i].max() < limits.upper
        assert np.abs(motion.dq[:, i]).max() < limits.velocity
        assert np.abs(motion.ddq[:, i]).max() < limits.acceleration
        assert np.abs(torque[:, i]).max() < 0.8 * limits.effort


def test_every_value_that_is_not_the_articles_is_marked(shipped):
    text = (Path(robots.__file__).parent / "er16.yaml").read_text()
    assert len(re.findall("# Limits and drive: our assumption", text)) == 6
    assert len(re.findall(r"(friction|damping): \S+  # our assumption", text)) == 6
    assert len(re.findall("inertia:  # our assumption", text)) == 3
