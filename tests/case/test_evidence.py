"""Evidence of units and scales, and that the draft of a case doubts what the checks doubt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynident.case.case import read_case
from dynident.case.draft.signal_units import position_unit, torque_unit
from dynident.case.draft.time_columns import time_unit
from dynident.case.evidence.positions import is_plausible, is_within, strays, travel
from dynident.case.evidence.rows import POSSIBLE_STEPS, is_step, same_as_before, time_units
from dynident.case.evidence.torques import agrees, scale_against
from dynident.case.evidence.velocities import is_near, velocity_pair
from dynident.model.joint import JointLimits

TIME = np.arange(2000) / 200.0
Q = np.stack([np.sin(2.0 * TIME), 0.5 * np.cos(3.0 * TIME)], axis=1)
DQ = np.stack([2.0 * np.cos(2.0 * TIME), -1.5 * np.sin(3.0 * TIME)], axis=1)

JOINT = replace(read_case("er16").robot.joints[0], limits=JointLimits(-1.0, 2.0))
FREE = replace(JOINT, limits=JointLimits())


@pytest.mark.parametrize(
    ("step", "words"), [(0.004, ("s",)), (4.0, ("ms",)), (4000.0, ("us",)), (1e-5, ()), (3e5, ("ns",))]
)
def test_the_unit_of_the_time_is_one_under_which_the_step_is_usual(step: float, words: tuple[str, ...]) -> None:
    assert time_units(step)[:1] == words[:1]
    assert time_unit(step, "").certain == ("s" in time_units(step))


def test_an_unusual_step_is_no_wrong_one() -> None:
    assert is_step(0.4) and is_step(5e-5) and not is_step(4.0) and not is_step(1e-6)
    assert time_units(0.4, POSSIBLE_STEPS) == ("s", "ms") and time_units(0.4) == ("ms",)


def test_rows_are_compared_over_all_columns() -> None:
    time, values = np.array([0.0, 0.0, 1.0, 1.0]), np.array([[1.0, 2.0], [1.0, 2.0], [1.0, 2.0], [1.0, np.nan]])
    assert same_as_before([time, values]).tolist() == [False, True, False, False]
    assert same_as_before([np.zeros(0)]).tolist() == []


def test_limits_have_a_slack_and_joints_without_them_three_turns() -> None:
    assert is_within(JOINT, -1.04, 2.04) and not is_within(JOINT, -1.06, 2.0)
    assert is_plausible(FREE, -6 * np.pi, 0.0) and not is_plausible(FREE, 0.0, 19.0)
    assert is_plausible(JOINT, -1.0, 2.0) and not is_plausible(JOINT, -1.0, 6.0)
    slide = replace(FREE, kind="prismatic")
    assert is_plausible(slide, 0.0, 10.0) and not is_plausible(slide, 0.0, 11.0)


def test_single_values_are_no_travel_and_a_lag_no_straying() -> None:
    resting = np.zeros((1000, 2))
    resting[3], resting[:, 1] = 1.0, np.linspace(0.0, 0.1, 1000)
    assert (travel(resting) > 1e-3).tolist() == [False, True]
    assert strays(Q, np.stack([Q[:, 1], np.roll(Q[:, 1], 3)], axis=1)).tolist() == [True, False]


@pytest.mark.parametrize("factor", [1.0, -1.0, 180 / np.pi])
def test_the_ratio_of_velocities_has_their_unit_and_their_sign(factor: float) -> None:
    pair = velocity_pair(TIME, Q, factor * DQ)
    assert pair is not None and pair.moving.all()
    assert pair.ratios == pytest.approx([factor, factor], rel=2e-3)
    assert np.sign(np.diagonal(pair.correlations)).tolist() == [np.sign(factor)] * 2
    assert all(is_near(ratio, factor) for ratio in pair.ratios.tolist())
    assert not is_near(1.15) and not is_near(180 / np.pi)
    assert velocity_pair(TIME[:40], Q[:40], DQ[:40]) is None


def test_a_low_rate_is_no_other_clock() -> None:
    """Central differences at 20 Hz are smaller than the velocity by 0.2 %, and that had been told of the clock."""
    time = np.arange(600) / 20.0
    waves = np.stack([np.sin(2.0 * time), np.cos(3.0 * time)], axis=1)
    pair = velocity_pair(time, waves, np.stack([2.0 * np.cos(2.0 * time), -3.0 * np.sin(3.0 * time)], axis=1))
    assert pair is not None and pair.ratios == pytest.approx([1.0, 1.0], abs=1e-4)


@pytest.mark.parametrize("pause", [0.0, 30.0])
def test_velocities_are_not_held_against_positions_across_a_gap(pause: float) -> None:
    """Positions that go on elsewhere after a pause in the recording had been a clock that is off."""
    later = np.where(TIME < 4.0, 0.0, 1.0)
    pair = velocity_pair(TIME + pause * later, Q + np.outer(later * (pause > 0.0), [1.5, 1.5]), DQ)
    assert pair is not None and pair.ratios == pytest.approx([1.0, 1.0], rel=2e-3)


@pytest.mark.parametrize("lag", [0.02, 0.15, -0.03, 0.0])
def test_the_lag_of_velocities_is_their_shift_and_noise_or_a_unit_is_none(lag: float) -> None:
    late = np.column_stack([np.interp(TIME - lag, TIME, column) for column in DQ.T])
    noise = np.random.default_rng(0).normal(0.0, 0.3, DQ.shape)
    for dq, truth in ((late, lag), (DQ + noise, 0.0), (180 / np.pi * DQ, 0.0)):
        pair = velocity_pair(TIME, Q, dq)
        assert pair is not None and pair.lags == pytest.approx([truth] * 2, abs=2e-3)


def test_a_scale_and_its_sign_are_those_of_the_torques() -> None:
    noise = np.random.default_rng(1).normal(size=Q.shape)
    assert scale_against(Q, 3.0 * Q) == pytest.approx((3.0, 1.0))
    assert scale_against(Q, -Q) == pytest.approx((-1.0, -1.0))
    assert abs(scale_against(Q, noise)[1]) < 0.1
    assert agrees(0.5) and agrees(2.4) and not agrees(3.0) and not agrees(0.3) and not agrees(-1.0)


def test_the_draft_is_sure_of_radians_that_the_checks_do_not_take_for_degrees() -> None:
    turns = 5 * np.pi * np.sin(TIME)[:, None]
    assert position_unit(turns, [FREE], "").certain
    assert not position_unit(2 * turns, [FREE], "").certain


def test_a_unit_in_the_header_stands_where_positions_leave_the_limits_a_little_and_no_other_unit_fits() -> None:
    beyond = 0.5 + 2.0 * np.sin(TIME)[:, None]  # rad, of a joint from -1 to 2
    told = position_unit(np.degrees(beyond), [JOINT], "deg")
    assert told.certain and told.text == "deg" and "beyond the limits" in told.why
    assert not position_unit(np.degrees(beyond), [JOINT], "rad").certain  # 57 times too far
    assert not position_unit(np.degrees(10.0 * beyond), [JOINT], "deg").certain  # of no joint like this
    assert not position_unit(np.degrees(beyond), [JOINT], "").certain


@pytest.mark.parametrize(("ratio", "sure"), [(1.0, True), (2.4, True), (3.0, False), (0.3, False)])
def test_the_draft_asks_for_a_stated_unit_of_torques_that_the_checks_warn_of(ratio: float, sure: bool) -> None:
    told = torque_unit([FREE], "N m", np.array([ratio]), [True], np.array([1.0]))
    assert told.certain == sure and told.text == "N m"


@pytest.mark.parametrize(("size", "told"), [(1.0, True), (180 / np.pi, False), (9.0, False)])
def test_a_joint_within_its_limits_with_its_sign_turned_is_no_joint_in_degrees(size: float, told: bool) -> None:
    q = size * np.stack([0.5 + np.sin(TIME), -1.5 + 0.4 * np.sin(TIME)], axis=1)
    found = position_unit(q, [JOINT, replace(JOINT, name="A2")], "")
    assert not found.certain and ("sign turned: [rad, -rad]" in found.why) == told
    assert not (told and found.text)


@pytest.mark.parametrize("in_degrees", [(0, 1, 2), (0, 1)])
def test_joints_that_move_as_others_do_in_radians_alone_are_named(in_degrees: tuple[int, ...]) -> None:
    """Columns in two units have no likely one; a log in degrees keeps it."""
    phase = np.linspace(0, 6, 200)
    q = np.stack([np.sin(phase), 0.8 * np.cos(phase), 0.9 * np.sin(2 * phase)], axis=1)
    q[:, list(in_degrees)] = np.degrees(q[:, list(in_degrees)])
    joints = [replace(JOINT, name=f"A{k + 1}") for k in range(3)]
    told = position_unit(q, joints, "")
    assert not told.certain
    if len(in_degrees) == 3:
        assert told.text == "deg" and "differ" not in told.why
    else:
        assert told.text == "" and "A3 are within them as rad too and move 1.8 deg" in told.why
        assert "[deg, deg, rad] where units differ by joint" in told.why


@pytest.mark.parametrize(
    ("limit", "size", "likely", "words"),
    [
        (np.radians(3.14159), 1.2, "rad", '(an MJCF lacks <compiler angle="radian"/> then)'),
        (1.9, 100.0, "", "within them as deg, or percent of the range"),
        (1.9, 95.0, "deg", "within them as deg"),
    ],
)
def test_limits_of_radians_read_as_degrees_and_percent_are_no_degrees(
    limit: float, size: float, likely: str, words: str
) -> None:
    joint = replace(JOINT, limits=replace(JOINT.limits, lower=-limit, upper=limit))
    found = position_unit(size * np.sin(np.linspace(0.0, 20.0, 2000))[:, None].round(3), [joint], "")
    assert not found.certain and found.text == likely and words in found.why
