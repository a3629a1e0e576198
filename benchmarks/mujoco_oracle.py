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
    moving = [i for i in range(model.njnt) if model.jnt_type[i] >= int(api.mjtJoint.mjJNT_SLIDE)]  # none floats
    names = [model.joint(i).name or f"joint{i + 1}" for i in moving]
    share, shift = tied(api, model, moving, [names.index(name) for name in robot.joint_names])
    turn = share.T
    model.opt.disableflags |= int(api.mjtDisableBit.mjDSBL_CONSTRAINT) | int(api.mjtDisableBit.mjDSBL_SPRING)
    model.opt.density = model.opt.viscosity = 0.0
    for name in FORCES:
        if hasattr(model, name):  # of MuJoCo 4, some of them
            getattr(model, name)[:] = 0.0
    bodies = [model.body(i).name or f"body{i}" for i in range(model.nbody)]
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


def tied(api: Any, model: Any, moving: list[int], free: list[int]) -> tuple[Array, Array]:
    """Return the share of each free joint in each joint, (n, N), and the positions of all where the free ones are 0.

    They are what MuJoCo's equalities of joints and tendons leave open, by their Jacobian and residual.

    Args:
        api: The package.
        model: The ``mujoco.MjModel``.
        moving: Its hinges and slides.
        free: Those of these that follow none and are not held.

    Raises:
        ValueError: MuJoCo has no memory for all equalities: the file needs <size memory="64M"/>.
    """
    data, kind = api.MjData(model), model.opt.jacobian
    model.opt.jacobian = api.mjtJacobian.mjJAC_DENSE
    api.mj_fwdPosition(model, data)
    model.opt.jacobian = kind
    linear = (int(api.mjtEq.mjEQ_JOINT), int(api.mjtEq.mjEQ_TENDON))
    rows = [row for row in range(data.ne) if model.eq_type[data.efc_id[row]] in linear]
    if data.warning[int(api.mjtWarning.mjWARN_CNSTRFULL)].number:
        raise ValueError('MuJoCo has no memory for all equalities: write <size memory="64M"/>')
    jacobian = np.reshape(data.efc_J, (-1, model.nv))[rows][:, model.jnt_dofadr[moving]]
    start = model.qpos0[model.jnt_qposadr[moving]]
    ratio, still = np.zeros((len(free), len(moving))), start.copy()
    ratio[:, free], still[free] = np.eye(len(free)), 0.0
    others = [joint for joint in range(len(moving)) if joint not in free]
    if rows:
        wanted = jacobian @ (start - still) - data.efc_pos[rows]
        open_ones = np.column_stack([-jacobian[:, free], wanted])
        found = np.linalg.lstsq(jacobian[:, others], open_ones, rcond=None)[0]
        ratio[:, others] = found[:, :-1].T
        still[others] += found[:, -1]
    return ratio, still


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
