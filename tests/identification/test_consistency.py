"""Verdicts on physical consistency, natural scales, and whether base parameters belong to any possible robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from arm_models import model_of, theta_of, without_inertias
from dynident.arrays import Array
from dynident.identification.consistency.verdicts import (
    broken_conditions,
    deepest_consistent,
    describe_reasons,
    judge,
    smallest_inertia,
)
from dynident.identification.problem.prior import natural_scale
from dynident.model.base_parameters import base_parameters
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, Joint
from dynident.model.kernels import batched
from dynident.model.robot import Link, Robot

ARMS = ("pendulum", "planar_2r", "spatial_3r", "sliding_arm", "scara", "mimic_arm", "coupled_arm")
UNITS = [(1e-3, 0.1), (1.0, 1.0), (1e3, 10.0)]


def test_broken_conditions_in_words(planar_2r: Robot) -> None:
    model = model_of(planar_2r, "coulomb", "offset")
    theta = theta_of(model)
    assert broken_conditions(model, theta) == ()
    broken = theta.copy()
    broken[9], broken[20], broken[21] = -1.0, -0.25, -5.0  # an offset may be negative
    assert broken_conditions(model, broken) == ("link1: the mass is -1 kg", "Fc[joint1] = -0.25 N m is negative")


def test_smallest_inertia_counts_all_rotors(coupled_arm: Robot) -> None:
    model = model_of(coupled_arm, "viscous", "rotor_inertia")
    theta = theta_of(model)
    motion = model.random_motion(200, 1)
    mass = batched.mass_matrix(coupled_arm.chain, theta[:30], motion.q)
    rotors = np.diag([theta[k] for k, p in enumerate(model.parameters) if p.symbol == "Ia"])
    coupling = np.asarray(coupled_arm.coupling)
    total = mass + coupling.T @ (rotors + np.diag([0.2, 120.0**2 * 2e-5, 80.0**2 * 2e-5])) @ coupling
    expected = min(float(np.linalg.eigvalsh(matrix)[0]) for matrix in total)
    assert smallest_inertia(model, theta) == pytest.approx(expected)


def test_smallest_inertia_is_that_of_pinocchio(spatial_3r: Robot) -> None:
    pin = pytest.importorskip("pinocchio")
    theirs = pin.Model()
    for joint, link in zip(spatial_3r.joints, spatial_3r.links, strict=True):
        pose = pin.SE3(joint.rotation.copy(), joint.translation.copy())
        index = theirs.addJoint(joint.parent + 1, pin.JointModelRevoluteUnaligned(joint.axis.copy()), pose, joint.name)
        body = link.inertia
        assert body is not None
        inertia = pin.Inertia(body.mass, body.centre_of_mass, body.about_centre)
        theirs.appendBodyToJoint(index, inertia, pin.SE3.Identity())
    data, model = theirs.createData(), model_of(spatial_3r)
    assert spatial_3r.nominal is not None
    states = model.random_motion(200, 1).q
    expected = min(float(np.linalg.eigvalsh(_symmetric(pin.crba(theirs, data, q)))[0]) for q in states)
    assert smallest_inertia(model, spatial_3r.nominal) == pytest.approx(expected)


def _symmetric(upper: Array) -> Array:
    return np.triu(upper) + np.triu(upper, 1).T


@pytest.mark.parametrize("arm", ARMS)
def test_a_possible_robot_is_found_from_its_base_parameters_alone(arm: str, request: pytest.FixtureRequest) -> None:
    model = model_of(request.getfixturevalue(arm), "coulomb", "viscous", "offset", "rotor_inertia")
    base = base_parameters(model)
    beta = base.from_standard(theta_of(model))
    found = deepest_consistent(model, base, beta)
    assert found is not None and broken_conditions(model, found) == ()
    np.testing.assert_allclose(base.from_standard(found), beta, atol=1e-6 * np.abs(beta).max())
    verdict = judge(model, base, beta, None)
    assert verdict.consistent and verdict.reasons == () and verdict.smallest_inertia > 0


@pytest.mark.parametrize(("mass", "length"), UNITS)
@pytest.mark.parametrize("arm", ["pendulum", "planar_2r", "spatial_3r", "scara"])
def test_verdicts_do_not_depend_on_the_units(
    arm: str, mass: float, length: float, request: pytest.FixtureRequest, scaled: Callable[..., Robot]
) -> None:
    """The same robot in grams and decimetres, or tonnes and decametres; so the same robot that no body has."""
    model = model_of(scaled(request.getfixturevalue(arm), mass, length), "viscous", "rotor_inertia")
    base = base_parameters(model)
    theta = theta_of(model, 0.1 * mass * length**2)
    assert judge(model, base, base.from_standard(theta), None).consistent
    impossible = theta.copy()
    impossible[-2] *= -1.0  # viscous friction of the last joint
    assert not judge(model, base, base.from_standard(impossible), None).consistent
    last = model.inertial_count - 10
    impossible = theta.copy()
    impossible[last + 5] = -2.0 * theta[last + 5] - theta[-1]  # Izz of the last link, rotor included
    assert not judge(model, base, base.from_standard(impossible), None).consistent


def test_why_base_parameters_belong_to_no_robot(planar_2r: Robot) -> None:
    model = model_of(planar_2r, "viscous")
    base = base_parameters(model)
    beta = base.from_standard(theta_of(model))
    friction = beta.copy()
    friction[-1] = -0.1
    verdict = judge(model, base, friction, None)
    assert verdict.reasons == ("no links with positive mass density and friction >= 0 have these base parameters",)
    inertia = beta.copy()
    inertia[3] = -0.5  # Izz[link2], alone a base parameter
    verdict = judge(model, base, inertia, None)
    assert len(verdict.reasons) == 2 and verdict.smallest_inertia < 0
    assert verdict.reasons[1] == f"the inertia matrix M(q) has the eigenvalue {verdict.smallest_inertia:.4g}"


def test_standard_parameters_are_judged_one_by_one(planar_2r: Robot) -> None:
    """The base parameters belong to a possible robot, but these standard parameters are none."""
    model = model_of(planar_2r, "viscous")
    base = base_parameters(model)
    theta = theta_of(model)
    theta[0] = -5.0  # Ixx[link1] moves no torque
    beta = base.from_standard(theta)
    assert judge(model, base, beta, None).consistent
    verdict = judge(model, base, beta, theta)
    assert not verdict.consistent and verdict.reasons[0].startswith("link1: a principal moment of inertia is -5")


def test_the_edge_of_the_possible_is_found() -> None:
    """Izz of a single link with a known first moment: any Izz > 0 has a heavy enough body, no Izz <= 0 has one."""
    axis = np.array([0, 0, 1.0])
    robot = Robot(
        "p", (Link("l"),), (Joint("j", "revolute", -1, np.eye(3), np.zeros(3), axis),), np.array([0, -9.81, 0])
    )
    model = model_of(robot)
    base = base_parameters(model)
    assert base.names == ("Izz[l]", "mx[l]", "my[l]")
    assert judge(model, base, np.array([1e-3, 0.5, 0.1]), None).consistent
    assert not judge(model, base, np.array([-1e-3, 0.5, 0.1]), None).consistent


@pytest.mark.parametrize(("mass", "length"), UNITS)
def test_scale_of_a_known_robot_is_its_own(
    mass: float, length: float, spatial_3r: Robot, scaled: Callable[..., Robot]
) -> None:
    robot = scaled(spatial_3r, mass, length)
    model = model_of(robot, "coulomb", "rotor_inertia")
    scale = natural_scale(model, np.array([30.0, 20.0, 10.0]) * mass * length**2, np.ones(3))
    assert scale.source == "the robot model's inertias"
    np.testing.assert_allclose(scale.mass, np.array([8.0, 5.0, 3.0]) * mass)
    np.testing.assert_array_equal(scale.prior[:30], robot.nominal)
    np.testing.assert_array_equal(scale.prior[30:], 0.0)
    assert np.all(scale.length < 0.6 * length) and np.all(scale.length > 0.05 * length)
    np.testing.assert_allclose(scale.parameters[[30, 32, 34]], np.array([30.0, 20.0, 10.0]) * mass * length**2)
    np.testing.assert_allclose(scale.parameters[[31, 33, 35]], np.max(scale.mass * scale.length**2))


@pytest.mark.parametrize(("mass", "length"), UNITS)
def test_scale_of_an_unknown_robot_follows_its_torques(
    mass: float, length: float, spatial_3r: Robot, scaled: Callable[..., Robot]
) -> None:
    model = model_of(without_inertias(scaled(spatial_3r, mass, length)), "viscous")
    torque = np.array([30.0, 20.0, 10.0]) * mass * length**2
    scale = natural_scale(model, torque, np.array([2.0, 2.0, 2.0]))
    plain = natural_scale(
        model_of(without_inertias(spatial_3r), "viscous"), np.array([30.0, 20.0, 10.0]), np.full(3, 2.0)
    )
    assert scale.source == "balls that explain the size of the torques"
    np.testing.assert_allclose(scale.mass, plain.mass * mass)
    np.testing.assert_allclose(scale.length, plain.length * length)
    for i in range(3):
        assert Inertia.from_vector(scale.prior[10 * i : 10 * i + 10]).is_consistent()
    assert 1.0 * mass < scale.mass.sum() < 100.0 * mass


def test_a_slide_weighs_what_its_force_says() -> None:
    """A force needs no lever: 200 N under gravity and 10 m/s^2 are about 10 kg, however short the links."""
    slide = Joint("j", "prismatic", -1, np.eye(3), np.array([0, 0, 1e-3]), np.array([0, 0, 1.0]))
    model = model_of(Robot("lift", (Link("l"),), (slide,)))
    scale = natural_scale(model, np.array([200.0]), np.array([10.0]))
    np.testing.assert_allclose(scale.mass, 2 * 200 / (9.81 + 10))


def test_an_impossible_description_is_no_prior(planar_2r: Robot) -> None:
    bad = replace(planar_2r, links=(planar_2r.links[0], Link("link2", Inertia(1.0, np.zeros(3), -np.eye(3)))))
    assert natural_scale(model_of(bad), np.ones(2), np.ones(2)).source.startswith("balls")


def test_sizes_where_torques_are_zero(planar_2r: Robot) -> None:
    scale = natural_scale(model_of(without_inertias(planar_2r), "viscous"), np.zeros(2), np.zeros(2))
    assert np.all(scale.parameters > 0) and np.all(np.isfinite(scale.parameters))


def test_rotor_of_a_slide_counts_in_kg(sliding_arm: Robot) -> None:
    model = model_of(sliding_arm.with_drives({"joint1": Drive(2.0)}), "rotor_inertia")
    scale = natural_scale(model, np.ones(3), np.ones(3))
    assert scale.parameters[31] == pytest.approx(scale.mass.max())


def test_reasons_in_one_line() -> None:
    assert describe_reasons(["a", "b", "c"]) == "a; b; c"
    assert describe_reasons(["a", "b", "c", "d", "e"]) == "a; b; c and 2 more"
    assert describe_reasons([]) == ""


def test_a_bound_met_by_rounding_is_not_broken_and_figures_beside_it_differ(planar_2r: Robot) -> None:
    drives = {joint.name: Drive(10.0, 0.004) for joint in planar_2r.active}
    model = model_of(planar_2r.with_drives(drives), "rotor_inertia")
    theta = theta_of(model)
    for value, told in ((-0.4 * (1 + 1e-9), ()), (-0.40002, ("Ia[joint1] = -0.40002 kg m^2 is below -0.4",))):
        theta[model.inertial_count] = value
        assert broken_conditions(model, theta) == told
