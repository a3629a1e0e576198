"""Base parameters: counts of the literature, closed forms by hand, and the laws of the map K."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_models import model_of
from dynident.applications.identifiability import structure
from dynident.arrays import Array
from dynident.model.base_parameters import (
    COMBINED,
    IDENTIFIABLE,
    NOT_IDENTIFIABLE,
    TOLERANCE,
    WEAK,
    ZERO,
    base_parameters,
    remainders,
    with_stated_rotors,
)
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Motion
from dynident.model.friction.rotor_inertia import RotorInertia
from dynident.model.joint import Joint, rotation_about
from dynident.model.robot import Link, Robot
from dynident.robot_files import read_robot
from dynident.robot_files.formats.dh import read_dh

# Table 1 of the article: alpha, a, d and offset of each joint, modified DH.
ER16 = (
    ("pi", "0", "0", "0"),
    ("pi/2", "0.16", "0", "-pi/2"),
    ("0", "0.68", "0", "0"),
    ("pi/2", "0.13", "-0.75", "0"),
    ("-pi/2", "0", "0", "0"),
    ("pi/2", "0", "0", "0"),
)
FIRST_THREE = ("joint4", "joint5", "joint6")
ARMS = ("pendulum", "planar_2r", "planar_3r", "spatial_3r", "sliding_arm", "scara", "mimic_arm", "coupled_arm")


@pytest.fixture(scope="module")
def er16() -> Robot:
    lines = ["name: er16", "convention: modified", "joints:"]
    for row in ER16:
        values = ", ".join(f"{key}: {value}" for key, value in zip(("alpha", "a", "d", "offset"), row, strict=True))
        lines.append(f"  - {{{values}}}")
    return read_dh("er16.yaml", "\n".join(lines).encode())


@pytest.mark.parametrize("velocity", [1e-3, 0.01, 0.05])
def test_friction_of_slow_motion_counts_on_every_drive(er16: Robot, velocity: float) -> None:
    """It has faded by many powers of ten at the speeds of a random motion; the others keep their names."""
    usual, fading = (
        model_of(er16, "coulomb", "viscous"),
        FRICTION.make("stribeck", {"velocity": velocity, "exponent": 2.0}),
    )
    plain, found = base_parameters(usual), base_parameters(replace(usual, friction=(*usual.friction, fading)))
    slow = [name for name in found.names if name.startswith("Fs")]
    assert slow == [f"Fs[{name}]" for name in er16.joint_names]
    assert sorted(found.names) == sorted([*plain.names, *slow])
    np.testing.assert_allclose(
        found.matrix[:, : usual.inertial_count].sum(0), plain.matrix[:, : usual.inertial_count].sum(0), atol=1e-9
    )


def test_counts_of_the_er16(er16: Robot) -> None:
    assert base_parameters(model_of(er16)).count == 36
    assert base_parameters(model_of(er16.locked(dict.fromkeys(FIRST_THREE, 0.0)))).count == 15


def test_columns_of_the_er16_are_those_of_table_2(er16: Robot) -> None:
    base = base_parameters(model_of(er16.locked(dict.fromkeys(FIRST_THREE, 0.0)), "coulomb", "viscous"))
    leads = [base.parameters[k].name for k in base.independent]
    second, third = (
        [f"{symbol}[link{i}]" for symbol in ("Ixx", "Ixy", "Ixz", "Iyz", "Izz", "mx", "my")] for i in (2, 3)
    )
    friction = [f"{symbol}[joint{i}]" for i in (1, 2, 3) for symbol in ("Fc", "Fv")]
    assert leads == ["Izz[link1]", *second, *third, *friction]
    assert base.names[0] == "Izz[link1] + Iyy[link2] + 0.0256 m[link2] + Iyy[link3] + 0.488 m[link3]"


@pytest.mark.parametrize(
    ("name", "count"), [("er16", 36), ("generic-7r", 43), ("generic-6r", 36), ("generic-scara", 8)]
)
def test_counts_of_the_robots_that_ship(name: str, count: int) -> None:
    model = model_of(read_robot(name), "coulomb", "viscous", "offset")
    assert base_parameters(model, inertial_only=True).count == count
    full = replace(model, friction=(RotorInertia(), *model.friction))
    assert base_parameters(full).rank_of(full.inertial_count) == count
    assert base_parameters(model).count == count + 3 * model.robot.dof


def test_pendulum_by_hand(pendulum: Robot) -> None:
    base = base_parameters(model_of(pendulum))
    assert base.names == ("Izz[link1]", "mx[link1]", "my[link1]")
    assert base.units == ("kg m^2", "kg m", "kg m")
    verdicts = dict(zip((p.symbol for p in base.parameters), base.verdicts, strict=True))
    assert {symbol for symbol, verdict in verdicts.items() if verdict == IDENTIFIABLE} == {"Izz", "mx", "my"}
    assert set(verdicts.values()) == {IDENTIFIABLE, NOT_IDENTIFIABLE}


def test_planar_two_link_arm_by_hand(planar_2r: Robot) -> None:
    """Spong's three inertial parameters and the gravity ones: m2 goes into Izz1 (times l^2) and mx1 (times l)."""
    base = base_parameters(model_of(planar_2r))
    assert base.names == (
        "Izz[link1] + 0.25 m[link2]",
        "mx[link1] + 0.5 m[link2]",
        "my[link1]",
        "Izz[link2]",
        "mx[link2]",
        "my[link2]",
    )
    verdicts = dict(zip((p.name for p in base.parameters), base.verdicts, strict=True))
    assert verdicts["m[link2]"] == verdicts["Izz[link1]"] == verdicts["mx[link1]"] == COMBINED
    assert verdicts["my[link1]"] == verdicts["Izz[link2]"] == IDENTIFIABLE
    assert verdicts["m[link1]"] == verdicts["Ixx[link2]"] == verdicts["mz[link2]"] == NOT_IDENTIFIABLE
    assert planar_2r.nominal is not None
    first, second = planar_2r.nominal[:10], planar_2r.nominal[10:]
    expected = [first[5] + 0.25 * second[9], first[6] + 0.5 * second[9], first[7], second[5], second[6], second[7]]
    np.testing.assert_allclose(base.from_standard(planar_2r.nominal), expected, atol=1e-12)


def test_gravity_along_the_axes_hides_the_first_link_moments(planar_2r: Robot) -> None:
    base = base_parameters(model_of(planar_2r.with_gravity([0, 0, -9.81])))
    assert base.names == ("Izz[link1] + 0.25 m[link2]", "Izz[link2]", "mx[link2]", "my[link2]")


def test_gantry_by_hand() -> None:
    """Two slides across each other: the first carries both masses, and nothing else moves a force."""
    x, y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    joints = tuple(
        Joint(f"joint{i + 1}", "prismatic", i - 1, np.eye(3), np.zeros(3), axis) for i, axis in enumerate((x, y))
    )
    gantry = Robot("gantry", (Link("bridge"), Link("head")), joints)
    assert base_parameters(model_of(gantry)).names == ("m[bridge]", "m[head]")
    driven = base_parameters(model_of(gantry, "rotor_inertia"))
    assert driven.names == ("m[bridge] + Ia[joint1] - Ia[joint2]", "m[head] + Ia[joint2]")
    assert driven.units == ("kg", "kg") and COMBINED in driven.verdicts and IDENTIFIABLE not in driven.verdicts


def test_scara_by_hand(scara: Robot) -> None:
    """Vertical axes: first arm 1, second arm 3, the mass that slides, last link 3; gravity acts on that mass alone."""
    base = base_parameters(model_of(scara))
    assert base.count == 8
    leads = {base.parameters[k].name for k in base.independent}
    assert "m[link3]" in leads and sum(name.startswith("m[") for name in leads) == 1


def test_rotor_inertia_of_a_first_joint_is_seen_with_its_link(planar_2r: Robot) -> None:
    base = base_parameters(model_of(planar_2r, "rotor_inertia"))
    assert base.names[0] == "Izz[link1] + 0.25 m[link2] + Ia[joint1]"
    assert base.names[-1] == "Ia[joint2]"
    assert base.count == 7 and base_parameters(model_of(planar_2r, "rotor_inertia"), inertial_only=True).count == 6


def _arm_on_a_slide(axis: str, arm: Robot) -> Robot:
    slide = Joint("slide", "prismatic", -1, np.eye(3), np.zeros(3), np.eye(3)["xyz".index(axis)])
    joints = (slide, *(replace(joint, parent=joint.parent + 1) for joint in arm.joints))
    return Robot("lift", (Link("carriage"), *arm.links), joints, arm.gravity)


def test_rotors_of_slides_are_stated_where_nothing_tells_them_from_mass(
    planar_2r: Robot, scara: Robot, spatial_3r: Robot, sliding_arm: Robot
) -> None:
    """A vertical slide has its mass from its weight, but not beside an offset; one that an arm turns has it."""
    one = RotorInertia(choose=("part",))
    for robot, friction, stated in (
        (_arm_on_a_slide("z", spatial_3r), ("offset",), ("slide",)),
        (_arm_on_a_slide("z", spatial_3r), (), ()),
        (_arm_on_a_slide("x", spatial_3r), (), ("slide",)),
        (scara, ("offset",), ("joint3",)),
        (scara, (), ()),
        (sliding_arm, ("offset",), ()),
        (planar_2r, ("offset",), ()),
        (planar_2r.with_gravity([0, 0, -9.81]), ("offset",), ()),  # the first rotor alone counts as its link
    ):
        parts = with_stated_rotors(DynamicModel(robot, [*friction, one])).friction[len(friction) :]
        sure = [part.joints for part in parts if not part.is_optional]
        assert sure == ([stated] if stated else [])
        left = {name for part in parts if part.is_optional for name in part.joints or robot.joint_names}
        assert left == {*robot.joint_names} - {*stated}


def test_signs_and_coefficients_in_names() -> None:
    turned = Joint("joint2", "revolute", 0, rotation_about(np.array([0, 0, 1.0]), np.pi), np.array([-0.3, 0, 0]),
                   np.array([0, 0, 1.0]))  # fmt: skip
    first = Joint("joint1", "revolute", -1, np.eye(3), np.zeros(3), np.array([0, 0, 1.0]))
    robot = Robot("folded", (Link("a"), Link("b")), (first, turned), np.array([0, -9.81, 0]))
    assert base_parameters(model_of(robot)).names[:2] == ("Izz[a] + 0.09 m[b]", "mx[a] - 0.3 m[b]")


@pytest.mark.parametrize("arm", ARMS)
def test_the_torque_knows_only_the_base_parameters(arm: str, request: pytest.FixtureRequest) -> None:
    check_invariance(model_of(request.getfixturevalue(arm), "coulomb", "viscous", "offset", "rotor_inertia"), 0)


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 10_000), links=st.integers(1, 5))
def test_the_torque_knows_only_the_base_parameters_of_any_tree(
    random_tree: Callable[..., Robot], seed: int, links: int
) -> None:
    check_invariance(model_of(random_tree(seed, links), "viscous", "rotor_inertia"), seed)


def check_invariance(model: DynamicModel, seed: int) -> None:
    """Y theta = Y[:, independent] K theta on states that the choice has not seen; the count is the rank."""
    base = base_parameters(model)
    motion = model.random_motion(60, seed + 77)
    regressor = model.regressor(motion).reshape(-1, len(model.parameters))
    theta = np.random.default_rng(seed).normal(size=regressor.shape[1])
    torque = regressor @ theta
    norms = np.linalg.norm(regressor, axis=0)
    # A column this small is taken for rounding of the robot model; the torque then lacks what it gives.
    tiny = bool(np.any((norms > 1e-14 * norms.max()) & (norms < 2 * ZERO * norms.max())))
    size = (1e-4 if tiny else 1e-9) * float(np.abs(torque).max())
    np.testing.assert_allclose(regressor[:, base.independent] @ base.from_standard(theta), torque, atol=size)
    np.testing.assert_allclose(regressor @ base.to_standard(base.from_standard(theta)), torque, atol=size)
    if tiny:
        return
    columns = regressor[:, norms > ZERO * norms.max()]
    assert base.count == np.linalg.matrix_rank(columns / np.linalg.norm(columns, axis=0), tol=1e-8)
    np.testing.assert_array_equal(base.matrix[:, base.independent], np.eye(base.count))
    check_verdicts(base.matrix, base.verdicts, base.count)


def check_verdicts(matrix: np.ndarray, verdicts: Sequence[str], count: int) -> None:
    """A parameter is identifiable exactly when a torque determines it: its unit vector lies in the rows of K."""
    for k, verdict in enumerate(verdicts):
        unit = np.eye(matrix.shape[1])[k]
        alone = np.linalg.matrix_rank(np.vstack([matrix, unit]), tol=1e-6) == count
        seen = bool(np.any(matrix[:, k]))
        assert verdict == (IDENTIFIABLE if alone else COMBINED if seen else NOT_IDENTIFIABLE)


@pytest.mark.parametrize("arm", ("spatial_3r", "sliding_arm", "scara"))
def test_the_choice_does_not_depend_on_the_random_states(arm: str, request: pytest.FixtureRequest) -> None:
    model = model_of(request.getfixturevalue(arm), "viscous")
    first = base_parameters(model)
    for seed in range(1, 5):
        other = base_parameters(model, seed=seed)
        assert other.names == first.names
        np.testing.assert_allclose(other.matrix, first.matrix, atol=1e-9)


def test_two_arms_on_one_base_count_apart(planar_2r: Robot) -> None:
    """A tree of two arms: the base parameters of each, side by side."""
    links = (*planar_2r.links, Link("link3"), Link("link4"))
    third, fourth = (
        replace(joint, name=f"joint{i + 3}", parent=(-1, 2)[i]) for i, joint in enumerate(planar_2r.joints)
    )
    pair = Robot("pair", links, (*planar_2r.joints, third, fourth), planar_2r.gravity)
    names = base_parameters(model_of(pair)).names
    one = base_parameters(model_of(planar_2r)).names
    renamed = tuple(name.replace("link1", "link3").replace("link2", "link4") for name in one)
    assert names == (*one, *renamed)


def test_inertial_parameters_alone_are_a_part_of_all(coupled_arm: Robot) -> None:
    model = model_of(coupled_arm, "coulomb", "viscous", "offset")
    whole, part = base_parameters(model), base_parameters(model, inertial_only=True)
    assert whole.count == part.count + 9
    np.testing.assert_array_equal(whole.independent[: part.count], part.independent)
    np.testing.assert_allclose(whole.matrix[: part.count, : model.inertial_count], part.matrix, atol=1e-9)


@pytest.mark.parametrize(
    ("axis", "grouped"), [(0, {"Iyy", "mx", "m"}), (1, {"Ixx", "my", "m"}), (2, {"Iyy", "mz", "m"})]
)
def test_what_goes_into_the_link_before_follows_the_axis(
    axis: int, grouped: set[str], random_tree: Callable[..., Robot]
) -> None:
    """Turning joints in general position: each link after the first keeps the other seven (Khalil and Dombre 2002)."""
    tree = random_tree(4, 3)
    joints = tuple(
        replace(joint, kind="revolute", parent=i - 1, axis=np.eye(3)[axis]) for i, joint in enumerate(tree.joints)
    )
    base = base_parameters(model_of(replace(tree, joints=joints, coupling=None)))
    kept = [base.parameters[k].name for k in base.independent]
    for link in ("link2", "link3"):
        symbols = {"Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz", "mx", "my", "mz", "m"}
        assert {name.partition("[")[0] for name in kept if name.endswith(f"[{link}]")} == symbols - grouped


@pytest.mark.parametrize("name", ARMS)
def test_shares_are_what_the_other_columns_leave(name: str, request: pytest.FixtureRequest) -> None:
    """In another basis of the same columns, by least squares; the largest column of a kind is the unit of its kind."""
    base = base_parameters(model_of(request.getfixturevalue(name), "viscous"))
    assert np.all(base.shares > WEAK) and np.all(base.shares <= 1.0 + 1e-12)
    generator = np.random.default_rng(0)
    columns = generator.normal(size=(20, 6)) * 10.0 ** generator.uniform(-3, 0, 6)
    for k, found in enumerate(remainders(columns)):
        others = np.delete(columns, k, axis=1)
        left = columns[:, k] - others @ np.linalg.lstsq(others, columns[:, k])[0]
        assert found == pytest.approx(np.linalg.norm(left), rel=1e-9)


def test_a_rank_that_is_not_clear_is_decided_and_told(
    spatial_3r: Robot, pendulum: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A regressor known to five digits only: singular values without a gap between what counts and what does not."""
    exact = DynamicModel.regressor

    def rough(self: DynamicModel, motion: Motion, **options: bool) -> Array:
        found = exact(self, motion, **options)
        return found + 2e-6 * np.abs(found).max() * np.random.default_rng(0).normal(size=found.shape)

    clear = base_parameters(model_of(spatial_3r))
    assert not len(clear.weak) and clear.neglected == 0
    assert base_parameters(model_of(pendulum)).neglected == 0  # where all columns that matter are independent
    monkeypatch.setattr(DynamicModel, "regressor", rough)
    base = base_parameters(model_of(replace(spatial_3r)))  # another robot: nothing is known of it yet
    assert base.count > clear.count and 1e-6 < base.neglected < 1e-5
    assert set(clear.independent) <= set(base.independent)
    assert {base.names[k] for k in base.weak} >= {base.names[k] for k in np.flatnonzero(base.shares < 1e-4)} != set()


@pytest.mark.parametrize("size", [3e-6, 1e-5, 3e-5, 1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("name", ["generic-6r", "generic-scara"])
def test_a_calibrated_robot_gets_an_answer(name: str, size: float) -> None:
    """Axes off by any angle: the torque of the base parameters is that of all, but for what is stated as neglected."""
    robot = read_robot(name)
    generator = np.random.default_rng(5)
    joints = tuple(
        replace(
            joint,
            rotation=joint.rotation @ rotation_about(np.array([1.0, 0, 0]), size * generator.normal()),
            translation=joint.translation + size * generator.normal(size=3),
        )
        for joint in robot.joints
    )
    model, ideal = model_of(replace(robot, joints=joints), "viscous"), base_parameters(model_of(robot, "viscous"))
    base = base_parameters(model)
    assert set(ideal.independent) <= set(base.independent) or size > 1e-3
    assert base.count >= ideal.count and bool(len(base.weak)) == (base.count > ideal.count)
    assert np.all(base.shares > 0.1 * TOLERANCE) and np.all(base.shares[base.weak] < WEAK)
    assert np.abs(base.matrix[:, : model.inertial_count]).max() < 1e3
    regressor, theta = model.regressor(model.random_motion(50, 9)), model.nominal()
    assert theta is not None
    torque, found = regressor @ theta, regressor[..., base.independent] @ base.from_standard(theta)
    assert np.abs(found - torque).max() <= 1e-4 * np.abs(torque).max()


def test_map_is_read_only(pendulum: Robot) -> None:
    base = base_parameters(model_of(pendulum))
    with pytest.raises(ValueError, match="read-only"):
        base.matrix[0, 0] = 2.0


DRIVES = ("viscous", "offset", "rotor_inertia")


def check_size(robot: Robot, friction: tuple[str, ...]) -> None:
    """The count is the exact one, and K theta gives the torque of theta on every joint."""
    model = model_of(robot, *friction)
    base = base_parameters(model)
    assert base.count == structure(model).count
    assert robot.nominal is not None
    torques = model.regressor(model.random_motion(50, 3))
    scale = float(np.abs(torques[..., : model.inertial_count] @ robot.nominal).max())
    theta = np.append(robot.nominal, np.full(len(model.parameters) - model.inertial_count, scale))
    torque, found = torques @ theta, torques[..., base.independent] @ base.from_standard(theta)
    assert np.all(np.abs(found - torque).max(axis=0) <= 1e-9 * np.abs(torque).max(axis=0))


@pytest.mark.parametrize("friction", [(), DRIVES])
@pytest.mark.parametrize(("length", "mass"), [(1e-3, 1e-3), (5e-3, 1e-2), (1e-2, 1.0), (10.0, 1e3)])
@pytest.mark.parametrize("name", ["generic-6r", "generic-7r", "generic-scara"])
def test_small_and_large_arms_lose_no_terms(
    name: str, length: float, mass: float, friction: tuple[str, ...], scaled: Callable[..., Robot]
) -> None:
    """From arms of a millimetre and a gram to ten metres and a ton, in the gravity of the earth."""
    check_size(scaled(read_robot(name), mass, length, 1.0), friction)


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 10_000), links=st.integers(1, 5), length=st.sampled_from([1e-3, 1e-2, 0.1, 10.0]))
def test_trees_of_every_size_lose_no_terms(
    random_tree: Callable[..., Robot], scaled: Callable[..., Robot], seed: int, links: int, length: float
) -> None:
    tree = scaled(random_tree(seed, links), 1.0, length, 1.0)
    own = base_parameters(model_of(tree, *DRIVES))
    assert own.count == structure(model_of(tree, *DRIVES)).count
    unit = base_parameters(model_of(random_tree(seed, links), *DRIVES))
    np.testing.assert_array_equal(own.independent, unit.independent)


def test_an_axis_that_lies_almost_across_still_counts(random_tree: Callable[..., Robot]) -> None:
    """Ixx of its second link adds axis_x^2 = 2e-5 of what Izz does: a true column, however small."""
    base = base_parameters(model_of(random_tree(1997, 2)))
    assert any("Ixx[link2]" in name for name in base.names)


@pytest.mark.parametrize("length", [5e-3, 1.0])
def test_rounded_angles_add_no_parameters(length: float, scaled: Callable[..., Robot]) -> None:
    """Right angles written as 1.5708, at any size: gravity along a tilted axis is no parameter of its own."""
    robot = read_robot("generic-6r")
    tilt = rotation_about(np.array([1.0, 0.0, 0.0]), 1.5708 - np.pi / 2)
    joints = tuple(replace(joint, rotation=joint.rotation @ tilt) for joint in robot.joints)
    rounded = scaled(replace(robot, joints=joints), 1.0, length, 1.0)
    assert base_parameters(model_of(rounded)).count == 36
