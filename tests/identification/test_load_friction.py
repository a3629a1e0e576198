"""Friction that depends on the load: a fixed point that predicts with its own torque, kept in files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynident.applications.predicted_torque import torque_deviations
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, preprocess
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.errors import BadOption, LogMismatch
from dynident.identification.build_problem import PriorKnowledge, build_problem
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.estimators.de import DifferentialEvolution
from dynident.identification.estimators.essential import restricted
from dynident.identification.estimators.rls import RLS
from dynident.identification.estimators.wls import WLS
from dynident.identification.files.estimate_file import read_estimate, write_estimate
from dynident.identification.fit import fit
from dynident.identification.identify import identify
from dynident.identification.problem.estimator import Solution
from dynident.identification.problem.prior import BodyPrior
from dynident.identification.problem.problem import Problem, make_problem
from dynident.identification.problem.regressor_stream import RegressorStream, motion_of
from dynident.identification.residuals.row_passes import RowPasses
from dynident.identification.search.box_search import BoxSearch
from dynident.identification.selection.friction.load import agrees, with_load, without_load
from dynident.identification.uncertainty.propagation import mass_matrix
from dynident.identification.validate import validate
from dynident.model.base_parameters import base_parameters
from dynident.model.body_constraints import Constraints, ValueRange
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.load import Load
from dynident.model.friction.load_directional import LoadDirectional
from dynident.model.friction.load_stribeck import LoadStribeck
from dynident.model.friction.offset import Offset
from dynident.model.friction.rotor_inertia import RotorInertia
from dynident.model.friction.temperature import Temperature
from dynident.model.friction.viscous import Viscous
from dynident.model.robot import Robot

GIVEN = Preprocessing(AsGiven(), rest="keep")
PARTS = (Coulomb(0.1), Viscous(), RotorInertia(), Load(0.1))

MakeLog = Callable[..., Log]


def truth(model: DynamicModel) -> np.ndarray:
    assert model.robot.nominal is not None
    table = np.tile([0.5, 0.3, 0.05, 0.12], (model.robot.dof, 1))
    return np.append(model.robot.nominal, table.ravel())


@pytest.fixture(params=["spatial_3r", "coupled_arm"])
def model(request: pytest.FixtureRequest) -> DynamicModel:
    return DynamicModel(request.getfixturevalue(request.param), PARTS)


@pytest.mark.parametrize("estimator", ["wls", "consistent"])
def test_exact_data_give_the_truth(model: DynamicModel, exact_log: MakeLog, estimator: str) -> None:
    theta = truth(model)
    estimate = identify(model, [exact_log(model, theta)], estimator, GIVEN)
    expected = estimate.base.from_standard(theta)
    np.testing.assert_allclose(estimate.beta, expected, atol=2e-3 * float(np.abs(expected).max()))
    assert estimate.train.total_relative_error < 1e-4
    names = [p.name for p in model.parameters]
    loss = estimate.base.to_standard(estimate.beta)[names.index("Fl[joint2]")]
    assert loss == pytest.approx(0.12, abs=1e-3)


def test_a_search_is_made_once_with_the_load_of_weighted_least_squares(
    model: DynamicModel, exact_log: MakeLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its own answer, far off after a few iterations, would give a load that no pass agrees with."""
    given = list[Problem]()
    solve = BoxSearch.solve

    def seen(self: BoxSearch, problem: Problem) -> Solution:
        given.append(problem)
        return solve(self, problem)

    monkeypatch.setattr(BoxSearch, "solve", seen)
    log = exact_log(model, truth(model))
    found = identify(model, [log], DifferentialEvolution(iterations=3), GIVEN)
    (problem,) = given
    assert agrees(problem, identify(model, [log], "wls", GIVEN).beta) and not agrees(problem, found.beta)


def test_base_and_standard_parameters_predict_the_same(model: DynamicModel, exact_log: MakeLog) -> None:
    """The load is a function of the base parameters, although joint 1 cannot tell rotor and link apart."""
    theta = truth(model)
    log = exact_log(model, theta, samples=50)
    base = base_parameters(model)
    found = RegressorStream(model, base).predict(log, base.from_standard(theta))
    assert log.torque is not None
    np.testing.assert_allclose(found, log.torque, atol=1e-9)
    other = base.to_standard(base.from_standard(theta))  # no possible bodies, but the same torque
    np.testing.assert_allclose(model.torque(motion_of(log), other), log.torque, atol=1e-9)


def test_the_fit_ends_where_its_load_is_its_own(spatial_3r: Robot, exact_log: MakeLog, tmp_path: Path) -> None:
    model = DynamicModel(spatial_3r, PARTS)
    log = exact_log(model, truth(model), noise=0.2, samples=600)
    how = Preprocessing(Butterworth(cutoff_hz=5.0), trim_s=0.3)
    problem = build_problem(model, [log], how)
    estimate = fit(problem, WLS())
    again = with_load(problem, estimate.beta)
    np.testing.assert_allclose(WLS().solve(again).beta, estimate.beta, atol=1e-3 * float(np.abs(estimate.beta).max()))
    assert agrees(again, estimate.beta) and not agrees(with_load(problem, 2.0 * estimate.beta), estimate.beta)
    write_estimate(estimate, tmp_path / "loaded.json")
    read = read_estimate(tmp_path / "loaded.json")
    assert read.model.friction == model.friction
    one, other = validate(estimate, [log]), validate(read, [log])
    np.testing.assert_array_equal(one.predicted, other.predicted)
    rows = again.rows  # what the estimator saw is what the estimate predicts
    spread = float(np.std(estimate.train.predicted))
    kept = again.masks[0]
    for i in range(3):
        own = rows.matrix[rows.joint == i] @ estimate.beta
        np.testing.assert_allclose(own, estimate.train.predicted[kept[:, i], i], atol=1e-3 * spread)


@pytest.mark.parametrize("how", [GIVEN, Preprocessing(Butterworth(cutoff_hz=5.0), rate_hz=50.0, trim_s=0.3)])
def test_rows_with_new_columns_of_the_load_are_rows_made_anew(
    model: DynamicModel, exact_log: MakeLog, how: Preprocessing
) -> None:
    log, base = exact_log(model, truth(model), samples=2500), base_parameters(model)
    raw = log if how is GIVEN else replace(log, dq=None, ddq=None)
    logs = [preprocess(raw.rows(part, "part"), how) for part in (slice(0, 1300), slice(1300, 2500))]
    simple = without_load(model)
    first = make_problem(simple, base_parameters(simple), logs)
    load = base.from_standard(truth(model))
    for before in (first, make_problem(model, base, logs, 2.0 * load)):
        assert before.kept is not None and before.kept.updated(RegressorStream(model, base, load)) is not None
        found, anew = make_problem(model, base, logs, load, before.kept), make_problem(model, base, logs, load)
        blocks = zip(RowPasses(found), RowPasses(replace(anew, kept=None)), strict=True)  # reducing leaves them alone
        for one, other in blocks:
            assert one.samples == other.samples
            for mine, its in zip(one.blocks, other.blocks, strict=True):
                np.testing.assert_allclose(mine, its, rtol=1e-12, atol=1e-12)
        for mine, its in zip(found.triangles, anew.triangles, strict=True):
            products = [np.asarray(each.factor).T @ each.factor for each in (mine, its)]
            np.testing.assert_allclose(*products, rtol=1e-9, atol=1e-9 * np.max(products[1]))


def test_load_on_one_joint_alone_is_identified(spatial_3r: Robot, exact_log: MakeLog) -> None:
    model = DynamicModel(spatial_3r, (*PARTS[:3], Load(0.1, joints=("joint2",))))
    assert spatial_3r.nominal is not None
    true = np.concatenate([spatial_3r.nominal, [0.5, 0.3, 0.05], [0.5, 0.3, 0.05, 0.12], [0.5, 0.3, 0.05]])
    log = replace(exact_log(model, true, samples=2500), dq=None, ddq=None)
    estimate = identify(model, [log], "wls", Preprocessing(Butterworth(cutoff_hz=20.0), trim_s=0.3))
    place = [estimate.base.parameters[k].symbol for k in estimate.base.independent].index("Fl")
    assert estimate.beta[place] == pytest.approx(0.12, rel=0.05)


def test_rows_are_made_anew_where_other_columns_differ(spatial_3r: Robot, exact_log: MakeLog) -> None:
    model = DynamicModel(spatial_3r, PARTS)
    base, log = base_parameters(model), preprocess(exact_log(model, truth(model), samples=300), GIVEN)
    load = base.from_standard(truth(model))
    before = make_problem(model, base, [log], load)
    wider = DynamicModel(spatial_3r, (Coulomb(0.3), *PARTS[1:]))
    assert before.kept is not None and before.kept.updated(RegressorStream(wider, base, load)) is None
    found, anew = (make_problem(wider, base, [log], load, kept) for kept in (before.kept, None))
    for mine, its in zip(found.triangles, anew.triangles, strict=True):
        np.testing.assert_array_equal(mine.factor, its.factor)


def test_what_is_known_about_bodies_holds_in_every_pass(spatial_3r: Robot, exact_log: MakeLog) -> None:
    """Each pass poses the problem anew; what was stated beforehand goes with it."""
    model = DynamicModel(spatial_3r, PARTS)
    theta = truth(model)
    known = Constraints(total_mass=ValueRange(20.0, 20.0))
    prior = BodyPrior(theta, tuple(p.name for p in model.parameters), "a drawing")
    problem = build_problem(model, [exact_log(model, theta, noise=0.2)], GIVEN, knowledge=PriorKnowledge(known, prior))
    assert problem.load is not None
    again = with_load(problem, 2.0 * problem.load)
    assert again.constraints == known and again.prior == problem.prior
    estimate = fit(problem, Consistent())
    assert estimate.theta is not None and estimate.run.prior == "a drawing"
    assert np.sum(estimate.theta[9:30:10]) == pytest.approx(20.0, abs=1e-5)


def test_recursive_least_squares_takes_loaded_rows(spatial_3r: Robot, exact_log: MakeLog) -> None:
    model = DynamicModel(spatial_3r, PARTS)
    problem = build_problem(model, [exact_log(model, truth(model), noise=0.2)], GIVEN)
    expected = WLS().solve(problem).beta
    np.testing.assert_allclose(RLS().solve(problem).beta, expected, rtol=2e-3, atol=1e-3 * np.abs(expected).max())


def test_fewer_parameters_leave_the_load_of_the_others(spatial_3r: Robot, exact_log: MakeLog) -> None:
    model = DynamicModel(spatial_3r, PARTS)
    problem = build_problem(model, [exact_log(model, truth(model), noise=0.2)], GIVEN)
    keep = np.arange(problem.base.count) != 2
    assert problem.load is not None
    unused = replace(problem, load=np.where(keep, problem.load, 0.0))
    np.testing.assert_allclose(restricted(unused, keep).rows.matrix, unused.rows.matrix[:, keep], atol=1e-9)


def test_covariances_that_follow_know_the_load(spatial_3r: Robot, exact_log: MakeLog) -> None:
    """The load is part of what is uncertain; the mass matrix has no friction."""
    model = DynamicModel(spatial_3r, PARTS)
    log = exact_log(model, truth(model), noise=0.5, samples=600)
    estimate = identify(model, [log], "wls", GIVEN)
    few, regressor = log.rows(slice(0, 60), "few"), RegressorStream(model, estimate.base)
    draws = np.random.default_rng(0).multivariate_normal(estimate.beta, estimate.covariance, 1000)
    torques = [regressor.predict(few, beta) for beta in draws]
    np.testing.assert_allclose(torque_deviations(estimate, preprocess(few, GIVEN)), np.std(torques, axis=0), rtol=0.1)
    plain = DynamicModel(spatial_3r, (*PARTS[:3], Offset()))  # as many coefficients, at the same places
    q = np.array([0.3, -0.8, 0.5])
    expected = mass_matrix(replace(estimate, model=plain), q)[1]
    np.testing.assert_allclose(mass_matrix(estimate, q)[1], expected, rtol=1e-9)


def test_a_problem_without_its_load_is_refused(spatial_3r: Robot, exact_log: MakeLog) -> None:
    model = DynamicModel(spatial_3r, PARTS)
    log = preprocess(exact_log(model, truth(model)), GIVEN)
    with pytest.raises(BadOption, match="rigid bodies"):
        make_problem(model, base_parameters(model), [log])


def test_coefficients_that_count_in_combination_alone_are_named(spatial_3r: Robot, exact_log: MakeLog) -> None:
    """Of one velocity and width the directional forms add up to the load-dependent Stribeck effect."""
    known = DynamicModel(spatial_3r, PARTS)
    log = exact_log(known, truth(known))
    for velocity in (0.1, 0.3):
        twice = (LoadStribeck(0.3, width=0.1), LoadDirectional(velocity, width=0.1))
        model = DynamicModel(spatial_3r, (*PARTS, *twice))
        if velocity != 0.3:
            build_problem(model, [log], GIVEN)
            continue
        with pytest.raises(BadOption, match=r"Fls\[joint1\] \+ Fl-\[joint1\].* leave a part of theirs out"):
            build_problem(model, [log], GIVEN)


def test_temperatures_must_be_in_the_log(planar_2r: Robot, exact_log: MakeLog) -> None:
    warm = DynamicModel(planar_2r, (Coulomb(0.1), Viscous(), Temperature(20.0, 0.1)))
    plain = DynamicModel(planar_2r, (Coulomb(0.1), Viscous()))
    assert planar_2r.nominal is not None
    log = exact_log(plain, np.append(planar_2r.nominal, [1.0, 0.5, 1.0, 0.5]))
    with pytest.raises(LogMismatch, match="no temperatures of the drives; map them in the case file"):
        identify(warm, [log], "wls", GIVEN)
    temperature = 20.0 + np.linspace(0, 30, log.samples)[:, None] * [1.0, 0.5]
    assert log.dq is not None and log.torque is not None
    cold = (temperature - 20.0) * (-0.01 * np.tanh(log.dq / 0.1) - 0.004 * log.dq)
    heated = replace(log, temperature=temperature, torque=log.torque + cold)
    estimate = identify(warm, [heated], "wls", GIVEN)
    found = dict(zip(estimate.base.names, estimate.beta, strict=True))
    assert found["FcT[joint2]"] == pytest.approx(-0.01, abs=1e-6)
    assert found["FvT[joint1]"] == pytest.approx(-0.004, abs=1e-6)


def test_every_part_that_ships_is_found_again(spatial_3r: Robot, exact_log: MakeLog) -> None:
    names = ("coulomb", "viscous", "stribeck", "polynomial", "degressive", "load")
    model = DynamicModel(spatial_3r, tuple(FRICTION.make(name) for name in names))
    count = len(model.parameters) - model.inertial_count
    assert spatial_3r.nominal is not None
    theta = np.append(spatial_3r.nominal, np.linspace(0.2, 0.5, count) * 0.3)
    estimate = identify(model, [exact_log(model, theta, samples=1500, rate=100.0)], "wls", GIVEN)
    assert estimate.train.total_relative_error < 1e-4
