"""What a script of the field does with a log, as a process.

Run: python peer_process.py URDF CUTOFF_HZ STEP COLUMN GAINS LOG...

pandas reads, a SciPy filter runs forwards and backwards over positions and torques, differences give velocities and
accelerations, Pinocchio's regressor is called sample by sample, a pivoted QR chooses the base columns, ``lstsq`` fits.
No delay, no choice, no interval, no check, nothing physically consistent, nothing is written.

COLUMN is the letter of the torque or current columns, GAINS their factors with commas (``1`` for torques), STEP takes
one row in so many after the filter.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as untyped
import scipy.linalg
import scipy.signal

pin: Any = untyped

#: Width of the sign of a velocity, and the diagonal of the QR below which a column depends on others, a share.
WIDTH, RANK = 0.02, 1e-6


def main(urdf: str, cutoff: float, step: int, column: str, gains: list[float], logs: list[str]) -> float:
    """Return the relative residual of the fit."""
    robot = pin.buildModelFromUrdf(urdf)
    data, joints = robot.createData(), robot.nv
    matrices, targets = [], []
    for log in logs:
        table = pd.read_csv(log)
        rate = 1.0 / float(np.median(np.diff(table["t"])))
        low_pass = scipy.signal.butter(4, cutoff, fs=rate, output="sos")
        q, torque = (
            scipy.signal.sosfiltfilt(low_pass, table[[f"{name}{i + 1}" for i in range(joints)]].to_numpy(), axis=0)
            for name in ("q", column)
        )
        dq = np.gradient(q, 1.0 / rate, axis=0)
        ddq = np.gradient(dq, 1.0 / rate, axis=0)
        q, dq, ddq, torque = (each[::step] for each in (q, dq, ddq, torque * gains))
        matrix = np.zeros((len(q), joints, 14 * joints))
        for k in range(len(q)):
            matrix[k, :, : 10 * joints] = pin.computeJointTorqueRegressor(robot, data, q[k], dq[k], ddq[k])
        for i in range(joints):
            columns = (np.tanh(dq[:, i] / WIDTH), dq[:, i], np.ones(len(q)), ddq[:, i])
            matrix[:, i, 10 * joints + 4 * i : 10 * joints + 4 * (i + 1)] = np.stack(columns, axis=1)
        matrices.append(matrix.reshape(-1, 14 * joints))
        targets.append(torque.ravel())
    whole, target = np.concatenate(matrices), np.concatenate(targets)
    triangle, order = scipy.linalg.qr(whole, mode="r", pivoting=True)
    size = np.abs(np.diag(triangle))
    base = whole[:, np.sort(order[: int(np.sum(size > RANK * size[0]))])]
    beta = np.linalg.lstsq(base, target, rcond=None)[0]
    return float(np.linalg.norm(target - base @ beta) / np.linalg.norm(target))


if __name__ == "__main__":
    urdf, cutoff, step, column, gains, *logs = sys.argv[1:]
    print(main(urdf, float(cutoff), int(step), column, [float(gain) for gain in gains.split(",")], logs))
