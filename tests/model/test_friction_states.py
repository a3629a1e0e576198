"""Friction with a memory: states run along a log, and the coefficients beside them are identified like others."""

from __future__ import annotations

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.errors import BadOption
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.robot_files import read_robot
from presliding import Presliding

PART = Presliding(fine=0.02, coarse=0.2)
RATE = 200.0


def motion(joints: int = 4) -> Motion:
    time = np.arange(1200)[:, None] / RATE
    rate, phase = 1.0 + 0.4 * np.arange(joints), np.arange(joints)
    turn = rate * time + phase
    return Motion(0.5 * np.sin(turn), 0.5 * rate * np.cos(turn), -0.5 * rate**2 * np.sin(turn))


def stops(q: Array, width: float) -> Array:
    """Return the stop operator along positions (N,), step by step."""
    found = [0.0]
    for moved in np.diff(q):
        found.append(float(np.clip(found[-1] + moved, -width, width)))
    return np.array(found)


def test_states_are_those_of_the_stop_operator() -> None:
    model, at = DynamicModel(read_robot("generic-scara"), ("viscous", PART)), motion()
    state = model.with_states(at, 1.0 / RATE).state
    assert state is not None and state.shape == (1200, 4, 2)
    for joint in range(4):
        for k, width in enumerate((PART.fine, PART.coarse)):
            np.testing.assert_allclose(state[:, joint, k], stops(at.q[:, joint], width), atol=1e-15)
    bounds = np.array([[own.low, own.high] for own in PART.states])
    assert np.all((state >= bounds[:, 0]) & (state <= bounds[:, 1]))


def test_columns_take_the_state_of_their_own_sample() -> None:
    model = DynamicModel(read_robot("generic-scara"), ("viscous", PART))
    at = model.with_states(motion(), 1.0 / RATE)
    assert at.state is not None and model.needs == {"state"}
    values = model.friction_values(at)
    np.testing.assert_allclose(values[..., 1:], at.state / [PART.fine, PART.coarse])
    np.testing.assert_array_equal(model.friction_values(at.rows(slice(300, 400))), values[300:400])


def test_rows_of_a_log_carry_the_states() -> None:
    model, at = DynamicModel(read_robot("generic-scara"), ("viscous", PART)), motion()
    theta = np.concatenate([model.robot.nominal, np.tile([0.3, 2.0, 1.0], 4)])  # type: ignore[arg-type]
    torque = model.torque(model.with_states(at, 1.0 / RATE), theta)
    base = base_parameters(model)
    log = Log(model.robot.joint_names, np.arange(1200) / RATE, at.q, at.dq, at.ddq, torque)
    found = RegressorStream(model, base).predict(log, base.from_standard(theta))
    np.testing.assert_allclose(found, torque, atol=1e-9)


def test_a_motion_without_the_state_is_refused() -> None:
    with pytest.raises(BadOption, match="its state is not known here"):
        PART.columns(motion())
