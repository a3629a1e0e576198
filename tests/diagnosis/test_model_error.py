"""Intervals of a coefficient where the model lacks something that depends on the state, and where it lacks nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults import injections as put
from benchmarks.faults.figures import stated
from benchmarks.faults.trials import Trial, subject_of, virtual

from dynident.arrays import Array
from dynident.case.case import read_case
from dynident.diagnosis.causes.against_bodies import Anchored
from dynident.diagnosis.causes.cause_columns import CauseRows
from dynident.diagnosis.causes.cause_figures import figured
from dynident.diagnosis.causes.cause_search import CLOSE, Cause, CauseSearch
from dynident.diagnosis.causes.frame_errors import MOVED, TURNED, displaced_torques, frame_errors
from dynident.diagnosis.causes.known_bodies import KnownBodies
from dynident.diagnosis.causes.model_error import INDEPENDENT, ModelError
from dynident.diagnosis.causes.thin_fit import quick_fit
from dynident.diagnosis.causes.torque_scales import joint_scales
from dynident.diagnosis.checks.residual_trends import ResidualTrends
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.inertia import Inertia
from dynident.model.kernels.batched import inverse_dynamics
from dynident.model.robot import Robot

ROWS, COLUMNS, DRAWS = 120, 6, 200


def held(error: float, noise: float) -> tuple[float, float]:
    """Return the share of 95 % intervals that hold the last coefficient of a fit, and their median widening."""
    generator = np.random.default_rng(3)
    state = 2.0 * np.sin(np.linspace(0.0, 20.0, ROWS))[:, None] * [1.0, 0.4] + generator.normal(0, 0.3, (ROWS, 2))
    columns = np.column_stack([np.sin(state @ generator.normal(size=2) + k) for k in range(COLUMNS)])
    covariance = np.exp(-0.5 * np.sum((state[:, None] - state) ** 2, axis=2))
    root = np.linalg.cholesky(covariance + 1e-9 * np.eye(ROWS))
    hat, inverse = np.linalg.pinv(columns), np.linalg.inv(columns.T @ columns)
    model, inside, widenings = ModelError(INDEPENDENT, [covariance]), [], []
    for _ in range(DRAWS):
        target = error * root @ generator.normal(size=ROWS) + noise * generator.normal(size=ROWS)
        residual = target - columns @ (hat @ target)
        deviation = float(np.sqrt(np.mean(residual**2)))
        widening = model.of_rows([columns / deviation], [residual / deviation]).widening(-1, np.ones(1))
        spread = deviation * np.sqrt(inverse[-1, -1] * widening / INDEPENDENT)
        inside.append(abs(hat[-1] @ target) < 1.96 * spread)
        widenings.append(widening / INDEPENDENT)
    return float(np.mean(inside)), float(np.median(widenings))


def held_beside_known_bodies(error: float, noise: float) -> tuple[float, float, float]:
    """Return the shares of 95 % intervals that hold a cause beside known bodies, with errors of the model and without.

    The third is by how much the former are wider, in the median.
    """
    generator = np.random.default_rng(4)
    count, joints, bodies = 4 * ROWS, 2, 3
    time = np.linspace(0.0, 20.0, count)
    state = np.stack([np.sin(time), np.cos(0.6 * time + 1.0)], axis=1)
    blocks = [np.sin(state @ generator.normal(size=(2, bodies)) + k) for k in range(joints)]
    cause = Cause("cause", "", np.sin(state @ generator.normal(size=(2, joints)) + 0.5)[None], is_filtered=True)
    covariance = np.exp(-0.5 * np.sum((state[:, None] - state) ** 2, axis=2))
    values, vectors = np.linalg.eigh(covariance)
    root, every, inside, widths = vectors * np.sqrt(np.maximum(values, 0.0)), [np.arange(bodies)] * joints, [], []
    model = ModelError(INDEPENDENT, [covariance[::INDEPENDENT, ::INDEPENDENT]] * joints)
    known = KnownBodies(np.arange(bodies), 10.0 * np.eye(bodies), np.ones(bodies))
    for _ in range(DRAWS // 2):
        beta = 1.0 + 0.1 * generator.normal(size=bodies)
        white = generator.normal(size=(count + INDEPENDENT - 1, joints))
        band = sum(white[k : count + k] for k in range(INDEPENDENT)) / np.sqrt(INDEPENDENT)
        target = np.stack([block @ beta for block in blocks], axis=1) + 2.0 * cause.columns[0]
        target = target + error * root @ generator.normal(size=(count, joints)) + noise * band
        rows = CauseRows(blocks, every, bodies, target, target, np.ones(target.shape, bool), float(INDEPENDENT))
        factors, told, doubts = np.full(joints, float(INDEPENDENT)), [], list[float]()
        search = CauseSearch(rows, [cause])
        _, own = figured(search, search.blames(), model, lambda cause, beta, values: cause)
        for errors in (lambda own=own: own, None):
            anchored = Anchored(rows, [cause], known, factors, errors)
            (blame,) = anchored.blames()
            told.append((abs(blame.values[0] - 2.0) < blame.half_widths[0], blame.half_widths[0]))
            doubts.append(anchored.distinct(anchored.fit([0]), [0]))
        inside.append([told[0][0], told[1][0]])
        widths.append(told[0][1] / told[1][1])
        assert doubts == pytest.approx([CLOSE * widths[-1] ** 2, CLOSE])  # what is told from another cause likewise
    with_errors, without = np.mean(inside, axis=0).tolist()
    return with_errors, without, float(np.median(widths))


def test_intervals_beside_known_bodies_hold_where_the_error_follows_the_state_and_stay_where_it_is_noise() -> None:
    share, without, wide = held_beside_known_bodies(0.1, 0.02)
    assert share > 0.9 and without < 0.6 and wide > 2.0, (share, without, wide)
    share, without, wide = held_beside_known_bodies(0.0, 0.1)
    assert share > 0.9 and without > 0.9 and wide < 1.3, (share, without, wide)


def test_intervals_hold_where_the_error_follows_the_state_and_stay_narrow_where_it_is_noise() -> None:
    share, wide = held(1.0, 0.1)
    assert share > 0.9 and wide > 3.0
    share, wide = held(0.0, 1.0)
    assert share > 0.9 and wide < 1.5


@pytest.mark.parametrize("state", [lambda motion: 3.0 * motion.q, lambda motion: motion.ddq / motion.ddq.std(axis=0)])
def test_an_error_of_positions_or_accelerations_widens_the_interval_of_a_scale_that_noise_does_not(
    state: Callable[[Motion], Array], tmp_path: Path
) -> None:
    right = virtual(read_case("generic-6r"))
    more = 0.03 * right.columns["tau"].std(axis=0) * np.sin(state(put.smoothed(right)))
    bent = right.with_columns(tau=right.columns["tau"] + more)
    spreads = []
    for trial in (right, bent):
        fit = quick_fit(trial.case, trial.case.read(trial.written(tmp_path)))
        assert fit is not None
        elbow = joint_scales(fit)[2]
        assert elbow.low <= 1.0 <= elbow.high
        spreads.append(elbow.spread)
    assert spreads[0] < 0.005 and spreads[1] > 3 * spreads[0]


def askew(robot: Robot, seed: int) -> Robot:
    """Return a robot whose axes are off by what parts are within their tolerances, but for the first one."""
    generator, joints = np.random.default_rng(seed), [robot.joints[0]]
    for joint in robot.joints[1:]:
        axis, place = joint.axis + TURNED * generator.normal(size=3), MOVED * generator.normal(size=3)
        joints.append(replace(joint, axis=axis, translation=joint.translation + place))
    return replace(robot, joints=tuple(joints))


@pytest.mark.parametrize("name", ["er16", "generic-scara"])
def test_torques_of_displaced_axes_are_those_of_the_displaced_robot(name: str) -> None:
    robot = read_case(name).robot
    robots, model = [askew(robot, seed) for seed in (1, 2)], DynamicModel(robot)
    motion, theta = model.random_motion(5), model.nominal()
    assert theta is not None
    theta = theta[: model.inertial_count]
    axes, places = (np.stack([getattr(one.chain, part) for one in robots]) for part in ("axis", "translation"))
    torques = displaced_torques(robot.chain, axes, places, theta, motion)
    wanted = [inverse_dynamics(one.chain, theta, motion.q, motion.dq, motion.ddq) for one in robots]
    assert np.allclose(torques, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


def test_a_joint_that_bears_nothing_has_errors_of_no_other_size(tmp_path: Path) -> None:
    """The nominal torque of a joint about which all mass is even is rounding: no ratio of torques comes from it."""
    case = read_case("generic-6r")
    ten = np.zeros(10)
    ten[6:] = [*(0.02 * np.asarray(case.robot.joints[-1].axis)), 0.2]
    even = replace(case.robot.links[-1], inertia=Inertia.from_vector(ten))
    nominal = replace(case, robot=replace(case.robot, links=(*case.robot.links[:-1], even)))
    fit = subject_of(replace(virtual(case), case=nominal), tmp_path).fit
    assert fit is not None
    errors = frame_errors(fit, 10)
    assert errors is not None and 0.0 < np.abs(errors[:, :, -1]).max() < 0.02


def test_intervals_of_a_clock_hold_where_axes_are_off_within_tolerances(tmp_path: Path) -> None:
    """No residual tells it, as bodies take most of it in: without errors of the axes the mean is 1.2."""
    case, squares = read_case("generic-6r"), []
    for seed in range(6):
        trial = virtual(replace(case, robot=askew(case.robot, seed)))
        fast = put.timed(Trial(case, trial.columns), 1.05)
        found = [one for one in ResidualTrends().findings(subject_of(fast, tmp_path)) if one.name == "time scale"]
        clock = stated(found[0], fast)
        assert clock is not None and clock.half < 0.01
        squares.append(abs((clock.value - 1.05) / clock.half) ** 2)
    assert np.mean(squares) < 0.9
