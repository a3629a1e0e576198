"""Inertia against point masses, Pinocchio, and the laws that its forms obey."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dynident.arrays import Array
from dynident.model.inertia import PSEUDO_BASIS, TEN, Inertia, skew
from dynident.model.joint import rotation_about
from dynident.model.parameters import to_pinocchio

LIMITED = st.floats(-1.0, 1.0)
ETA = arrays(float, 10, elements=LIMITED)
CLOUD = arrays(float, (6, 4), elements=LIMITED)
POSE = arrays(float, 6, elements=st.floats(-2.0, 2.0))


def of_points(points: Array, masses: Array) -> Inertia:
    """Return the inertia of point masses, straight from the definition of the moments."""
    moments = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for p, m in zip(points, masses, strict=True))
    return Inertia(float(masses.sum()), masses @ points, np.asarray(moments))


def pose_of(numbers: Array) -> tuple[Array, Array]:
    angle = float(np.linalg.norm(numbers[:3]))
    axis = numbers[:3] / angle if angle > 1e-9 else np.array([1.0, 0.0, 0.0])
    return rotation_about(axis, angle), numbers[3:]


def close(one: Inertia, other: Inertia, tolerance: float = 1e-12) -> bool:
    size = max(float(np.abs(one.pseudo).max()), 1e-300)
    return bool(np.abs(one.pseudo - other.pseudo).max() <= tolerance * size)


@given(CLOUD)
def test_pseudo_inertia_is_the_second_moment_of_the_points(cloud: Array) -> None:
    points, masses = cloud[:, :3], np.abs(cloud[:, 3]) + 0.1
    homogeneous = np.column_stack([points, np.ones(len(points))])
    body = of_points(points, masses)
    np.testing.assert_allclose(body.pseudo, (homogeneous.T * masses) @ homogeneous, atol=1e-12)
    np.testing.assert_allclose(np.einsum("k,kij->ij", body.vector, PSEUDO_BASIS), body.pseudo, atol=1e-12)


@given(CLOUD, POSE)
def test_moved_is_the_inertia_of_the_moved_points(cloud: Array, numbers: Array) -> None:
    points, masses = cloud[:, :3], np.abs(cloud[:, 3]) + 0.1
    rotation, translation = pose_of(numbers)
    seen = of_points(points @ rotation.T + translation, masses)
    assert close(of_points(points, masses).moved(rotation, translation), seen)


@given(CLOUD, CLOUD)
def test_sum_is_the_inertia_of_all_points(one: Array, other: Array) -> None:
    masses = [np.abs(cloud[:, 3]) + 0.1 for cloud in (one, other)]
    both = of_points(np.vstack([one[:, :3], other[:, :3]]), np.concatenate(masses))
    assert close(of_points(one[:, :3], masses[0]) + of_points(other[:, :3], masses[1]), both)


@given(CLOUD)
def test_parallel_axis_theorem(cloud: Array) -> None:
    points, masses = cloud[:, :3], np.abs(cloud[:, 3]) + 0.1
    body = of_points(points, masses)
    centred = of_points(points - body.centre_of_mass, masses)
    np.testing.assert_allclose(body.about_centre, centred.rotational, atol=1e-12)
    again = Inertia.from_centre_of_mass(body.mass, body.centre_of_mass, body.about_centre)
    assert close(again, body)


@given(ETA)
def test_the_forms_are_bijections(eta: Array) -> None:
    body = Inertia.from_log_cholesky(eta)
    assert body.is_consistent() and body.defect() == ""
    np.testing.assert_allclose(body.log_cholesky, eta, atol=1e-8)
    assert close(Inertia.from_vector(body.vector), body, 0.0)
    assert close(Inertia.from_pseudo(body.pseudo), body, 1e-15)


@given(ETA)
def test_log_cholesky_is_the_formula_of_its_docstring(eta: Array) -> None:
    alpha, d1, d2, d3, s12, s23, s13, t1, t2, t3 = eta
    u = np.exp(alpha) * np.array(
        [[np.exp(d1), s12, s13, t1], [0, np.exp(d2), s23, t2], [0, 0, np.exp(d3), t3], [0, 0, 0, 1]]
    )
    np.testing.assert_allclose(Inertia.from_log_cholesky(eta).pseudo, u @ u.T, atol=1e-12)


@given(ETA)
def test_pinocchio_agrees(eta: Array) -> None:
    pin = pytest.importorskip("pinocchio")
    body = Inertia.from_log_cholesky(eta)
    theirs = pin.Inertia(body.mass, body.centre_of_mass, body.about_centre)
    np.testing.assert_allclose(theirs.toDynamicParameters(), to_pinocchio(body.vector), rtol=1e-9, atol=1e-9)
    log_cholesky = pin.LogCholeskyParameters(eta)
    np.testing.assert_allclose(log_cholesky.toDynamicParameters(), to_pinocchio(body.vector), rtol=1e-9, atol=1e-9)


@given(ETA, POSE)
def test_a_possible_body_stays_one_in_every_frame(eta: Array, numbers: Array) -> None:
    assert Inertia.from_log_cholesky(eta).moved(*pose_of(numbers)).is_consistent()


@given(arrays(float, 10, elements=st.floats(-3.0, 3.0)), POSE)
def test_an_impossible_body_stays_one_in_every_frame(theta: Array, numbers: Array) -> None:
    body = Inertia.from_vector(theta)
    eigenvalues = np.linalg.eigvalsh(body.pseudo)
    assume(np.abs(eigenvalues).min() > 1e-3)
    assert body.moved(*pose_of(numbers)).is_consistent() == body.is_consistent() == bool(eigenvalues[0] > 0)


@given(arrays(float, 10, elements=st.floats(-3.0, 3.0)))
def test_a_defect_is_named_exactly_where_the_pseudo_inertia_is_not_positive(theta: Array) -> None:
    body = Inertia.from_vector(theta)
    assume(np.abs(np.linalg.eigvalsh(body.pseudo)).min() > 1e-6 and abs(body.mass) > 1e-6)
    moments = np.linalg.eigvalsh(body.about_centre)
    assume(not 0.0 <= min(moments[0], moments[0] + moments[1] - moments[2]) + 2e-3 * abs(moments).max() < 4e-3)
    assert (body.defect() == "") == body.is_consistent()


@given(ETA, ETA)
def test_two_possible_bodies_make_a_possible_one(one: Array, other: Array) -> None:
    assert (Inertia.from_log_cholesky(one) + Inertia.from_log_cholesky(other)).is_consistent()


@pytest.mark.parametrize(
    ("body", "defect"),
    [
        (Inertia(0.0, np.zeros(3), np.eye(3)), "the mass is 0 kg"),
        (Inertia(-2.5, np.zeros(3), np.eye(3)), "the mass is -2.5 kg"),
        (Inertia(1.0, np.zeros(3), np.diag([-1.0, 1, 1])), "a principal moment of inertia is -1 kg m^2"),
        (
            Inertia(1.0, np.array([1.0, 0, 0]), np.eye(3)),
            "the principal moments 0, 0, 1 kg m^2 break the triangle inequality",
        ),
        (
            Inertia(1.0, np.zeros(3), np.diag([1.0, 2, 4])),
            "the principal moments 1, 2, 4 kg m^2 break the triangle inequality",
        ),
        (Inertia(np.nan, np.zeros(3), np.eye(3)), "a value is not a number"),
        (Inertia(1.0, np.zeros(3), np.diag([np.inf, 1, 1])), "a value is not a number"),
    ],
)
def test_defects_in_words(body: Inertia, defect: str) -> None:
    assert body.defect() == defect
    assert not body.is_consistent()
    with pytest.raises(ValueError, match="only a strictly consistent inertia"):
        body.log_cholesky
    assert body.solid() is None


@given(POSE)
def test_bodies_on_the_boundary_are_possible(numbers: Array) -> None:
    """A plate, a plate in numbers of four digits, a rod, and a point, which no thickness makes a body."""
    cross = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    printed = Inertia(1.0, np.zeros(3), np.diag([0.08333, 0.08333, 0.1667]))
    for body in (of_points(cross, np.ones(4)), of_points(cross[:2], np.ones(2)), printed):
        moved = body.moved(*pose_of(numbers))
        solid = moved.solid()
        assert moved.defect() == "" and solid is not None and solid.is_consistent()
        assert solid.mass == moved.mass and np.array_equal(solid.first_moment, moved.first_moment)
        away = np.abs(solid.about_centre - moved.about_centre).max()
        assert away <= 1.001e-2 * np.trace(moved.about_centre)
    point = Inertia.from_centre_of_mass(2.0, [0.3, -0.7, 0.2], np.zeros((3, 3)))
    assert point.defect() == "" and point.solid() is None


def test_rounding_hides_no_broken_inequality() -> None:
    assert "triangle" in Inertia(1.0, np.zeros(3), np.diag([0.08333, 0.08333, 0.1669])).defect()


def test_margin_is_a_share_of_the_trace() -> None:
    body = Inertia(1.0, np.zeros(3), np.diag([0.5, 0.5, 0.5]))  # P = diag(.25, .25, .25, 1), trace 1.75
    assert body.is_consistent(0.25 / 1.75 - 1e-9)
    assert not body.is_consistent(0.25 / 1.75 + 1e-9)


def test_a_homogeneous_box() -> None:
    a, b, c, m = 0.4, 0.2, 0.1, 3.0
    inertia = m / 12 * np.diag([b**2 + c**2, a**2 + c**2, a**2 + b**2])
    body = Inertia.from_centre_of_mass(m, [a / 2, 0, 0], inertia)
    np.testing.assert_allclose(body.vector, [m / 12 * (b**2 + c**2), 0, 0, m / 12 * (4 * a**2 + c**2), 0,
                                             m / 12 * (4 * a**2 + b**2), m * a / 2, 0, 0, m])  # fmt: skip
    np.testing.assert_allclose(np.diag(body.pseudo), [m * a**2 / 3, m * b**2 / 12, m * c**2 / 12, m])


def test_values_are_frozen_and_symmetric() -> None:
    source = np.array([[1.0, 0.2, 0], [0.4, 2, 0], [0, 0, 3]])
    body = Inertia(1, np.zeros(3), source)
    np.testing.assert_array_equal(body.rotational, body.rotational.T)
    assert body.rotational[0, 1] == pytest.approx(0.3)
    source[0, 0] = 9.0
    assert body.rotational[0, 0] == 1.0 and isinstance(body.mass, float)
    with pytest.raises(ValueError, match="read-only"):
        body.first_moment[0] = 1.0
    with pytest.raises(AttributeError):
        body.mass = 2.0  # type: ignore[misc]


def test_shapes_are_checked() -> None:
    with pytest.raises(ValueError, match=r"first moment has shape \(2,\)"):
        Inertia(1.0, np.zeros(2), np.eye(3))
    with pytest.raises(ValueError, match=r"ten parameters expected, got shape \(9,\)"):
        Inertia.from_vector(np.zeros(9))


def test_a_massless_link_has_its_centre_at_the_origin() -> None:
    np.testing.assert_array_equal(Inertia(0.0, np.zeros(3), np.zeros((3, 3))).centre_of_mass, np.zeros(3))


def test_order_of_the_ten() -> None:
    body = Inertia(10.0, np.array([7.0, 8, 9]), np.array([[1.0, 2, 3], [2, 4, 5], [3, 5, 6]]))
    assert TEN == ("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz", "mx", "my", "mz", "m")
    np.testing.assert_array_equal(body.vector, np.arange(1, 11))


@given(arrays(float, 3, elements=LIMITED), arrays(float, 3, elements=LIMITED))
def test_skew_is_the_cross_product(one: Array, other: Array) -> None:
    np.testing.assert_allclose(skew(one) @ other, np.cross(one, other), atol=1e-15)
