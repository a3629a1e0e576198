"""The descriptions of real arms, right angles with a few digits and all, against Pinocchio."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynident.model.kernels import batched
from dynident.model.kernels.batched import JointColumns
from dynident.robot_files import read_robot
from real_data import real

ARMS = (
    "kuka_lwr4_flobaroid/robot.urdf",
    "panda_gaz2019/robot.urdf",
    "staubli_tx40_figaroh/robot.urdf",
    "tiago_figaroh/robot_full.urdf",
    "ur10e_mamedov/robot.urdf",
)


@pytest.mark.parametrize("name", ARMS)
def test_a_described_arm_moves_as_in_pinocchio(name: str, kernel: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path = real(name, monkeypatch)
    pin: Any = pytest.importorskip("pinocchio")
    robot, model = read_robot(path), pin.buildModelFromUrdf(str(path))
    chain, data = robot.chain, model.createData()
    follow = np.zeros(
        (chain.links, robot.dof)
    )  # link speed = follow @ joint speed; Pinocchio knows no mimic joint here
    follow[np.arange(chain.links), chain.joint] = chain.multiplier
    places = [model.joints[model.getJointId(joint.name)] for joint in robot.joints]
    columns = [place.idx_v for place in places]
    q, dq, ddq = np.random.default_rng(2).normal(size=(3, 4, robot.dof))
    position, speed, rate = np.zeros((4, model.nq)), np.zeros((4, model.nv)), np.zeros((4, model.nv))
    speed[:, columns], rate[:, columns] = dq @ follow.T, ddq @ follow.T
    for place, angle in zip(places, (q @ follow.T + chain.offset).T, strict=True):
        turns = [np.cos(angle), np.sin(angle)] if place.nq == 2 else [angle]  # a continuous joint
        position[:, place.idx_q : place.idx_q + place.nq] = np.stack(turns, axis=1)
    states = zip(position, speed, rate, strict=True)
    theirs = np.array([pin.rnea(model, data, *state)[columns] for state in states]) @ follow
    assert robot.nominal is not None
    tau = batched.inverse_dynamics(chain, robot.nominal, q, dq, ddq)
    assert np.abs(tau - theirs).max() < 1e-10 * np.abs(theirs).max()
    chosen = JointColumns(chain, range(10 * chain.links))
    blocks = chosen.evaluate(q, dq, ddq)
    sums = [robot.nominal[found] @ block for found, block in zip(chosen.columns, blocks, strict=True)]
    assert np.abs(np.array(sums).T - theirs).max() < 1e-10 * np.abs(theirs).max()
