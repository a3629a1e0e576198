"""The consistent estimator: closed forms, a full optimality certificate, scales, and the robots it must serve."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize

from arm_models import model_of, without_inertias
from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.errors import BadOption
from dynident.identification.build_problem import build_problem
from dynident.identification.consistency.consistent_fit import MARGIN, consistent_fit, scale_of
from dynident.identification.consistency.verdicts import broken_conditions
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.estimators.wls import WLS
from dynident.identification.fit import fit
from dynident.identification.problem.prior import natural_scale
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import PSEUDO_BASIS, Inertia
from dynident.model.joint import Drive, Joint
from dynident.model.reduction import Reduced
from dynident.model.robot import Link, Robot

ARMS = ("pendulum", "planar_2r", "planar_3r", "spatial_3r", "sliding_arm", "scara", "mimic_arm", "coupled_arm")
FREE = Consistent(bodies="free")
GIVEN = Preprocessing(AsGiven(), rest="keep")
PARTS = ("coulomb", "viscous", "offset", "rotor_inertia")

MakeLog = Callable[..., Log]
Scaled = Callable[..., Robot]


def theta_of(model: DynamicModel, mass: float = 1.0, length: float = 1.0) -> Array:
    """Return a possible truth: the inertias of the robot model, and friction in the same units."""
    assert model.robot.nominal is not None
    sizes = {"N m": mass * length**2, "N m s/rad": mass * length**2, "kg m^2": 0.02 * mass * length**2,
             "N": mass * length, "N s/m": mass * length, "kg": 0.02 * mass}  # fmt: skip
    return np.append(model.robot.nominal, [0.5 * sizes[p.unit] for p in model.parameters[model.inertial_count :]])


def vertical_slide() -> Robot:
    slide = Joint("joint1", "prismatic", -1, np.eye(3), np.zeros(3), np.array([0, 0, 1.0]))
    return Robot("lift", (Link("link1"),), (slide,))


@pytest.mark.parametrize("stated", [0.02, 0.3], ids=["too small", "too large"])
@pytest.mark.parametrize("bodies", ["free", "plausible"])
def test_a_rotor_is_found_beside_a_stated_inertia_of_any_size(
    stated: float, bodies: str, planar_2r: Robot, exact_log: MakeLog
) -> None:
    """What is identified is the rest: less than 0 where the robot model states too much, and no less than that."""
    rotors = np.array([0.1, 0.08])
    model = model_of(planar_2r, *PARTS)
    names = [parameter.name for parameter in model.parameters]
    places = [names.index(f"Ia[{joint}]") for joint in planar_2r.joint_names]
    theta = theta_of(model)
    theta[places] = rotors
    known = model_of(planar_2r.with_drives(dict.fromkeys(planar_2r.joint_names, Drive(1.0, stated))), *PARTS)
    estimate = fit(build_problem(known, [exact_log(model, theta)], GIVEN), Consistent(bodies=bodies))
    assert estimate.theta is not None and estimate.consistency.consistent, estimate.consistency.reasons
    found = np.asarray(estimate.theta)[places] + stated
    np.testing.assert_allclose(found[1], rotors[1], rtol=1e-2)  # the first one is seen with its link
    assert np.all(found >= -1e-9)
    assert broken_conditions(known, np.where(np.isin(np.arange(len(theta)), places), -stated - 0.01, estimate.theta))


@pytest.mark.parametrize("known", [True, False], ids=["description", "bare"])
@pytest.mark.parametrize("arm", ARMS)
def test_exact_data_give_the_truth(arm: str, known: bool, request: pytest.FixtureRequest, exact_log: MakeLog) -> None:
    robot = request.getfixturevalue(arm)
    model = model_of(robot, *PARTS)
    theta = theta_of(model)
    log = exact_log(model, theta)
    problem = build_problem(model if known else model_of(without_inertias(robot), *PARTS), [log], GIVEN)
    estimate = fit(problem, FREE)
    truth = problem.base.from_standard(theta)
    np.testing.assert_allclose(estimate.beta, truth, atol=1e-6 * np.abs(truth).max())
    assert estimate.consistency.consistent and estimate.theta is not None
    np.testing.assert_allclose(problem.base.from_standard(estimate.theta), estimate.beta, atol=1e-12)


@pytest.mark.parametrize("seed", [3, 8, 19, 41, 50, 52])
def test_exact_data_of_any_tree_give_the_truth(
    seed: int, random_tree: Callable[..., Robot], exact_log: MakeLog
) -> None:
    robot = random_tree(seed, 6)
    model = model_of(robot, "coulomb", "viscous", "offset")
    theta = theta_of(model)
    problem = build_problem(
        model_of(without_inertias(robot), "coulomb", "viscous", "offset"), [exact_log(model, theta)], GIVEN
    )
    truth = problem.base.from_standard(theta)
    np.testing.assert_allclose(FREE.solve(problem).beta, truth, atol=1e-6 * np.abs(truth).max())


@pytest.mark.parametrize("arm", ["planar_2r", "spatial_3r", "scara", "coupled_arm"])
def test_it_is_weighted_least_squares_where_that_is_possible(
    arm: str, request: pytest.FixtureRequest, exact_log: MakeLog
) -> None:
    model = model_of(request.getfixturevalue(arm), "coulomb", "viscous", "offset")
    theta = theta_of(model)
    size = np.std(np.asarray(exact_log(model, theta).torque), axis=0)
    problem = build_problem(model, [exact_log(model, theta, noise=0.003 * size)], GIVEN)
    free, consistent = fit(problem, WLS()), fit(problem, FREE)
    assert free.consistency.consistent
    moved = np.linalg.norm((consistent.beta - free.beta) / free.std)
    assert moved < 0.02
    assert consistent.run.residual_above_unconstrained < 1e-6
    assert consistent.run.prior == "the robot model's inertias"


def test_friction_alone_is_bounded_least_squares(exact_log: MakeLog) -> None:
    """One vertical slide: its mass and the coefficients are a bounded least-squares problem that SciPy solves too."""
    model = model_of(vertical_slide(), "coulomb", "viscous", "offset")
    truth = np.r_[np.zeros(9), 3.0, -2.0, 0.4, -0.7]  # negative dry friction: impossible
    problem = build_problem(model, [exact_log(model, truth, noise=0.05)], GIVEN)
    estimate = fit(problem, FREE)
    rows = problem.rows
    lower = np.array([0.0, 0.0, 0.0, -np.inf])
    expected = scipy.optimize.lsq_linear(rows.matrix, rows.torque, (lower, np.full(4, np.inf)), tol=1e-14).x
    assert problem.base.names == ("m[link1]", "Fc[joint1]", "Fv[joint1]", "F0[joint1]")
    np.testing.assert_allclose(estimate.beta, expected, rtol=1e-4, atol=1e-6)
    assert estimate.beta[1] == pytest.approx(0.0, abs=1e-7) and estimate.consistency.consistent


def test_an_impossible_mass_stops_at_the_margin(exact_log: MakeLog) -> None:
    """The best possible mass for data of a negative one is the smallest: margin times the natural mass."""
    model = model_of(vertical_slide(), "offset")
    problem = build_problem(model, [exact_log(model, np.r_[np.zeros(9), -3.0, 0.5], noise=0.01)], GIVEN)
    for margin in (1e-6, 1e-4):
        found = replace(FREE, margin=margin).solve(problem)
        assert found.theta is not None
        assert found.theta[9] == pytest.approx(margin * scale_of(problem).mass[0], rel=0.05)


def test_the_joint_inertia_of_a_balanced_wheel(exact_log: MakeLog) -> None:
    """A wheel about its axis without gravity: Izz and a rotor; for data of Izz + Ia < 0 both end at their bounds."""
    hinge = Joint("joint1", "revolute", -1, np.eye(3), np.zeros(3), np.array([0, 0, 1.0]))
    body = Inertia.from_centre_of_mass(2.0, np.zeros(3), np.diag([0.03, 0.03, 0.05]))
    model = model_of(Robot("wheel", (Link("link1", body),), (hinge,)), "viscous")
    theta = np.append(body.vector, 0.3)
    theta[5] = -0.02
    problem = build_problem(model, [exact_log(model, theta, noise=1e-3)], GIVEN)
    assert problem.base.names == ("Izz[link1]", "Fv[joint1]")
    estimate = fit(problem, FREE)
    scale = scale_of(problem)
    # Izz is the sum of two diagonal entries of the pseudo-inertia's upper block, each at least margin m L^2.
    assert estimate.beta[0] == pytest.approx(2 * MARGIN * scale.mass[0] * scale.length[0] ** 2, rel=0.05)
    rows = problem.rows
    expected = rows.matrix[:, 1] @ rows.torque / (rows.matrix[:, 1] @ rows.matrix[:, 1])
    assert estimate.beta[1] == pytest.approx(expected, rel=1e-3)


def _dual_of(gradient: Array) -> Array:
    """Return the symmetric S, shape (4, 4), with <S, B_k> = gradient_k for the ten basis matrices of P."""
    pairs = [(i, j) for i in range(4) for j in range(i, 4)]
    columns = [[PSEUDO_BASIS[k, i, j] * (1 if i == j else 2) for i, j in pairs] for k in range(10)]
    found = np.zeros((4, 4))
    for (i, j), value in zip(pairs, np.linalg.solve(np.array(columns), gradient), strict=True):
        found[i, j] = found[j, i] = value
    return found


@pytest.mark.parametrize(
    ("arm", "broken"), [("planar_2r", "Izz"), ("spatial_3r", "Izz"), ("spatial_3r", "Fv"), ("sliding_arm", "m")]
)
def test_the_optimum_is_certified_by_its_dual(
    arm: str, broken: str, request: pytest.FixtureRequest, exact_log: MakeLog
) -> None:
    """The conditions of Karush, Kuhn and Tucker: the gradient lies in the dual cones and is orthogonal to the slack."""
    model = model_of(request.getfixturevalue(arm), *PARTS)
    theta = theta_of(model)
    for k, parameter in enumerate(model.parameters):
        if parameter.symbol == broken and parameter.owner[-1] != "1":
            theta[k] *= -0.5  # least squares is impossible
    problem = build_problem(model, [exact_log(model, theta, noise=0.1)], GIVEN)
    assert not fit(problem, WLS()).consistency.consistent
    weights = WLS().solve(problem).weights
    reduced, scale, pull, margin = problem.reduced(weights), scale_of(problem), 1e-3, 1e-6
    found = consistent_fit(model, problem.base, reduced, scale, pull * reduced.rows, margin).theta
    assert broken_conditions(model, found) == ()
    heavy = np.array([p.unit.startswith("kg") for p in model.parameters])
    residual = (reduced.r @ (problem.base.matrix @ found) - reduced.z) / reduced.rest
    gradient = scale.parameters * (problem.base.matrix.T @ (reduced.r.T @ residual))
    size = float(np.max(scale.parameters * np.linalg.norm(reduced.r @ problem.base.matrix, axis=0))) / reduced.rest
    size *= float(np.linalg.norm(residual)) * reduced.rest  # of the terms that cancel in the gradient
    phi = found / scale.parameters
    gradient += np.where(heavy, pull * (phi - scale.prior / scale.parameters), 0.0)
    tolerance = 1e-5 * (size + pull * float(np.abs(phi).max()))
    for link in range(len(model.robot.links)):
        part = slice(10 * link, 10 * link + 10)
        slack = np.einsum("k,kij->ij", phi[part], PSEUDO_BASIS) - margin * np.eye(4)
        dual = _dual_of(gradient[part])
        assert np.linalg.eigvalsh(slack)[0] > -1e-7
        assert np.linalg.eigvalsh(dual)[0] > -tolerance
        assert abs(np.sum(dual * slack)) < tolerance * max(1.0, float(np.abs(slack).max()))
    for k in range(model.inertial_count, len(found)):
        if model.parameters[k].nonnegative:
            assert gradient[k] > -tolerance and abs(gradient[k] * phi[k]) < tolerance * max(1.0, abs(phi[k]))
        else:
            assert abs(gradient[k]) < tolerance


def test_no_other_possible_robot_fits_better(planar_2r: Robot, exact_log: MakeLog) -> None:
    """Gauss-Newton over log-Cholesky forms, which never leaves the possible, comes no lower from any start."""
    model = model_of(planar_2r, "viscous")
    theta = theta_of(model)
    theta[15] = -0.1  # Izz[link2]
    problem = build_problem(model, [exact_log(model, theta, noise=0.2)], GIVEN)
    reduced = problem.reduced(WLS().solve(problem).weights)
    ours = reduced.residual_square(replace(FREE, pull=1e-8).solve(problem).beta)

    def of(x: Array) -> Array:
        bodies = [Inertia.from_log_cholesky(np.clip(x[10 * i : 10 * i + 10], -12, 12)).vector for i in (0, 1)]
        return reduced.r @ problem.base.from_standard(np.concatenate([*bodies, x[20:] ** 2])) - reduced.z

    for seed in range(2):
        start = np.random.default_rng(seed).uniform(-1, 1, 22)
        best = scipy.optimize.least_squares(of, start, max_nfev=100)
        assert 2 * best.cost + reduced.rest > ours * (1 - 1e-6)
    assert ours > 1.01 * reduced.rest


def same_robot_in(robot: Robot, scaled: Scaled, exact_log: MakeLog, mass: float, length: float,
                  known: bool, broken: bool) -> tuple[Estimate, Array]:  # fmt: skip
    """Identify a robot whose masses and lengths are scaled; return the estimate and beta over its deviations."""
    model = model_of(scaled(robot, mass, length), *PARTS)
    theta = theta_of(model, mass, length)
    if broken:
        theta[15] *= -0.5
        theta[[-7, -3]] *= -1.0  # viscous friction of the last joint but one and of the last
    units = np.array([mass * length**2 if joint.kind == "revolute" else mass * length for joint in robot.active])
    log = exact_log(model, theta, noise=0.05 * units)
    if not known:
        model = model_of(without_inertias(model.robot), *PARTS)
    estimate = fit(build_problem(model, [log], GIVEN), FREE)
    return estimate, estimate.beta / estimate.std


@pytest.mark.parametrize("known", [True, False], ids=["description", "bare"])
@pytest.mark.parametrize("broken", [False, True], ids=["possible", "impossible"])
@pytest.mark.parametrize("arm", ["planar_2r", "spatial_3r"])
def test_grams_and_tonnes_give_the_same_relative_result(
    arm: str,
    broken: bool,
    known: bool,
    request: pytest.FixtureRequest,
    scaled: Callable[..., Robot],
    exact_log: MakeLog,
) -> None:
    robot = request.getfixturevalue(arm)
    plain, relative = same_robot_in(robot, scaled, exact_log, 1.0, 1.0, known, broken)
    for mass, length in ((1e-3, 0.1), (1e-3, 10.0), (1e3, 0.1), (1e3, 10.0)):
        other, found = same_robot_in(robot, scaled, exact_log, mass, length, known, broken)
        assert other.consistency.consistent
        assert other.train.total_relative_error == pytest.approx(plain.train.total_relative_error, rel=1e-4)
        assert np.linalg.norm(found - relative) < 1e-3 * np.linalg.norm(relative)


@pytest.mark.parametrize(("mass", "length"), [(1e-3, 0.1), (1e3, 10.0)])
@pytest.mark.parametrize("arm", ["spatial_3r", "scara", "sliding_arm", "planar_3r"])
def test_small_and_large_robots_under_the_same_gravity(
    arm: str,
    mass: float,
    length: float,
    request: pytest.FixtureRequest,
    scaled: Callable[..., Robot],
    exact_log: MakeLog,
) -> None:
    model = model_of(scaled(request.getfixturevalue(arm), mass, length, gravity=1.0), "coulomb", "viscous", "offset")
    theta = theta_of(model, mass, length)
    size = np.std(np.asarray(exact_log(model, theta).torque), axis=0)
    problem = build_problem(model, [exact_log(model, theta, noise=0.01 * size)], GIVEN)
    estimate = fit(problem, FREE)
    assert estimate.consistency.consistent
    error = (estimate.beta - problem.base.from_standard(theta)) / estimate.std
    assert np.abs(error).max() < 5


def test_a_gantry_with_short_links_and_long_strokes(exact_log: MakeLog) -> None:
    axes = np.eye(3)
    joints = [Joint(f"joint{i + 1}", "prismatic", i - 1, np.eye(3), 0.05 * i * axes[2], axes[i]) for i in (0, 1)]
    joints.append(Joint("joint3", "revolute", 1, np.eye(3), 0.05 * axes[2], axes[0]))
    bodies = [Inertia.from_centre_of_mass(m, [0.01, 0.02, 0.0], 0.01 * m * np.eye(3)) for m in (40.0, 15.0, 3.0)]
    links = tuple(Link(f"link{i + 1}", body) for i, body in enumerate(bodies))
    model = model_of(Robot("gantry", links, tuple(joints)), "coulomb", "viscous", "offset")
    theta = theta_of(model)
    log = exact_log(model, theta, noise=np.array([1.0, 1.0, 0.01]), size=2.0)
    for robot in (model.robot, without_inertias(model.robot)):
        estimate = fit(build_problem(model_of(robot, "coulomb", "viscous", "offset"), [log], GIVEN), FREE)
        error = (estimate.beta - estimate.base.from_standard(theta)) / estimate.std
        assert np.abs(error).max() < 5 and estimate.consistency.consistent


def test_a_truth_on_the_edge_of_the_possible(spatial_3r: Robot, exact_log: MakeLog) -> None:
    """Point masses have singular pseudo-inertias: the estimate stays the margin away from them, no further."""
    model = model_of(spatial_3r, "viscous")
    bodies = [Inertia.from_centre_of_mass(m, [0.2, 0.1, 0.05], np.zeros((3, 3))) for m in (8.0, 5.0, 3.0)]
    theta = np.append(np.concatenate([body.vector for body in bodies]), [0.5, 0.5, 0.5])
    problem = build_problem(model, [exact_log(model, theta)], GIVEN)
    estimate = fit(problem, FREE)
    truth = problem.base.from_standard(theta)
    assert np.abs(estimate.beta - truth).max() < 1e-5 * np.abs(truth).max()
    assert estimate.consistency.consistent


def test_what_the_data_leave_open_stays_at_the_description(planar_2r: Robot, exact_log: MakeLog) -> None:
    """The mass of link 1 moves no torque: it is that of the robot model, and follows when another one is given."""
    model = model_of(planar_2r, "viscous")
    theta = theta_of(model)
    log = exact_log(model, theta, noise=0.01)
    found = FREE.solve(build_problem(model, [log], GIVEN)).theta
    assert found is not None
    assert found[9] == pytest.approx(3.0, rel=0.05)
    bodies = [link.inertia for link in planar_2r.links]
    assert bodies[0] is not None
    heavy = Link("link1", Inertia(6.0, bodies[0].first_moment, bodies[0].rotational * 2))
    other = FREE.solve(build_problem(model_of(replace(planar_2r, links=(heavy, planar_2r.links[1])), "viscous"),
                                    [log], GIVEN)).theta  # fmt: skip
    assert other is not None and other[9] == pytest.approx(6.0, rel=0.05)


def test_pull_is_the_price_of_leaving_the_prior(planar_2r: Robot, exact_log: MakeLog) -> None:
    model = model_of(planar_2r, "viscous")
    problem = build_problem(model, [exact_log(model, theta_of(model), noise=0.5)], GIVEN)
    above = [replace(FREE, pull=pull).solve(problem).run.residual_above_unconstrained for pull in (1e-8, 1e-4, 0.1)]
    assert above[0] <= above[1] <= above[2] and above[0] < 1e-5


def test_a_problem_without_a_residual(planar_2r: Robot) -> None:
    """As many rows as parameters: nothing is left over, and the fit still finds the truth."""
    model = model_of(planar_2r)
    base = base_parameters(model)
    beta = base.from_standard(theta_of(model))
    reduced = Reduced(np.eye(base.count), beta, 0.0, base.count)
    scale = natural_scale(model, np.array([20.0, 5.0]), np.ones(2))
    np.testing.assert_allclose(base.from_standard(consistent_fit(model, base, reduced, scale).theta), beta, atol=1e-6)


@pytest.mark.parametrize(
    ("option", "value", "step"),
    [
        ("pull", 0.0, "give a number above 0, such as 0.01"),
        ("pull", np.nan, "give a number above 0, such as 0.01"),
        ("margin", 0.2, "give a share between 0 and 0.1, such as 1e-8"),
        ("margin", -1.0, "give a share between 0 and 0.1, such as 1e-8"),
    ],
)
def test_options_that_are_none(option: str, value: float, step: str) -> None:
    with pytest.raises(BadOption) as caught:
        Consistent(**{option: value})
    assert str(caught.value) == f"{option} = {value!r} is not possible; {step}"
