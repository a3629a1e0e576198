"""Friction of drives that warm up by their own losses: its state in closed form, and whether logs decide rightly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from dynident import validate as validated
from dynident.applications.monitor.signals import signals_of
from dynident.applications.predicted_torque import predict_torque
from dynident.applications.standstill import held_torque
from dynident.applications.start_states import warmed_torque, with_warm_starts
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, preprocess
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.split import Split
from dynident.diagnosis.warnings import warnings_of
from dynident.errors import BadOption, LogMismatch
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.identify import identify
from dynident.identification.problem.regressor_stream import remembered_motion
from dynident.identification.selection.friction.variable_projection import spans_of
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction, Motion
from dynident.model.friction.base import Range
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.presliding import Presliding
from dynident.model.friction.viscous import Viscous
from dynident.model.friction.warm_up import WarmUp
from dynident.model.robot import Robot

RATE = 20.0
HOW = Preprocessing(AsGiven(), rest="keep")
MakeMotion = Callable[..., Motion]

#: What a draft asks of a long log, and what a robot may be like: friction falls by a third as it warms up.
DRAFT = (Coulomb(0.02), Viscous(), WarmUp(choose=("part", "time_constant")))
TRUTH, VALUES = (Coulomb(0.02), Viscous(), WarmUp(150.0)), [2.0, 1.0, -0.5, -0.2, 1.5, 0.8, -0.4, -0.15]


def logged(robot: Robot, motion: MakeMotion, parts: tuple[Friction, ...], seconds: float, seed: int = 1) -> Log:
    """Return a log with noise of 2 % of the torque."""
    assert robot.nominal is not None
    model, time = DynamicModel(robot, parts), np.arange(int(seconds * RATE)) / RATE
    at = motion(2, time, 0.5, seed=seed)
    values = np.array(VALUES).reshape(2, 4)[:, : model.coefficients_per_joint].ravel()
    torque = model.torque(model.with_states(at, 1.0 / RATE), np.append(robot.nominal, values))
    noise = 0.02 * np.std(torque, axis=0) * np.random.default_rng(seed).normal(size=torque.shape)
    return Log(robot.joint_names, time, at.q, at.dq, at.ddq, torque=torque + noise)


def warm_up_of(found: Estimate) -> WarmUp | None:
    return next((part for part in found.model.friction if isinstance(part, WarmUp)), None)


def test_the_state_is_that_of_its_own_update_and_of_the_closed_form(exact_motion: MakeMotion) -> None:
    part, motion = WarmUp(0.5, crossover=0.7), exact_motion(3, np.arange(9000) / 50.0)  # two pieces of the sum
    np.testing.assert_allclose(part.states_along(motion, 0.02), Friction.states_along(part, motion, 0.02), rtol=1e-12)
    time = np.arange(200)[:, None] * 0.02
    steady = Motion(-0.4 * time, np.full_like(time, -0.4), np.zeros_like(time))
    # a step in its middle: off by (step / time constant)^2 / 24
    expected = (0.4 + 0.4**2 / 0.7) * -np.expm1(-time[:, 0] / 0.5)
    np.testing.assert_allclose(part.states_along(steady, 0.02)[:, 0, 0], expected, rtol=1e-4)


def test_the_logs_find_it(planar_2r: Robot, exact_motion: MakeMotion) -> None:
    found = identify(DynamicModel(planar_2r, DRAFT), [logged(planar_2r, exact_motion, TRUTH, 400.0)], "wls", HOW)
    part = warm_up_of(found)
    assert part is not None and part.time_constant == pytest.approx(150.0, rel=0.1)
    values = {p["name"]: p["value"] for p in found.parameters()}
    for name, value in (("Fc[joint1]", 2.0), ("FcW[joint1]", -0.5), ("Fc[joint2]", 1.5), ("FcW[joint2]", -0.4)):
        assert values[name] == pytest.approx(value, rel=0.1), name


def test_it_is_left_out_where_drives_do_not_warm_up(planar_2r: Robot, exact_motion: MakeMotion) -> None:
    log = logged(planar_2r, exact_motion, (Coulomb(0.02), Viscous()), 200.0)
    assert warm_up_of(identify(DynamicModel(planar_2r, DRAFT), [log], "wls", HOW)) is None


@pytest.fixture(scope="module")
def warm(planar_2r: Robot, exact_motion: MakeMotion) -> tuple[Estimate, Log, Log]:
    """Return an estimate by the first 270 s of a recording, that part, and the rest, which begins warm."""
    log = logged(planar_2r, exact_motion, TRUTH, 400.0)
    train, test = log.split(0.675)
    return identify(DynamicModel(planar_2r, TRUTH), [train], "wls", HOW), train, test


def test_what_follows_in_the_same_recording_goes_on_warm(warm: tuple[Estimate, Log, Log]) -> None:
    found, train, test = warm
    known = validated(found, test)
    assert train.before is None and isinstance(test.before, Log) and known.start_states == ()
    assert known.total_relative_error < 1.1 * found.train.total_relative_error
    first, rest = Split.parse("samples:3000:5400,0:2000").apply(train)
    whole, part = (remembered_motion(found.model, preprocess(log, HOW).log).state for log in (train, first))
    assert whole is not None and part is not None and rest.before is None
    np.testing.assert_allclose(part, whole[3000:], rtol=1e-9)


@pytest.mark.filterwarnings("ignore:.*used for training")
def test_a_log_of_its_own_begins_as_its_torques_say(warm: tuple[Estimate, Log, Log]) -> None:
    found, train, test = warm
    alone = replace(test, before=None)
    known = validated(found, alone)
    assert known.total_relative_error < 1.1 * found.train.total_relative_error
    true = remembered_motion(found.model, preprocess(test, HOW).log).state
    assert true is not None
    values = [each["value"] for each in known.start_states]
    np.testing.assert_allclose(values, true[0, :, 0], rtol=0.05)
    assert [each["joint"] for each in known.start_states] == ["joint1", "joint2"]
    (said,) = [each for each in warnings_of(found, known) if "warm the drives were" in each]
    assert "warm_up found from its torques (joint1" in said and "reduces the squared error by 9" in said
    cold = validated(found, replace(train, before=None))
    assert all(each["value"] == 0.0 for each in cold.start_states)
    assert any("warm_up taken to begin cold" in each for each in warnings_of(found, cold))
    told = predict_torque(found, alone)
    assert np.sqrt(np.mean((told.torque - np.asarray(told.measured)) ** 2)) < 0.05 * np.std(np.asarray(told.measured))
    assert float(warmed_torque(found, preprocess(replace(train, torque=None), HOW)).min()) > 0.1


def test_training_logs_that_begin_warm_are_named(warm: tuple[Estimate, Log, Log]) -> None:
    found, train, test = warm
    alone = replace(test, before=None, source=replace(test.source, path="second.csv"))
    told = with_warm_starts(found, [train, alone])
    assert {each["log"] for each in told.train.start_states} == {"second.csv"}
    (said,) = [each for each in warnings_of(told) if each.startswith("training log second.csv")]
    assert "give logs that follow each other as one" in said
    assert with_warm_starts(found, [train]) is found
    colder = replace(train, torque=np.asarray(train.torque) * 1.2)  # no drive is colder than cold
    assert all(each["value"] >= 0.0 for each in validated(found, colder).start_states)


def test_a_monitor_begins_as_the_torques_of_a_log_say(warm: tuple[Estimate, Log, Log]) -> None:
    found, train, test = warm
    alone = signals_of(found, replace(test, before=None))
    assert alone.first is not None and (alone.first > 0.1).all()
    np.testing.assert_allclose(alone.first, np.asarray(signals_of(found, test).first), rtol=0.05)
    first = signals_of(found, train).first
    assert first is None or not first.any()


@pytest.mark.battery
def test_it_is_left_out_in_95_of_100_and_found_in_all(planar_2r: Robot, exact_motion: MakeMotion) -> None:
    model, false, far = DynamicModel(planar_2r, DRAFT), 0, 0
    for seed in range(100):
        none = logged(planar_2r, exact_motion, (Coulomb(0.02), Viscous()), 200.0, seed)
        false += warm_up_of(identify(model, [none], "wls", HOW)) is not None
        part = warm_up_of(identify(model, [logged(planar_2r, exact_motion, TRUTH, 400.0, seed)], "wls", HOW))
        far += part is None or abs(part.time_constant / 150.0 - 1.0) > 0.1
    assert false <= 5 and far <= 5


def test_logs_too_short_for_it_do_not_try_it_and_refuse_it_where_it_is_stated(
    planar_2r: Robot, exact_motion: MakeMotion
) -> None:
    log = logged(planar_2r, exact_motion, TRUTH, 100.0)
    short = identify(DynamicModel(planar_2r, DRAFT), [log], "wls", HOW)
    assert warm_up_of(short) is None
    (told,) = [each for each in short.choices.chosen_fields or () if each.part == "warm_up"]
    assert told.value == 0 and told.not_tried == "logs of 100 s: log 120 s or more from a cold start"
    with pytest.raises(LogMismatch, match=r"time_constant 3000 s is longer than the longest log, 100 s; log at least"):
        identify(DynamicModel(planar_2r, (*DRAFT[:2], WarmUp(3000.0))), [log], "wls", HOW)
    with pytest.raises(BadOption, match="looked for from 60 s on, in logs of at least twice that; this is 100 s"):
        identify(DynamicModel(planar_2r, (*DRAFT[:2], WarmUp(vary=("time_constant",)))), [log], "wls", HOW)


@pytest.mark.parametrize(("seconds", "is_told"), [(90.0, False), (1500.0, True)])
def test_a_start_longer_than_the_log_is_named_where_the_log_finds_nothing_shorter(
    planar_2r: Robot, exact_motion: MakeMotion, seconds: float, is_told: bool
) -> None:
    log = logged(planar_2r, exact_motion, (Coulomb(0.02), Viscous(), WarmUp(seconds)), 200.0)
    found = identify(DynamicModel(planar_2r, DRAFT), [log], "wls", HOW)
    part = warm_up_of(found)
    assert part is not None and (part.time_constant > 195.0) == is_told
    told = [one for one in warnings_of(found) if "time_constant 300 s is longer than the longest log, 200 s" in one]
    assert bool(told) == is_told and all("log longer from a cold start to identify it" in one for one in told)


def test_a_narrow_range_of_a_field_that_is_no_duration_is_looked_for() -> None:
    @dataclass(frozen=True)
    class Narrow(WarmUp):
        ranges: ClassVar = {"crossover": Range(1.0, 1.5)}

    assert spans_of(Narrow(vary=("crossover",)), "vary", 1.0, longest=10.0) == {"crossover": (1.0, 1.5)}


def test_at_rest_a_warm_drive_holds_what_its_friction_is_then(planar_2r: Robot, exact_motion: MakeMotion) -> None:
    assert planar_2r.nominal is not None
    model = DynamicModel(planar_2r, (Coulomb(0.02), WarmUp(150.0), Presliding(0.01)))
    motion = exact_motion(2, np.arange(50) / RATE)
    warm = np.stack([np.full(motion.q.shape, 0.8), np.zeros(motion.q.shape)], axis=-1)
    still = Motion(motion.q, np.zeros_like(motion.q), np.zeros_like(motion.q), state=warm)
    theta = np.append(planar_2r.nominal, [2.0, -0.5, -0.2, 0.3, 1.5, -0.4, -0.15, 0.2])
    held = held_torque(model, theta, still, np.ones(still.q.shape, dtype=bool))
    expected = np.broadcast_to([2.0 - 0.8 * 0.5 + 0.3, 1.5 - 0.8 * 0.4 + 0.2], held.half.shape)
    np.testing.assert_allclose(held.half, expected, rtol=1e-6)
