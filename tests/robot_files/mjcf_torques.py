"""Torques of an MJCF by MuJoCo (mj_inverse) and by the robot that was read from it, armature and damping included."""

from __future__ import annotations

from typing import Any

import numpy as np
from benchmarks.mujoco_oracle import tied

from dynident.arrays import Array
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.robot import Robot


def torque_difference(robot: Robot, model: Any) -> float:
    """Return the largest difference of the torque on 30 random states, of the largest torque.

    What MuJoCo has at a joint that follows another acts at its leader; joints that an equality holds are still, and the
    torque at them is left out.

    Args:
        robot: The robot.
        model: The ``mujoco.MjModel``.
    """
    import mujoco

    names = [model.joint(number).name or f"joint{number + 1}" for number in range(model.njnt)]
    free = list(robot.joint_names)
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 30, len(free)))
    ratio, still = tied(mujoco, model, list(range(model.njnt)), [names.index(name) for name in free])
    expected = _inverse(mujoco, model, q @ ratio + still, dq @ ratio, ddq @ ratio) @ ratio.T
    own = DynamicModel(robot, ())
    theta = own.nominal()
    assert theta is not None
    viscous = np.array([joint.damping or 0.0 for joint in robot.active])
    found = own.regressor(Motion(q, dq, ddq)) @ theta + ddq @ robot.reflected_inertia + dq * viscous
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def _inverse(mujoco: Any, model: Any, q: Array, dq: Array, ddq: Array) -> Array:
    """Return the torque of the states, shape (N, nv), without constraints."""
    flags = model.opt.disableflags
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data, found = mujoco.MjData(model), []
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(q, dq, ddq, strict=True):
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse.copy())
    model.opt.disableflags = flags
    return np.array(found)
