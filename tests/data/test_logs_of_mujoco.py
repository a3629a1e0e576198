"""What docs/log-formats.md says of logs of MuJoCo: what its integrators leave out of the force that is recorded."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

mujoco: Any = pytest.importorskip("mujoco")

JOINT = (
    '<joint name="{0}" axis="0 1 0" armature="0.1" damping="4"/><inertial pos="0.1 0 0" mass="2" diaginertia="1 1 1"/>'
)
SERVO = '<general joint="{0}" gaintype="fixed" biastype="affine" gainprm="2000" biasprm="0 -2000 {1}"/>'
MODEL = """<mujoco><option integrator="{0}" timestep="{1}"><flag eulerdamp="{2}"/></option>
<worldbody><body>{3}<body pos="0.2 0 0">{4}</body></body></worldbody><actuator>{5}{6}</actuator></mujoco>"""


@pytest.mark.parametrize("step", [1e-3, 2e-3])
@pytest.mark.parametrize(
    ("integrator", "flag", "damping"),
    [("implicitfast", "enable", 34.0), ("Euler", "enable", 4.0), ("Euler", "disable", 0.0)],
)
def test_the_motion_lacks_what_is_implicit(integrator: str, flag: str, damping: float, step: float) -> None:
    parts = [*(JOINT.format(name) for name in "ab"), *(SERVO.format(name, -30) for name in "ab")]
    model = mujoco.MjModel.from_xml_string(MODEL.format(integrator, step, flag, *parts))
    data, other = mujoco.MjData(model), mujoco.MjData(model)
    for k in range(300):
        data.ctrl[:] = 0.5 * np.sin(6 * k * step), 0.7 * np.sin(9 * k * step + 1)
        mujoco.mj_forward(model, data)
        other.qpos[:], other.qvel[:], recorded = data.qpos, data.qvel, data.qfrc_actuator.copy()
        mujoco.mj_step(model, data)
        acceleration = (data.qvel - other.qvel) / step
        other.qacc[:] = acceleration
        mujoco.mj_inverse(model, other)
        torque = recorded - step * damping * acceleration
        np.testing.assert_allclose(other.qfrc_inverse, torque, atol=1e-9 * np.abs(recorded).max())
