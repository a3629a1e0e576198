"""Logs of a small arm with two revolute joints, a slide and a wrist, as its robot model has it, with friction."""

from __future__ import annotations

import numpy as np

from dynident import DynamicModel, FourierSeries, Log, Robot
from dynident.model.friction import FRICTION, Motion


def recorded(robot: Robot, seed: int, samples: int) -> Log:
    """Return a noisy log of a robot like generic-scara at 100 Hz, with its true velocities and accelerations."""
    model = DynamicModel(robot, (FRICTION.make("coulomb"), FRICTION.make("viscous")))
    assert robot.nominal is not None
    generator = np.random.default_rng(seed)
    scale = np.array([0.6, 0.6, 0.05, 0.8])[:, None]
    sine, cosine = scale * generator.normal(size=(2, 4, 4)) / 2
    time = np.arange(samples) / 100.0
    q, dq, ddq = FourierSeries(np.zeros(4), sine, cosine, 7.5).evaluate(time)
    torque = model.torque(Motion(q, dq, ddq), np.concatenate([robot.nominal, np.tile([1.0, 2.0], 4)]))
    torque += np.array([0.3, 0.3, 1.0, 0.05]) * generator.normal(size=torque.shape)
    return Log(robot.joint_names, time, q, dq, ddq, torque)
