"""An arm of one joint, and a log of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

URDF = """<robot name="arm"><link name="base"/>
  <link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="3"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.05"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="100" velocity="3"/></joint></robot>
"""


def write_run(path: Path, samples: int, seed: int = 0) -> None:
    """Write a noisy log at 100 Hz as CSV."""
    time = np.arange(samples) / 100
    q = np.sin(1.7 * time) + 0.3 * np.sin(5 * time)
    torque = -6 * np.cos(q) + 0.5 * np.gradient(q, time) + np.random.default_rng(seed).normal(0, 0.1, q.shape)
    rows = [",".join(map(repr, row)) for row in np.column_stack([time, q, torque]).tolist()]
    path.write_text("\n".join(["t,q1,tau1", *rows]) + "\n")
