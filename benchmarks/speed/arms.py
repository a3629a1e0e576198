"""The arms and motions that rows share, and the same arms in Pinocchio."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.model.friction import Motion
from dynident.model.inertia import Inertia
from dynident.model.joint import Joint, rotation_about
from dynident.model.parameters import to_pinocchio
from dynident.model.robot import Link, Robot

#: a (m), alpha (rad), d (m) of the UR10, standard convention, as its maker publishes them.
UR10 = (
    (0.0, np.pi / 2, 0.1273),
    (-0.612, 0.0, 0.0),
    (-0.5723, 0.0, 0.0),
    (0.0, np.pi / 2, 0.163941),
    (0.0, -np.pi / 2, 0.1157),
    (0.0, 0.0, 0.0922),
)


def ur10() -> Robot:
    """Return the arm with bodies of our own, on which times do not depend; link i stands on the axis of joint i."""
    body = Inertia.from_centre_of_mass(5.0, [0.1, -0.05, 0.08], np.diag([0.06, 0.07, 0.05]))
    joints, a, alpha = [], 0.0, 0.0
    for i, (length, twist, offset) in enumerate(UR10):
        turn = rotation_about([1.0, 0.0, 0.0], alpha)
        joints.append(
            Joint(f"joint{i + 1}", "revolute", i - 1, turn, turn @ [0.0, 0.0, offset] + [a, 0.0, 0.0], [0, 0, 1])
        )
        a, alpha = length, twist
    return Robot("ur10", tuple(Link(f"link{i + 1}", body) for i in range(6)), tuple(joints))


def motion(samples: int = 25_000, joints: int = 6) -> Motion:
    """Return a motion of five harmonics of 0.1 Hz at 1 kHz."""
    generator = np.random.default_rng(0)
    sine, cosine = 0.3 * generator.normal(size=(2, joints, 5))
    series = FourierSeries(np.zeros(joints), sine, cosine, 10.0)
    return Motion(*(np.ascontiguousarray(part) for part in series.evaluate(np.arange(samples) / 1000)))


def as_pinocchio(robot: Robot, armature: Array | None = None) -> Any:
    """Return a robot of revolute joints as a Pinocchio model, joint by joint; Pinocchio must be there."""
    import pinocchio

    model = pinocchio.Model()
    for link, joint in zip(robot.links, robot.joints, strict=True):
        place = pinocchio.SE3(np.array(joint.rotation), np.array(joint.translation))
        turning = pinocchio.JointModelRevoluteUnaligned(np.array(joint.axis))
        index = model.addJoint(joint.parent + 1, turning, place, joint.name)
        body = link.inertia
        inertia = pinocchio.Inertia(body.mass, body.centre_of_mass, body.about_centre)
        model.appendBodyToJoint(index, inertia, pinocchio.SE3.Identity())
    model.gravity.linear = np.array(robot.gravity)
    if armature is not None:
        model.armature = np.diagonal(armature).copy()
    return model


def pinocchio_columns(columns: IntArray) -> IntArray:
    """Return where our columns of the regressor stand in Pinocchio's, whose ten parameters have another order."""
    order = np.argsort(to_pinocchio(np.arange(10)))
    return 10 * (columns // 10) + order[columns % 10]
