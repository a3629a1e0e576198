"""Friction parts for some joints only, and friction that depends on the load, in the dynamic model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynident.errors import BadOption, UnknownChoice
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.load import Load
from dynident.model.friction.rotor_inertia import RotorInertia
from dynident.model.friction.viscous import Viscous
from dynident.model.joint import Drive
from dynident.model.robot import Robot


def test_a_part_for_some_joints_is_the_part_with_no_coefficient_elsewhere(spatial_3r: Robot) -> None:
    mixed = DynamicModel(
        spatial_3r, (Coulomb(joints=("joint3", "joint1")), Viscous(), Coulomb(0.5, joints=("joint2",)))
    )
    assert [p.name for p in mixed.parameters[30:]] == [
        "Fc[joint1]", "Fv[joint1]", "Fv[joint2]", "Fc[joint2]", "Fc[joint3]", "Fv[joint3]",
    ]  # fmt: skip
    theta = np.random.default_rng(0).normal(size=36)
    motion = mixed.random_motion(20)
    found = mixed.torque(motion, theta)
    np.testing.assert_allclose(mixed.regressor(motion) @ theta, found, atol=1e-10)
    fine, coarse = (DynamicModel(spatial_3r, (Coulomb(width), Viscous())) for width in (0.02, 0.5))
    narrow = np.r_[theta[:30], theta[30:32], 0, theta[32], theta[34:]]
    wide = np.r_[np.zeros(30), 0, 0, theta[33], 0, 0, 0]
    np.testing.assert_allclose(found, fine.torque(motion, narrow) + coarse.torque(motion, wide), atol=1e-10)


def test_coefficients_by_drive_and_column(coupled_arm: Robot) -> None:
    model = DynamicModel(coupled_arm, (Coulomb(), RotorInertia(joints=("joint3",))))
    theta = np.r_[np.zeros(30), 1.0, 2.0, 3.0, 4.0]
    np.testing.assert_array_equal(model.coefficient_table(theta), [[1, 0], [2, 0], [3, 4]])
    np.testing.assert_array_equal(model.rotors(theta), [0, 0, 4])
    assert base_parameters(model).count == len(base_parameters(DynamicModel(coupled_arm)).independent) + 4


def test_joints_that_are_none_and_parts_that_meet(planar_2r: Robot) -> None:
    with pytest.raises(UnknownChoice, match="no joint called 'elbow'"):
        DynamicModel(planar_2r, (Coulomb(joints=("elbow",)),))
    with pytest.raises(BadOption, match="the coefficient Fc is there twice on joint2"):
        DynamicModel(planar_2r, (Coulomb(), Coulomb(0.1, joints=("joint2",))))


@pytest.mark.parametrize("arm", ["spatial_3r", "coupled_arm"])
def test_the_load_is_the_torque_without_friction_of_the_same_parameters(
    arm: str, request: pytest.FixtureRequest
) -> None:
    robot = request.getfixturevalue(arm)
    model = DynamicModel(robot, (RotorInertia(), Viscous(), Load(0.1)))
    still = DynamicModel(robot, (RotorInertia(), Viscous()))
    motion = still.random_motion(15)
    table = np.random.default_rng(2).uniform(0.1, 1.0, (3, 3))
    theta = np.append(robot.nominal, table.ravel())
    bare = np.append(robot.nominal, (table[:, :2] * [1.0, 0.0]).ravel())
    coupling = robot.coupling
    carried = np.linalg.solve(coupling.T, still.torque(motion, bare).T).T
    brake = table[:, 2] * np.abs(carried) * np.tanh(motion.dq @ coupling.T / 0.1)
    plain = still.torque(motion, np.append(robot.nominal, table[:, :2].ravel()))
    np.testing.assert_allclose(model.torque(motion, theta), plain + brake @ coupling, atol=1e-10)
    stated = replace(motion, torque=still.torque(motion, bare))
    np.testing.assert_allclose(model.torque(stated, theta), model.torque(motion, theta), atol=1e-10)
    with pytest.raises(BadOption, match="rigid bodies"):
        model.regressor(motion)


def test_a_bias_is_taken_off_the_prediction(planar_2r: Robot) -> None:
    model = DynamicModel(planar_2r.with_drives({"joint2": Drive(bias=7.5)}))
    motion = Motion(*np.zeros((3, 4, 2)))
    theta = model.nominal()
    assert theta is not None
    found = DynamicModel(planar_2r).torque(motion, theta) - model.torque(motion, theta)
    np.testing.assert_allclose(found, np.tile([0.0, 7.5], (4, 1)))
    with pytest.raises(ValueError, match="the bias is nan"):
        Drive(bias=np.nan)
