"""identify and validate: what an estimate holds, honest deviations, and the requests that are refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dynident.arrays import Array
from dynident.data.log import Log, Source
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.errors import LogMismatch, UnknownChoice
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.estimators.ols import OLS
from dynident.identification.estimators.wls import WLS
from dynident.identification.fit import fit
from dynident.identification.identify import identify
from dynident.identification.problem.regressor_stream import motion_of
from dynident.identification.residuals.covariance import correlation_factors
from dynident.identification.validate import validate, with_nominal
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.robot import Robot

GIVEN = Preprocessing(AsGiven(), rest="keep")
NOISE = np.array([1.0, 0.2])

MakeLog = Callable[..., Log]


@pytest.fixture(scope="module")
def model(planar_2r: Robot) -> DynamicModel:
    return DynamicModel(planar_2r, tuple(FRICTION.make(name) for name in ("coulomb", "viscous", "offset")))


@pytest.fixture(scope="module")
def theta(model: DynamicModel) -> Array:
    assert model.robot.nominal is not None
    return np.append(model.robot.nominal, np.linspace(0.5, 1.0, 6))


@pytest.fixture(scope="module")
def log(model: DynamicModel, theta: Array, exact_log: MakeLog) -> Log:
    return exact_log(model, theta, noise=NOISE)


def test_an_estimate_is_whole(model: DynamicModel, log: Log) -> None:
    steps: list[str] = []
    estimate = identify(model, [log], "wls", GIVEN, progress=steps.append)
    assert estimate.model is model and estimate.base.count == len(estimate.beta) == 12
    assert estimate.covariance.shape == (12, 12) and estimate.theta is None
    np.testing.assert_array_equal(estimate.covariance, estimate.covariance.T)
    assert np.linalg.eigvalsh(estimate.covariance)[0] > 0
    assert (estimate.estimator, estimate.options) == ("wls", {"iterations": 10, "tolerance": 1e-3})
    assert (estimate.samples, estimate.inertial_base_parameters) == (400, 6)
    assert estimate.columns.joints == model.robot.joint_names and estimate.preprocessing is GIVEN
    assert estimate.provenance["versions"]["numpy"] == np.__version__
    (kept,) = estimate.provenance["logs"]
    assert kept["steps"][0] == "signals as given" and kept["steps"][1].startswith("400 of 400 samples kept")
    assert estimate.run.seconds >= 0 and estimate.run.iterations >= 1
    assert steps == ["preprocessing", "base parameters and reduction", "estimator wls"]
    np.testing.assert_allclose(estimate.joint_deviations, NOISE, rtol=0.15)


def test_correlations_of_a_log_end_with_it(model: DynamicModel, log: Log) -> None:
    parts = [log.rows(slice(0, 150), "a"), log.rows(slice(150, 250), "b"), log.rows(slice(250, None), "c")]
    estimate = identify(model, parts, "wls", GIVEN)
    beta = estimate.base.to_standard(estimate.beta)
    residuals = [one.torque - model.torque(motion_of(one), beta) for one in parts if one.torque is not None]
    np.testing.assert_allclose(estimate.correlation_factors, correlation_factors(residuals), rtol=1e-9)


def test_condition_number_is_of_the_weighted_matrix_with_unit_columns(model: DynamicModel, log: Log) -> None:
    problem = build_problem(model, [log], GIVEN)
    estimate = fit(problem, WLS())
    rows = problem.rows
    matrix = rows.matrix / estimate.joint_deviations[rows.joint][:, None]
    singular = np.linalg.svd(matrix / np.linalg.norm(matrix, axis=0), compute_uv=False)
    assert estimate.condition_number == pytest.approx(singular[0] / singular[-1])


def test_parameters_as_plain_data(model: DynamicModel, log: Log) -> None:
    estimate = identify(model, [log], "wls", GIVEN)
    first = estimate.parameters()[0]
    assert first["name"] == "Izz[link1] + 0.25 m[link2]" and first["unit"] == "kg m^2"
    assert first["value"] == estimate.beta[0] and first["std"] == estimate.std[0]
    assert first["relative_std"] == pytest.approx(estimate.std[0] / abs(estimate.beta[0]))
    zero = replace(estimate, beta=np.zeros(12))
    assert zero.parameters()[0]["relative_std"] is None


@pytest.mark.parametrize("name", ["ols", "wls", "consistent"])
def test_a_name_and_the_part_it_stands_for_do_the_same(model: DynamicModel, log: Log, name: str) -> None:
    part = {"ols": OLS(), "wls": WLS(), "consistent": Consistent()}[name]
    by_name, by_part = identify(model, [log], name, GIVEN), identify(model, [log], part, GIVEN)
    np.testing.assert_array_equal(by_name.beta, by_part.beta)
    assert by_name.estimator == by_part.estimator == name


def test_default_is_the_consistent_estimator(model: DynamicModel, log: Log) -> None:
    estimate = identify(model, [log], preprocessing=GIVEN)
    assert estimate.estimator == "consistent" and estimate.theta is not None
    assert estimate.consistency.consistent


def test_what_is_asked_for_must_be_there(model: DynamicModel, log: Log) -> None:
    with pytest.raises(UnknownChoice, match=r"no estimator called 'wsl'.*did you mean 'wls'"):
        identify(model, [log], "wsl", GIVEN)
    with pytest.raises(LogMismatch, match="identify: no log; give at least one log"):
        identify(model, [], "wls", GIVEN)
    with pytest.raises(LogMismatch, match="no joint called 'joint2'; the log has joint1, elbow"):
        identify(model, [replace(log, joints=("joint1", "elbow"))], "wls", GIVEN)


def test_columns_are_matched_by_name_not_by_place(model: DynamicModel, log: Log) -> None:
    swapped = log.ordered(("joint2", "joint1"))
    np.testing.assert_array_equal(
        identify(model, [swapped], "wls", GIVEN).beta, identify(model, [log], "wls", GIVEN).beta
    )


def test_figures_of_the_fit_and_of_a_new_log(model: DynamicModel, theta: Array, log: Log, exact_log: MakeLog) -> None:
    estimate = identify(model, [log], "wls", GIVEN)
    other = exact_log(model, theta, noise=NOISE, seed=5, size=0.7)
    test = validate(estimate, [other])
    assert test.samples == 400 and test.logs == ("simulated log",)
    for joint, deviation in zip(test.joints, NOISE, strict=True):
        assert joint.rmse == pytest.approx(deviation, rel=0.15) and joint.correlation > 0.9
    error = np.asarray(other.torque) - test.predicted
    assert test.total_relative_error == pytest.approx(np.linalg.norm(error) / np.linalg.norm(other.torque))  # type: ignore[arg-type]
    truth = estimate.base.from_standard(theta)
    perfect = validate(replace(estimate, beta=truth), [replace(other, torque=model.torque(motion_of(other), theta))])
    assert perfect.total_relative_error < 1e-12


def test_a_log_without_torques_cannot_be_compared(model: DynamicModel, log: Log) -> None:
    estimate = identify(model, [log], "wls", GIVEN)
    with pytest.raises(LogMismatch, match="no torques to compare with; map torque columns in the case file"):
        validate(estimate, [replace(log, torque=None)])


def test_validation_can_be_prepared_otherwise(model: DynamicModel, log: Log) -> None:
    estimate = identify(model, [log], "wls", GIVEN)
    smooth = validate(estimate, [log], Preprocessing(Butterworth(cutoff_hz=3.0), trim_s=0.5))
    assert smooth.filter["kind"] == "butterworth" and smooth.filter["trim_s"] == 0.5
    assert smooth.joints[0].rmse < 0.6 * validate(estimate, [log]).joints[0].rmse


def test_several_logs_are_one_data_set(model: DynamicModel, theta: Array, exact_log: MakeLog) -> None:
    logs = [exact_log(model, theta, noise=NOISE, seed=k, size=s) for k, s in ((0, 1.0), (1, 0.7), (2, 0.5))]
    estimate = identify(model, logs, "wls", GIVEN)
    alone = identify(model, logs[:1], "wls", GIVEN)
    assert estimate.samples == 1200 and len(estimate.provenance["logs"]) == 3
    assert estimate.train.starts == (0, 400, 800)
    assert np.all(estimate.std < alone.std)


def test_provenance_names_the_files(model: DynamicModel, log: Log) -> None:
    source = Source("run.csv", "abc", 400, ("read",))
    estimate = identify(model, [replace(log, source=source)], "wls", GIVEN)
    kept = estimate.provenance["logs"][0]
    assert (kept["path"], kept["sha256"], kept["rows"], kept["steps"][0]) == ("run.csv", "abc", 400, "read")


def test_deviations_of_ols_know_that_noise_differs(model: DynamicModel, theta: Array, exact_log: MakeLog) -> None:
    """Joint 1 is far noisier: least squares without weights is worse, and says so."""
    truth = base_parameters(model).from_standard(theta)
    scores, sizes = [], []
    for seed in range(25):
        problem = build_problem(model, [exact_log(model, theta, noise=np.array([3.0, 0.3]), seed=300 + seed)], GIVEN)
        pair = [fit(problem, part) for part in (OLS(), WLS())]
        scores.append([(e.beta - truth) / e.std for e in pair])
        sizes.append([e.std for e in pair])
    ols, wls = np.mean(sizes, axis=0)
    assert np.all(ols > 0.98 * wls) and np.any(ols > 1.5 * wls)
    inside = np.mean(np.abs(np.array(scores)) < stats.norm.ppf(0.975), axis=(0, 2))
    assert np.all(inside > 0.92)


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.9])
def test_correlation_factor_of_a_first_order_process(memory: float) -> None:
    """Integrated autocorrelation of an AR(1) process in closed form: (1 + rho) / (1 - rho)."""
    generator = np.random.default_rng(0)
    white = generator.normal(size=(200_000, 1))
    series = np.zeros_like(white)
    for k in range(1, len(white)):
        series[k] = memory * series[k - 1] + white[k]
    found = correlation_factors([series])
    assert found.shape == (1,)
    assert found[0] == pytest.approx((1 + memory) / (1 - memory), rel=0.1)


def test_correlation_factors_are_weighted_by_rows_and_at_least_one() -> None:
    alternating = np.tile([[1.0], [-1.0]], (50, 1))
    assert correlation_factors([alternating])[0] == 1.0
    assert correlation_factors([np.zeros((20, 2))]).tolist() == [1.0, 1.0]
    slow = np.repeat(np.random.default_rng(0).normal(size=(40, 1)), 10, axis=0)
    alone = correlation_factors([slow])[0]
    mixed = correlation_factors([slow, alternating])[0]
    assert mixed == pytest.approx((400 * alone + 100 * 1.0) / 500)


def test_rows_that_do_not_count_have_no_say_in_the_correlation() -> None:
    generator = np.random.default_rng(0)
    residual = generator.normal(size=(4000, 2))
    residual[1000:3000, 1] = 50.0  # at rest: a constant error that the fit has not seen
    mask = np.ones((4000, 2), bool)
    mask[1000:3000, 1] = False
    assert correlation_factors([residual])[1] > 100
    np.testing.assert_allclose(correlation_factors([residual], [mask]), 1.0, atol=0.6)
    assert correlation_factors([residual], [np.zeros_like(mask)]).tolist() == [1.0, 1.0]


@pytest.mark.parametrize("parts", [("coulomb", "viscous"), ("offset",), ("coulomb",)])
def test_friction_beside_the_nominal_inertias_brakes_as_that_of_the_estimate_does(
    parts: tuple[str, ...], planar_2r: Robot, exact_log: MakeLog
) -> None:
    assert planar_2r.nominal is not None
    truth = DynamicModel(planar_2r, (FRICTION.make("coulomb"), FRICTION.make("viscous"), FRICTION.make("offset")))
    log = exact_log(truth, np.append(planar_2r.nominal, [2.0, -0.5, 0.3, 1.0, 0.4, 0.2]), noise=0.05)
    problem = build_problem(DynamicModel(planar_2r, tuple(FRICTION.make(name) for name in parts)), [log], GIVEN)
    found = with_nominal(fit(problem, Consistent()), problem)
    nominal = found.train.nominal
    assert nominal is not None
    if parts == ("coulomb", "viscous"):
        assert nominal.friction["Fv[joint1]"] == 0.0 and nominal.friction["Fv[joint2]"] > 0.2
    assert min((v for name, v in nominal.friction.items() if name[:2] in ("Fc", "Fv")), default=0.0) >= 0.0
    assert nominal.friction_fitted > 0.98 * found.train.total_relative_error


def test_a_stated_rotor_beside_the_nominal_inertias_is_taken_off_at_most_whole(
    planar_2r: Robot, exact_log: MakeLog
) -> None:
    """Where the nominal inertias are too large by more than the stated rotor, it is gone, and not left as stated."""
    assert planar_2r.nominal is not None
    truth = DynamicModel(planar_2r, (FRICTION.make("viscous"),))
    log = exact_log(truth, np.append(planar_2r.nominal * 0.5, [0.3, 0.2]), noise=0.01)
    joints = [replace(own, drive=replace(own.drive, rotor_inertia=0.01)) for own in planar_2r.joints]
    model = DynamicModel(
        replace(planar_2r, joints=tuple(joints)), tuple(map(FRICTION.make, ("viscous", "rotor_inertia")))
    )
    problem = build_problem(model, [log], GIVEN)
    nominal = with_nominal(fit(problem, Consistent()), problem).train.nominal
    assert nominal is not None
    assert [nominal.friction[f"Ia[joint{k}]"] for k in (1, 2)] == [-0.01, -0.01]
