"""Predicted torques: filtered as the measured ones, no spoiled rows, and bands that hold what they state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynident import DynamicModel, FourierSeries, Log, Robot, identify, read_robot
from dynident.applications.predicted_torque import predict_torque
from dynident.arrays import Array
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.errors import LogMismatch
from dynident.model.friction import FRICTION, Motion

RATE, NOISE, TORQUE_NOISE = 250.0, 1e-4, 0.03

HOW = Preprocessing(Butterworth(6.0), trim_s=0.5, rest="keep", rows_per_period=8.0)


def driven(robot: Robot, seed: int, seconds: float) -> tuple[Log, Log]:
    """Return a log of a virtual robot with noise in positions and torques, and the same without."""
    parts = (FRICTION.make("viscous"), FRICTION.make("offset"))
    model, generator, dof = DynamicModel(robot, parts), np.random.default_rng(seed), robot.dof
    scale = np.array([0.5 if joint.kind == "revolute" else 0.05 for joint in robot.active])[:, None]
    sine, cosine = scale * generator.normal(size=(2, dof, 4)) / 2
    time = np.arange(int(seconds * RATE)) / RATE
    q, dq, ddq = FourierSeries(np.zeros(dof), sine, cosine, 7.5).evaluate(time)
    assert robot.nominal is not None
    torque = model.torque(Motion(q, dq, ddq), np.concatenate([robot.nominal, np.tile([1.0, 0.2], dof)]))
    exact = Log(robot.joint_names, time, q, torque=torque)
    noise = TORQUE_NOISE * np.std(torque, axis=0) * generator.normal(size=q.shape)
    return replace(exact, q=q + NOISE * generator.normal(size=q.shape), torque=torque + noise), exact


def filtered(torque: Array) -> Array:
    return HOW.filter.smooth(torque.T, RATE).T


@pytest.mark.battery
def test_bands_hold_the_share_of_torques_that_they_state() -> None:
    shares = []
    for name, seed in [("generic-scara", 0), ("generic-scara", 1), ("generic-6r", 2), ("generic-6r", 3)]:
        robot = read_robot(name)
        model = DynamicModel(robot, (FRICTION.make("viscous"), FRICTION.make("offset")))
        estimate = identify(model, [driven(robot, 100 + seed, 15.0)[0]], "wls", HOW)
        estimate = replace(estimate, preprocessing=replace(HOW, trim_s=0.0))  # the ends are left out all the same
        log, exact = driven(robot, seed, 9.0)
        begun, true = log.rows(slice(250, 2000), "1 to 8 s"), filtered(np.asarray(exact.torque))[250:2000]
        found, planned = predict_torque(estimate, begun), predict_torque(estimate, replace(exact, torque=None))
        error, ends = np.abs(found.torque - true[found.prepared.keep]), np.r_[0:25, -25:0]
        planned_error = np.abs(planned.torque - filtered(np.asarray(exact.torque))[planned.prepared.keep])
        shares.append(
            [
                np.mean(error <= found.half_model),
                np.mean(planned_error <= planned.half_model),
                np.mean(found.inside),
                np.mean(error[ends] <= found.half_model[ends]),
            ]
        )
        assert found.prepared.keep[0] == 125 and len(error) == 1500
        assert np.all(found.half_measured >= found.half_model)
        assert np.all(planned.half_model[250:1750].mean(axis=0) < found.half_model.mean(axis=0))
    model_share, planned_share, measured_share, ends_share = np.mean(shares, axis=0)
    assert 0.9 < model_share < 0.98 and 0.9 < planned_share < 0.98
    assert 0.92 < measured_share < 0.98
    assert ends_share > 0.8


def test_a_motion_that_the_filter_spoils_as_a_whole_is_refused() -> None:
    robot = read_robot("generic-scara")
    model = DynamicModel(robot, (FRICTION.make("viscous"), FRICTION.make("offset")))
    estimate = identify(model, [driven(robot, 0, 15.0)[0]], "wls", HOW)
    with pytest.raises(LogMismatch, match=r"the filter spoils 0\.5 s at both ends; give a longer motion"):
        predict_torque(estimate, driven(robot, 1, 1.0)[0])
