"""Limits of a robot with margins, and the check of a motion against them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynident.errors import BadOption
from dynident.excitation.design.limits import MotionLimits, check_limits, limits_of, worst_row
from dynident.excitation.design.rest_to_rest import RestToRest
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.excitation.trajectories.quintic import Quintic
from dynident.model.dynamic_model import DynamicModel
from dynident.model.joint import JointLimits
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

NONE = np.full(2, np.inf)


def bounds(**given: object) -> MotionLimits:
    values = {"lower": -NONE, "upper": NONE, "velocity": NONE, "acceleration": NONE, "jerk": NONE, "torque": NONE}
    return MotionLimits(("a", "b"), (True, False), **{**values, **given})  # type: ignore[arg-type]


def limited(robot: Robot, *limits: JointLimits) -> Robot:
    return replace(robot, joints=tuple(replace(j, limits=one) for j, one in zip(robot.joints, limits, strict=True)))


def test_margins_are_taken_off_every_limit(planar_2r: Robot) -> None:
    first = JointLimits(-1.0, 3.0, 2.0, 10.0, 100.0, 50.0)
    found = limits_of(limited(planar_2r, first, JointLimits(velocity=1.0)), margin=0.1, torque_margin=0.3)
    assert found.joints == ("joint1", "joint2") and found.revolute == (True, True)
    np.testing.assert_allclose(found.lower, [-0.8, -np.inf])
    np.testing.assert_allclose(found.upper, [2.8, np.inf])
    np.testing.assert_allclose(found.velocity, [1.8, 0.9])
    np.testing.assert_allclose(found.acceleration, [9.0, np.inf])
    np.testing.assert_allclose(found.jerk, [90.0, np.inf])
    np.testing.assert_allclose(found.torque, [35.0, np.inf])
    np.testing.assert_allclose(found.centre, [1.0, 0.0])
    np.testing.assert_allclose(found.reach, [1.8, np.inf])


def test_the_rate_of_the_torque_is_taken_as_it_is_stated(planar_2r: Robot) -> None:
    found = limits_of(limited(planar_2r, JointLimits(velocity=1.0, effort_rate=80.0), JointLimits(velocity=1.0)))
    np.testing.assert_array_equal(found.torque_rate, [80.0, np.inf])
    np.testing.assert_array_equal(bounds().torque_rate, NONE)
    np.testing.assert_array_equal(bounds(torque_rate=np.array(7.0)).torque_rate, [7.0, 7.0])
    with pytest.raises(BadOption, match=r"torque_rate of b = -1.0 is not possible; give a bound above 0"):
        bounds(torque_rate=np.array([1.0, -1.0]))


def test_a_follower_hands_its_limits_to_its_leader(mimic_arm: Robot) -> None:
    """q3 = -0.5 q2 + 0.3: joint 3 within -0.2..0.5 means joint 2 within -0.4..1."""
    leader, follower = JointLimits(-3.0, 0.8, 2.0, 10.0, 100.0, 50.0), JointLimits(-0.2, 0.5, 0.6, 2.0, 80.0, 1.0)
    robot = limited(mimic_arm, JointLimits(-1.0, 1.0, 1.0), leader, follower)
    found = limits_of(robot, margin=0.0, torque_margin=0.0)
    assert found.joints == ("joint1", "joint2")
    np.testing.assert_allclose([found.lower[1], found.upper[1]], [-0.4, 0.8])
    np.testing.assert_allclose([found.velocity[1], found.acceleration[1], found.jerk[1]], [1.2, 4.0, 100.0])
    assert found.torque[1] == 50.0
    np.testing.assert_array_equal([found.lower[0], found.upper[0], found.velocity[0]], [-1.0, 1.0, 1.0])
    with pytest.raises(
        BadOption, match=r"position of joint2 = .*'joint3' follows with -0.5 and 0.3 and leaves it no ra"
    ):
        limits_of(limited(mimic_arm, leader, leader, replace(follower, lower=2.0, upper=2.5)))


def test_the_speed_limit_of_a_follower_is_one_of_its_leader(mimic_arm: Robot) -> None:
    free, slow = JointLimits(), JointLimits(velocity=0.6)
    found = limits_of(limited(mimic_arm, slow, free, slow), margin=0.0)
    np.testing.assert_allclose(found.velocity, [0.6, 1.2])


@pytest.mark.parametrize("name", ["er16", "generic-6r", "generic-7r", "generic-scara"])
def test_robots_that_ship_have_all_limits(name: str) -> None:
    found = limits_of(read_robot(name))
    assert np.all(np.isfinite(found.bounds())) and np.all(np.isfinite(found.torque))


def test_a_joint_without_a_speed_limit_is_named(planar_2r: Robot) -> None:
    with pytest.raises(
        BadOption, match=r"joint2 = inf is not possible; state its speed limit in a case file .*MJCF has no place"
    ):
        limits_of(limited(planar_2r, JointLimits(velocity=1.0), JointLimits(-1.0, 1.0)))


@pytest.mark.parametrize(
    ("limit", "message"),
    [
        (JointLimits(velocity=0.0), r"velocity of joint2 = 0.0 .*lock the joint in the case.*locked: {joint2: VALUE}"),
        (JointLimits(0.0, 0.0, 1.0), r"position of joint2 = \[0.0, 0.0\] .*no range.*locked: {joint2: VALUE}"),
        (JointLimits(velocity=1.0, effort=0.0), r"effort of joint2 = 0.0 .*in a case file .limits: {effort: "),
        (JointLimits(velocity=1.0, jerk=0.0), r"jerk of joint2 = 0.0 .*or leave it out of the robot"),
    ],
)
def test_limits_of_zero_are_named_with_the_way_out(planar_2r: Robot, limit: JointLimits, message: str) -> None:
    with pytest.raises(BadOption, match=message):
        limits_of(limited(planar_2r, JointLimits(velocity=1.0), limit))


def test_a_slide_without_ends_is_named(sliding_arm: Robot) -> None:
    with pytest.raises(BadOption, match=r"position of joint2 = \[-inf, inf\].*a slide has some"):
        limits_of(limited(sliding_arm, *[JointLimits(velocity=1.0)] * 3))


@pytest.mark.parametrize("name", ["margin", "torque_margin"])
@pytest.mark.parametrize("value", [-0.1, 1.0, np.nan])
def test_margins_that_are_none(planar_2r: Robot, name: str, value: float) -> None:
    with pytest.raises(BadOption, match="give a share from 0 to less than 1"):
        limits_of(planar_2r, **{name: value})


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"lower": np.array([0.0, -np.inf])}, r"position of a = \[0.0, inf\].*two finite ends"),
        ({"lower": np.ones(2), "upper": np.ones(2)}, "the lower one first"),
        ({"velocity": np.array([1.0, 0.0])}, "velocity of b = 0.0 is not possible; give a bound above 0"),
        ({"torque": np.array([np.nan, 1.0])}, "torque of a = nan"),
    ],
)
def test_bounds_that_no_motion_keeps(given: dict[str, object], message: str) -> None:
    with pytest.raises(BadOption, match=message):
        bounds(**given)


def test_shapes_that_do_not_fit() -> None:
    with pytest.raises(ValueError, match="velocity has shape"):
        bounds(velocity=np.ones(3))
    with pytest.raises(ValueError, match="1 kinds for 2 joints"):
        MotionLimits(("a", "b"), (True,), *np.ones((6, 2)))


def test_the_worst_of_a_sine_in_closed_form() -> None:
    amplitude, period = np.array([0.4, 0.1]), 8.0
    w = 2 * np.pi / period
    motion = FourierSeries(np.array([1.0, 0.0]), amplitude[:, None], np.zeros((2, 1)), period)
    limits = bounds(lower=np.array([0.5, -1.0]), upper=np.array([1.3, 1.0]), velocity=np.array([1.0, 0.05]))
    rows = {(row.joint, row.quantity): row for row in check_limits(motion, limits, 801)}
    assert len(rows) == 8
    high = rows["a", "position"]
    assert (high.value, high.limit, high.time) == pytest.approx((1.4, 1.3, 2.0), rel=1e-9)
    assert high.unit == "rad"
    assert high.used == pytest.approx(0.5 / 0.4) and not high.kept
    assert rows["a", "velocity"].value == pytest.approx(0.4 * w) and rows["a", "velocity"].kept
    fast = rows["b", "velocity"]
    assert (fast.used, fast.unit) == (pytest.approx(0.1 * w / 0.05), "m/s")
    free = rows["b", "jerk"]
    assert (abs(free.value), free.limit, free.used) == (pytest.approx(0.1 * w**3), np.inf, 0.0)
    assert worst_row(tuple(rows.values())) is fast
    assert max(rows.values(), key=lambda row: row.used).used == pytest.approx(0.1 * w / 0.05)


def test_the_torque_is_that_of_the_model(planar_2r: Robot) -> None:
    model = DynamicModel(planar_2r)
    theta = model.nominal()
    assert theta is not None
    still = FourierSeries(np.zeros(2), np.zeros((2, 1)), np.zeros((2, 1)), 1.0)
    rows = check_limits(still, bounds(torque=np.array([5.0, 100.0])), 3, lambda m: model.torque(m, theta))
    held = {row.joint: row for row in rows if row.quantity == "torque"}
    # g along -y: joint 1 holds the first moments along x of both links at arm's length, joint 2 those of its own
    second = 9.81 * 2.0 * 0.18
    first = 9.81 * (3.0 * 0.22 + 2.0 * 0.5) + second
    assert held["a"].value == pytest.approx(first) and not held["a"].kept
    assert held["b"].value == pytest.approx(second) and held["b"].kept


def test_rate_and_chance_margin_in_closed_form() -> None:
    """A torque that is 30 q plus what jumps has the rate 30 dq; the margin adds to the size on either side."""
    amplitude, w = np.array([0.4, 0.1]), 2 * np.pi / 8.0
    motion = FourierSeries(np.zeros(2), amplitude[:, None], np.zeros((2, 1)), 8.0)
    rows = {
        (row.joint, row.quantity): row
        for row in check_limits(
            motion,
            bounds(torque=np.array([13.0, 5.0]), torque_rate=np.array([9.0, 3.0])),
            801,
            lambda m: 30 * m.q + np.sign(m.dq),
            spread=lambda m: 0.1 + 0 * m.q,
            smooth_torque=lambda m: 30 * m.q,
        )
    }
    assert abs(rows["a", "torque"].value) == pytest.approx(12.0 + 1.0 + 0.1, rel=1e-4)
    assert not rows["a", "torque"].kept and rows["b", "torque"].kept
    assert abs(rows["a", "torque rate"].value) == pytest.approx(30 * 0.4 * w, rel=1e-6)
    assert (rows["a", "torque rate"].unit, rows["b", "torque rate"].unit) == ("N m/s", "N/s")
    assert not rows["a", "torque rate"].kept and rows["b", "torque rate"].used == pytest.approx(w, rel=1e-6)


def test_a_jump_of_the_jerk_is_looked_at_from_both_sides() -> None:
    """The jerk at the end of a run-in is larger than at any sample that is not there."""
    core = FourierSeries(np.zeros(2), np.array([[0.3], [0.2]]), np.array([[0.1], [0.1]]), 3.0)
    motion = RestToRest(core, 1.0)
    assert motion.seams == pytest.approx((1.0, 1.0, 4.0, 4.0))
    ends = np.abs(motion.enter.jerk(1.0)[0])
    found = {row.joint: row for row in check_limits(motion, bounds(), 100) if row.quantity == "jerk"}
    most = np.abs(motion.jerk(np.linspace(0.0, 5.0, 20_001))).max(axis=0)
    np.testing.assert_allclose([abs(found["a"].value), abs(found["b"].value)], most, rtol=2e-3)
    assert np.all(most >= ends - 1e-2 * ends)
    assert RestToRest(core, 0.0).seams == ()


def test_a_motion_of_other_joints_is_refused() -> None:
    motion = FourierSeries(np.zeros(3), np.zeros((3, 1)), np.zeros((3, 1)), 1.0)
    with pytest.raises(BadOption, match=r"for 3 joints.*the limits are of 2"):
        check_limits(motion, bounds(), 10)


def test_rest_to_rest_is_smooth_and_ends_at_rest() -> None:
    generator = np.random.default_rng(0)
    core = FourierSeries(generator.normal(size=2), *generator.normal(size=(2, 2, 3)), 4.0)
    motion = RestToRest(core, 1.5, repeats=2)
    assert (motion.duration, motion.joints, motion.periodic) == (11.0, 2, False)
    for signal in motion.evaluate([0.0, 11.0])[1:]:
        np.testing.assert_allclose(signal, 0.0, atol=1e-10)
    time = np.linspace(0.01, 10.99, 4001)
    step = 1e-5
    above, below = motion.evaluate(time + step), motion.evaluate(time - step)
    away = (np.abs(time - 1.5) > 2 * step) & (np.abs(time - 9.5) > 2 * step)
    for order, exact in enumerate([*motion.evaluate(time)[1:], motion.jerk(time)]):
        slope = (above[order] - below[order]) / (2 * step)
        chosen = away if order == 2 else np.ones(len(time), bool)  # the jerk jumps where run-in and motion meet
        np.testing.assert_allclose(slope[chosen], exact[chosen], rtol=1e-5, atol=2e-3)
    np.testing.assert_allclose(motion.evaluate([3.0])[0], core.evaluate([1.5])[0], atol=1e-12)


def test_rest_to_rest_of_what_cannot_be_repeated() -> None:
    core = FourierSeries(np.zeros(1), np.ones((1, 1)), np.zeros((1, 1)), 4.0)
    with pytest.raises(BadOption, match="give a periodic motion"):
        RestToRest(Quintic.from_rest(np.zeros((3, 1)), 1.0), 0.0)
    with pytest.raises(BadOption, match="run_in = -1"):
        RestToRest(core, -1.0)
    with pytest.raises(BadOption, match="repeats = 0"):
        RestToRest(core, 1.0, 0)
