"""What static friction can hold: closed forms, and samples at rest inside and beyond it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dynident
from bare_estimates import bare_estimate
from dynident import Log, Robot
from dynident import validate as validated
from dynident.applications.predicted_torque import predict_torque
from dynident.applications.standstill import end_states, held_torque
from dynident.arrays import Array
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.diagnosis.verdict import causes_against
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.files.estimate_file import read_estimate, write_estimate
from dynident.identification.identify import identify as core_identified
from dynident.identification.validate import validate as core_validated
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.load import Load
from dynident.model.friction.offset import Offset
from dynident.model.friction.presliding import Presliding
from dynident.model.friction.stribeck import Stribeck
from dynident.model.friction.viscous import Viscous
from dynident.model.kernels import batched
from dynident.results.short_answer import of_training
from dynident.results.text import rest_table, rest_words

GIVEN = Preprocessing(AsGiven(), rest="mask", standstill=0.02)


def test_the_interval_is_that_of_all_dry_friction(coupled_arm: Robot) -> None:
    parts = (Coulomb(0.3), Viscous(), Offset(), Load(), Stribeck(), Presliding())
    model, dof = DynamicModel(coupled_arm, parts), coupled_arm.dof
    levels = np.array([2.0, 5.0, 0.3, 0.05, 0.7, 1.1])
    assert coupled_arm.nominal is not None
    theta = np.concatenate([coupled_arm.nominal, np.tile(levels, dof)])
    motion = model.random_motion(20, seed=3)
    still = Motion(motion.q, np.zeros_like(motion.q), np.zeros_like(motion.q), state=np.zeros((20, dof, 1)))
    found = held_torque(model, theta, still, np.ones(motion.q.shape, dtype=bool))
    coupling = np.asarray(coupled_arm.coupling)
    gravity = batched.inverse_dynamics(coupled_arm.chain, coupled_arm.nominal, still.q, still.dq, still.ddq)
    load = np.linalg.solve(coupling.T, gravity.T).T
    half = (2.0 + 0.7 + 1.1 + 0.05 * np.abs(load)) @ np.abs(coupling)
    middle = gravity + np.full(dof, 0.3) @ coupling - coupled_arm.bias
    np.testing.assert_allclose(found.half, half, rtol=1e-4)
    np.testing.assert_allclose(found.middle, middle, atol=1e-4)
    none = held_torque(model, theta, motion, np.zeros(motion.q.shape, dtype=bool))
    np.testing.assert_array_equal(none.half, 0.0)
    np.testing.assert_array_equal(none.rests, False)
    np.testing.assert_allclose(none.torque, model.torque(motion, theta), rtol=1e-12)


def paused(robot: Robot, exact_motion: Callable[..., Motion], share: Array) -> tuple[Estimate, Log]:
    """Return an estimate, and a log that rests in its second half with shares (N / 2, n) of what friction can hold."""
    model = DynamicModel(robot, (Coulomb(), Viscous()))
    assert robot.nominal is not None
    theta = np.concatenate([robot.nominal, np.tile([3.0, 1.0], robot.dof)])
    time = np.arange(2 * len(share)) / 100.0
    moving = exact_motion(robot.dof, time[: len(share)], 0.5)
    stays = np.zeros_like(share)
    q, dq, ddq = (
        np.concatenate(pair) for pair in ((moving.q, stays + moving.q[-1]), (moving.dq, stays), (moving.ddq, stays))
    )
    torque = model.torque(Motion(q, dq, ddq), theta)
    torque[len(share) :] += 3.0 * share
    return replace(bare_estimate(model, theta), preprocessing=GIVEN), Log(robot.joint_names, time, q, dq, ddq, torque)


def test_until_a_drive_has_moved_on_friction_lies_between_both_ends(coupled_arm: Robot) -> None:
    """Presliding of any state at the start is inside; once all have come together the interval is the torque."""
    model, dof = DynamicModel(coupled_arm, (Coulomb(0.01), Presliding(length=0.01))), coupled_arm.dof
    assert coupled_arm.nominal is not None
    theta = np.concatenate([coupled_arm.nominal, np.tile([0.5, 2.0], dof)])
    time = np.linspace(0.0, 2.0, 400)
    q = np.outer(0.3 * (1.0 - np.cos(np.pi * time)), np.ones(dof))
    dq, ddq = (np.gradient(each, time, axis=0) for each in (q, np.gradient(q, time, axis=0)))
    motion = model.with_states(Motion(q, dq, ddq), time[1])
    ends = end_states(model)
    assert ends is not None and end_states(DynamicModel(coupled_arm, (Coulomb(),))) is None
    low, high = (np.asarray(model.with_states(motion, time[1], end).state) for end in ends)
    moves = np.zeros(q.shape, dtype=bool)
    found = held_torque(model, theta, motion, moves, (low, high))
    for first in np.linspace(ends[0], ends[1], 5):
        torque = model.torque(model.with_states(motion, time[1], first), theta)
        assert np.all(torque >= found.bounds[0] - 1e-9) and np.all(torque <= found.bounds[1] + 1e-9)
    assert found.rests[0].all() and np.max(found.half) > 2.0 and not found.rests[150:].any()
    np.testing.assert_array_equal(held_torque(model, theta, motion, moves).rests, False)


@pytest.mark.parametrize("part", [Presliding(length=0.003), Presliding(length=0.02, shape=0.01), None])
def test_filtered_bands_hold_all_that_friction_can_have_been(planar_2r: Robot, part: Presliding | None) -> None:
    """A log begins at rest, its friction anywhere; bands hold the torque also where the filter looks back on that."""
    model = DynamicModel(planar_2r, (Coulomb(0.01), *([] if part is None else [part])))
    assert planar_2r.nominal is not None
    theta = np.concatenate([planar_2r.nominal, np.tile([1.0] if part is None else [1.0, 3.0], 2)])
    time = np.arange(1200) / 100.0
    since, rest = np.maximum(time - 3.0, 0.0), time < 3.0
    q = np.outer(1.0 - np.cos(2.0 * since), [0.4, -0.3])
    dq, ddq = np.outer(np.sin(2.0 * since), [0.8, -0.6]), np.outer(np.cos(2.0 * since) * ~rest, [1.6, -1.2])
    how = Preprocessing(Butterworth(4.0), rest="mask", standstill=0.02)
    estimate, ends = replace(bare_estimate(model, theta), preprocessing=how), end_states(model)
    for share in np.linspace(0.01, 0.99, 5):
        start = None if ends is None else ends[0] + share * (ends[1] - ends[0])
        torque = model.torque(model.with_states(Motion(q, dq, ddq), 0.01, start), theta)
        torque[rest] += 2.0 * share - 1.0
        found = predict_torque(estimate, Log(planar_2r.joint_names, time, q, dq, ddq, torque))
        assert found.measured is not None
        assert np.all(np.abs(found.measured - found.torque) <= found.half_held + 1e-3)
    kept, level = found.prepared.kept.time, 1.0 if part is None else 4.0
    np.testing.assert_allclose(found.half_held[kept < 2.0], level, rtol=0.01)
    assert np.all(found.half_held[kept < 3.0] <= 1.4 * level) and np.all(
        found.half_held[np.abs(kept - 4.4) < 0.1] < 0.01
    )


@pytest.mark.parametrize("beyond", [False, True])
def test_samples_at_rest_are_counted_against_the_interval(
    planar_2r: Robot, exact_motion: Callable[..., Motion], beyond: bool
) -> None:
    share = np.random.default_rng(0).uniform(-0.98, 0.98, (300, 2))
    share[:, 1] += 20.0 * beyond
    estimate, log = paused(planar_2r, exact_motion, share)
    found = validated(estimate, log)
    first, second = found.at_rest
    assert first["samples"] >= 290 and first["inside"] == 1.0 and first["rms_beyond"] == pytest.approx(0.0, abs=1e-9)
    assert first["half_width"] == pytest.approx(3.0, rel=1e-3)
    if beyond:
        assert second["inside"] == 0.0 and second["rms_beyond"] == pytest.approx(3.0 * 19.0, rel=0.02)
    else:
        assert second["inside"] == 1.0
    free, own = core_validated(estimate, [log]), 3.0 * np.abs(share[:, 1])
    assert found.moving == free.moving and found.joints[0].relative_error == pytest.approx(0.0, abs=1e-3)
    assert free.joints[0].relative_error > 0.05  # against the middle
    if beyond:
        assert found.joints[1].rmse == pytest.approx(
            float(np.sqrt(np.sum(np.maximum(own - 3.0, 0.0) ** 2) / 600)), rel=0.02
        )
    else:
        assert found.total_relative_error < 1e-3 < free.total_relative_error
    assert found.figures()["at_rest"] == [first, second]
    assert found.held is not None and all(np.array_equal(side[:250], found.predicted[:250]) for side in found.held)
    reach = 3.0 * (20.0 if beyond else 0.0) * np.arange(2)
    np.testing.assert_allclose(np.abs(found.residual[310:]).mean(axis=0), np.maximum(reach - 3.0, 0.0), atol=0.2)
    shares = [band["inside"] for band in replace(found, deviations=0.01 * found.predicted, noise=np.ones(2)).bands()]
    assert shares[0] == 1.0 and shares[1] == (pytest.approx(0.5, abs=0.02) if beyond else 1.0)
    assert set(first) == {"name", "unit", "samples", "half_width", "inside", "rms_beyond"}
    table = rest_table(found)
    assert (
        table is not None
        and len(table.rows) == 2
        and rest_table(validated(estimate, log.rows(slice(0, 280), "m"))) is None
    )
    moving = validated(estimate, log.rows(slice(0, 280), "the motion"))
    assert not moving.at_rest and "at_rest" not in moving.figures()


def test_training_errors_count_samples_at_rest_so(
    planar_2r: Robot, exact_motion: Callable[..., Motion], tmp_path: Path
) -> None:
    """Two logs, the torque of one late by 80 ms: each is counted with the delay that the fit took out of it."""
    known, first = paused(planar_2r, exact_motion, np.random.default_rng(0).uniform(-0.98, 0.98, (300, 2)))
    _, second = paused(planar_2r, exact_motion, np.random.default_rng(1).uniform(-0.98, 0.98, (300, 2)))
    late = np.roll(np.asarray(second.torque), 8, axis=0)
    logs = [first, replace(second, torque=late)]
    model, how = known.model, replace(GIVEN, delay_s=None, trim_s=0.2)
    full = core_identified(model, logs, "wls", how).train
    estimate = dynident.identify(model, logs, "wls", how, record=dynident.Record(checks=False))
    found = estimate.train
    assert estimate.choices.delays is not None
    assert [one.applied for one in estimate.choices.delays] == pytest.approx([0.0, 0.08], abs=2e-3)
    assert full.rests and full.held is None and found.held is not None and found.moving == full.moving
    np.testing.assert_array_equal(found.predicted, full.predicted)
    assert found.total_relative_error < 0.3 * full.total_relative_error
    assert [each["name"] for each in found.at_rest] == list(planar_2r.joint_names)
    assert rest_words(found).endswith("static friction cannot hold") and rest_words(full).endswith("in full")
    assert of_training(full, found) == f"; the training error {rest_words(full)}" and not of_training(found, found)
    write_estimate(estimate, tmp_path / "own.json")
    again = read_estimate(tmp_path / "own.json").train
    assert again.at_rest == found.at_rest and again.held is not None
    np.testing.assert_allclose(again.held, found.held, rtol=1e-6)
    assert again.total_relative_error == found.total_relative_error
    moving = [log.rows(slice(0, 280), log.name) for log in logs]
    assert dynident.identify(model, moving, "wls", how, record=dynident.Record(checks=False)).train.held is None


def test_what_static_friction_holds_explains_nothing(planar_2r: Robot, exact_motion: Callable[..., Motion]) -> None:
    estimate, log = paused(planar_2r, exact_motion, np.zeros((300, 2)))
    train = core_validated(estimate, [log])
    measured = train.measured
    wrong = replace(train, predicted=np.zeros_like(measured) + measured.mean(axis=0))
    held = replace(wrong, held=(measured - 1.0, measured + 1.0), joints=train.joints)
    names = [[one.name for one in causes_against(replace(estimate, train=each))] for each in (train, wrong, held)]
    assert names == [[], ["nothing explained"], ["nothing explained"]]


def test_a_prediction_at_rest_is_an_interval(planar_2r: Robot, exact_motion: Callable[..., Motion]) -> None:
    estimate, log = paused(planar_2r, exact_motion, np.random.default_rng(0).uniform(-0.98, 0.98, (300, 2)))
    found = predict_torque(estimate, log)
    rest = found.prepared.kept.time > 3.2
    assert np.all(found.half_held[rest] == pytest.approx(3.0, rel=1e-3)) and np.all(found.half_held[:250] == 0.0)
    assert np.all(np.abs(found.measured - found.torque)[rest] <= found.half_model[rest])  # type: ignore[operator]
    assert np.mean(np.abs(found.measured - found.torque)[rest] > 0.5) > 0.5  # type: ignore[operator]
    moving = predict_torque(estimate, log.rows(slice(0, 280), "the motion"))
    np.testing.assert_array_equal(moving.half_held, 0.0)


def test_a_slow_reversal_carries_the_state_as_the_model_does(planar_2r: Robot) -> None:
    model = DynamicModel(planar_2r, (Presliding(length=0.01),))
    assert planar_2r.nominal is not None
    theta = np.concatenate([planar_2r.nominal, np.full(planar_2r.dof, 2.0)])
    time = np.arange(600) / 100.0
    q, dq, ddq = (
        np.tile(one[:, None], (1, 2))
        for one in (0.03 * np.sin(0.6 * time), 0.018 * np.cos(0.6 * time), -0.0108 * np.sin(0.6 * time))
    )
    motion = model.with_states(Motion(q, dq, ddq), 0.01)
    torque = model.torque(motion, theta)
    estimate = replace(bare_estimate(model, theta), preprocessing=GIVEN)
    found = predict_torque(estimate, Log(planar_2r.joint_names, time, q, dq, ddq, torque))
    assert np.all(found.half_held > 0)  # slower than standstill throughout
    assert found.measured is not None
    np.testing.assert_allclose(found.torque, found.measured, atol=1e-9)
