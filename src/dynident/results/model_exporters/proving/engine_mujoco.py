"""Torques by MuJoCo, from the file as MuJoCo reads it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np

from dynident.arrays import Array
from dynident.results.model_exporters.subject.states import States
from dynident.results.model_exporters.writing.xml_edit import without_elements


def version() -> str:
    """Return the name with its version; empty where it is not installed."""
    try:
        import mujoco
    except ImportError:
        return ""
    return f"MuJoCo {mujoco.__version__}"


def torque(path: Path, kind: Literal["urdf", "mjcf"], states: States) -> Array:
    """Return the torques of a URDF or MJCF on the states, shape (N, n), in N m or N.

    ``mj_inverse`` has armature and damping of joints and tendons. Dry friction is a constraint of its solver: it is
    added from the loaded model with the sharp sign, the other constraints are off. Shapes of a URDF are left out, so
    that no mesh is looked for, and gravity is set, which a URDF has none of.
    """
    import mujoco

    api: Any = mujoco
    data = path.read_bytes()
    is_urdf = kind == "urdf"
    if is_urdf:
        data = without_elements(data, ("visual", "collision"))
        stripped = path.with_name(f"stripped-{path.name}")
        stripped.write_bytes(data)
        path = stripped
    model = api.MjModel.from_xml_path(str(path))
    if is_urdf:
        model.opt.gravity = states.gravity
    model.opt.disableflags |= int(api.mjtDisableBit.mjDSBL_CONSTRAINT)
    joints = [model.joint(i).name for i in range(model.njnt)]
    q, dq, ddq = states.of(joints)
    state, found = api.MjData(model), np.empty_like(q)
    for k in range(len(q)):
        state.qpos, state.qvel, state.qacc = q[k], dq[k], ddq[k]
        api.mj_inverse(model, state)
        found[k] = state.qfrc_inverse
    found += np.sign(dq) * model.dof_frictionloss
    for tendon in range(model.ntendon):
        part = slice(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
        row = np.zeros(len(joints))
        row[model.wrap_objid[part]] = model.wrap_prm[part]
        found += np.sign(dq @ row)[:, None] * row * model.tendon_frictionloss[tendon]
    return states.gather(joints, found)
