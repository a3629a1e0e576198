"""Play command files on a virtual arm in MuJoCo and log it, in place of a program that drives a real arm.

The arm has the bodies of arm.urdf and servos whose parameters TRUE states. Run: python record.py MOTIONS LOGS
"""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np

#: By joint: torque at full duty in N m, back-EMF and viscous friction in N m s/rad, Coulomb friction in N m, armature
#: in kg m^2, delay in s, angle of the encoder's zero in rad.
TRUE = {
    "shoulder_pan": (2.9, 0.45, 0.08, 0.09, 0.028, 0.011, 0.0),
    "shoulder_lift": (2.8, 0.47, 0.09, 0.10, 0.027, 0.012, 0.012),
    "elbow_flex": (2.9, 0.46, 0.07, 0.08, 0.028, 0.011, -0.008),
    "wrist_flex": (2.7, 0.44, 0.08, 0.07, 0.026, 0.010, 0.010),
    "wrist_roll": (3.0, 0.46, 0.07, 0.08, 0.029, 0.011, 0.0),
}
KP, ERROR_GAIN, LIMIT = 16.0, 0.166, 0.97
STEP, COUNT = 5e-4, 2.0 * np.pi / 4096


def arm(payload: bool) -> mujoco.MjModel:
    """Return the arm, with 0.2 kg in its gripper or without."""
    spec = mujoco.MjSpec.from_file(str(Path(__file__).with_name("arm.urdf")))
    spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    for name, (_, _, viscous, coulomb, armature, _, _) in TRUE.items():
        joint = spec.joint(name)
        joint.damping, joint.frictionloss, joint.armature = [viscous, 0, 0], coulomb, armature
        joint.solref_friction = [2.0 * STEP, 1.0]
    if payload:
        geom = spec.body("gripper").add_body(pos=[0.08, 0, 0.03]).add_geom(size=[0.005, 0.005, 0.005], mass=0.2)
        geom.type = mujoco.mjtGeom.mjGEOM_SPHERE
    return spec.compile()


def played(time: np.ndarray, commands: np.ndarray, on: np.ndarray, payload: bool) -> np.ndarray:
    """Return the positions that the encoders read at the times of the commands."""
    model = arm(payload)
    data = mujoco.MjData(model)
    torque, emf, _, _, _, delay, zero = np.array([TRUE[model.joint(k).name] for k in range(model.nv)]).T
    data.qpos[:] = commands[0] + zero
    q, now = np.empty(commands.shape), 0.0
    joints = np.arange(model.nv)
    for row in range(len(time)):
        q[row] = np.round((data.qpos - zero) / COUNT) * COUNT
        if row + 1 == len(time):
            break
        while now < time[row + 1] - 0.5 * STEP:
            held = np.maximum(np.searchsorted(time, now - delay + 1e-9, side="right") - 1, 0)
            duty = np.clip(KP * ERROR_GAIN * (commands[held, joints] - data.qpos + zero), -LIMIT, LIMIT)
            data.qfrc_applied[:] = on[row] * (torque * duty - emf * data.qvel)
            mujoco.mj_step(model, data)
            now += STEP
    return q


def record(motions: str, logs: str) -> None:
    """Play each command file of a folder and log it under the same name."""
    Path(logs).mkdir(exist_ok=True)
    for file in sorted(Path(motions).glob("*.csv")):
        header = file.read_text().partition("\n")[0].split(",")
        table = np.loadtxt(file, delimiter=",", skiprows=1)
        n = len(TRUE)
        q = played(table[:, 0], table[:, 1 : n + 1], table[:, n + 1 :], file.stem.endswith("load"))
        names = [header[0], *(f"q{k + 1}" for k in range(n)), *header[1:]]
        rows = np.hstack([table[:, :1], q, table[:, 1:]])
        np.savetxt(Path(logs) / file.name, rows, "%.9g", ",", header=",".join(names), comments="")


if __name__ == "__main__":
    record(*sys.argv[1:3])
