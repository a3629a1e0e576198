"""What tests of log checks have in common."""

from dataclasses import replace

import pytest

from dynident.case.case import Case
from dynident.data.formats import ColumnMap
from dynident.data.preprocessing import default_preprocessing
from dynident.model.friction import FRICTION, default_friction
from dynident.model.robot import Robot


@pytest.fixture(scope="module")
def case(spatial_3r: Robot) -> Case:
    """The case of a small arm with friction."""
    joints = tuple(replace(joint, damping=2.0, friction=3.0) for joint in spatial_3r.joints)
    robot = replace(spatial_3r, joints=joints)
    friction = tuple(FRICTION.make(name) for name in default_friction())
    return Case(robot, friction, ColumnMap(joints=robot.joint_names), default_preprocessing())
