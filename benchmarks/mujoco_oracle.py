"""The regressor of a file by MuJoCo: torques of ten bodies a link, from which its ten columns follow."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.exports.models.proving.engines import without_log
from dynident.model.inertia import Inertia
from dynident.model.robot import Robot

#: What has a torque beside the bodies.
FORCES = (
    *("body_gravcomp", "dof_armature", "dof_damping", "dof_dampingpoly", "actuator_armature", "actuator_damping"),
    *("actuator_dampingpoly", "tendon_damping", "tendon_dampingpoly", "tendon_armature", "tendon_stiffness"),
)


def mujoco_regressor(path: Path, robot: Robot, q: Array, dq: Array, ddq: Array) -> Array:
    """Return the columns of the inertial parameters, shape (N, n, 10 l); NaN for links that are no body of the file."""
    import mujoco

    api: Any = mujoco
    with without_log():
        model = _with_turned_bodies(api, path)
    model.opt.disableflags |= int(api.mjtDisableBit.mjDSBL_CONSTRAINT) | int(api.mjtDisableBit.mjDSBL_SPRING)
    model.opt.density = model.opt.viscosity = 0.0
    for name in FORCES:
        if hasattr(model, name):  # of MuJoCo 4, some of them
            getattr(model, name)[:] = 0.0
    moving = [i for i in range(model.njnt) if model.jnt_type[i] >= int(api.mjtJoint.mjJNT_SLIDE)]  # none floats
    names = [model.joint(i).name or f"joint{i + 1}" for i in moving]
    bodies = [model.body(i).name or f"body{i}" for i in range(model.nbody)]
    column = {name: i for i, name in enumerate(robot.joint_names)}
    turn, shift = np.zeros((len(names), robot.dof)), np.zeros(len(names))
    for joint in robot.joints:
        row = names.index(joint.name)
        leader = joint.mimic.joint if joint.mimic else joint.name
        turn[row, column[leader]] = joint.mimic.multiplier if joint.mimic else 1.0
        shift[row] = joint.mimic.offset if joint.mimic else 0.0
    data = api.MjData(model)
    states = q @ turn.T + shift, dq @ turn.T, ddq @ turn.T
    model.body_mass[:], model.body_inertia[:] = 0.0, 0.0
    bare = _torques(api, model, data, states) @ turn  # of what is no body, such as rotors of actuators
    found = np.full((len(q), robot.dof, 10 * len(robot.links)), np.nan)
    designs = [Inertia.from_log_cholesky(np.random.default_rng(k).normal(scale=0.6, size=10)) for k in range(10)]
    table = np.column_stack([body.vector for body in designs])
    for number, link in enumerate(robot.links):
        if link.name not in bodies:
            continue
        row = bodies.index(link.name)
        last = model.body_jntadr[row] + model.body_jntnum[row] - 1
        anchor = np.array(model.jnt_pos[last])
        torques = np.empty((len(q), robot.dof, 10))
        for k, design in enumerate(designs):
            model.body_mass[:], model.body_inertia[:] = 0.0, 0.0
            body = design.moved(np.eye(3), anchor)
            moments, axes = np.linalg.eigh(body.about_centre)
            axes[:, 2] *= np.sign(np.linalg.det(axes))
            quaternion = np.zeros(4)
            api.mju_mat2Quat(quaternion, axes.ravel())
            model.body_mass[row], model.body_ipos[row] = body.mass, body.centre_of_mass
            model.body_iquat[row], model.body_inertia[row] = quaternion, moments
            with without_log():  # of joints without inertia
                api.mj_setConst(model, data)
            torques[:, :, k] = _torques(api, model, data, states) @ turn - bare
        found[:, :, 10 * number : 10 * number + 10] = np.linalg.solve(table.T, torques.swapaxes(1, 2)).swapaxes(1, 2)
    return found


def _with_turned_bodies(api: Any, path: Path) -> Any:
    """Return the model of a file with bodies for which MuJoCo takes no short cut, such as for those at their origin."""
    spec = api.MjSpec.from_file(str(path))
    spec.compiler.inertiafromgeom = int(api.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE)
    spec.compiler.settotalmass = -1.0
    for body in spec.bodies[1:]:
        body.mass, body.ipos, body.inertia = 1.0, [0.1, 0.2, 0.3], [2.0, 3.0, 4.0]
        body.iquat, body.explicitinertial = [0.5, 0.5, 0.5, -0.5], True
        body.fullinertia, body.ialt.type = np.full(6, np.nan), api.mjtOrientation.mjORIENTATION_QUAT
    return spec.compile()


def _torques(api: Any, model: Any, data: Any, states: tuple[Array, Array, Array]) -> Array:
    moving = model.jnt_type >= int(api.mjtJoint.mjJNT_SLIDE)
    places, dofs = model.jnt_qposadr[moving], model.jnt_dofadr[moving]
    found = np.empty_like(states[0])
    for i, (position, velocity, acceleration) in enumerate(zip(*states, strict=True)):
        data.qpos[places], data.qvel[dofs], data.qacc[dofs] = position, velocity, acceleration
        api.mj_inverse(model, data)
        found[i] = data.qfrc_inverse[dofs]
    return found
