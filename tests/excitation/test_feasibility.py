"""Start points by construction, shrinking about the posture, and errors that name what cannot be kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_problems import LIMITS, TipWalls, model_of, problem_of

from dynident.arrays import Array
from dynident.errors import InfeasibleTrajectory
from dynident.excitation.design.design_problem import GUARD, DesignProblem
from dynident.excitation.design.feasibility import feasible_start, model_uses, posture_shares, shrunk
from dynident.excitation.design.finishing import FINER, FinishingCandidate, checked_plan, first_that_starts
from dynident.excitation.design.limits import check_limits
from dynident.excitation.design.parametrisation import kinds
from dynident.excitation.design.rest_to_rest import RestToRest
from dynident.model.joint import JointLimits
from dynident.model.robot import Robot


def posture_of(problem: DesignProblem, x: Array) -> Array:
    return problem.free(x)[:, 0]


@pytest.mark.parametrize("kind", kinds())
@pytest.mark.parametrize("seed", range(5))
def test_every_start_keeps_every_bound_and_moves(planar_2r: Robot, kind: str, seed: int) -> None:
    problem = problem_of(model_of(planar_2r), kind, sigmas=2.0, clearance=TipWalls())
    x = feasible_start(problem, np.random.default_rng(seed))
    assert problem.point(x, 4.0).used.max() < 1.0
    assert np.all(np.ptp(problem.motion(x).q, axis=0) > 0.02)
    posture = posture_shares(problem, posture_of(problem, x)[None])
    assert posture.max() <= 1.0 - GUARD  # the robot can stand in the middle of its motion
    np.testing.assert_array_equal(feasible_start(problem, np.random.default_rng(seed)), x)


def test_a_joint_without_a_range_may_start_anywhere(planar_2r: Robot) -> None:
    limits = JointLimits(velocity=2.0, effort=400.0)
    problem = problem_of(model_of(planar_2r, limits))
    starts = [posture_of(problem, feasible_start(problem, np.random.default_rng(seed))) for seed in range(20)]
    assert np.ptp(starts, axis=0).min() > 1.0 and np.abs(starts).max() < np.pi


@pytest.mark.parametrize("kind", kinds())
def test_shrinking_keeps_the_posture_and_every_bound_on_a_grid_20_times_finer(planar_2r: Robot, kind: str) -> None:
    problem = problem_of(model_of(planar_2r), kind, sigmas=2.0, clearance=TipWalls())
    dense = replace(problem, samples=FINER * problem.samples)
    x = feasible_start(problem, np.random.default_rng(2)).reshape(2, -1)
    x[:, 1:] *= 1.5
    kept = shrunk(dense, x.ravel())
    assert kept is not None
    np.testing.assert_array_equal(kept.reshape(2, -1)[:, 0], x[:, 0])
    shares = kept.reshape(2, -1)[:, 1:] / x[:, 1:]
    np.testing.assert_allclose(shares, np.broadcast_to(shares[:, :1], shares.shape), rtol=1e-9)  # one factor a joint
    assert np.all(shares[:, 0] < 1.0)
    finest = replace(problem, samples=20 * dense.samples)
    used = np.r_[finest.point(kept, 4.0).used, model_uses(finest, kept)]
    assert used.max() <= 1.0
    assert used.max() > 0.9


def test_a_motion_whose_mean_posture_is_in_the_way_is_shrunk_about_one_of_its_samples(planar_2r: Robot) -> None:
    problem = problem_of(model_of(planar_2r), clearance=TipWalls())
    dense = replace(problem, samples=10 * problem.samples)
    kept = shrunk(dense, feasible_start(problem, np.random.default_rng(2)))
    assert kept is not None
    mean = dense.free(kept)[:, 0]
    samples = TipWalls().distances(dense.motion(kept).q)
    own = TipWalls().distances(mean[None])[0]
    pair = int(np.argmax(samples.max(axis=0) - own))
    required = np.full(3, -9.0)
    required[pair] = 0.5 * (own[pair] + samples[:, pair].max())  # the mean is too near, some samples are not
    moved = replace(dense, clearance=TipWalls(required=required))
    found = shrunk(moved, kept)
    assert found is not None
    assert model_uses(moved, found).max() <= 1.0
    assert np.any(found.reshape(2, -1)[:, 0] != kept.reshape(2, -1)[:, 0])


def test_what_keeps_its_bounds_is_not_shrunk(planar_2r: Robot) -> None:
    problem = problem_of(model_of(planar_2r))
    x = 0.5 * feasible_start(problem, np.random.default_rng(4))
    np.testing.assert_allclose(shrunk(problem, x), x, rtol=1e-11)


def test_a_posture_outside_the_range_cannot_be_shrunk(planar_2r: Robot) -> None:
    problem = problem_of(model_of(planar_2r))
    x = feasible_start(problem, np.random.default_rng(4)).reshape(2, -1)
    x[1, 0] = 1.1 * problem.limits.reach[1] / problem.unit[1]
    assert shrunk(problem, x.ravel()) is None


@pytest.mark.parametrize("kind", kinds())
def test_the_plan_of_a_start_keeps_all_its_rows_everywhere(planar_2r: Robot, kind: str) -> None:
    problem = problem_of(model_of(planar_2r), kind, sigmas=2.0, clearance=TipWalls())
    dense = replace(problem, samples=FINER * problem.samples)
    kept = shrunk(dense, feasible_start(problem, np.random.default_rng(0)))
    assert kept is not None
    best = first_that_starts(problem, [FinishingCandidate(kept, 0.0, 1)])
    plan = checked_plan(problem, best, problem.noise)
    assert plan.feasible and (plan.run_in > 0) == (kind == "fourier")
    assert [row.quantity for row in plan.rows].count("clearance") == 3
    by_name = {(row.joint, row.quantity): row for row in plan.rows}
    assert problem.theta is not None and problem.smooth_theta is not None
    theta, smooth, model = problem.theta, problem.smooth_theta, problem.observation.model
    fine = check_limits(
        RestToRest(plan.trajectory, plan.run_in),
        plan.limits,
        20 * plan.samples,
        lambda motion: model.torque(motion, theta),
        smooth_torque=lambda motion: model.torque(motion, smooth),
    )
    for row in fine:
        assert row.kept
        stated = by_name[row.joint, row.quantity]
        assert (stated.unit, stated.limit) == (row.unit, pytest.approx(row.limit, rel=1e-12))
        if row.quantity == "torque":
            assert stated.used > row.used  # its chance margin is counted
        else:
            assert row.used <= 1.002 * stated.used + 1e-9


def test_a_robot_that_cannot_hold_itself(planar_2r: Robot) -> None:
    weak = problem_of(model_of(planar_2r, replace(LIMITS, lower=-0.4, upper=0.4, effort=5.0)))
    with pytest.raises(InfeasibleTrajectory) as caught:
        feasible_start(weak, np.random.default_rng(0), attempts=5)
    assert caught.value.bound == "the torque of joint1"
    assert str(caught.value).startswith("no motion keeps the limits, above all the torque of joint1: every one of 320")
    assert str(caught.value).endswith("check masses and effort limits, or give a smaller torque margin")


def test_a_pair_that_is_always_too_near_is_named_with_what_is_missing(planar_2r: Robot) -> None:
    walls = TipWalls(offsets=np.array([0.8, 0.75, -1.0]))  # the tip reaches down 0.9 m at most
    problem = problem_of(model_of(planar_2r), clearance=walls)
    with pytest.raises(
        InfeasibleTrajectory, match=r"the clearance of tip \| floor: in every one of \d+ postures it is"
    ):
        feasible_start(problem, np.random.default_rng(0), attempts=3)


def test_bounds_that_no_posture_keeps_together(planar_2r: Robot) -> None:
    normals, offsets = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, -1.0]]), np.array([0.0, -0.1, 5.0])
    problem = problem_of(model_of(planar_2r), clearance=TipWalls(normals, offsets))
    with pytest.raises(
        InfeasibleTrajectory, match=r"none of 192 postures keeps all of them at once; .* % break this one"
    ):
        feasible_start(problem, np.random.default_rng(0), attempts=3)


def test_dry_friction_that_leaves_no_motion_at_all(planar_2r: Robot) -> None:
    problem = problem_of(model_of(planar_2r))
    assert problem.theta is not None
    theta = problem.theta.copy()
    theta[problem.observation.model.inertial_count] = 1e5  # Fc of joint 1: it can stand, not move
    stuck = replace(problem, theta=theta)
    with pytest.raises(
        InfeasibleTrajectory, match=r"the torque of joint1: a posture keeps all limits, but even the smal"
    ):
        feasible_start(stuck, np.random.default_rng(0), attempts=2)


def test_no_run_in_is_short_enough(planar_2r: Robot) -> None:
    problem = problem_of(model_of(planar_2r), "fourier")
    x = feasible_start(problem, np.random.default_rng(1))
    tight = replace(problem, limits=replace(problem.limits, velocity=np.full(2, 1e-3)))
    scaled = (x.reshape(2, -1) * (problem.unit / tight.unit)[:, None]).ravel()  # the same motion
    with pytest.raises(
        InfeasibleTrajectory, match=r"the velocity of joint\d: no run-in of up to 8 s keeps it; .*bspline"
    ):
        first_that_starts(tight, [FinishingCandidate(scaled, 0.0, 1)])
