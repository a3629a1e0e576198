"""The generic arms are arms that could be built: possible bodies, and drives that can move them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynident.model.plausible import consistency_defects
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

ARMS = {"generic-6r": "RRRRRR", "generic-7r": "RRRRRRR", "generic-scara": "RRPR"}


def pinocchio_model(robot: Robot) -> Any:
    pin = pytest.importorskip("pinocchio")
    model = pin.Model()
    model.gravity.linear = robot.gravity.copy()
    for joint, link in zip(robot.joints, robot.links, strict=True):
        kind = pin.JointModelPrismaticUnaligned if joint.kind == "prismatic" else pin.JointModelRevoluteUnaligned
        pose = pin.SE3(joint.rotation.copy(), joint.translation.copy())
        index = model.addJoint(joint.parent + 1, kind(joint.axis.copy()), pose, joint.name)
        body = link.inertia
        assert body is not None
        inertia = pin.Inertia(body.mass, body.centre_of_mass, body.about_centre)
        model.appendBodyToJoint(index, inertia, pin.SE3.Identity())
    return model


@pytest.mark.parametrize("name", ARMS)
def test_links_are_possible_bodies(name: str) -> None:
    robot = read_robot(name)
    assert "".join(joint.kind[0].upper() for joint in robot.joints) == ARMS[name]
    assert consistency_defects(robot.links) == {}
    for link in robot.links:
        assert link.inertia is not None and link.inertia.is_consistent(margin=5e-5)


@pytest.mark.parametrize("name", ARMS)
def test_everything_is_stated(name: str) -> None:
    robot = read_robot(name)
    assert robot.tool == "tool" and "no maker's data" in robot.note
    for joint in robot.joints:
        assert np.all(np.isfinite(list(vars(joint.limits).values())))
        assert joint.drive.gain and joint.drive.rotor_inertia > 0
        assert joint.damping and joint.friction


@pytest.mark.parametrize("name", ARMS)
def test_drives_hold_and_accelerate_the_arm(name: str) -> None:
    """At rest anywhere, each joint alone at its acceleration limit; and its friction at full speed beside gravity."""
    pin = pytest.importorskip("pinocchio")
    robot = read_robot(name)
    model = pinocchio_model(robot)
    data = model.createData()
    limits = [joint.limits for joint in robot.joints]
    lower, upper = np.array([item.lower for item in limits]), np.array([item.upper for item in limits])
    effort = np.array([item.effort for item in limits])
    acceleration = np.array([item.acceleration for item in limits])
    speed = np.array([item.velocity for item in limits])
    dry = np.array([joint.friction for joint in robot.joints], dtype=float)
    wet = np.array([joint.damping for joint in robot.joints], dtype=float)
    random = np.random.default_rng(0)
    for _ in range(300):
        q = random.uniform(lower, upper)
        inertia = np.diag(pin.crba(model, data, q)) + np.diag(robot.reflected_inertia)
        gravity = np.abs(pin.computeGeneralizedGravity(model, data, q))
        assert np.all(gravity + inertia * acceleration < 0.95 * effort)
        assert np.all(gravity + dry + wet * speed < 0.95 * effort)
