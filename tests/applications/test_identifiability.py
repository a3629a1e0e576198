"""The exact count and null space against the numeric ones, and against what is known of small arms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynident.applications.identifiability import structure
from dynident.errors import BadOption
from dynident.model.base_parameters import COMBINED, IDENTIFIABLE, base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

FRICTIONS = ((), ("rotor_inertia",), ("coulomb", "viscous", "offset", "rotor_inertia"))


def check(robot: Robot, friction: tuple[str, ...]) -> int:
    """Compare count, null space and verdicts with the numeric method, and return the count."""
    model = DynamicModel(robot, friction)
    exact, numeric = structure(model), base_parameters(model)
    assert exact.count == numeric.count
    hidden = exact.null_space
    assert hidden.shape == (len(model.parameters), len(model.parameters) - exact.count)
    if hidden.size:
        size = np.abs(numeric.matrix).max() * np.abs(hidden).max(axis=0)
        assert np.all(np.abs(numeric.matrix @ hidden) <= 1e-8 * size)
    expected = [
        IDENTIFIABLE if alone else "not identifiable" if lost else COMBINED
        for alone, lost in zip(exact.alone, exact.hidden, strict=True)
    ]
    assert tuple(expected) == numeric.verdicts
    return exact.count


@pytest.mark.parametrize("friction", FRICTIONS)
@pytest.mark.parametrize("gravity", [None, (0.0, 0.0, 0.0), (3.0, 1.0, -9.0)])
@pytest.mark.parametrize("name", ["er16", "generic-6r", "generic-7r", "generic-scara"])
def test_the_robots_that_ship(name: str, gravity: tuple[float, ...] | None, friction: tuple[str, ...]) -> None:
    robot = read_robot(name)
    check(robot if gravity is None else robot.with_gravity(gravity), friction)


def test_the_counts_of_the_literature() -> None:
    assert structure(DynamicModel(read_robot("er16"))).count == 36
    assert structure(DynamicModel(read_robot("generic-7r"))).count == 43


@pytest.mark.parametrize("arm", ["pendulum", "planar_2r", "planar_3r", "spatial_3r", "sliding_arm", "scara"])
@pytest.mark.parametrize("friction", FRICTIONS)
def test_small_arms(arm: str, friction: tuple[str, ...], request: pytest.FixtureRequest) -> None:
    check(request.getfixturevalue(arm), friction)


def test_a_pendulum_has_three(pendulum: Robot) -> None:
    found = structure(DynamicModel(pendulum))
    names = [p.symbol for p, alone in zip(DynamicModel(pendulum).parameters, found.alone, strict=True) if alone]
    assert (found.count, len(names), sum(found.hidden)) == (3, 3, 7)


def test_a_planar_arm_in_closed_form(planar_2r: Robot) -> None:
    """With gravity in the plane: Izz1 + a^2 m2, mx1 + a m2, my1, Izz2, mx2, my2."""
    model = DynamicModel(planar_2r)
    found = structure(model)
    assert found.count == 6
    place = {parameter.name: k for k, parameter in enumerate(model.parameters)}
    first, second = (link.name for link in planar_2r.links)
    a = float(planar_2r.joints[1].translation[0])
    change = np.zeros(len(model.parameters))
    change[place[f"m[{second}]"]] = 1.0
    change[place[f"mx[{first}]"]], change[place[f"Izz[{first}]"]] = -a, -(a**2)
    rest = change - found.null_space @ np.linalg.lstsq(found.null_space, change, rcond=None)[0]
    assert np.abs(rest).max() < 1e-12


@settings(max_examples=15)
@given(st.integers(0, 10_000), st.integers(2, 6), st.sampled_from(FRICTIONS))
def test_random_trees(random_tree: Callable[..., Robot], seed: int, links: int, friction: tuple[str, ...]) -> None:
    check(random_tree(seed, links), friction)


def test_locked_joints() -> None:
    robot = read_robot("generic-6r")
    check(robot.locked({"shoulder_pitch": 0.3}), ("rotor_inertia",))
    check(robot.locked({"base_yaw": 0.0, "wrist_2": -1.1}), FRICTIONS[2])


@pytest.mark.parametrize("friction", FRICTIONS)
def test_coupled_motors(coupled_arm: Robot, friction: tuple[str, ...]) -> None:
    check(coupled_arm, friction)


def test_coupled_motors_of_two_branches(random_tree: Callable[..., Robot]) -> None:
    tree = random_tree(3, 3)
    joints = tuple(replace(joint, parent=-1) for joint in tree.joints)
    robot = replace(tree, joints=joints, coupling=None).with_drives({}, [[1, 0, 0], [0.4, 1, 0], [0.2, -0.3, 1]])
    check(robot, FRICTIONS[2])


def test_a_joint_that_follows_is_refused(mimic_arm: Robot) -> None:
    with pytest.raises(BadOption, match="the numeric one holds"):
        structure(DynamicModel(mimic_arm))
