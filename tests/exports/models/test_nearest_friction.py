"""Damping and Coulomb friction of simulators stand for the whole friction of a drive, not for two parts of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identified_arms import estimate_of

from dynident.data.log import Log
from dynident.exports.models import export_model
from dynident.exports.models.subject.drives import Drives, drives_of
from dynident.exports.models.subject.identified import identified
from dynident.exports.models.subject.states import motion_of_fit
from dynident.identification.estimate.estimate import Estimate
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Motion
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

CURVED = ("coulomb", "viscous", "offset", "rotor_inertia", "degressive", "load")


@pytest.fixture
def curved(spatial_3r: Robot, exact_log: Callable[..., Log]) -> Estimate:
    estimate = estimate_of(spatial_3r, exact_log, CURVED, exact=True)
    assert estimate.theta is not None
    model, theta = estimate.model, estimate.theta.copy()
    for k, parameter in enumerate(model.parameters):
        if k >= model.inertial_count and parameter.name.startswith("Fd"):
            theta[k] = 5.0  # most of the friction
    return replace(estimate, theta=theta, beta=estimate.base.from_standard(theta))


def within(estimate: Estimate, seed: int) -> Motion:
    """Return other states of the mean and covariance of those that the logs have seen."""
    seen = estimate.envelope
    assert seen is not None
    drawn = np.random.default_rng(seed).normal(size=(20000, len(seen.mean)))
    states = (seen.mean + drawn @ np.linalg.inv(seen.whitener)).reshape(20000, 3, -1)
    return Motion(*np.clip(states, seen.low, seen.high).transpose(1, 0, 2))


def missing(estimate: Estimate, drives: Drives) -> np.ndarray:
    """Return what drives lack of the friction, rms of each joint, offsets aside."""
    model, motion = estimate.model, within(estimate, 7)
    assert estimate.theta is not None
    rigid = estimate.theta.copy()
    rigid[model.inertial_count :] = 0.0
    true = model.torque(motion, estimate.theta) - model.torque(motion, rigid)
    offset = model.coefficient_table(estimate.theta)[:, 2]
    rest = true - offset - drives.torque(motion, armature=True, coupled=True)
    return np.sqrt(np.mean(rest**2, axis=0))


def test_logged_temperatures_leave_the_motion_of_the_fit_as_it_is(curved: Estimate, spatial_3r: Robot) -> None:
    """Every export of such an estimate had ended in an error of shapes."""
    seen = curved.envelope
    assert seen is not None
    low, high = (np.vstack([side, np.full(3, at)]) for side, at in ((seen.low, 20.0), (seen.high, 35.0)))
    warm = replace(curved, envelope=replace(seen, low=low, high=high))
    motion, same = motion_of_fit(warm), motion_of_fit(curved)
    assert all(np.array_equal(getattr(motion, name), getattr(same, name)) for name in ("q", "dq", "ddq"))
    heated = replace(warm, model=DynamicModel(spatial_3r, tuple(map(FRICTION.make, ("viscous", "temperature")))))
    drawn = motion_of_fit(heated).temperature
    assert drawn is not None and drawn.min() == 20.0 and drawn.max() == 35.0


def test_the_nearest_two_numbers_lose_little_of_a_curve(curved: Estimate) -> None:
    drives = drives_of(identified(curved))
    assert drives.nearest.all()
    best = missing(curved, drives)
    plain = {part.__class__.__name__: part for part in curved.model.friction}
    assert {"Degressive", "Load"} <= set(plain)
    table = curved.model.coefficient_table(curved.theta)
    two = replace(drives, dry=table[:, 0], damping=table[:, 1])
    assert np.all(best < 0.5 * missing(curved, two))
    for factor in (0.8, 1.25):  # and no others near them are better
        for word in ("dry", "damping"):
            other = replace(drives, **{word: factor * getattr(drives, word)})
            assert np.all(missing(curved, other) > 0.99 * best)


def test_what_does_not_turn_its_sign_with_the_speed_is_in_neither(
    spatial_3r: Robot, exact_log: Callable[..., Log]
) -> None:
    """Friction that differs by direction has its mean, torques of the position alone have no part."""
    parts = ("asymmetric", "viscous", FRICTION.make("periodic", {"cycles": 4.0}))
    estimate = estimate_of(spatial_3r, exact_log, parts, exact=True)
    assert estimate.theta is not None
    table = estimate.model.coefficient_table(estimate.theta)
    drives = drives_of(identified(estimate))
    assert drives.dry == pytest.approx(0.5 * (table[:, 0] + table[:, 1]), rel=0.02)
    assert drives.damping == pytest.approx(table[:, 2], rel=0.02)


def test_friction_that_simulators_hold_is_written_as_it_is(spatial_3r: Robot, exact_log: Callable[..., Log]) -> None:
    estimate = estimate_of(spatial_3r, exact_log)
    drives = drives_of(identified(estimate))
    table = estimate.model.coefficient_table(identified(estimate).theta)
    assert not drives.nearest.any()
    assert np.array_equal(drives.dry, table[:, 0]) and np.array_equal(drives.damping, table[:, 1])


@pytest.mark.parametrize("target", ["urdf", "mjcf", "sdf"])
def test_files_hold_it_and_say_so(curved: Estimate, target: str, tmp_path: Path) -> None:
    path = tmp_path / f"arm.{'xml' if target == 'mjcf' else target}"
    export = export_model(curved, target, path)
    drives = drives_of(identified(curved))
    joints = [joint for joint in read_robot(path).joints if joint.damping is not None]
    assert [joint.damping for joint in joints] == pytest.approx(drives.damping.tolist(), rel=1e-9)
    assert [joint.friction for joint in joints] == pytest.approx(drives.dry.tolist(), rel=1e-9)
    assert "are those nearest to all parts of the friction in the logs" in " ".join(export.notes)
    assert {"Fd", "Fl"} <= {term.symbol for term in export.left_out}
    beside = json.loads(Path(export.files[-1]).read_text(encoding="utf-8"))
    assert beside["drives"]["damping"] == drives.damping.tolist()
    assert any("degressive" in part for part in beside["friction"])
