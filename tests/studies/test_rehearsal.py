"""The rehearsal: possible truths, more time buys smaller deviations, and a verdict that follows the tolerance."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.errors import BadOption, NotConsistent
from dynident.excitation.trajectories.rest_fourier import RestFourier
from dynident.identification.estimators.wls import WLS
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.offset import Offset
from dynident.model.friction.viscous import Viscous
from dynident.model.inertia import Inertia
from dynident.robot_files import read_robot
from dynident.simulation.cell import Cell
from dynident.simulation.controllers import CONTROLLERS
from dynident.simulation.effects import Effort, Encoder, Payload, Recorder, Tilt
from dynident.studies.benchmark.possible_robots import described_truth, near, random_truth, told
from dynident.studies.selftest.rehearsal import Rehearsal, RehearsalPlan, Tolerance, rehearse
from dynident.studies.selftest.rehearsal_view import verdict


@pytest.fixture(scope="module")
def model() -> DynamicModel:
    return DynamicModel(read_robot("generic-scara"), (Coulomb(0.05), Viscous(), Offset()))


def bodies(model: DynamicModel, theta: np.ndarray) -> list[Inertia]:
    return [Inertia.from_vector(theta[k : k + 10]) for k in range(0, model.inertial_count, 10)]


@pytest.mark.parametrize("seed", range(5))
def test_random_robots_could_exist_with_and_without_a_description(model: DynamicModel, seed: int) -> None:
    blind = told(model, None)
    for each in (model, blind):
        theta = random_truth(each, seed)
        assert all(body.is_consistent() for body in bodies(each, theta))
        signs = [p.nonnegative for p in each.parameters[each.inertial_count :]]
        assert np.all(theta[each.inertial_count :][signs] > 0)
        assert np.array_equal(theta, random_truth(each, seed))
    assert not np.allclose(random_truth(model, seed), random_truth(model, seed + 1))


def test_invented_friction_of_low_speeds_is_as_strong_as_the_other() -> None:
    model = DynamicModel(read_robot("generic-6r"), ("coulomb", "viscous", "stribeck"))  # type: ignore[arg-type]
    theta = random_truth(model, 0)
    by_symbol = {
        symbol: [float(v) for p, v in zip(model.parameters, theta, strict=True) if p.symbol == symbol]
        for symbol in ("Fc", "Fs")
    }
    assert np.all(0 < np.array(by_symbol["Fs"])) and sum(by_symbol["Fs"]) < 2 * sum(by_symbol["Fc"])


def test_near_moves_masses_by_the_share_and_leaves_bodies_possible(model: DynamicModel) -> None:
    theta = described_truth(model)
    drawn = np.array([near(model, theta, seed, 0.15) for seed in range(400)])
    ratio = drawn[:, 9] / theta[9]
    assert 0.12 < np.std(ratio) < 0.18
    assert np.array_equal(near(model, theta, 1, 0.0), theta) or np.allclose(near(model, theta, 1, 0.0), theta)
    with pytest.raises(BadOption, match="share"):
        near(model, theta, 0, 1.0)


def test_what_is_told_is_the_guess_and_nothing_of_the_truth(model: DynamicModel) -> None:
    assert told(model, None).nominal() is None
    theta = random_truth(model, 3)
    guess = told(model, theta).nominal()
    assert guess is not None
    symbols = np.array([p.symbol for p in model.parameters])
    same = symbols != "F0"  # a description has no word for an offset
    assert np.allclose(guess[same], theta[same])


def test_an_impossible_description_is_no_truth(model: DynamicModel) -> None:
    link = model.robot.links[0]
    flat = Inertia(1.0, np.array([1.0, 0, 0]), 1e-3 * np.eye(3))
    robot = replace(model.robot, links=(replace(link, inertia=flat), *model.robot.links[1:]))
    with pytest.raises(NotConsistent, match="--truth random"):
        described_truth(replace(model, robot=robot))
    with pytest.raises(NotConsistent, match="states no inertias"):
        described_truth(told(model, None))


@pytest.fixture(scope="module")
def plan(model: DynamicModel) -> RehearsalPlan:
    generator = np.random.default_rng(4)
    free = RestFourier.free_map(4)
    rows = []
    for joint in model.robot.active:
        middle = 0.5 * (joint.limits.lower + joint.limits.upper)
        reach = 0.2 * (joint.limits.upper - joint.limits.lower)
        rows.append(free @ np.r_[middle, reach * generator.uniform(-0.4, 0.4, free.shape[1] - 1)])
    core = RestFourier.from_table(rows, 6.0)
    how = Preprocessing(Butterworth(20.0), rate_hz=160.0, trim_s=0.3, standstill=0.02)
    cell = Cell(encoder=Encoder(noise=(2e-6,)), effort=Effort(noise=(0.5,)), recorder=Recorder(rate=500.0), lead_in=0.0)
    return RehearsalPlan(core, 0.0, 1, cell, how, seed=4)


def test_longer_logs_know_more_and_the_verdict_follows_the_tolerance(model: DynamicModel, plan: RehearsalPlan) -> None:
    theta = described_truth(model)
    found = rehearse(model, theta, plan, WLS(), Tolerance(0.05))
    assert [stage.share for stage in found.stages] == [0.5, 1.0, 2.0, 4.0]
    deviations = [float(np.median(stage.relative_std)) for stage in found.stages[1:]]
    assert 0.4 < deviations[2] / deviations[0] < 0.65  # about 1 / 2 for four times the log
    assert found.passed and found.enough is not None
    assert min(stage.inside for stage in found.stages) > 0.8  # no shift between torque and motion takes them away
    worst = float(np.max(found.planned.torque_errors))
    strict = replace(found, tolerance=Tolerance(0.99 * worst))
    assert not strict.passed and any("torque of" in text for text in strict.complaints(strict.planned))
    asked = replace(found, tolerance=Tolerance(0.05, 1e-6))
    counting = int(np.sum(found.weights >= 0.01))
    assert len(asked.complaints(asked.planned)) == counting
    assert found.figures()["passed"] is True
    assert not any("intervals" in line for line in verdict(found))
    last = found.stages[-1]
    assert last.estimate is not None
    away = replace(last, truth=last.truth + 3 * last.estimate.std * (np.arange(len(last.truth)) < 6))
    said = verdict(replace(found, stages=(*found.stages[:-1], away)))
    assert any("intervals hold the truth" in line for line in said)  # 6 misses of 20 are no chance


def test_a_log_that_tells_nothing_fails_with_its_reason(model: DynamicModel, plan: RehearsalPlan) -> None:
    still = RestFourier.from_table([np.r_[row[0], 0 * row[1:]] for row in plan.core.table], 6.0)
    found = rehearse(model, described_truth(model), replace(plan, core=still), WLS(), Tolerance(), shares=(1.0,))
    assert not found.passed and found.planned.failure and found.enough is None
    with pytest.raises(BadOption, match="repeats"):
        rehearse(model, described_truth(model), replace(plan, repeats=0), WLS(), Tolerance())
    with pytest.raises(BadOption, match="tolerance"):
        Tolerance(0.0)


@pytest.mark.battery
def test_a_joint_that_sticks_is_named_with_what_helps(model: DynamicModel, plan: RehearsalPlan) -> None:
    theta, last = described_truth(model), model.robot.joint_names[-1]
    sticks = [p.symbol == "Fc" and p.owner == last for p in model.parameters]
    theta = np.where(sticks, 0.7 * model.robot.active[-1].limits.effort, theta)

    def rehearsed(**options: Any) -> Rehearsal:
        cell = replace(plan.cell, controller=CONTROLLERS.make("pd", options))
        return rehearse(model, theta, replace(plan, cell=cell), WLS(), Tolerance(), shares=(1.0,))

    found = rehearsed(bandwidth_hz=8.0)
    assert list(found.left_behind) == [last]
    (said,) = [line for line in verdict(found) if "not on the commanded motion" in line]
    assert last in said and "controller.feedforward=model" in said
    assert not rehearsed(bandwidth_hz=8.0, feedforward="model").left_behind
    assert not rehearsed().left_behind


def test_payload_and_tilt_of_the_cell_are_part_of_the_truth(model: DynamicModel, plan: RehearsalPlan) -> None:
    theta = described_truth(model)
    cell = replace(plan.cell, payload=Payload(mass=1.5, centre=(0.05, 0.0, 0.1)), tilt=Tilt(roll=0.1))
    found = rehearse(model, theta, replace(plan, cell=cell), WLS(), Tolerance(0.05), shares=(1.0,))
    bare = rehearse(model, theta, plan, WLS(), Tolerance(0.05), shares=(1.0,))
    mass = next(k for k, name in enumerate(found.names) if name.startswith("m["))
    assert found.planned.truth[mass] - bare.planned.truth[mass] == pytest.approx(1.5)
    assert abs(found.planned.errors[mass]) < 0.1 and bare.passed
    assert found.planned.torque_errors[0] > 3 * bare.planned.torque_errors[0]  # of gravity that the model does not have
