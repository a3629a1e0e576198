"""A tracker on a small arm: what stays, what drifts, and what changes at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

from dynident.applications.tracking import Pace, Tracker, thresholds_of, tracked
from dynident.applications.tracking.tracked_log import looked_for
from dynident.applications.tracking.tracker import evidence_of, threshold
from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.errors import BadOption, LogMismatch
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.identify import identify
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.inertia import Inertia
from dynident.model.reduction import Reduced

PACE = Pace(memory=5.0, window=0.5)


class Arm:
    """An arm in white noise, its estimate, and logs of it whose parameters change half-way."""

    def __init__(self, robot, exact_log):
        self.model = DynamicModel(robot, (Coulomb(), Viscous()))
        self.theta = np.append(robot.nominal, np.tile([2.0, 1.0], robot.dof))
        self.make = exact_log
        self.estimate = identify(self.model, [self.log(1)], "wls", Preprocessing(AsGiven(), rest="keep"))

    def log(self, seed: int, other: Array | None = None, samples: int = 2000) -> Log:
        """Return a log of 20 s; the second half has the parameters ``other``."""
        log = self.make(self.model, self.theta, noise=0.5, seed=seed, samples=samples, rate=100.0)
        if other is None:
            return log
        changed = self.model.torque(Motion(log.q, log.dq, log.ddq), other - self.theta)
        changed[: samples // 2] = 0.0
        return replace(log, torque=log.torque + changed)


@pytest.fixture(scope="module")
def arm(spatial_3r, exact_log) -> Arm:
    return Arm(spatial_3r, exact_log)


@pytest.fixture(scope="module")
def thresholds(arm):
    return thresholds_of(arm.estimate, [arm.log(1), arm.log(2)], PACE, 1.0)


def test_what_does_not_change_stays_within_its_intervals(arm, thresholds):
    found = tracked(arm.estimate, arm.log(3), PACE, thresholds)
    truth = arm.estimate.base.from_standard(arm.theta)
    assert not found.events
    assert np.mean((np.abs(found.beta - truth) <= found.half_widths())[found.time > 5.0]) > 0.9
    assert found.figures(arm.estimate)["evaluations"] == len(found.time)


def test_a_load_is_named_with_its_time_and_mass(arm, thresholds):
    body = Inertia.from_centre_of_mass(0.8, [0.1, 0.02, 0.0], 0.002 * np.eye(3))
    other = arm.theta.copy()
    other[20:30] += body.vector
    found = tracked(arm.estimate, arm.log(4, other), PACE, thresholds)
    assert [event.change.name for event in found.events] == ["load on link3"]
    event = found.events[0]
    assert 10.0 <= event.time <= 10.6
    after = arm.estimate.base.from_standard(other)
    away = np.abs(found.beta - after)[found.time > 16.0] / found.deviations[found.time > 16.0]
    assert np.mean(away < 2.5) > 0.9
    assert event.figures()["kind"] == "load"
    if event.mass is not None:
        assert abs(event.mass[0] - 0.8) < 4.0 * event.mass[1]


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_friction_that_doubles_is_named_with_its_joint(arm, thresholds, joint):
    other = arm.theta.copy()
    other[arm.model.inertial_count + 2 * joint] += 2.0
    found = tracked(arm.estimate, arm.log(5 + joint, other), PACE, thresholds)
    assert found.events[0].change.name == f"friction of joint{joint + 1}"
    assert 10.0 <= found.events[0].time <= 11.0


def test_evidence_is_the_generalised_least_squares_fit_written_out(arm):
    """With one change of full rank: x = (X' S^-1 X)^-1 X' S^-1 (z - R beta), and its square is what it explains."""
    generator = np.random.default_rng(0)
    size = arm.estimate.base.count
    rows = Reduced(np.triu(generator.normal(size=(size, size))), generator.normal(size=size), 1.0, 50)
    root = generator.normal(size=(size, size))
    beta, covariance = generator.normal(size=size), root @ root.T / size
    change = looked_for(arm.estimate)[1]
    found = evidence_of([change], rows, beta, covariance)[0]
    spread = np.eye(size) + rows.r @ covariance @ rows.r.T
    shown = rows.r @ change.columns
    inverse = np.linalg.inv(shown.T @ np.linalg.solve(spread, shown))
    x = inverse @ shown.T @ np.linalg.solve(spread, rows.z - rows.r @ beta)
    np.testing.assert_allclose(found.x, x * change.sizes, rtol=1e-8)
    np.testing.assert_allclose(found.deviations, np.sqrt(np.diag(inverse)) * change.sizes, rtol=1e-8)
    np.testing.assert_allclose(found.square, x @ np.linalg.solve(inverse, x), rtol=1e-8)
    assert found.rank == 2


def test_a_threshold_of_white_noise_is_that_of_chi_square():
    squares = np.random.default_rng(1).chisquare(3, 200_000)
    assert threshold(squares, 3, 1e9, 1e-4) == pytest.approx(scipy.stats.chi2.isf(1e-4, 3), rel=0.02)
    assert threshold(4.0 * squares, 3, 1e9, 1e-4) == pytest.approx(4.0 * scipy.stats.chi2.isf(1e-4, 3), rel=0.02)
    assert threshold(squares, 3, 5.0, 1e-4) > threshold(squares, 3, 1e9, 1e-4)


def test_drift_is_followed_and_its_lag_is_in_the_interval(arm):
    log = arm.log(8, samples=4000)
    base = arm.estimate.base
    friction = np.flatnonzero(base.independent >= arm.model.inertial_count)
    grown = 1.0 + 0.5 * log.time / 40.0
    cold = np.append(np.zeros(arm.model.inertial_count), arm.theta[arm.model.inertial_count :])
    more = arm.model.torque(Motion(log.q, log.dq, log.ddq), cold) * (grown - 1.0)[:, None]
    found = tracked(arm.estimate, replace(log, torque=log.torque + more), PACE)
    truth = base.from_standard(arm.theta)[friction] * (1.0 + 0.5 * found.time[:, None] / 40.0)
    away = np.abs(found.beta[:, friction] - truth)
    late = found.time > 20.0
    static = np.abs(arm.estimate.beta[friction] - truth)
    assert np.mean(away[late]) < 0.35 * np.mean(static[late])
    assert np.mean((away <= found.half_widths()[:, friction])[late]) > 0.85


def test_where_nothing_is_shown_it_goes_back_to_the_estimate(arm):
    tracker = Tracker(arm.estimate, 100.0, PACE, looked_for(arm.estimate))
    size, joints = arm.estimate.base.count, arm.model.robot.dof
    for _ in range(5000):
        tracker.update(np.zeros((joints, size)), np.zeros(joints))
    beta, covariance = tracker.now()
    np.testing.assert_allclose(beta, arm.estimate.beta, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), 30.0 * arm.estimate.std, rtol=1e-6)


def test_what_a_tracker_refuses(arm: Arm, thresholds):
    with pytest.raises(BadOption, match="window = 20"):
        Pace(10.0, 20.0)
    with pytest.raises(BadOption, match="memory = 0"):
        Pace(0.0)
    with pytest.raises(BadOption, match="false alarms = 0"):
        thresholds_of(arm.estimate, [arm.log(1)], PACE, 0.0)
    with pytest.raises(BadOption, match="at least one log"):
        thresholds_of(arm.estimate, [], PACE, 1.0)
    with pytest.raises(LogMismatch, match="fewer than two windows"):
        tracked(arm.estimate, arm.log(1, samples=90), PACE)
    singular: Estimate = replace(arm.estimate, covariance=np.zeros_like(arm.estimate.covariance))
    with pytest.raises(BadOption, match="variance that is not above 0"):
        tracked(singular, arm.log(1), PACE)
