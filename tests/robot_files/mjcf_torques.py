"""Torques of an MJCF by MuJoCo (mj_inverse) and by the robot that was read from it, armature and damping included."""

from __future__ import annotations

from typing import Any

import numpy as np

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
    ratio, still = _tied(mujoco, model, [names.index(name) for name in free])
    expected = _inverse(mujoco, model, q @ ratio + still, dq @ ratio, ddq @ ratio) @ ratio.T
    own = DynamicModel(robot, ())
    theta = own.nominal()
    assert theta is not None
    viscous = np.array([joint.damping or 0.0 for joint in robot.active])
    found = own.regressor(Motion(q, dq, ddq)) @ theta + ddq @ robot.reflected_inertia + dq * viscous
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def _tied(mujoco: Any, model: Any, free: list[int]) -> tuple[Array, Array]:
    """Return the share of each free joint in each joint, (n, nv), and the positions of all where the free ones are 0.

    They are what MuJoCo's constraints of equality, by their Jacobian and residual, leave open.
    """
    data, kind = mujoco.MjData(model), model.opt.jacobian
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    mujoco.mj_fwdPosition(model, data)
    model.opt.jacobian = kind
    rows, residual = np.reshape(data.efc_J, (-1, model.nv))[: data.ne], data.efc_pos[: data.ne]
    others = [joint for joint in range(model.nv) if joint not in free]
    ratio, still = np.zeros((len(free), model.nv)), np.zeros(model.nv)
    ratio[:, free] = np.eye(len(free))
    if others:
        ratio[:, others] = -np.linalg.solve(rows[:, others], rows[:, free]).T
        still[others] = np.linalg.solve(rows[:, others], rows @ model.qpos0 - residual)
    return ratio, still


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
